# SPDX-License-Identifier: BSD-3-Clause
"""What a task file says of springs between two frames of two arms, as frozen data. Nothing here computes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from impedance_modules.spec.build_task import build_matrix
from impedance_modules.spec.task import Matrix

BETWEEN = "between"
"""Key of these springs in a task file, and before their names in recordings."""


@dataclass(frozen=True)
class FrameOfArm:
    """A frame that an arm moves, in a task file ``ARM.FRAME``."""

    limb: str
    frame: str


@dataclass(frozen=True)
class BetweenSpec:
    """A virtual spring between a frame of one arm and a frame of another.

    Attributes:
        name: Unique in the task; phases move its rest by this name.
        first, second: The two frames. Coordinates are those of the first as seen from the second.
        expressed_in: None for world, or a frame: its axes at the start posture are the spring's axes there. From then
            on they turn with the two frames, half with each.
        stiffness: (6, 6) symmetric positive semidefinite, in those axes.
        damping: (6, 6) explicit damping of the relative motion [N.s/m, N.m.s/rad]; None adds none.
        damping_ratio: Damping from the inertia of both arms, zeta; None adds none.
        rest: Axis -> coordinate at which the spring is relaxed at the start [m], [rad]; an omitted one is that of the
            start posture.
    """

    name: str
    first: FrameOfArm
    second: FrameOfArm
    expressed_in: FrameOfArm | None
    stiffness: Matrix
    damping: Matrix | None
    damping_ratio: float | None
    rest: Mapping[str, float]


def frame_of_arm(word: str) -> FrameOfArm:
    """Reads ``ARM.FRAME``."""
    limb, _, frame = word.partition(".")
    return FrameOfArm(limb, frame)


def build_between(raw: Mapping[str, Any]) -> BetweenSpec:
    """Makes one spring of clean plain data."""
    first, second = (frame_of_arm(word) for word in raw["frames"])
    axes = raw["expressed_in"]
    return BetweenSpec(
        name=raw["name"],
        first=first,
        second=second,
        expressed_in=None if axes == "world" else frame_of_arm(axes),
        stiffness=build_matrix(raw["stiffness"]),
        damping=build_matrix(raw["damping"]) if "damping" in raw else None,
        damping_ratio=float(raw["damping_ratio"]) if "damping_ratio" in raw else None,
        rest={axis: float(value) for axis, value in raw.get("rest", {}).items()},
    )
