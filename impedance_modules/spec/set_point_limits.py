# SPDX-License-Identifier: BSD-3-Clause
"""What a task file allows of set-points that arrive while it runs, as frozen data. Nothing here computes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class TargetLimits:
    """Limits of one target whose equilibrium follows set-points.

    Attributes:
        speed: Largest speed of the equilibrium [m/s].
        turn_speed: Largest angular velocity of the equilibrium [rad/s].
        step: Largest distance of a set-point from the equilibrium in force; a farther one is refused [m].
        turn: Largest angle between the two; a set-point beyond is refused [rad].
    """

    speed: float
    turn_speed: float
    step: float
    turn: float


@dataclass(frozen=True)
class SetPointLimits:
    """What set-points may do in the phases that listen to them.

    Attributes:
        age: A set-point older than this counts no more: the equilibrium comes to rest [s].
        lag: Time constant with which the equilibrium follows; it reaches its largest speed in as much time [s].
        targets: Target (``object`` or ``<arm>.<spring>``) -> its limits.
    """

    age: float
    lag: float
    targets: Mapping[str, TargetLimits]


def build_set_point_limits(raw: Mapping[str, Any]) -> SetPointLimits:
    """Makes the limits of clean plain data [s], [m], [rad]."""
    targets = {
        name: TargetLimits(**{key: float(given[key]) for key in ("speed", "turn_speed", "step", "turn")})
        for name, given in raw["targets"].items()
    }
    return SetPointLimits(age=float(raw["age"]), lag=float(raw["lag"]), targets=targets)
