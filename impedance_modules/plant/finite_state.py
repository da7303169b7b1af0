# SPDX-License-Identifier: BSD-3-Clause
"""Finds and names the first number of the plant's state that is infinite or NaN, and what moved fastest before."""

from __future__ import annotations

import numpy as np

from impedance_modules.errors import PlantNotFinite
from impedance_modules.plant.plant_state import StateVector
from impedance_modules.records import Vector

JOINT_QUANTITIES = {
    "velocity": "link velocity",
    "motor_velocity": "motor velocity",
    "position": "link position",
    "motor_position": "motor position",
}
OBJECT_QUANTITIES = {
    "object_velocity": "object's velocity",
    "object_momentum": "object's angular momentum",
    "object_position": "object's position",
    "object_rotation": "object's rotation",
}


def refuse_non_finite(now: StateVector, before: StateVector, time: float, names: tuple[str, ...]) -> None:
    """Refuses a state with a number that is not finite.

    Args:
        now: The state.
        before: The state one loop of the robot earlier.
        time: Of the state [s].
        names: Of the joints.

    Raises:
        PlantNotFinite: Says which quantity, of which joint or of the object, when, and what moved fastest before.
    """
    found = [
        *(_first(getattr(now, part), text, names) for part, text in JOINT_QUANTITIES.items()),
        *(_first(getattr(now, part), text, None) for part, text in OBJECT_QUANTITIES.items()),
        *_works(now),
    ]
    broken = [text for text in found if text]
    if broken:
        count = int(np.count_nonzero(~np.isfinite(now.whole)))
        raise PlantNotFinite(
            f"the simulated {broken[0]} is not finite at {time:.4f} s ({count} of {now.whole.size} numbers of"
            f" the state); before it, {_fastest(before, names)}"
        )


def _first(values: Vector, quantity: str, names: tuple[str, ...] | None) -> str:
    """Says which of some values is the first that is not finite; nothing if all are."""
    broken = np.flatnonzero(~np.isfinite(values))
    if broken.size == 0:
        return ""
    return quantity if names is None else f"{quantity} of {names[int(broken[0])]}"


def _works(now: StateVector) -> list[str]:
    """Names the work counters that are not finite."""
    counters = now.work[0]
    return [name.replace("_", " ") for name in counters.dtype.names if not np.isfinite(counters[name])]


def _fastest(before: StateVector, names: tuple[str, ...]) -> str:
    """Says which joint moved fastest, and how fast the object."""
    speeds = np.abs(before.velocity)
    joint = int(np.argmax(speeds))
    text = f"{names[joint]} moved at {speeds[joint]:.3g} rad/s"
    moving = float(np.linalg.norm(before.object_velocity))
    return f"{text}, the object at {moving:.3g} m/s" if moving > 0.0 else text
