# SPDX-License-Identifier: BSD-3-Clause
r"""Somebody pushes an arm: the torque it feels, and when the robot takes it for a collision (``plant.collision``).

    tau = J^T (F, 0)

The robot judges from its torque sensors; the double knows who pushes it and judges from that, so that no quick
motion of its own is taken for a collision. Pushes are the only collisions it knows.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impedance_modules.backends.baxter.fake.numbers import (
    IMPACT_SCALERS,
    IMPACT_THRESHOLD,
    IMPACT_TIME,
    SQUISH_THRESHOLDS,
    SQUISH_TIME,
    TICK,
)
from impedance_modules.plant.joint_servos import CollisionDetector, CollisionLimits

Array = NDArray[np.float64]


@dataclass
class Push:
    """A force on a hand (3,) [N], base axes, until a time [s]."""

    force: Array
    end: float


def contact_sense(short_names: Sequence[str]) -> CollisionDetector:
    """Watches one limb for impacts and squeezes, with the robot's own thresholds."""
    infinite = math.inf
    limits = CollisionLimits(
        impact=np.array([IMPACT_THRESHOLD * IMPACT_SCALERS.get(s, infinite) for s in short_names]),
        squish=np.array([SQUISH_THRESHOLDS.get(s, infinite) for s in short_names]),
        impact_time=IMPACT_TIME,
        squish_time=SQUISH_TIME,
        tick=TICK,
    )
    return CollisionDetector(limits)
