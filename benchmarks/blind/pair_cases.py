# SPDX-License-Identifier: BSD-3-Clause
"""Block D: one arm with one cause, seen by a motion that cannot tell it from another and by one that can.

After the poor motion the right answer is to name both causes and to refuse the choice.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from benchmarks.blind.case import (
    Bench,
    Episode,
    Planted,
    draw_at,
    draw_bench,
    measure,
    plant_effect,
    poor_episodes,
    ports_beside,
    rich_episodes,
    situation,
)
from benchmarks.blind.catalogue import CATALOGUE
from benchmarks.blind.excitation import PoorShape, held, one_speed, one_speed_small, one_way, slow_tone
from benchmarks.blind.injection import Draw, Injection, Situation
from benchmarks.blind.noise_scale import ALIKE, APART

SIZES = tuple(float(size) for size in np.linspace(1.6, 1.1, 12))
"""Sizes that are wanted of one arm after another: what is large is easily told, what is small is easily lost."""
ROUNDS = 6
"""Times that the sizes are gone through before a pair is given up."""
BOTH_TORQUES = ("actuator", "link")
UPRIGHT = (0,)
"""The joint that carries no weight: elsewhere a lag of the motor holds back the robot's own compensation of the weight
too, which a late command does not."""


@dataclass(frozen=True)
class Seen:
    """One cause in one set of logs.

    Attributes:
        episodes: Of the logs.
        planted: The cause, with its size in these logs.
        apart: What of it the partner cannot imitate, sum of squares over noise.
    """

    episodes: list[Episode]
    planted: Planted
    apart: float


@dataclass(frozen=True)
class _Poor:
    seen: Seen
    partner: Injection


def draw_pair(pair: Pair, noise: float, rng: np.random.Generator) -> tuple[Bench, Seen, Seen]:
    """Returns an arm, its poor logs and its rich ones.

    Arm, joint, motion and size are drawn again until the poor logs hold nothing that tells the pair apart, the
    rich ones do, and the cause is at or above the noise in both.

    Raises:
        RuntimeError: No arm of many was such.
    """
    for wanted in ROUNDS * SIZES:
        bench = draw_bench(rng, noise)
        poor = _poor(pair, bench, wanted, rng)
        if poor is None:
            continue
        rich = _rich(poor, bench, rng)
        if rich.apart > APART and rich.planted.size.net >= 1.0:
            return bench, poor.seen, rich
    raise RuntimeError(f"{pair.truth} beside {pair.partner}: {ROUNDS * len(SIZES)} arms gave no pair of logs")


def _poor(pair: Pair, bench: Bench, wanted: float, rng: np.random.Generator) -> _Poor | None:
    """Draws joint, motion and shape once; None where the cause cannot be seen or can be told."""
    joint = int(rng.choice(pair.joints))
    episodes = poor_episodes(bench, pair.motion, joint, rng)
    scale = measure(bench, episodes, int(rng.integers(2**31)))
    planted = plant_effect(_at_port(pair), bench, scale, episodes, wanted, rng, joint, True)
    if planted.size.net < 1.0:
        return None
    place = situation(bench, episodes, joint, rng)
    partner = draw_at(CATALOGUE[pair.partner], ports_beside(planted.injection.port), place)
    _, apart = scale.apart(planted.injection, planted.amplitude, partner)
    return _Poor(Seen(episodes, planted, apart), partner) if apart < ALIKE else None


def _rich(poor: _Poor, bench: Bench, rng: np.random.Generator) -> Seen:
    episodes = rich_episodes(bench, rng)
    scale = measure(bench, episodes, int(rng.integers(2**31)))
    injection, amplitude = poor.seen.planted.injection, poor.seen.planted.amplitude
    size = scale.size(lambda arm, i: injection.apply(arm, amplitude, i))
    _, apart = scale.apart(injection, amplitude, poor.partner)
    return Seen(episodes, Planted(injection, amplitude, size), apart)


def _at_port(pair: Pair) -> Draw:
    """Returns the pair's true effect, drawn until it sits on one joint and at a port where the pair is a pair."""

    def draw(s: Situation) -> Injection:
        return draw_at(CATALOGUE[pair.truth], pair.ports, s)

    return draw


@dataclass(frozen=True)
class Pair:
    """What is true, what it cannot be told from, on which motion, and the ports and joints where that holds."""

    truth: str
    partner: str
    motion: PoorShape
    ports: tuple[str, ...]
    joints: tuple[int, ...] = tuple(range(7))


PAIRS: tuple[Pair, ...] = (
    Pair("coulomb_friction", "viscous_friction", one_speed, BOTH_TORQUES),
    Pair("viscous_friction", "coulomb_friction", one_speed, BOTH_TORQUES),
    Pair("quadratic_drag", "viscous_friction", one_speed, BOTH_TORQUES),
    Pair("load_dependent_friction", "coulomb_friction", one_speed_small, BOTH_TORQUES),
    Pair("coulomb_friction", "torque_offset", one_way, BOTH_TORQUES),
    Pair("torque_offset", "coulomb_friction", one_way, BOTH_TORQUES),
    Pair("torque_offset", "parallel_spring", held, ("link",)),
    Pair("parallel_spring", "torque_offset", held, ("link",)),
    Pair("command_delay", "actuator_lag", slow_tone, ("timing",), UPRIGHT),
    Pair("actuator_lag", "command_delay", slow_tone, ("actuator",), UPRIGHT),
)
