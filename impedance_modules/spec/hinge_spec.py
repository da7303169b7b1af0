# SPDX-License-Identifier: BSD-3-Clause
"""What a task file says of an object's hinge, as frozen data (SI units). Nothing here computes."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

HINGE = "hinge"
"""Name by which a phase's target refers to the object's hinge."""

ANGLE = "angle"
"""The only coordinate of that target [rad]."""


@dataclass(frozen=True)
class HingeSpec:
    """A bearing that lets an object only turn about one axis, fixed in the world: of a valve, a lever or a door.

    Attributes:
        point: Of the axis, in world; where the bearing holds the object [m].
        axis: Direction in world axes, of any length but 0; angles count about it by the right-hand rule.
        friction: Coulomb friction about it [N.m].
        damping: Viscous, about it [N.m.s/rad].
        stiffness: Of a return spring about it [N.m/rad]; 0 for none.
        rest: Angle at which that spring is relaxed [rad].
        angle: At the start posture [rad].
        lower, upper: Stops [rad]; infinite for none.
    """

    point: tuple[float, float, float]
    axis: tuple[float, float, float]
    friction: float = 0.0
    damping: float = 0.0
    stiffness: float = 0.0
    rest: float = 0.0
    angle: float = 0.0
    lower: float = -math.inf
    upper: float = math.inf


def build_hinge(raw: Mapping[str, Any]) -> HingeSpec:
    """Makes a hinge of clean plain data [m], [rad], [N.m]; every rule for a key left out stands in the schema."""
    point, axis = (tuple(float(value) for value in raw[name]) for name in ("point", "axis"))
    numbers = ("friction", "damping", "stiffness", "rest", ANGLE)
    return HingeSpec(
        point=(point[0], point[1], point[2]),
        axis=(axis[0], axis[1], axis[2]),
        **{name: float(raw.get(name, 0.0)) for name in numbers},
        lower=float(raw.get("lower", -math.inf)),
        upper=float(raw.get("upper", math.inf)),
    )
