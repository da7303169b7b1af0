# SPDX-License-Identifier: BSD-3-Clause
"""Motion of joints at one side of their gears: what an effect's law is a function of.

The same law reads it twice: the plant hands over the joints of one instant, the diagnosis one joint over a
whole recording. All arrays have one shape, (k,) joints or (N,) samples.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Shape = Mapping[str, Array | float]
"""Values of the parameters that enter a law nonlinearly, by symbol; numbers or one per joint."""

SMOOTHING, SLIDING_SMOOTHING = 0.01, 0.001
"""Speed v_0 over which dry friction turns over, sgn(v) ~ tanh(v / v_0) [rad/s], and of a sliding joint [m/s].

The diagnosis always uses this one, the plant a larger one where a light link would demand a shorter step.
"""


@dataclass(frozen=True)
class Sample:
    """Motion and torques that a joint's law may depend on.

    Attributes:
        time: Since the start [s].
        position, velocity, acceleration: Of the side at which the effect acts [rad], [rad/s], [rad/s^2];
            the plant, which is still to find the acceleration, gives zeros.
        load: Torque between gear and link [N.m].
        turnover: Speed v_0 over which dry friction turns over.
        bristles: Bend in [-1, 1] of what rubs, where dry friction turns over a way and not a speed; or None.
    """

    time: Array
    position: Array
    velocity: Array
    acceleration: Array
    load: Array
    turnover: Array | float = SMOOTHING
    bristles: Array | None = None

    @property
    def direction(self) -> Array:
        """The regularised sign of the velocity, or the bend of the bristles."""
        if self.bristles is not None:
            return self.bristles
        return sign(self.velocity, self.turnover)


def smoothing(sliding: NDArray[np.bool_]) -> Array:
    """Gives each joint's v_0 (n,) from whether it slides."""
    return np.where(sliding, SLIDING_SMOOTHING, SMOOTHING)


def sign(velocity: Array, turnover: Array | float = SMOOTHING) -> Array:
    """Gives the regularised sign tanh(v / v_0)."""
    return np.asarray(np.tanh(velocity / turnover))
