# SPDX-License-Identifier: BSD-3-Clause
"""Postures that a new robot gets by name, so that tasks which name no joint run on it at once.

The hands are where they are on every shipped robot, 0.6 m in front of the base and 0.1 m above it. An arm that does
not reach there gets a place before its own shoulder.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.robot.model import Limb, RobotModel
from impedance_modules.robot.pointing_posture import pointing_posture

FORWARD, UP = 0.6, 0.1
"""Of the hands, from the base [m]."""

BEFORE_SHOULDER, BELOW_SHOULDER = (0.5, 0.35), (0.2, 0.1)
"""Of a hand that does not reach there, as shares of its arm's reach: what is tried."""

FRONTS = ((1.0, 0.0), (0.0, -1.0), (0.0, 1.0), (-1.0, 0.0))
"""Directions in the plane xy that may be an arm's front, x first."""


@dataclass(frozen=True)
class NamedPosture:
    """One posture.

    Attributes:
        name: What tasks call it.
        source: Where it comes from, and what it is, in words.
        limbs: Limb -> angle by short joint name [rad].
    """

    name: str
    source: str
    limbs: Mapping[str, Mapping[str, float]]


def first_postures(model: RobotModel) -> tuple[NamedPosture, ...]:
    """Finds the postures ``palms-down`` and ``palms-inward`` as far as the arms have them."""
    return tuple(
        posture
        for posture in (
            _posture(model, "palms-down", 0.25, inward=False),
            _posture(model, "palms-inward", 0.1, inward=True),
        )
        if posture.limbs
    )


def _posture(model: RobotModel, name: str, aside: float, *, inward: bool) -> NamedPosture:
    limbs, places = dict[str, dict[str, float]](), list[str]()
    for limb in model.limbs.values():
        shoulder = _shoulder(model, limb)
        side = 1.0 if shoulder[1] > 1e-3 else -1.0
        direction = np.array([0.0, -side, 0.0]) if inward else np.array([0.0, 0.0, -1.0])
        found = _first(model, limb, _places(model, limb, shoulder, side * aside), direction)
        if found is not None:
            limbs[limb.name], words = found
            places.append(f"{limb.name} at {words}")
    pointing = "pointing at the plane between the arms" if inward else "pointing down"
    return NamedPosture(name, f"found by search, hands {pointing}: {'; '.join(places)}", limbs)


def _first(
    model: RobotModel, limb: Limb, places: list[Array], direction: Array
) -> tuple[dict[str, float], str] | None:
    """Gives the first place that has a posture, with the direction if any has."""
    for wanted in (direction, None):
        for place in places:
            q = pointing_posture(model, limb, place, wanted)
            if q is not None:
                angles = (round(float(angle), 4) for angle in q)
                words = f"{', '.join(f'{x:.2f}' for x in place)} m"
                words += " (pointing as it does)" if wanted is None else ""
                return dict(zip(limb.short_names, angles, strict=True)), words
    return None


def _places(model: RobotModel, limb: Limb, shoulder: Array, aside: float) -> list[Array]:
    reach = model.reach(limb.name)
    own = [
        shoulder + reach * np.array([share * x, share * y, -below])
        for x, y in FRONTS
        for share, below in zip(BEFORE_SHOULDER, BELOW_SHOULDER, strict=True)
    ]
    return [np.array([FORWARD, aside, UP]), *own]


def _shoulder(model: RobotModel, limb: Limb) -> Array:
    """Where the limb's first joint is, in world [m]."""
    return model.joint_place(limb.joint_names[0])
