# SPDX-License-Identifier: BSD-3-Clause
r"""The velocity that dampers act on: the motors', not the links'.

Behind an elastic joint the motor is at \theta = q + effort / K_sea. A damper on the link's velocity pushes
through the spring: the push arrives late, and above a modest gain it feeds the swinging of rotor against
link instead of draining it (non-collocated control, thesis 3.1.1). A damper on \theta' takes energy out at
the very port where torque is applied, D \theta'^2 >= 0, for every gain, delay and lag aside.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class MotorVelocity:
    r"""Estimates \theta' = q' + d(effort / K_sea)/dt from what the robot reports, sample by sample.

    The robot's velocity estimate lags; the rate of the wind-up is filtered with the same time constant so
    that both halves describe the same moment:

        u <- u + (1 - exp(-T / T_f)) ((wind_k - wind_k-1) / T - u),    wind = effort / K_sea

    Attributes:
        compliance: (n,) 1 / K_sea [rad/(N.m)]; 0 for a rigid joint.
    """

    def __init__(self, compliance: Array, period: float, lag: float) -> None:
        """Takes the joints' compliance (n,), the control period [s] and the velocity filter's T_f [s]."""
        self.compliance = compliance
        self._period = period
        self._share = 1.0 - math.exp(-period / lag) if lag > 0.0 else 1.0
        self._wind: Array | None = None
        self._rate: Array = np.zeros_like(compliance)

    def update(self, velocity: Array, effort: Array) -> Array:
        """Takes one sample, a period after the last: velocity (n,) [rad/s] and effort (n,) [N.m].

        Returns:
            (n,) velocity of the motors [rad/s]; the first sample can only give the links'.
        """
        wind = self.compliance * effort
        if self._wind is not None:
            difference = (wind - self._wind) / self._period
            self._rate = self._rate + self._share * (difference - self._rate)
        self._wind = wind
        return velocity + self._rate
