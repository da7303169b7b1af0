# SPDX-License-Identifier: BSD-3-Clause
r"""Somebody pushes an arm: the torque it feels, and whether the robot takes it for a collision.

    tau = J^T (F, 0)        impact: |tau - low pass of tau| > 0.85 scaler        squish: |tau| > threshold, for a while

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

Array = NDArray[np.float64]

NOTHING = 1e-6
"""A push that has faded below this is over [N.m]."""

FADE = 1.0 - math.exp(-TICK / IMPACT_TIME)


@dataclass
class Push:
    """A force on a hand (3,) [N], base axes, until a time [s]."""

    force: Array
    end: float


class ContactSense:
    """Watches one limb for impacts and squeezes."""

    def __init__(self, short_names: Sequence[str]) -> None:
        infinite = math.inf
        self._impact = np.array([IMPACT_THRESHOLD * IMPACT_SCALERS.get(s, infinite) for s in short_names])
        self._squish = np.array([SQUISH_THRESHOLDS.get(s, infinite) for s in short_names])
        self._slow = np.zeros(len(short_names))
        self._pressed = 0.0

    @property
    def calm(self) -> bool:
        """Says whether nobody has pushed lately."""
        return not self._slow.any() and self._pressed == 0.0

    def feel(self, torque: Array) -> str:
        """Takes the torque (k,) [N.m] of one tick; returns ``impact``, ``squish`` or nothing."""
        sudden = np.abs(torque - self._slow)
        self._slow = self._slow + FADE * (torque - self._slow)
        self._slow[np.abs(self._slow) < NOTHING] = 0.0
        pressed = bool((np.abs(torque) > self._squish).any())
        self._pressed = self._pressed + TICK if pressed else 0.0
        if (sudden > self._impact).any():
            return "impact"
        return "squish" if self._pressed >= SQUISH_TIME else ""
