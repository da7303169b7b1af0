# SPDX-License-Identifier: BSD-3-Clause
"""Where a probe begins: where the recordings were made if that is safe, else the posture with most room."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from impedance_modules.diagnosis.probe.clearance import Clearance
from impedance_modules.diagnosis.probe.room import Room
from impedance_modules.errors import BadInput

Array = NDArray[np.float64]

TRIES = 200
"""Postures that are looked at, from a fixed seed."""

MIDDLE = 0.3
"""Part of a joint's range on either side of its middle in which they lie."""

FREE = 0.15
"""Room that a recorded start needs to either end of a joint's range [rad]."""


def choose_start(room: Room, recorded: Mapping[str, float], clearance: Clearance | None) -> Array:
    """Chooses the posture at which a probe begins and ends, (n,) [rad].

    Raises:
        BadInput: Links are too near each other in every posture that was looked at.
    """
    middle, span = 0.5 * (room.lower + room.upper), room.upper - room.lower
    known = np.array([recorded.get(name, middle[i]) for i, name in enumerate(room.joints)])
    free = np.minimum(FREE, 0.4 * span)
    known = np.clip(known, room.lower + free, room.upper - free)
    if clearance is None:
        return np.asarray(np.round(known, 3))
    if clearance.nearest(known[None])[0] >= clearance.needed:
        return np.asarray(np.round(known, 3))
    random = np.random.default_rng(0)
    best, distance = known, 0.0
    for _ in range(TRIES):
        posture = middle + MIDDLE * span * random.uniform(-1.0, 1.0, len(span))
        found, _ = clearance.nearest(posture[None])
        if found > distance:
            best, distance = posture, found
    if distance < clearance.needed:
        raise BadInput(
            f"in {TRIES} postures links come within {clearance.needed:g} m of each other"
            " (valid: a diagnosis recorded in a posture with more room)"
        )
    return np.asarray(np.round(best, 3))
