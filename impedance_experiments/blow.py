# SPDX-License-Identifier: BSD-3-Clause
"""The blow of thesis fig. 3-3 on a series-elastic joint, with its spring and without."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from impedance_experiments.series_elastic_joint import SeriesElasticJoint

Array = NDArray[np.float64]

BLOW_FORCE, BLOW_TIME, BLOW_WIDTH = 56.52, 0.2, 0.01775
"""The thesis's fit of a measured blow (3.11): peak [N], time of the peak [s] (26.35 s in its log), width [s]."""
BLOW_END = 6.0
"""When the link has come to rest again [s]."""


@dataclass(frozen=True)
class Blow:
    """Answer to the blow: time (m,) [s], force [N]; link angle [rad] and velocity [rad/s], (2, m), of both models."""

    time: Array
    force: Array
    full: Array
    reduced: Array

    @property
    def departure(self) -> Array:
        """(2,) largest difference of the two angles, and velocities, over the largest of the reduced model."""
        worst = np.max(np.abs(self.full - self.reduced), axis=1)
        return np.asarray(worst / np.max(np.abs(self.reduced), axis=1))


def strike(joint: SeriesElasticJoint, lever: float) -> Blow:
    """Lets the thesis's blow act on the hand and integrates both models.

    Args:
        joint: At rest before the blow.
        lever: Of the hand about the joint's axis [m].
    """
    time = np.linspace(0.0, BLOW_END, 10_001)

    def force(t: Array | float) -> Array:
        return np.asarray(BLOW_FORCE * np.exp(-(((t - BLOW_TIME) / BLOW_WIDTH) ** 2)))

    inertia = joint.link_inertia + joint.reflected_inertia

    def rate(t: float, x: Array) -> Array:
        torque = lever * float(force(t))
        full = joint.system @ x[:4] + joint.inputs[:, 0] * torque
        return np.append(full, [x[5], (torque - joint.motor_damping * x[5]) / inertia])

    found = solve_ivp(rate, (0.0, time[-1]), np.zeros(6), t_eval=time, rtol=1e-8, atol=1e-11, max_step=5e-3)
    return Blow(time, force(time), found.y[[0, 2]], found.y[[4, 5]])
