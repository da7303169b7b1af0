# SPDX-License-Identifier: BSD-3-Clause
"""A run in numbers: peaks, sums and the filter's reductions, gathered cycle by cycle, written to ``summary.json``.

Recorded rows are summed a block at a time: a cycle has no time for a dozen small sums; a block of a hundred cycles has,
as they cost the same once.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from impedance_modules.arrays import Array, Indices
from impedance_modules.control.assembly import Assembly
from impedance_modules.control.supervisor import Supervisor
from impedance_modules.episode.columns import (
    HINGE_COLUMNS,
    joint_columns,
    pose_columns,
    target_columns,
    wrench_columns,
)
from impedance_modules.episode.run_folder import write_summary
from impedance_modules.safety.attribute import attribute

ATTRIBUTED = 5
"""One in so many of the cycles that the filter changed is attributed to rows and modules."""
BLOCK = 128
"""Rows that are gathered before they are summed."""


class Summary:
    """Gathers a run: peaks and sums from its recorded rows, the filter's reductions from the controller."""

    def __init__(
        self, assembly: Assembly, supervisor: Supervisor, columns: Sequence[str], backend: str, seed: int
    ) -> None:
        """Args are the run's, with the columns of its rows (``record.Recorder``)."""
        self._assembly, self._supervisor = assembly, supervisor
        self._backend, self._seed = backend, seed
        self._tally = Tally(assembly, columns)
        self._changed = self._attributed = 0
        self._at_end: list[dict[str, Any]] = []
        self._reduced: dict[tuple[str, str], float] = defaultdict(float)

    def add(self, row: Array) -> None:
        """Takes one cycle's recorded row."""
        self._tally.add(row)
        if len(self._supervisor.sequence.ended) > len(self._at_end):
            self._at_end.append(self._tally.errors(row))
        if self._supervisor.controller.changed:
            if self._changed % ATTRIBUTED == 0:
                self._attribute()
            self._changed += 1

    def _attribute(self) -> None:
        controller = self._supervisor.controller
        if controller.solution is None:
            return
        self._attributed += 1
        found = attribute(
            controller.cycle.problem,
            controller.layout,
            controller.solution,
            controller.module_names,
            controller.cycle.modules.efforts,
        )
        for reduction in found:
            self._reduced[reduction.row, reduction.module or "motion"] += reduction.amount

    def _reductions(self) -> list[dict[str, Any]]:
        """Mean torque that each row took from each module while the filter was at work, largest first."""
        ranked = sorted(self._reduced.items(), key=lambda item: -item[1])
        return [
            {"row": row, "module": module, "mean": amount / self._attributed, "unit": "N.m"}
            for (row, module), amount in ranked[:20]
        ]

    def _tank(self) -> dict[str, Any]:
        tank, tally = self._supervisor.controller.tank, self._tally
        return {
            "initial": self._assembly.tank.initial,
            "lowest": tally.lowest,
            "final": tank.level,
            "floor": self._assembly.tank.floor,
            "max": self._assembly.tank.max,
            "spilled": tank.spilled,
            "charged_for_sensing": tank.charged,
            "work": tank.work,
            "work_bound": tank.work_bound,
            "softest_springs": tally.softest,
            "cycles_slowed": tally.slowed,
            "unit": "J",
        }

    def _hand_numbers(self) -> dict[str, Any]:
        return {
            hand.frame: {
                "tracking_rms": hand.error_rms,
                "tracking_peak": hand.error_peak,
                "start_force": hand.force_start,
                "peak_force": hand.force_peak,
                "units": "m, m, N, N",
            }
            for hand in self._tally.hands
        }

    def write(self, directory: Path, *, interrupted: bool) -> dict[str, Any]:
        """Writes the summary and returns it."""
        supervisor, assembly, tally = self._supervisor, self._assembly, self._tally
        tally.finish()
        names = assembly.model.joint_names
        limits = assembly.limits.effort_max
        summary: dict[str, Any] = {
            "format": 1,
            "task": assembly.task.name,
            "robot": assembly.robot.name,
            "backend": self._backend,
            "seed": self._seed,
            "rate": assembly.rate,
            "scale": assembly.scale,
            "allow_unstable": assembly.allow_unstable,
            "ending": "recording ended" if supervisor.ending is None else supervisor.ending.value,
            "reason": supervisor.reason,
            "interrupted": interrupted,
            "duration": tally.duration,
            "cycles": tally.cycles,
            "late_cycles": tally.late,
            "phases": [
                {"name": name, "seconds": seconds, "ended_by": why, "hands": errors}
                for (name, seconds, why), errors in zip(supervisor.sequence.ended, self._at_end, strict=False)
            ],
            "ended_in": {"phase": supervisor.sequence.phase.name, "hands": tally.errors(tally.last)},
            "tank": self._tank(),
            "torque_peak_over_limit": dict(zip(names, (tally.effort_peak / limits).tolist(), strict=True)),
            "hands": self._hand_numbers(),
            "filter": {"cycles_changed": self._changed, "reductions": self._reductions()},
            "messages": [{"time": time, "text": text} for time, text in supervisor.messages],
        }
        if tally.hinge is not None:
            summary["hinge"] = tally.hinge.numbers()
        write_summary(directory, summary)
        return summary


