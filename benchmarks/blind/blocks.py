# SPDX-License-Identifier: BSD-3-Clause
"""The blocks of the benchmark: how many cases each has and what is planted in which; made in parallel, truth sealed."""

from __future__ import annotations

import hashlib
import json
import random
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.blind.case import (
    Bench,
    Episode,
    Planted,
    draw_bench,
    equivalents_of,
    measure,
    on_a_surface,
    plant_effect,
    plant_map_error,
    rich_episodes,
    task_episodes,
    write_logs,
)
from benchmarks.blind.catalogue import CATALOGUE, CONFUSABLE, OPEN_SET, are_one
from benchmarks.blind.floor import MAP_ERRORS
from benchmarks.blind.injection import Draw
from benchmarks.blind.pair_cases import PAIRS, draw_pair
from benchmarks.blind.three_names import make_named

COUNTS: dict[str, int] = {"A": 140, "B": 250, "C": 80, "D": 80, "E": 100, "F": 112, "G": 60, "N": 4}
"""Cases per block, so many that a method at the target rate stays clear of the floor by its Wilson interval.

Each of D is one poor and one rich set of logs of the same arm.
"""
NOTHING, TOOL, JOINT = "nothing", "tool", "joint"
FLOORS = {error.effect: error for error in MAP_ERRORS}
KINDS = (NOTHING, *FLOORS, TOOL, JOINT)
"""What is planted in block G, in turn: nothing, an error of the floor's map, a tool in the hand, a joint's effect."""
SEEDS: dict[str, int] = {"dev": 1, "report": 2}
SIZES = (1.0, 3.0, 0.5)
NOISES = (1.0, 0.5, 3.0)
REDRAWN = 8
"""Times that a withheld effect is drawn again where another, at its size, would be as true in these logs."""
CASES, SEALED, SEALS = "cases", "sealed", "seals.txt"


