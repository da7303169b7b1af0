# SPDX-License-Identifier: BSD-3-Clause
"""Where a probe begins: where the recordings were made if that is safe, else a posture with room and little weight."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from impedance_modules.diagnosis.experiment_design.clearance import Clearance
from impedance_modules.diagnosis.experiment_design.motion_limits import Room
from impedance_modules.errors import BadInput

Array = NDArray[np.float64]

DRAWN, TRIES = 4000, 200
"""Postures that are drawn, from a fixed seed; of these so many with least weight have their distances measured."""

MIDDLE = 0.3
"""Part of a joint's range on either side of its middle in which they lie."""

FREE = 0.15
"""Room that a recorded start needs to either end of a joint's range [rad]."""


WEIGHT_SHARE = 0.7
"""Part of the torque that a probe may use, that the weight takes at the start: the rest is for moving."""

Weight = Callable[[Array], Array]
"""Postures (N, n) [rad] -> what the links' weight asks of the joints, (N, n) [N.m]."""


def choose_start(
    room: Room, recorded: Mapping[str, float], clearance: Clearance | None, weight: Weight
) -> Array:
    """Chooses the posture at which a probe begins and ends, (n,) [rad].

    Args:
        room: Limits.
        recorded: Joint -> angle about which was recorded.
        clearance: Of the links; None where they are not known.
        weight: Of the links.

    Raises:
        BadInput: Links are too near each other in every posture that was looked at.
    """
    middle, span = 0.5 * (room.lower + room.upper), room.upper - room.lower
    known = np.array([recorded.get(name, middle[i]) for i, name in enumerate(room.joints)])
    free = np.minimum(FREE, 0.4 * span)
    known = np.clip(known, room.lower + free, room.upper - free)
    random = np.random.default_rng(0)
    drawn = middle + MIDDLE * span * random.uniform(-1.0, 1.0, (DRAWN, len(span)))
    postures = np.clip(np.vstack([known, drawn]), room.lower + free, room.upper - free)
    load = np.max(np.abs(weight(postures)) / room.effort, axis=1)
    lightest = np.append(0, 1 + np.argsort(load[1:])[:TRIES])
    postures, load = postures[lightest], load[lightest]
    if clearance is None:
        return np.asarray(np.round(postures[0 if load[0] <= WEIGHT_SHARE else int(np.argmin(load))], 3))
    distance = np.array([clearance.nearest(posture[None])[0] for posture in postures])
    free_enough = distance >= clearance.needed
    if not free_enough.any():
        raise BadInput(
            f"in {TRIES} postures links come within {clearance.needed:g} m of each other"
            " (valid: a diagnosis recorded in a posture with more room)"
        )
    light = free_enough & (load <= WEIGHT_SHARE)
    if light[0]:
        return np.asarray(np.round(known, 3))
    best = (
        np.argmax(np.where(light, distance, -np.inf))
        if light.any()
        else np.argmin(np.where(free_enough, load, np.inf))
    )
    return np.asarray(np.round(postures[int(best)], 3))
