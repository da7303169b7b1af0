# SPDX-License-Identifier: BSD-3-Clause
r"""Whether a robot takes what it feels for a collision: something sudden, or something that goes on pressing.

    impact: |tau - low pass of tau| > threshold        squish: |tau| > threshold, for a while

tau is the torque from outside on the joints of one limb. A robot judges it from its torque sensors and its model; here
the plant knows it, so that no quick motion of its own is taken for a collision.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

NOTHING = 1e-6
"""What has faded below this is over [N.m]."""


@dataclass(frozen=True)
class CollisionLimits:
    """When a limb has collided.

    Attributes:
        impact, squish: (k,) sudden and steady torque that count [N.m]; infinite where nothing is watched.
        impact_time: Time constant of the low pass behind the one [s].
        squish_time: Duration of the other [s].
        tick: Between two looks [s].
    """

    impact: Array
    squish: Array
    impact_time: float
    squish_time: float
    tick: float


class ContactSense:
    """Watches one limb for impacts and squeezes."""

    def __init__(self, limits: CollisionLimits) -> None:
        self._limits = limits
        self._fade = 1.0 - math.exp(-limits.tick / limits.impact_time)
        self._slow = np.zeros(limits.impact.size)
        self._pressed = 0.0

    @property
    def calm(self) -> bool:
        """Says whether nothing has pressed lately."""
        return not self._slow.any() and self._pressed == 0.0

    def feel(self, torque: Array) -> str:
        """Takes the torque (k,) [N.m] of one tick; returns ``impact``, ``squish`` or nothing."""
        sudden = np.abs(torque - self._slow)
        self._slow = self._slow + self._fade * (torque - self._slow)
        self._slow[np.abs(self._slow) < NOTHING] = 0.0
        pressed = bool((np.abs(torque) > self._limits.squish).any())
        self._pressed = self._pressed + self._limits.tick if pressed else 0.0
        if (sudden > self._limits.impact).any():
            return "impact"
        return "squish" if self._pressed >= self._limits.squish_time else ""