class HandTally:
    """One hand: how far from its target it was, and how hard the surroundings pushed.

    Attributes:
        frame: Of the hand.
        error_peak: Largest distance to the target [m]; 0 for a hand without a spring.
        force_start, force_peak: Estimated force, at first and at most [N]; the estimate before any contact is
            mostly what the model does not know of the robot.
    """

    def __init__(self, frame: str, columns: Sequence[str]) -> None:
        self.frame = frame
        self.error_peak = self.force_start = self.force_peak = 0.0
        self._squares, self._rows = 0.0, 0
        self._place = _places(columns, pose_columns(frame)[:3])
        self._force = _places(columns, wrench_columns(frame)[:3])
        target = target_columns(frame)
        self._target = _places(columns, target[:3]) if target[0] in columns else None
        self._turn = _places(columns, pose_columns(frame)[3:])
        self._target_turn = _places(columns, target[3:]) if target[0] in columns else None

    @property
    def error_rms(self) -> float:
        """Root of the mean squared distance to the target [m]."""
        return math.sqrt(self._squares / max(1, self._rows))

    def error(self, row: Array) -> dict[str, Any] | None:
        """Gives distance [m] and angle [rad] of one row from its target; None for a hand without a spring.

        Of two unit quaternions a, b the angle is 2 atan2(|vector part of a b*|, |a . b|).
        """
        if self._target is None or self._target_turn is None:
            return None
        distance = float(np.linalg.norm(row[self._place] - row[self._target]))
        turn = _turned_back(row[self._turn], row[self._target_turn])
        angle = 2.0 * math.atan2(float(np.linalg.norm(turn[:3])), abs(float(turn[3])))
        return {"position_error": distance, "orientation_error": angle, "units": "m, rad"}

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


class HingeTally:
    """The hinge of the held object, as measured: how far it turned, and the torque of the hands about its axis."""

    def __init__(self, columns: Sequence[str]) -> None:
        self._angle, self._torque = _places(columns, HINGE_COLUMNS)
        self._lowest, self._highest = math.inf, -math.inf
        self._last = self._largest = 0.0

    def add(self, rows: Array) -> None:
        """Takes a block of rows (k, columns); a block's mean torque counts, for single ones are mostly noise."""
        angles = rows[:, self._angle]
        self._lowest = min(self._lowest, float(angles.min()))
        self._highest = max(self._highest, float(angles.max()))
        self._last = float(angles[-1])
        mean = float(rows[:, self._torque].mean())
        if len(rows) == BLOCK:
            self._largest = max(self._largest, abs(mean))

    def numbers(self) -> dict[str, Any]:
        """Lowest, highest and last angle [rad], and the largest mean torque of ``BLOCK`` cycles [N.m]."""
        return {
            "lowest_angle": self._lowest,
            "highest_angle": self._highest,
            "final_angle": self._last,
            "peak_torque": self._largest,
            "units": "rad, rad, rad, N.m",
        }


class Tally:
    """Peaks and sums of a run's rows; complete after ``finish``.

    Attributes:
        cycles: Rows taken.
        late: Rows whose last torque missed its deadline.
        slowed: Rows in which the tank cut motion or torque.
        lowest: Least energy in the tank [J].
        softest: Smallest part of the springs in force.
        effort_peak: (n,) largest magnitude of every joint's torque that left [N.m].
        hands: In the order of the task's arms.
        hinge: Of the held object; None without one.
        last: (columns without the phase,) the newest row that was taken into account.
    """

    def __init__(self, assembly: Assembly, columns: Sequence[str]) -> None:
        self.last: Array = np.zeros(len(columns) - 1)
        self.cycles = self.late = self.slowed = 0
        self.lowest, self.softest = assembly.tank.initial, 1.0
        self.effort_peak: Array = np.zeros(assembly.model.n)
        self.hands = tuple(HandTally(arm.limb.hand, columns) for arm in assembly.modules.arms)
        self.hinge = HingeTally(columns) if HINGE_COLUMNS[0] in columns else None
        self._first = self._last = 0.0
        self._effort = _places(columns, joint_columns("effort_command", assembly.model.joint_names))
        names = ("tank", "spring_scale", "granted", "paid", "late")
        self._tank, self._scale, self._granted, self._paid, self._late = _places(columns, names)
        # The phase is text and no part of a row.
        self._rows = np.zeros((BLOCK, len(columns) - 1))
        self._filled = 0

    def errors(self, row: Array) -> dict[str, Any]:
        """Gives how far each hand with a spring is from its target in one row, by its frame."""
        found = {hand.frame: hand.error(row) for hand in self.hands}
        return {frame: error for frame, error in found.items() if error is not None}

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
        self.last[:] = rows[-1]
        self.cycles += len(rows)
        self.late += int(np.count_nonzero(rows[:, self._late]))
        self.slowed += int(np.count_nonzero((rows[:, self._granted] < 1.0) | (rows[:, self._paid] < 1.0)))
        self.lowest = min(self.lowest, float(rows[:, self._tank].min()))
        self.softest = min(self.softest, float(rows[:, self._scale].min()))
        np.maximum(self.effort_peak, np.abs(rows[:, self._effort]).max(axis=0), out=self.effort_peak)
        for hand in self.hands:
            hand.add(rows)
        if self.hinge is not None:
            self.hinge.add(rows)


def _places(columns: Sequence[str], names: Sequence[str]) -> Indices:
    return np.array([columns.index(name) for name in names], dtype=np.intp)


def _turned_back(a: Array, b: Array) -> Array:
    """Gives the quaternion a b* of two unit quaternions (x, y, z, w)."""
    vector = b[3] * a[:3] - a[3] * b[:3] - np.cross(a[:3], b[:3])
    return np.append(vector, a @ b)


def _lengths(vectors: Array) -> Array:
    return np.asarray(np.sqrt(np.einsum("ij,ij->i", vectors, vectors)))
