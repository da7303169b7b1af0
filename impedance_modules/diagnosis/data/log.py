# SPDX-License-Identifier: BSD-3-Clause
"""Admitted recordings on one even time base in one joint order, and the report about them."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from impedance_modules.arrays import Array
from impedance_modules.diagnosis.data.task_object import TaskObject
from impedance_modules.diagnosis.data.task_surfaces import TaskSurfaces
from impedance_modules.errors import ImpedanceError

Mask = NDArray[np.bool_]


class InsufficientData(ImpedanceError):  # noqa: N818 - as its siblings are called
    """Recordings that are too short, too slowly sampled or without motion, so that no cause can be found."""

    exit_code = 7


PATH_BEFORE = 30.0
"""Length of the path before a segment that is kept: bristles forget what is older [s]."""


@dataclass(frozen=True, eq=False)
class Log:
    """One recording on an even time base, N samples of n joints; what was not measured is None.

    Attributes:
        name: Name of the recording.
        group: Recordings of one group repeat each other.
        rate: Samples per second [Hz].
        position: (N, n) [rad].
        velocity: (N, n) as reported [rad/s].
        computed_velocity: (n,) joints whose velocities are differences of the positions; None where none are.
        effort: (N, n) measured [N.m].
        command: (N, n) commanded torque [N.m].
        position_command: (N, n) [rad].
        effort_source: ``joint_sensor`` or ``motor``; None without ``effort``.
        gravity_compensation: ``robot``, ``command`` or ``none``.
        start: Time of its first sample since the recording began [s]; a segment of a recording begins later.
        in_contact: (N,) samples whose phase says that the robot is in contact; None without phases.
        rounding: (N, n) errors as the encoders' grids made them of these positions, simulated [rad]; zero where
            positions are not rounded.
        effort_steps: (n,) of the grids on which efforts were written [N.m]; zero where there is none.
        effort_dither: (n,) noise of the sensors over these steps; None where nobody looked for grids.
        surroundings: What the task says that the hands could touch; None where it says nothing.
        task_object: Object of the task, and who holds it; None where it has none.
        carrying: (N,) samples in which hands hold it for certain, and nothing is touched; None where there are none.
        gaps: (G, 2) times of the last sample before and of the first after one or several lost ones, since the
            recording began [s].
        path_before: (K, n) positions of a segment's recording up to its first sample [rad]; None where nothing was
            recorded before.
    """

    name: str
    group: str
    rate: float
    position: Array
    velocity: Array | None
    effort: Array | None
    command: Array | None
    position_command: Array | None
    effort_source: str | None
    gravity_compensation: str
    start: float = 0.0
    computed_velocity: Mask | None = None
    in_contact: Mask | None = None
    rounding: Array | None = None
    effort_steps: Array | None = None
    effort_dither: Array | None = None
    surroundings: TaskSurfaces | None = None
    task_object: TaskObject | None = None
    carrying: Mask | None = None
    gaps: Array = field(default_factory=lambda: np.zeros((0, 2)))
    path_before: Array | None = None

    @property
    def samples(self) -> int:
        """Number of samples."""
        return len(self.position)

    @property
    def duration(self) -> float:
        """Length in time [s]."""
        return self.samples / self.rate

    def part(self, first: int, stop: int, mark: str = "") -> Log:
        """Cuts samples ``first`` to ``stop`` out; ``mark`` is added to its name and its group's."""
        piece = slice(first, stop)

        def cut(values: Array | None) -> Array | None:
            return None if values is None else values[piece]

        return replace(
            self,
            name=self.name + mark,
            group=self.group + mark,
            position=self.position[piece],
            velocity=cut(self.velocity),
            effort=cut(self.effort),
            command=cut(self.command),
            position_command=cut(self.position_command),
            start=self.start + first / self.rate,
            in_contact=None if self.in_contact is None else self.in_contact[piece],
            rounding=cut(self.rounding),
            carrying=None if self.carrying is None else self.carrying[piece],
            path_before=self.position[max(0, first - round(PATH_BEFORE * self.rate)) : first]
            if first
            else None,
        )


@dataclass(frozen=True, eq=False)
class DataReport:
    """What admission found out about the recordings.

    Attributes:
        rates: Recording -> rate [Hz].
        jitter: Recording -> rms of the steps' deviation over the step [-].
        weak_joints: Joints that hardly move in any recording.
        repeats: Groups of recordings that repeat each other.
        torque: What the torque channels mean, in words.
        delay: Common lag of effort behind command [s]; None where it cannot be seen.
        warnings: Sentences for the reader.
    """

    rates: dict[str, float]
    jitter: dict[str, float]
    weak_joints: tuple[str, ...]
    repeats: tuple[tuple[str, ...], ...]
    torque: str
    delay: float | None
    warnings: tuple[str, ...]
