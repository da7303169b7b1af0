# SPDX-License-Identifier: BSD-3-Clause
"""What a task file says of obstacles that push frames of the arms away, as frozen data. Nothing here computes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from impedance_modules.spec.between_spec import FrameOfArm, frame_of_arm

OBSTACLES = "obstacles"
"""Key of the obstacles in a task file."""

LENGTHS = {"sphere": 1, "capsule": 2, "box": 3, "plane": 0}
"""Shape -> how many lengths its size has."""


@dataclass(frozen=True)
class ObstacleSpec:
    """A body at rest from which frames of the arms are pushed away before they touch it.

    Attributes:
        name: Unique in the task.
        shape: ``sphere``, ``capsule``, ``box`` or ``plane``.
        position: Of its centre in world, of a plane any point of it [m].
        rotation: Rotation vector of its axes [rad]; a capsule is along its z, a plane's z points out of it.
        size: Diameter of a sphere; diameter and straight length of a capsule; edges of a box; nothing of a plane [m].
        distance: From its surface, at which the push begins [m].
        stiffness: Of the push against coming nearer [N/m].
        damping: Against motion along the push, in full at the surface [N.s/m]; 0 for none.
        guards: Frames that are pushed.
    """

    name: str
    shape: str
    position: tuple[float, float, float]
    rotation: tuple[float, float, float]
    size: tuple[float, ...]
    distance: float
    stiffness: float
    damping: float
    guards: tuple[FrameOfArm, ...]

    @property
    def largest_force(self) -> float:
        """The push at the surface, and everywhere inside [N]."""
        return self.stiffness * self.distance


def build_obstacle(raw: Mapping[str, Any]) -> ObstacleSpec:
    """Makes one obstacle of clean plain data."""
    x, y, z = (float(value) for value in raw["position"])
    rx, ry, rz = (float(value) for value in raw.get("rotation", (0.0, 0.0, 0.0)))
    return ObstacleSpec(
        name=raw["name"],
        shape=raw["shape"],
        position=(x, y, z),
        rotation=(rx, ry, rz),
        size=tuple(float(length) for length in raw.get("size", ())),
        distance=float(raw["distance"]),
        stiffness=float(raw["stiffness"]),
        damping=float(raw.get("damping", 0.0)),
        guards=tuple(frame_of_arm(word) for word in raw["guards"]),
    )
