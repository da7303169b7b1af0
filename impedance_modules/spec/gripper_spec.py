# SPDX-License-Identifier: BSD-3-Clause
"""What robot file and task say of grippers, as frozen data (m, N, m/s, s). Nothing here moves anything."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

OPEN, CLOSE, WIDTH = "open", "close", "width"
"""What a phase may order of a gripper."""

HELD, OPENED, CLOSED, REACHED = "held", "open", "closed", "reached"
"""What a phase may wait for: something between the fingers, or at rest with nothing between them: as wide as it can, as
narrow as it can, or as wide as was ordered."""

CONDITIONS = (HELD, OPENED, CLOSED, REACHED)


@dataclass(frozen=True)
class GripperSpec:
    """A gripper with two fingers that move towards each other.

    Attributes:
        kind: Which gripper it is; a real robot's software takes only its own.
        narrowest, widest: Distance between the fingers [m].
        force: Largest that may be asked for [N].
        speed: Largest, of that distance [m/s].
        time_out: Longest time from an order to its end [s].
    """

    kind: str
    narrowest: float
    widest: float
    force: float
    speed: float
    time_out: float


@dataclass(frozen=True)
class GripperOrder:
    """What a phase asks of one gripper when it begins.

    Attributes:
        what: ``open``, ``close`` or ``width``.
        width: Distance between the fingers, for ``width`` [m]; None for others.
        force: With which the fingers press once they close [N]; None for others.
        speed: Of the distance [m/s]; None for the gripper's largest.
    """

    what: str
    width: float | None = None
    force: float | None = None
    speed: float | None = None

    def motion(self, gripper: GripperSpec) -> GripperMotion:
        """Completes an order with what the gripper can."""
        goals = {OPEN: gripper.widest, CLOSE: gripper.narrowest}
        width = goals.get(self.what, gripper.widest if self.width is None else self.width)
        return GripperMotion(width, gripper.speed if self.speed is None else self.speed, self.force)


@dataclass(frozen=True)
class GripperMotion:
    """A motion of the fingers, complete.

    Attributes:
        width: Distance between them at the end, unless something is in the way [m].
        speed: Of that distance [m/s].
        force: With which they press on what is in the way, and hold it [N]; None for a motion that shall hold nothing.
    """

    width: float
    speed: float
    force: float | None

    def described(self) -> str:
        """Says it in a few words."""
        if self.force is not None:
            return f"close with {self.force:g} N at {self.speed:g} m/s"
        return f"move to {self.width:g} m at {self.speed:g} m/s"


@dataclass(frozen=True)
class GripperCondition:
    """Every named gripper reports what is asked for: limb -> one of ``CONDITIONS``."""

    states: Mapping[str, str]


def build_gripper(raw: Mapping[str, Any]) -> GripperSpec:
    """Makes the gripper of a limb of clean plain data."""
    narrowest, widest = (float(width) for width in raw["opening"])
    numbers = {name: float(raw[name]) for name in ("force", "speed", "time_out")}
    return GripperSpec(kind=raw["kind"], narrowest=narrowest, widest=widest, **numbers)


def build_gripper_order(raw: Any) -> GripperOrder:
    """Makes an order of clean plain data."""
    if raw == OPEN:
        return GripperOrder(OPEN)
    if CLOSE in raw:
        close = raw[CLOSE]
        return GripperOrder(CLOSE, force=float(close["force"]), speed=_number(close, "speed"))
    return GripperOrder(WIDTH, width=float(raw[WIDTH]), speed=_number(raw, "speed"))


def _number(raw: Mapping[str, Any], key: str) -> float | None:
    return float(raw[key]) if key in raw else None
