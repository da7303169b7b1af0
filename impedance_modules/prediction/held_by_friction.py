# SPDX-License-Identifier: BSD-3-Clause
r"""Where dry friction holds a hand short of its rest on a surface.

The rest is without friction. A hand that slides towards it along t stops where everything else pulls with no more than
the friction of the surfaces that press with N_i, so where it rests under

    f = -\sum \mu_i N_i t,        t = (x_rest - x_end)_t / |(x_rest - x_end)_t|        (_t: along the surface)

or where the phase ends, if that is nearer: friction does not push it back. N_i is that of the place where it stops.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.prediction.contact_geometry import Contact
from impedance_modules.prediction.mechanism import Mechanism, Setting
from impedance_modules.prediction.statics import Loads, Rest, find_rest

ROUNDS = 20
"""Searches of the place where normal force and friction belong together."""

SETTLED = 1e-6
"""Change of the friction after which they do [N]."""


@dataclass(frozen=True)
class FrictionHold:
    """What friction does to a hand's rest.

    Attributes:
        force: Largest friction of the surfaces on the hand where it stops [N].
        position: (3,) where the hand stops in world, coming from the predicted end of its phase [m].
    """

    force: float
    position: Array


def held_by_friction(
    mechanism: Mechanism, setting: Setting, rest: Rest, end: Array, hand: str
) -> FrictionHold | None:
    """Finds where a hand stops on its way to rest; None where nothing rough presses it, or nothing is found.

    Args:
        mechanism: Of the task.
        setting: Springs and equilibria at rest.
        rest: Without friction.
        end: (n,) joints where the phase ends [rad].
        hand: Frame of the hand.
    """
    start, q = _place(mechanism, hand, end), rest.q
    way, friction = start - _place(mechanism, hand, rest.q), np.zeros(3)
    for _ in range(ROUNDS):
        pressing = _pressing(mechanism, hand, q)
        new = _friction(pressing, way)
        if not np.any(new):
            return None
        if np.linalg.norm(new - friction) < SETTLED:
            break
        friction = new
        moment = np.cross(pressing[0].arm, friction)
        found = find_rest(
            mechanism, setting, q, Loads({hand: np.concatenate([friction, moment])}, surfaces=True)
        )
        if found is None:
            return None
        q = found.q
    stops = _place(mechanism, hand, q)
    farther = np.linalg.norm(stops - start + way) > np.linalg.norm(way)
    return FrictionHold(float(np.linalg.norm(friction)), start if farther else stops)


def _place(mechanism: Mechanism, hand: str, q: Array) -> Array:
    mechanism.update(q, np.zeros_like(q))
    return mechanism.kinematics.pose(hand).translation.copy()


def _pressing(mechanism: Mechanism, hand: str, q: Array) -> list[Contact]:
    """Lists the surfaces that press a hand at q (n,) [rad]."""
    mechanism.update(q, np.zeros_like(q))
    number = [arm.limb.hand for arm in mechanism.modules.arms].index(hand)
    return [c for c, _ in mechanism.contacts(0.0) if c.key[0] == number and c.depth > 0.0]


def _friction(pressing: list[Contact], way: Array) -> Array:
    """Gives the largest friction (3,) [N] that keeps a hand from leaving ``way`` (3,) [m] behind; 0 without any."""
    found = np.zeros(3)
    for contact in pressing:
        along = way - contact.normal * float(contact.normal @ way)
        size = float(np.linalg.norm(along))
        if size > 0.0:
            press = contact.surface.stiffness * contact.depth
            found += contact.surface.fresh_friction * press * along / size
    return found
