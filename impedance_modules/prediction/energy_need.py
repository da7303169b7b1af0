# SPDX-License-Identifier: BSD-3-Clause
r"""How much energy the tank must hold at the start so that the task is never slowed.

Along the rehearsal the tank's level is, as the ledger books it (docs/passivity.md),

    T = T_0 - U - W - C,      W = \int \tau . dq + \sum \tau^2 / (2 K_sea)        (work on the motors)

U what the declared springs hold, C the charge for sensing; what dampers take out of the arms comes back in W. At every
moment T must cover the floor and the commands in flight, \sum |\tau| (v_max (hold + delay) + (4 d + 5) e).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impedance_modules.control.assembly import Assembly
from impedance_modules.prediction.mechanism import Mechanism
from impedance_modules.prediction.quasi_static_result import Rehearsal
from impedance_modules.prediction.sensing import charged, sensing_rate

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


def forecast_tank(assembly: Assembly, mechanism: Mechanism, rehearsal: Rehearsal) -> TankForecast:
    """Follows the tank's level through a rehearsal."""
    samples = rehearsal.samples
    charges, unrest = _noise(assembly, mechanism, rehearsal)
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
    phase = next(p for p in rehearsal.phases if p.samples.start <= worst < p.samples.stop)
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


def _noise(assembly: Assembly, mechanism: Mechanism, rehearsal: Rehearsal) -> tuple[Array, Array]:
    """Gives the charge for sensing up to every sample [J], and the torque's noise at it (m, n) [N.m]."""
    charges = np.zeros(len(rehearsal.samples))
    unrest = np.zeros((len(rehearsal.samples), assembly.model.n))
    variance = energy = 0.0
    for phase in rehearsal.phases:
        mechanism.update(phase.q, np.zeros_like(phase.q))
        rate = sensing_rate(assembly, mechanism.joints, *mechanism.gains(phase.modules, phase.damping))
        unrest[phase.samples] = rate.unrest
        for index in range(phase.samples.start, phase.samples.stop):
            since = rehearsal.samples[index].time - phase.began
            charges[index] = charged(variance + rate.variance * since, energy + rate.energy * since)
        variance += rate.variance * (phase.ended - phase.began)
        energy += rate.energy * (phase.ended - phase.began)
    return charges, unrest
