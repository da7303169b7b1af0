# SPDX-License-Identifier: BSD-3-Clause
"""The seven blocks of the benchmark: how many cases each has and what is planted in which."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.blind.case import (
    Bench,
    Episode,
    Planted,
    draw_bench,
    measure,
    on_a_surface,
    plant_effect,
    poor_episodes,
    rich_episodes,
    task_episodes,
    write_logs,
)
from benchmarks.blind.catalogue import CATALOGUE, CONFUSABLE
from benchmarks.blind.injection import Draw, Injection, Situation
from benchmarks.blind.open_set import OPEN_SET
from benchmarks.blind.pairs import PAIRS, Pair

COUNTS: dict[str, int] = {"A": 100, "B": 200, "C": 60, "D": 60, "E": 100, "F": 100, "G": 30}
"""Cases per block; each of D is one poor and one rich set of logs of the same arm."""

SEEDS: dict[str, int] = {"dev": 1, "report": 2}
SIZES = (1.0, 3.0, 0.5)
NOISES = (1.0, 0.5, 3.0)
ALIKE = 20.0
"""Sum of squares over noise below which two causes count as one in a log."""


@dataclass
class Made:
    """One case as it was made: what is shown and what is sealed.

    Attributes:
        name: Folder of the logs; says nothing.
        shown: Goes into case.json.
        truth: Goes under the seal.
    """

    name: str
    shown: dict[str, Any] = field(default_factory=dict)
    truth: dict[str, Any] = field(default_factory=dict)


def make(block: str, index: int, seeds: str, folder: Path) -> list[Made]:
    """Makes one case of a block (two for D) and writes its logs below ``folder``.

    Args:
        block: A to G.
        index: Of the case in its block.
        seeds: ``dev`` or ``report``.
        folder: Where the cases' folders go.
    """
    rng = np.random.default_rng((SEEDS[seeds], ord(block), index))
    if block == "D":
        return _make_pair(index, rng, folder)
    noise = NOISES[(index + index // len(CATALOGUE)) % len(NOISES)]
    bench = draw_bench(rng, noise)
    episodes = task_episodes(bench, rng) if block == "G" else rich_episodes(bench, rng)
    if block == "G":
        bench = on_a_surface(bench, episodes)
    planted = _plant(block, index, bench, episodes, rng)
    truth: dict[str, Any] = {"block": block}
    without = []
    if block == "F":
        without = [planted[0].injection.effect]
    if block == "G":
        truth["surroundings"] = [
            "external_contact",
            "surface_height",
            "surface_stiffness",
            "surface_friction",
        ]
    return [_write(folder, bench, episodes, planted, rng, truth, without, phases=block == "G")]


def _plant(
    block: str, index: int, bench: Bench, episodes: list[Episode], rng: np.random.Generator
) -> list[Planted]:
    wishes: list[tuple[Draw, float, int | None]] = []
    names = list(CATALOGUE)
    if block == "A":
        wishes = [(CATALOGUE[names[index % len(names)]], SIZES[(index // len(names)) % len(SIZES)], None)]
    elif block == "C":
        wishes = [(CATALOGUE[name], float(rng.uniform(2, 4)), None) for name in _two(index, rng)]
    elif block == "E":
        strange = list(OPEN_SET)
        wishes = [(OPEN_SET[strange[index % len(strange)]], (2.0, 5.0)[(index // len(strange)) % 2], None)]
    elif block == "F":
        wishes = [(CATALOGUE[names[index % len(names)]], 3.0, None)]
    elif block == "G" and index % 5 < 4:
        usual = [name for name in names if name != "external_contact"]
        wishes = [(CATALOGUE[usual[int(rng.integers(len(usual)))]], 3.0, None)]
    if not wishes:
        return []
    yardstick = measure(bench, episodes, int(rng.integers(2**31)))
    centre = episodes[0].motion.position.mean(axis=0)
    return [
        plant_effect(draw, bench, yardstick, centre, size, rng, at, block == "F") for draw, size, at in wishes
    ]


def _two(index: int, rng: np.random.Generator) -> tuple[str, str]:
    """Returns two effects: a confusable pair for every other case, any two for the rest."""
    if index % 2 == 0:
        return CONFUSABLE[(index // 2) % len(CONFUSABLE)]
    first, second = rng.choice([name for name in CATALOGUE if name != "external_contact"], 2, replace=False)
    return str(first), str(second)


def _make_pair(index: int, rng: np.random.Generator, folder: Path) -> list[Made]:
    """Makes one arm with one cause, seen by a motion that cannot tell it and by one that can.

    Joint, motion and size are drawn again until the poor logs hold nothing that tells the pair apart; how near
    that came is in the truth (``apart``, see `Yardstick.apart`), and the scorer leaves out what did not.
    """
    pair = PAIRS[index % len(PAIRS)]
    bench = draw_bench(rng, NOISES[(index // len(PAIRS)) % len(NOISES)])
    tries: list[tuple[float, list[Episode], Planted, Injection]] = []
    for wanted in (2.0, 1.5, 1.2, 1.2):
        tries.append(_poor_try(pair, bench, wanted, rng))
        if tries[-1][0] < ALIKE:
            break
    apart, poor, planted, partner = min(tries, key=lambda one: one[0])
    rich = rich_episodes(bench, rng)
    rich_stick = measure(bench, rich, int(rng.integers(2**31)))
    seen = rich_stick.size(lambda arm, i: planted.injection.wear(arm, planted.amplitude, i))
    _, rich_apart = rich_stick.apart(planted.injection, planted.amplitude, partner)
    as_rich = Planted(planted.injection, planted.amplitude, seen)
    made = []
    for motion, episodes, one, far in (("poor", poor, planted, apart), ("rich", rich, as_rich, rich_apart)):
        truth = {
            "block": "D",
            "motion": motion,
            "pair": [pair.truth, pair.partner],
            "index": index,
            "apart": far,
        }
        made.append(_write(folder, bench, episodes, [one], rng, truth, [], phases=False))
    return made


def _poor_try(
    pair: Pair, bench: Bench, wanted: float, rng: np.random.Generator
) -> tuple[float, list[Episode], Planted, Injection]:
    """Draws joint, motion and shape once; returns how far apart the pair is, infinite where it cannot be seen."""
    joint = int(rng.integers(len(bench.arm.drive.joints)))
    poor = poor_episodes(bench, pair.motion, joint, rng)
    stick = measure(bench, poor, int(rng.integers(2**31)))
    centre = poor[0].motion.position.mean(axis=0)
    planted = plant_effect(_at_port(pair), bench, stick, centre, wanted, rng, joint, True)
    swapped = Pair(pair.partner, pair.truth, pair.motion, _ports_beside(planted.injection.port))
    partner = _at_port(swapped)(Situation(bench.arm, joint, centre, stick.peak, rng))
    if planted.size.net < 1.0:
        return float("inf"), poor, planted, partner
    return stick.apart(planted.injection, planted.amplitude, partner)[1], poor, planted, partner


def _ports_beside(port: str) -> tuple[str, ...]:
    """Returns the ports where a partner acts on the same torque: a delay is timing, a lag the actuator's."""
    return ("timing", "actuator") if port == "timing" else (port, "timing")


