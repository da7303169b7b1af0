# SPDX-License-Identifier: BSD-3-Clause
"""One recording as arrays: what was commanded and measured, sample by sample. Absent stays absent."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from impedance_modules.episode.columns import JOINT_KINDS
from impedance_modules.errors import BadInput, nearest

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]
Texts = NDArray[np.object_]


class Interval(NamedTuple):
    """A stretch of consecutive samples of one phase: ``start`` included, ``stop`` not."""

    phase: str
    start: int
    stop: int


@dataclass(frozen=True, eq=False)
class Episode:
    """A recorded run of N samples; every array is read-only.

    Attributes:
        time: (N,) [s].
        position: Joint -> (N,) [rad].
        velocity: Joint -> (N,) [rad/s]; empty when not recorded, like every mapping below.
        effort_command: Joint -> (N,) [N.m], what the controller asked for, without what the robot adds by
            itself.
        effort: Joint -> (N,) [N.m], measured where ``effort_source`` says.
        position_command: Joint -> (N,) [rad].
        wrench: Frame -> (N, 6) force [N] then torque [N.m] at the frame's origin, world axes.
        pose: Frame -> (N, 7) position [m] and unit quaternion (x, y, z, w) in world.
        target: Frame -> (N, 7) equilibrium pose in world. NaN marks a component that was not recorded (also
            in ``wrench`` and ``pose``) or had no value.
        phase: (N,) text or None; None when not recorded.
        tank: (N,) energy [J], NaN where it had no value; None when not recorded.
        extra: Column -> (N,) of every other numeric column, e.g. per-module torques.
        labels: Column -> (N,) of every other text column.
        metadata: The checked JSON object of the file.
        source: File or directory it was read from.
    """

    time: Vector
    position: Mapping[str, Vector]
    velocity: Mapping[str, Vector]
    effort_command: Mapping[str, Vector]
    effort: Mapping[str, Vector]
    position_command: Mapping[str, Vector]
    wrench: Mapping[str, Matrix]
    pose: Mapping[str, Matrix]
    target: Mapping[str, Matrix]
    phase: Texts | None
    tank: Vector | None
    extra: Mapping[str, Vector]
    labels: Mapping[str, Texts]
    metadata: Mapping[str, Any]
    source: Path

    def __len__(self) -> int:
        """Returns the number of samples."""
        return len(self.time)

    @property
    def name(self) -> str:
        """Name of the recording."""
        return str(self.metadata["episode"])

    @property
    def robot(self) -> str:
        """Name of the robot."""
        return str(self.metadata["robot"])

    @property
    def effort_source(self) -> str | None:
        """``joint_sensor``, ``motor``, or None where no effort was measured."""
        return self.metadata.get("effort_source")

    @property
    def gravity_compensation(self) -> str:
        """What compensates the arms' weight: ``robot``, ``command`` or ``none``."""
        return str(self.metadata["gravity_compensation"])

    @property
    def repeat_of(self) -> str | None:
        """Name of the episode that this one repeats, or None."""
        return self.metadata.get("repeat_of")

    @property
    def complete(self) -> bool:
        """False for what a killed run left; a log of another program counts as complete."""
        return bool(self.metadata.get("complete", True))

    @property
    def joints(self) -> tuple[str, ...]:
        """Joints with a position, in file order."""
        return tuple(self.position)

    def matrix(self, kind: str, joints: Sequence[str] | None = None) -> Matrix:
        """Returns one joint quantity as (N, joints).

        Args:
            kind: ``position``, ``velocity``, ``effort_command``, ``effort`` or ``position_command``.
            joints: Order of the columns; None takes the file's.

        Raises:
            BadInput: The quantity, or a joint of it, was not recorded.
        """
        if kind not in JOINT_KINDS:
            raise BadInput(f"{self.source}: '{kind}' is no joint quantity (valid: {', '.join(JOINT_KINDS)})")
        found: Mapping[str, Vector] = getattr(self, kind)
        wanted = tuple(found) if joints is None else tuple(joints)
        missing = [joint for joint in wanted if joint not in found]
        if missing or not wanted:
            absent = missing[0] if missing else "<joint>"
            near = nearest(absent, tuple(found))
            recorded = ", ".join(found) or "none"
            raise BadInput(f"{self.source}: no column '{kind}.{absent}'{near} (recorded: {recorded})")
        return np.column_stack([found[joint] for joint in wanted])

    def part(self, rows: slice | NDArray[np.bool_]) -> Episode:
        """Gives some of the samples, of every quantity."""

        def cut(quantity: Mapping[str, Any]) -> Mapping[str, Any]:
            return MappingProxyType({name: values[rows] for name, values in quantity.items()})

        mappings: dict[str, Any] = {
            name: cut(getattr(self, name))
            for name in (*JOINT_KINDS, "wrench", "pose", "target", "extra", "labels")
        }
        return replace(
            self,
            time=self.time[rows],
            phase=None if self.phase is None else self.phase[rows],
            tank=None if self.tank is None else self.tank[rows],
            **mappings,
        )

    def phase_intervals(self) -> tuple[Interval, ...]:
        """Returns the stretches of each phase in order; empty when phases were not recorded."""
        if self.phase is None:
            return ()
        changes = np.flatnonzero(self.phase[1:] != self.phase[:-1]) + 1
        edges = [0, *changes.tolist(), len(self)]
        return tuple(
            Interval(self.phase[start], start, stop)
            for start, stop in itertools.pairwise(edges)
            if self.phase[start] is not None
        )
