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

from impedance_modules.arrays import Array
from impedance_modules.compiled import compiled
from impedance_modules.records import Record, Vector


class MotorVelocity(Record):
    """The estimate and what it needs from the last sample.

    Attributes:
        compliance: (n,) 1 / K_sea [rad/(N.m)]; 0 for a rigid joint.
        period: Between samples [s].
        share: 1 - exp(-period / T_f), T_f the time constant of the robot's own velocity estimate.
        deflection: (n,) of the joints' springs at the last sample, effort / K_sea [rad].
        rate: (n,) its filtered rate [rad/s].
        velocity: (n,) of the motors [rad/s].
    """

    compliance: Vector
    period: float
    share: float
    deflection: Vector
    rate: Vector
    velocity: Vector


@compiled
def estimate_motor_velocity(motor: MotorVelocity, velocity: Array, effort: Array) -> None:
    r"""Takes one sample, a period after the last: \theta' = q' + u, u the filtered rate of the springs' deflection.

    u <- u + (1 - exp(-T / T_f)) ((d_k - d_{k-1}) / T - u),    d = effort / K_sea

    The robot's velocity estimate lags; the deflection's rate is filtered with the same time constant so that both
    halves describe the same moment.

    Args:
        motor: Its ``velocity`` is overwritten.
        velocity: (n,) of the links, as reported [rad/s].
        effort: (n,) measured torque between gearbox and link [N.m].
    """
    for j in range(velocity.size):
        now = effort[j] * motor.compliance[j]
        motor.rate[j] += motor.share * ((now - motor.deflection[j]) / motor.period - motor.rate[j])
        motor.deflection[j] = now
        motor.velocity[j] = velocity[j] + motor.rate[j]


def motor_velocity(compliance: Array, period: float, lag: float) -> MotorVelocity:
    """Prepares the estimate; the first sample can only give the links' velocity.

    Args:
        compliance: (n,) [rad/(N.m)].
        period: Between samples [s].
        lag: T_f of the robot's velocity estimate [s]; 0 for none.
    """
    n = compliance.size
    return MotorVelocity(
        compliance=compliance.copy(),
        period=period,
        share=1.0 - math.exp(-period / lag) if lag > 0.0 else 1.0,
        deflection=np.zeros(n),
        rate=np.zeros(n),
        velocity=np.zeros(n),
    )


def begin_at(motor: MotorVelocity, velocity: Array, effort: Array) -> None:
    """Starts from a state (n,), (n,) whose springs are taken as steady."""
    motor.deflection[:] = effort * motor.compliance
    motor.rate[:] = 0.0
    motor.velocity[:] = velocity
