# SPDX-License-Identifier: BSD-3-Clause
r"""How much energy the tank must hold at the start so that the task is never slowed, noisy sensors included.

Along the predicted motion the level of the energy tank (docs/passivity.md) is

    T = T_0 - U - W - C,      W = \int \tau . dq + \sum \tau^2 / (2 K_sea)        (work on the motors)

U what the declared springs hold, C the charge for sensing; what dampers take out of the arms comes back in W. At every
moment T must cover the floor and the commands in flight, \sum |\tau| (v_max (hold + delay) + (4 d + 5) e).

The tank is charged for the error of measured rotor angles times the change of torque from cycle to cycle (``safety``).
That change is mostly the noise itself, through the controller's own gains:

    \Delta\tau = (K + D a / T_1) \Delta n + D (a_T / T) \Delta w,      a = 1 - exp(-T_1 / T_f)

n noise of the positions in the robot's loop of period T_1 = 1 ms or shorter, w noise of effort / K_sea in the
controller's period T, T_f the velocity filter. With white errors of deviation s the charge is
6 sqrt(V), V growing by \sum s_i^2 Var(\Delta\tau_i) per cycle; otherwise \sum |\Delta\tau_i| e_i per cycle.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impedance_modules.arrays import Array
from impedance_modules.control.assembly import Assembly
from impedance_modules.prediction.compensation_forecast import CompensationForecast
from impedance_modules.prediction.mechanism import Mechanism
from impedance_modules.prediction.quasi_static import MotionPrediction
from impedance_modules.robot.model import RobotModel
from impedance_modules.safety.motor_port import spring_compliances
from impedance_modules.safety.tank import DEVIATIONS
from impedance_modules.superposition.elastic_joints import sampling_of

COMPENSATED = "friction and drives compensated"
"""Name of the cost of what is compensated and has no potential."""

NOISIEST_CYCLE = 3.0
"""Standard deviations by which the noisiest of a run's cycles stands out."""


@dataclass(frozen=True)
class TankForecast:
    """What the tank must hold.

    Attributes:
        need: Least ``tank.initial`` with which nothing is slowed [J].
        time: When it is tightest [s].
        phase: In which phase.
        costs: What the need is made of at that moment, by name [J]; negative for what was gained.
        sensing: Charge for sensing over the whole task, its end term included [J]: how far the measured work
            can be from the true.
    """

    need: float
    time: float
    phase: str
    costs: Mapping[str, float]
    sensing: float


def forecast_tank(
    assembly: Assembly,
    mechanism: Mechanism,
    motion: MotionPrediction,
    compensation: CompensationForecast | None = None,
) -> TankForecast:
    """Follows the tank's level along the predicted motion, with what is compensated on the way."""
    samples = motion.samples
    efforts = [sample.effort for sample in samples]
    drawn = np.zeros(len(samples))
    if compensation is not None:
        efforts = [effort + added for effort, added in zip(efforts, compensation.effort, strict=True)]
        drawn = compensation.drawn
    charges, torque_noise = _sensing_along(assembly, mechanism, motion)
    elastic = np.array([_elastic_energy(assembly, effort) for effort in efforts])
    flight = np.array(
        [_in_flight(assembly, effort, noise) for effort, noise in zip(efforts, torque_noise, strict=True)]
    )
    spent = np.array([sample.potential + sample.work for sample in samples])
    spent += elastic - elastic[0] + charges + drawn
    level, lost = _level(assembly, spent)
    needed = assembly.tank.initial - level + assembly.tank.floor + flight
    worst = int(np.argmax(needed))
    at = samples[worst]
    costs = {
        "floor": assembly.tank.floor,
        "commands in flight": float(flight[worst]),
        "springs deflected": at.potential,
        "arms moving": at.kinetic,
        "friction on surfaces": at.surface_friction,
        "friction of motors": at.motor_friction,
        "friction of the hinge": at.hinge_friction,
        "elastic joints deflected": float(elastic[worst] - elastic[0]),
        COMPENSATED: float(drawn[worst]),
        "lifting and pressing": at.work
        - at.kinetic
        - at.surface_friction
        - at.motor_friction
        - at.hinge_friction,
        "sensing": float(charges[worst]),
        "lost above the maximum": float(lost[worst]),
    }
    end_term = float(np.abs(efforts[-1]) @ (assembly.tank.gains[1] * assembly.tank.sensing_error))
    phase = next(p for p in motion.phases if p.samples.start <= worst < p.samples.stop)
    return TankForecast(float(needed[worst]), at.time, phase.name, costs, float(charges[-1]) + end_term)


def _level(assembly: Assembly, spent: Array) -> tuple[Array, Array]:
    """Gives the tank's level at every sample, and what was lost because the tank was full [J]."""
    level, lost = np.zeros_like(spent), np.zeros_like(spent)
    now, lost_so_far = assembly.tank.initial, 0.0
    for index, change in enumerate(np.diff(spent, prepend=0.0)):
        now -= change
        excess = max(0.0, now - assembly.tank.max)
        now, lost_so_far = now - excess, lost_so_far + excess
        level[index], lost[index] = now, lost_so_far
    return level, lost


