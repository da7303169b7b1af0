# SPDX-License-Identifier: BSD-3-Clause
"""Peaks, lows and sums over the recorded rows of a run, taken a block of rows at a time.

A cycle has no time for a dozen small sums; a block of a hundred cycles has, as they cost the same once.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from impedance_modules.control.assembly import Assembly
from impedance_modules.episode.columns import joint_columns, pose_columns, target_columns, wrench_columns

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

BLOCK = 128
"""Rows that are gathered before they are looked at."""


class HandTally:
    """One hand: how far from its target it was, and how hard the surroundings pushed.

    Attributes:
        frame: Of the hand.
        error_peak: Largest distance to the target [m]; 0 for a hand without a spring.
        force_start, force_peak: Estimated force, at first and at most [N]; what is felt before anything has happened is
            mostly what the model does not know of the robot.
    """

    def __init__(self, frame: str, columns: Sequence[str]) -> None:
        self.frame = frame
        self.error_peak = self.force_start = self.force_peak = 0.0
        self._squares, self._rows = 0.0, 0
        self._place = _places(columns, pose_columns(frame)[:3])
        self._force = _places(columns, wrench_columns(frame)[:3])
        target = target_columns(frame)[:3]
        self._target = _places(columns, target) if target[0] in columns else None

    @property
    def error_rms(self) -> float:
        """Root of the mean squared distance to the target [m]."""
        return math.sqrt(self._squares / max(1, self._rows))

    def add(self, rows: Array) -> None:
        """Takes a block of rows (k, columns)."""
        forces = _lengths(rows[:, self._force])
        if self._rows == 0:
            self.force_start = float(forces[0])
        self.force_peak = max(self.force_peak, float(forces.max()))
        self._rows += len(rows)
        if self._target is not None:
            error = _lengths(rows[:, self._place] - rows[:, self._target])
            self._squares += float(error @ error)
            self.error_peak = max(self.error_peak, float(error.max()))


class Tally:
    """What a run's rows come to; complete after ``finish``.

    Attributes:
        cycles: Rows taken.
        late: Rows whose last torque missed its deadline.
        slowed: Rows in which the tank cut motion or torque.
        lowest: Least energy in the tank [J].
        softest: Smallest part of the springs in force.
        effort_peak: (n,) largest magnitude of every joint's torque that left [N.m].
        hands: In the order of the task's arms.
    """

    def __init__(self, assembly: Assembly, columns: Sequence[str]) -> None:
        self.cycles = self.late = self.slowed = 0
        self.lowest, self.softest = assembly.tank.initial, 1.0
        self.effort_peak: Array = np.zeros(assembly.model.n)
        self.hands = tuple(HandTally(arm.limb.hand, columns) for arm in assembly.modules.arms)
        self._first = self._last = 0.0
        self._effort = _places(columns, joint_columns("effort_command", assembly.model.joint_names))
        names = ("tank", "spring_scale", "granted", "paid", "late")
        self._tank, self._scale, self._granted, self._paid, self._late = _places(columns, names)
        # The phase is text and no part of a row.
        self._rows = np.zeros((BLOCK, len(columns) - 1))
        self._filled = 0

    @property
    def duration(self) -> float:
        """From the first row to the last [s]."""
        return self._last - self._first

    def add(self, row: Array) -> None:
        """Takes one row."""
        self._rows[self._filled] = row
        self._filled += 1
        if self._filled == BLOCK:
            self.finish()

    def finish(self) -> None:
        """Takes what has been gathered into account."""
        rows, self._filled = self._rows[: self._filled], 0
        if not len(rows):
            return
        if self.cycles == 0:
            self._first = float(rows[0, 0])
        self._last = float(rows[-1, 0])
        self.cycles += len(rows)
        self.late += int(np.count_nonzero(rows[:, self._late]))
        self.slowed += int(np.count_nonzero((rows[:, self._granted] < 1.0) | (rows[:, self._paid] < 1.0)))
        self.lowest = min(self.lowest, float(rows[:, self._tank].min()))
        self.softest = min(self.softest, float(rows[:, self._scale].min()))
        np.maximum(self.effort_peak, np.abs(rows[:, self._effort]).max(axis=0), out=self.effort_peak)
        for hand in self.hands:
            hand.add(rows)


def _places(columns: Sequence[str], names: Sequence[str]) -> Indices:
    return np.array([columns.index(name) for name in names], dtype=np.intp)


def _lengths(vectors: Array) -> Array:
    return np.asarray(np.sqrt(np.einsum("ij,ij->i", vectors, vectors)))
