# SPDX-License-Identifier: BSD-3-Clause
r"""How much energy the tank must hold at the start so that the task is never slowed.

Along the motion the tank's level is, as the ledger books it (docs/passivity.md),

    T = T_0 - U - W - C,      W = \int \tau . dq + \sum \tau^2 / (2 K_sea)        (work on the motors)

U what the declared springs hold, C the charge for sensing; what dampers take out of the arms comes back in W. At every
moment T must cover the floor and the commands in flight, \sum |\tau| (v_max (hold + delay) + (4 d + 5) e).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impedance_modules.control.assembly import Assembly
from impedance_modules.prediction.mechanism import Mechanism
from impedance_modules.prediction.quasi_static import MotionPrediction
from impedance_modules.robot.model import RobotModel
from impedance_modules.safety.ledger import DEVIATIONS
from impedance_modules.superposition.elastic_joints import sampling_of

Array = NDArray[np.float64]

NOISIEST = 3.0
"""Deviations by which the noisiest of a run's cycles stands out."""


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


def forecast_tank(assembly: Assembly, mechanism: Mechanism, motion: MotionPrediction) -> TankForecast:
    """Follows the tank's level through a motion."""
    samples = motion.samples
    charges, unrest = _sensing_along(assembly, mechanism, motion)
    wound = np.array([_wound(assembly, sample.effort) for sample in samples])
    flight = np.array(
        [_in_flight(assembly, s.effort, noise) for s, noise in zip(samples, unrest, strict=True)]
    )
    spent = np.array([sample.potential + sample.work for sample in samples])
    spent += wound - wound[0] + charges
    level, spilled = _level(assembly, spent)
    asked = assembly.tank.initial - level + assembly.tank.floor + flight
    worst = int(np.argmax(asked))
    at = samples[worst]
    costs = {
        "floor": assembly.tank.floor,
        "commands in flight": float(flight[worst]),
        "springs wound": at.potential,
        "arms moving": at.kinetic,
        "rubbing on surfaces": at.rubbed,
        "friction of motors": at.friction,
        "elastic joints wound": float(wound[worst] - wound[0]),
        "lifting and pressing": at.work - at.kinetic - at.rubbed - at.friction,
        "sensing": float(charges[worst]),
        "spilled over the ceiling": float(spilled[worst]),
    }
    end_term = float(np.abs(samples[-1].effort) @ assembly.tank.sensing_error)
    phase = next(p for p in motion.phases if p.samples.start <= worst < p.samples.stop)
    return TankForecast(float(asked[worst]), at.time, phase.name, costs, float(charges[-1]) + end_term)


def _level(assembly: Assembly, spent: Array) -> tuple[Array, Array]:
    """Gives the tank's level at every sample, and what it has spilled over its ceiling [J]."""
    level, lost = np.zeros_like(spent), np.zeros_like(spent)
    now, spilled = assembly.tank.initial, 0.0
    for index, change in enumerate(np.diff(spent, prepend=0.0)):
        now -= change
        excess = max(0.0, now - assembly.tank.max)
        now, spilled = now - excess, spilled + excess
        level[index], lost[index] = now, spilled
    return level, lost


def _wound(assembly: Assembly, effort: Array) -> float:
    """Gives what a torque (n,) stores in the series springs [J]."""
    return 0.5 * float(effort**2 @ assembly.tank.compliance)


def _in_flight(assembly: Assembly, effort: Array, unrest: Array) -> float:
    """Gives what the guarantee keeps for a torque (n,) with noise on it, as ``safety.ledger.pay`` does [J].

    The mean of |x + noise| is about sqrt(x^2 + 2 s^2 / pi); the noisiest of many cycles lies ``NOISIEST`` of the sum's
    deviation, at most 0.6 s each, above it.
    """
    tank = assembly.tank
    lasting = tank.hold + tank.delay * tank.period
    price = tank.speed_bound * lasting + (4 * tank.delay + 5) * tank.sensing_error
    size = np.sqrt(effort**2 + 2.0 / np.pi * unrest**2)
    return float(size @ price + NOISIEST * 0.6 * np.linalg.norm(unrest * price))


def _sensing_along(assembly: Assembly, mechanism: Mechanism, motion: MotionPrediction) -> tuple[Array, Array]:
    """Gives the charge for sensing up to every sample [J], and the torque's noise at it (m, n) [N.m]."""
    charges = np.zeros(len(motion.samples))
    unrest = np.zeros((len(motion.samples), assembly.model.n))
    variance = energy = 0.0
    for phase in motion.phases:
        mechanism.update(phase.q, np.zeros_like(phase.q))
        rate = sensing_rate(assembly, mechanism.joints, *mechanism.gains(phase.modules, phase.damping))
        unrest[phase.samples] = rate.unrest
        for index in range(phase.samples.start, phase.samples.stop):
            since = motion.samples[index].time - phase.began
            charges[index] = charged(variance + rate.variance * since, energy + rate.energy * since)
        variance += rate.variance * (phase.ended - phase.began)
        energy += rate.energy * (phase.ended - phase.began)
    return charges, unrest


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
    position, wind = _sensor_variances(assembly.model)
    position, wind = position[joints], wind[joints]
    sampling = sampling_of(assembly.robot, assembly.rate, True)
    loop, period = assembly.period / sampling.robot_loops, assembly.period
    by_position = stiffness + dampers * _share(loop, sampling.velocity_filter) / loop
    by_wind = dampers * _share(period, sampling.velocity_filter) / period
    return np.asarray(2.0 * (by_position**2 @ position + by_wind**2 @ wind))


def _share(period: float, lag: float) -> float:
    return 1.0 - math.exp(-period / lag) if lag > 0.0 else 1.0


def _sensor_variances(model: RobotModel) -> tuple[Array, Array]:
    """Gives variances (n,) of measured positions and of effort / K_sea [rad^2], rounding included."""
    sensors = model.spec.sensors
    position = sensors.position_resolution**2 / 12.0 + sensors.position_noise**2
    effort = sensors.effort_resolution**2 / 12.0 + sensors.effort_noise**2
    return np.full(model.n, position), effort * model.spring_compliance() ** 2