def _elastic_energy(assembly: Assembly, effort: Array) -> float:
    """Gives what a torque (n,) stores in the series springs [J]."""
    return 0.5 * float(effort**2 @ assembly.tank.compliance)


def _in_flight(assembly: Assembly, effort: Array, torque_noise: Array) -> float:
    """Gives what the guarantee keeps for a torque (n,) with noise on it, as ``safety.tank`` does [J].

    The mean of |x + noise| is about sqrt(x^2 + 2 s^2 / pi); the noisiest of many cycles lies
    ``NOISIEST_CYCLE`` of the sum's deviation, at most 0.6 s each, above it.
    """
    tank = assembly.tank
    duration = tank.hold + tank.delay * tank.period
    cost = tank.gains[1] * (tank.speed_bound * duration + (4 * tank.delay + 5) * tank.sensing_error)
    size = np.sqrt(effort**2 + 2.0 / np.pi * torque_noise**2)
    return float(size @ cost + NOISIEST_CYCLE * 0.6 * np.linalg.norm(torque_noise * cost))


def _sensing_along(assembly: Assembly, mechanism: Mechanism, motion: MotionPrediction) -> tuple[Array, Array]:
    """Gives the charge for sensing up to every sample [J], and the torque's noise at it (m, n) [N.m]."""
    charges = np.zeros(len(motion.samples))
    torque_noise = np.zeros((len(motion.samples), assembly.model.n))
    variance = energy = 0.0
    for phase in motion.phases:
        mechanism.update(phase.q, np.zeros_like(phase.q))
        gains = mechanism.gains(phase.modules, phase.damping, phase.equilibrium)
        rate = _sensing_rate(assembly, mechanism.joints, *gains)
        torque_noise[phase.samples] = rate.torque_noise
        for index in range(phase.samples.start, phase.samples.stop):
            since = motion.samples[index].time - phase.began
            charges[index] = _charge(variance + rate.variance * since, energy + rate.energy * since)
        variance += rate.variance * (phase.ended - phase.began)
        energy += rate.energy * (phase.ended - phase.began)
    return charges, torque_noise


@dataclass(frozen=True)
class _SensingRate:
    """Cost of sensing under one phase's gains.

    Attributes:
        variance: Per second, where the sensors' errors are white [J^2/s]; else 0.
        energy: Per second, where only their bound is known [J/s]; else 0.
        torque_noise: (n,) standard deviation of the noise in the commanded torque [N.m].
    """

    variance: float
    energy: float
    torque_noise: Array


def _sensing_rate(
    assembly: Assembly, joints: NDArray[np.intp], stiffness: Array, dampers: Array
) -> _SensingRate:
    """Predicts the cost of sensing under gains (k, k) over ``joints``."""
    spread = np.sqrt(_torque_variance(assembly, joints, stiffness, dampers))
    settings = assembly.tank
    torque_noise = np.zeros(assembly.model.n)
    # A white torque changes from cycle to cycle by sqrt(2) of its own deviation.
    torque_noise[joints] = spread / math.sqrt(2.0)
    if settings.sensing_deviation is None:
        # The mean of |x| of a normal x is sqrt(2 / pi) of its deviation.
        energy = math.sqrt(2.0 / math.pi) * float(spread @ settings.sensing_error[joints])
        return _SensingRate(0.0, energy * assembly.rate, torque_noise)
    variance = float(np.sum((spread * settings.sensing_deviation[joints]) ** 2))
    return _SensingRate(variance * assembly.rate, 0.0, torque_noise)


def _charge(variance: float, energy: float) -> float:
    """Gives the charge [J] from an accumulated variance [J^2] and energy [J]."""
    return DEVIATIONS * math.sqrt(variance) + energy


def _torque_variance(assembly: Assembly, joints: NDArray[np.intp], stiffness: Array, dampers: Array) -> Array:
    """Gives the variance (k,) of the torque's change from one cycle to the next [N^2.m^2]."""
    position, deflection = _sensor_variances(assembly.model)
    position, deflection = position[joints], deflection[joints]
    sampling = sampling_of(assembly.robot, assembly.rate, True)
    loop, period = assembly.period / sampling.robot_loops, assembly.period
    by_position = stiffness + dampers * _filter_gain(loop, sampling.velocity_filter) / loop
    by_deflection = dampers * _filter_gain(period, sampling.velocity_filter) / period
    return np.asarray(2.0 * (by_position**2 @ position + by_deflection**2 @ deflection))


def _filter_gain(period: float, lag: float) -> float:
    return 1.0 - math.exp(-period / lag) if lag > 0.0 else 1.0


def _sensor_variances(model: RobotModel) -> tuple[Array, Array]:
    """Gives variances (n,) of measured positions and of the effort / K_sea added to them [rad^2], rounding included."""
    sensors = model.spec.sensors
    position = sensors.position_resolution**2 / 12.0 + sensors.position_noise**2
    effort = sensors.effort_resolution**2 / 12.0 + sensors.effort_noise**2
    return np.full(model.n, position), effort * spring_compliances(model.joints) ** 2
