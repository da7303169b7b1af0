# SPDX-License-Identifier: BSD-3-Clause
r"""What noisy sensors cost the energy tank while a phase runs.

The ledger charges for the error of measured rotor angles times the change of torque from cycle to cycle
(``safety.ledger.sensing_charge``). That change is mostly the noise itself, through the controller's own gains:

    \Delta\tau = (K + D a / T_1) \Delta n + D (a_T / T) \Delta w,      a = 1 - exp(-T_1 / T_f)

n noise of the positions in the robot's loop of period T_1 = 1 ms or shorter, w noise of effort / K_sea in the
controller's period T, T_f the velocity filter. With white errors of deviation s the charge is
6 sqrt(V), V growing by \sum s_i^2 Var(\Delta\tau_i) per cycle; otherwise \sum |\Delta\tau_i| e_i per cycle.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impedance_modules.control.assembly import Assembly
from impedance_modules.robot.model import RobotModel
from impedance_modules.safety.ledger import DEVIATIONS
from impedance_modules.superposition.elastic_joints import sampling_of

Array = NDArray[np.float64]


@dataclass(frozen=True)
class SensingRate:
    """Cost of sensing under one phase's gains.

    Attributes:
        variance: Per second, where the sensors' errors are white [J^2/s]; else 0.
        energy: Per second, where only their bound is known [J/s]; else 0.
        unrest: (n,) standard deviation of the noise in the commanded torque [N.m].
    """

    variance: float
    energy: float
    unrest: Array


def sensing_rate(
    assembly: Assembly, joints: NDArray[np.intp], stiffness: Array, dampers: Array
) -> SensingRate:
    """Predicts the cost of sensing under gains (k, k) over ``joints``."""
    spread = np.sqrt(_torque_variance(assembly, joints, stiffness, dampers))
    settings = assembly.tank
    unrest = np.zeros(assembly.model.n)
    # A white torque changes from cycle to cycle by sqrt(2) of its own deviation.
    unrest[joints] = spread / math.sqrt(2.0)
    if settings.sensing_deviation is None:
        # The mean of |x| of a normal x is sqrt(2 / pi) of its deviation.
        energy = math.sqrt(2.0 / math.pi) * float(spread @ settings.sensing_error[joints])
        return SensingRate(0.0, energy * assembly.rate, unrest)
    variance = float(np.sum((spread * settings.sensing_deviation[joints]) ** 2))
    return SensingRate(variance * assembly.rate, 0.0, unrest)


def charged(variance: float, energy: float) -> float:
    """Gives the charge [J] from an accumulated variance [J^2] and energy [J]."""
    return DEVIATIONS * math.sqrt(variance) + energy


def _torque_variance(assembly: Assembly, joints: NDArray[np.intp], stiffness: Array, dampers: Array) -> Array:
    """Gives the variance (k,) of the torque's change from one cycle to the next [N^2.m^2]."""
    position, wind = _noise(assembly.model)
    position, wind = position[joints], wind[joints]
    sampling = sampling_of(assembly.robot, assembly.rate, True)
    loop, period = assembly.period / sampling.robot_loops, assembly.period
    by_position = stiffness + dampers * _share(loop, sampling.velocity_filter) / loop
    by_wind = dampers * _share(period, sampling.velocity_filter) / period
    return np.asarray(2.0 * (by_position**2 @ position + by_wind**2 @ wind))


def _share(period: float, lag: float) -> float:
    return 1.0 - math.exp(-period / lag) if lag > 0.0 else 1.0


def _noise(model: RobotModel) -> tuple[Array, Array]:
    """Gives variances (n,) of measured positions and of effort / K_sea [rad^2], rounding included."""
    sensors = model.spec.sensors
    position = sensors.position_resolution**2 / 12.0 + sensors.position_noise**2
    effort = sensors.effort_resolution**2 / 12.0 + sensors.effort_noise**2
    return np.full(model.n, position), effort * model.spring_compliance() ** 2
