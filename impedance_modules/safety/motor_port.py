# SPDX-License-Identifier: BSD-3-Clause
"""The port at which the controller's work is counted: the motor side of each joint.

A commanded torque acts on the rotor, so the energy that leaves the controller is torque times rotor
travel. Behind a series-elastic spring the link moves differently; counting ``tau . dq`` there can even give
the wrong sign (``tests/laws/test_ledger_counterexample.py``).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from impedance_modules.spec.robot_spec import JointSpec, SensorSpec

Vector = NDArray[np.float64]

NOISE_DEVIATIONS = 4.0
"""Sensor noise is taken as bounded by this many standard deviations (exceeded by 6 samples in 100 000)."""


def spring_compliances(joints: tuple[JointSpec, ...]) -> Vector:
    """How far each series-elastic spring twists per torque: 1 / K_sea, and 0 for a rigid joint.

    Returns:
        (n,) [rad/N.m], in the order of ``joints``.
    """
    return np.array([0.0 if j.spring_stiffness is None else 1.0 / j.spring_stiffness for j in joints])


def motor_positions(q: Vector, effort: Vector, compliance: Vector) -> Vector:
    """Where the rotors are, from the link angles and the twist of the springs.

    ``theta = q + effort / K_sea`` (thesis eq. 3.3; design 4 "Passivity"). ``effort`` must be the torque of
    the spring's deflection, K_sea (theta - q), without the spring's structural damping.

    Args:
        q: (n,) link angles [rad].
        effort: (n,) torque between gearbox and link [N.m].
        compliance: (n,) 1 / K_sea [rad/N.m], 0 for a rigid joint.

    Returns:
        (n,) rotor angles seen at the joint [rad].
    """
    return q + effort * compliance


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


DITHER = 0.35
"""Noise of at least this part of a grid step makes the rounding error white: what is left of its mean is below
exp(-2 pi^2 0.35^2) / pi = 3 % of a step."""


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


def absolute_dot(effort: Vector, weight: Vector) -> float:
    """The most that torques of these sizes can spend: ``sum_i |tau_i| weight_i``, weight >= 0 [rad], [J]."""
    return float(np.abs(effort) @ weight)