def _at_port(pair: Pair) -> Draw:
    """Returns the pair's true effect, drawn until it sits on one joint and at a port where the pair is a pair."""

    def draw(s: Situation) -> Injection:
        while True:
            found = CATALOGUE[pair.truth](s)
            if found.port in pair.ports and found.joints == (s.name,):
                return found

    return draw


def _write(
    folder: Path,
    bench: Bench,
    episodes: Sequence[Episode],
    planted: Sequence[Planted],
    rng: np.random.Generator,
    truth: dict[str, Any],
    without: list[str],
    phases: bool,
) -> Made:
    name = f"{int(rng.integers(16**10)):010x}"
    shown = write_logs(folder / name, bench, episodes, planted, int(rng.integers(2**31)), phases)
    effects = [
        {
            "effect": one.injection.effect,
            "joints": list(one.injection.joints),
            "port": one.injection.port,
            "parameters": one.injection.parameters(one.amplitude),
            "also": list(one.injection.also),
            "size": one.size.net,
            "size_with_inertias": one.size.raw,
        }
        for one in planted
    ]
    truth = truth | {
        "effects": effects,
        "noise_level": bench.noise_level,
        "inertia_error": bench.inertia_error,
    }
    truth |= {"side": bench.arm.side, "withheld": without}
    return Made(name, {"robot": "baxter", **shown, "without": without}, truth)
