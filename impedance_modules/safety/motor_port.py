# SPDX-License-Identifier: BSD-3-Clause
"""The port at which the controller's work is counted: the motor side of each joint.

A commanded torque acts on the rotor, so the energy that leaves the controller is torque times rotor
travel. Behind a series-elastic spring the link moves differently; counting ``tau . dq`` there can even give
the wrong sign (``tests/safety/test_ledger_counterexample.py``).
"""

from __future__ import annotations

import numpy as np

from impedance_modules.compiled import compiled
from impedance_modules.records import Vector
from impedance_modules.spec.robot_spec import JointSpec, SensorSpec

NOISE_DEVIATIONS = 4.0
"""Sensor noise is taken as bounded by this many standard deviations (exceeded by 6 samples in 100 000)."""


DITHER = 0.35
"""Noise of at least this part of a grid step makes the rounding error white: what is left of its mean is below
exp(-2 pi^2 0.35^2) / pi = 3 % of a step."""


def spring_compliances(joints: tuple[JointSpec, ...]) -> Vector:
    """How far the rotor turns ahead of the reported position per torque: the twist 1 / K_sea of a series spring.

    It is 0 for a rigid joint, and for one whose encoder sits at the motor: that one reports theta itself.

    Returns:
        (n,) [rad/N.m], in the order of ``joints``.
    """
    unseen = (None if j.encoder == "motor" else j.spring_stiffness for j in joints)
    return np.array([0.0 if stiffness is None else 1.0 / stiffness for stiffness in unseen])


@compiled
def motor_position(q: float, effort: float, compliance: float) -> float:
    """Where a rotor is, from the link's angle and the twist of the spring: ``theta = q + effort / K_sea``.

    ``effort`` must be the torque of the spring's deflection, K_sea (theta - q), without the spring's structural
    damping. Source: thesis eq. 3.3; design section 4, "Passivity".

    Args:
        q: Link angle [rad].
        effort: Torque between gearbox and link [N.m].
        compliance: 1 / K_sea [rad/N.m], 0 for a rigid joint.

    Returns:
        Rotor angle seen at the joint [rad].
    """
    return q + effort * compliance


@compiled
def absolute_dot(effort: Vector, weight: Vector) -> float:
    """The most that torques of these sizes can spend: ``sum_i |tau_i| weight_i`` [J], weight (n,) >= 0 [rad]."""
    total = 0.0
    for i in range(effort.size):
        total += abs(effort[i]) * weight[i]
    return total


def sensing_error(sensors: SensorSpec, compliance: Vector, speed_bound: Vector, latency: float) -> Vector:
    """How wrong a measured rotor angle can be: half a grid step, the noise, and the age of the sample.

    ``e = dq/2 + s sigma_q + (dtau/2 + s sigma_tau) / K_sea + v_max latency``, s = ``NOISE_DEVIATIONS``.

    Args:
        sensors: Grids and standard deviations.
        compliance: (n,) 1 / K_sea [rad/N.m].
        speed_bound: (n,) declared bound of the rotor speed [rad/s].
        latency: Age of a state sample when its cycle begins [s]; 0 if the delay lies in the command path.

    Returns:
        (n,) bound of |theta measured - theta| [rad].
    """
    position = sensors.position_resolution / 2 + NOISE_DEVIATIONS * sensors.position_noise
    effort = sensors.effort_resolution / 2 + NOISE_DEVIATIONS * sensors.effort_noise
    return position + effort * compliance + speed_bound * latency


def sensing_deviation(sensors: SensorSpec, compliance: Vector) -> Vector | None:
    """Standard deviation of a measured rotor angle's error, where the noise makes that error white.

    ``s^2 = dq^2/12 + sigma_q^2 + (dtau^2/12 + sigma_tau^2) / K_sea^2``.

    Args:
        sensors: Grids and standard deviations.
        compliance: (n,) 1 / K_sea [rad/N.m].

    Returns:
        (n,) s [rad]; None where a grid is coarser than its noise can dither: there only bounds hold.
    """
    grids = (
        (sensors.position_resolution, sensors.position_noise),
        (sensors.effort_resolution, sensors.effort_noise),
    )
    if any(noise < DITHER * grid or noise == 0.0 for grid, noise in grids):
        return None
    position, effort = (grid**2 / 12.0 + noise**2 for grid, noise in grids)
    return np.asarray(np.sqrt(position + effort * compliance**2))