def kind_of(index: int) -> str:
    """Returns what is planted in a case of block G."""
    return KINDS[index % len(KINDS)]


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
        block: A to G, or N.
        index: Of the case in its block.
        seeds: ``dev`` or ``report``.
        folder: Where the cases' folders go.
    """
    rng = rng_of(block, index, seeds)
    if block == "D":
        return _make_pair(index, rng, folder)
    if block == "N":
        return [Made(*make_named(index, rng, folder))]
    drawn = _draw(block, index, rng)
    truth: dict[str, Any] = {"block": block, "index": index}
    without = []
    if block == "F":
        without = [drawn.planted[0].injection.effect]
    if block == "G":
        truth |= {"surroundings": ["external_contact"], "kind": kind_of(index)}
    return [_write(folder, drawn, rng, truth, without, phases=block == "G")]


@dataclass(frozen=True)
class Drawn:
    """An arm, its runs, and what is wrong with it, before anything is recorded."""

    bench: Bench
    episodes: list[Episode]
    planted: list[Planted]


def rng_of(block: str, index: int, seeds: str) -> np.random.Generator:
    """Returns the random numbers of one case."""
    return np.random.default_rng((SEEDS[seeds], ord(block), index))


def draw_case(block: str, index: int, seeds: str) -> Drawn:
    """Draws a case again, the same as `make` did; not for block D."""
    return _draw(block, index, rng_of(block, index, seeds))


def _draw(block: str, index: int, rng: np.random.Generator) -> Drawn:
    noise = NOISES[(index + index // len(CATALOGUE)) % len(NOISES)]
    bench = draw_bench(rng, noise)
    episodes = task_episodes(bench, rng) if block == "G" else rich_episodes(bench, rng)
    if block == "G":
        bench = on_a_surface(bench, episodes, rng)
    return Drawn(bench, episodes, _plant(block, index, bench, episodes, rng))


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
    elif block == "G" and kind_of(index) == TOOL:
        wishes = [(CATALOGUE["payload"], 3.0, None)]
    elif block == "G" and kind_of(index) == JOINT:
        usual = [name for name in names if name not in ("external_contact", "payload")]
        wishes = [(CATALOGUE[usual[int(rng.integers(len(usual)))]], 3.0, None)]
    elif block == "G" and kind_of(index) in FLOORS:
        scale = measure(bench, episodes, int(rng.integers(2**31)))
        return [plant_map_error(FLOORS[kind_of(index)], bench, scale, rng)]
    if not wishes:
        return []
    scale = measure(bench, episodes, int(rng.integers(2**31)))
    planted: list[Planted] = []
    for draw, size, at in wishes:
        one = plant_effect(draw, bench, scale, episodes, size, rng, at, block == "F")
        while any(_same_place(one, other) for other in planted):
            one = plant_effect(draw, bench, scale, episodes, size, rng, at)
        equivalents = equivalents_of(one, bench, scale, episodes, rng) if block in "ACFG" else ()
        for _ in range(REDRAWN if block == "F" and equivalents else 0):
            one = plant_effect(draw, bench, scale, episodes, size, rng, at, True)
            equivalents = equivalents_of(one, bench, scale, episodes, rng)
            if not equivalents:
                break
        planted.append(replace(one, equivalents=equivalents))
    return planted


def _same_place(one: Planted, other: Planted) -> bool:
    """Tells whether two causes sit on the same joint and may be one there: no answer could hold both."""
    shared = set(one.injection.joints) & set(other.injection.joints)
    return bool(shared) and are_one(one.injection.effect, other.injection.effect)


def _two(index: int, rng: np.random.Generator) -> tuple[str, str]:
    """Returns two effects: a confusable pair for every other case, any two for the rest."""
    if index % 2 == 0:
        return CONFUSABLE[(index // 2) % len(CONFUSABLE)]
    first, second = rng.choice([name for name in CATALOGUE if name != "external_contact"], 2, replace=False)
    return str(first), str(second)


def _make_pair(index: int, rng: np.random.Generator, folder: Path) -> list[Made]:
    """Makes one arm with one cause, seen by a motion that cannot tell it and by one that can."""
    pair = PAIRS[index % len(PAIRS)]
    bench, poor, rich = draw_pair(pair, NOISES[(index // len(PAIRS)) % len(NOISES)], rng)
    made = []
    for motion, seen in (("poor", poor), ("rich", rich)):
        truth = {
            "block": "D",
            "motion": motion,
            "pair": [pair.truth, pair.partner],
            "index": index,
            "apart": seen.apart,
        }
        drawn = Drawn(bench, seen.episodes, [seen.planted])
        made.append(_write(folder, drawn, rng, truth, [], phases=False))
    return made


def _write(
    folder: Path,
    drawn: Drawn,
    rng: np.random.Generator,
    truth: dict[str, Any],
    without: list[str],
    phases: bool,
) -> Made:
    bench = drawn.bench
    name = f"{int(rng.integers(16**10)):010x}"
    shown = write_logs(folder / name, bench, drawn.episodes, drawn.planted, int(rng.integers(2**31)), phases)
    effects = [
        {
            "effect": one.injection.effect,
            "joints": list(one.injection.joints),
            "port": one.injection.port,
            "parameters": one.injection.parameters(one.amplitude),
            "also": sorted({*one.injection.also, *one.equivalents}),
            "size": one.size.net,
            "size_in_weakest_motion": one.size.weakest,
            "size_with_inertias": one.size.raw,
        }
        for one in drawn.planted
    ]
    truth = truth | {
        "effects": effects,
        "noise_level": bench.noise_level,
        "inertia_error": bench.inertia_error,
    }
    truth |= {"side": bench.arm.side, "withheld": without}
    return Made(name, {"robot": "baxter", **shown, "without": without}, truth)


def generate(
    block: str,
    seeds: str,
    count: int | None,
    out: Path,
    jobs: int,
    tell: Callable[[str], None],
    first: int = 0,
) -> Path:
    """Makes ``count`` cases of a block from number ``first`` on (as many as the block has where None).

    Writes out/cases/NAME/{run_*.parquet, case.json}, out/sealed/BLOCK.json and a line of out/seals.txt.

    Returns:
        The sealed file.
    """
    wanted = COUNTS[block] if count is None else count
    cases = out / CASES
    cases.mkdir(parents=True, exist_ok=True)
    made: list[Made] = []
    with ProcessPoolExecutor(jobs) as pool:
        waiting = [pool.submit(make, block, index, seeds, cases) for index in range(first, first + wanted)]
        for i, one in enumerate(waiting):
            made += one.result()
            tell(f"{block} {i + 1}/{wanted}")
    random.Random(f"{seeds}{block}").shuffle(made)
    for case in made:
        (cases / case.name / "case.json").write_text(json.dumps(case.shown, indent=1) + "\n")
    sealed = out / SEALED / f"{block}.json"
    sealed.parent.mkdir(exist_ok=True)
    truth = {"seeds": seeds, "block": block, "cases": {case.name: case.truth for case in made}}
    sealed.write_text(json.dumps(truth, indent=1) + "\n")
    with (out / SEALS).open("a") as file:
        file.write(f"{seal_of(sealed)}  {SEALED}/{block}.json  {seeds}  {len(made)} cases\n")
    return sealed


def seal_of(path: Path) -> str:
    """Returns the SHA-256 of a file."""
    return hashlib.sha256(path.read_bytes()).hexdigest()
