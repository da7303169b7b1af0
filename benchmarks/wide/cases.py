# SPDX-License-Identifier: BSD-3-Clause
"""One case: values of every dimension, what is wrong, its recordings, and the truth that is sealed."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.blind.catalogue import CONFUSABLE, are_one
from benchmarks.blind.excitation import Motion
from benchmarks.blind.injection import Injection, Situation
from benchmarks.wide.arms import WideArm, draw_arm, rigid, write_description
from benchmarks.wide.design import Values, draw_cases
from benchmarks.wide.effects import DRY, draw_effect, names_for, simpler_than, twins, visible
from benchmarks.wide.logs import SPARE, record, save
from benchmarks.wide.motions import draw_motions, peaks_of
from benchmarks.wide.size import Scale, Simulate, Size

Array = NDArray[np.float64]

COUNTS: dict[str, int] = {"A": 80, "B": 60, "C": 40, "D": 40, "E": 30}
"""Cases of a block where nothing else is asked: one effect, nothing wrong, two or three, a pair that a poor motion
cannot tell and a rich one can (`pair_cases`; two sets of logs each), outside the catalogue."""
LEAST: dict[str, int] = {"A": 1, "B": 0, "C": 2, "E": 1}
"""Effects that a case must have; an arm and motions that cannot show so many are drawn again."""
SEEDS: dict[str, int] = {"dev": 1, "smoke": 7, "frozen": 3}
MEASURED = 6.0
"""Longest stretch [s] of a motion on which sizes are measured."""
TRIES = 4
"""Draws of an effect until one reaches its size."""


@dataclass
class Made:
    """One case as it was made: its folder's name, what is shown, what is sealed."""

    name: str
    shown: dict[str, Any] = field(default_factory=dict)
    truth: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Planted:
    """An effect with its amplitude, its size, and effects that are as true."""

    injection: Injection
    amplitude: float
    size: Size
    also: tuple[str, ...]


def values_of(block: str, index: int, seeds: str, frozen: str | None) -> dict[str, str]:
    """Returns the values of one case."""
    seed = (SEEDS[seeds], ord(block), 0 if frozen is None else zlib.crc32(frozen.encode()))
    return next(islice(draw_cases(seed, frozen), index, None))


def make(block: str, index: int, seeds: str, frozen: str | None, folder: Path, simulate: Simulate) -> Made:
    """Makes one case and writes its recordings and its robot below ``folder``.

    Args:
        block: A, B, C or E.
        index: Of the case in its block.
        seeds: One of `SEEDS`.
        frozen: Dimension that has its frozen value, or None.
        folder: Where the cases' folders go.
        simulate: Runs a plan on the engine that it names.
    """
    values = values_of(block, index, seeds, frozen)
    mark, attempt = 0 if frozen is None else zlib.crc32(frozen.encode()), 0
    while True:
        attempt += 1
        rng = np.random.default_rng((SEEDS[seeds], ord(block), index, mark, attempt))
        arm, seconds = draw_arm(values, rng), float(values["seconds"]) + SPARE
        model = rigid(arm.machine).model
        motions, repeats = draw_motions(values, model, arm.drive, seconds, int(values["logs"]), rng)
        planted: list[Planted] = []
        if block != "B":
            scale = Scale(arm, cut(motions[0]), int(rng.integers(2**31)), simulate)
            planted = _plant(block, index, arm, motions, scale, rng, frozen == "friction")
        if len(planted) >= LEAST[block]:
            break
    name = f"{int(rng.integers(16**10)):010x}"
    shown = write_case(folder / name, arm, motions, repeats, planted, int(rng.integers(2**31)), simulate)
    return Made(name, shown, truth_of(block, index, values, frozen, planted))


def cut(motion: Motion, lead: float = 0.0) -> Array:
    """Returns the part (samples, n) of a motion on which sizes are measured, and what leads to it [rad]."""
    return motion.position[: round((lead + MEASURED + SPARE) * 1000)]


def _plant(
    block: str,
    index: int,
    arm: WideArm,
    motions: Sequence[Motion],
    scale: Scale,
    rng: np.random.Generator,
    dry: bool,
) -> list[Planted]:
    names, wanted = (
        _wishes(block, index, arm.values, rng, dry),
        {"A": (1.5, 4.0), "C": (2.5, 5.0), "E": (3.0, 6.0)},
    )
    planted: list[Planted] = []
    for name in names:
        size = float(rng.uniform(*wanted[block]))
        one = _one(name, size, arm, motions, scale, rng, [p.injection for p in planted])
        spare = [other for other in names_for(block, arm.values) if other not in names]
        while one is None and spare:
            other = spare.pop(int(rng.integers(len(spare))))
            one = _one(other, size, arm, motions, scale, rng, [p.injection for p in planted])
        if one is not None:
            planted.append(one)
    return planted


def _wishes(block: str, index: int, values: Values, rng: np.random.Generator, dry: bool) -> list[str]:
    """Returns effects by name: in turn for A and E, a pair that is easily confused for half of C.

    With ``dry`` the first is a dry friction: the law of friction is what is asked about.
    """
    names = names_for(block, values)
    rubbing = [name for name in names if name in DRY]
    if dry and rubbing:
        first = str(rng.choice(rubbing))
        other = str(rng.choice([name for name in names if name not in (first, "external_contact")]))
        return [first, other] if block == "C" else [first]
    if block in "AE":
        every = names_for(block, _all_channels(values))
        order = np.random.default_rng(ord(block)).permutation(every)
        turn = [str(order[(index + k) % len(order)]) for k in range(len(order))]
        return [next(name for name in turn if name in names)]
    pairs = [pair for pair in CONFUSABLE if set(pair) <= set(names)]
    if index % 2 == 0 and pairs:
        return list(pairs[(index // 2) % len(pairs)])
    quiet = [name for name in names if name != "external_contact"]
    return [str(name) for name in rng.choice(quiet, 2 if index % 4 else 3, replace=False)]


def _all_channels(values: Values) -> dict[str, str]:
    rich = {"streams": "command+joint", "transmission": "spring", "velocity": "filtered", "stamps": "even"}
    return {**values, **rich, "robot": "ur5", "friction": "lugre"}


def _one(
    name: str, wanted: float, arm: WideArm, motions: Sequence[Motion], scale: Scale, rng: np.random.Generator,
    others: Sequence[Injection],
) -> Planted | None:  # fmt: skip
    """Draws joint and shape of an effect until it reaches its size; None where it never does."""
    peak, least, weight = peaks_of(motions)
    centre = motions[0].position.mean(axis=0)
    for _ in range(TRIES):
        joint = int(rng.integers(len(arm.drive.joints)))
        place = Situation(arm, joint, centre, peak, least, weight, rng)
        injection = draw_effect(name, place)
        if not visible(injection, arm.values) or any(_one_place(injection, other) for other in others):
            continue
        if arm.values["friction"] in ("constraint", "regularised"):
            injection = replace(injection, also=())  # these laws have no presliding that could be seen
        amplitude, size = scale.tune(injection, wanted)
        if 0.9 <= size.over(wanted) <= 3.0:
            also = {*injection.also, *twins(injection, arm.values)}
            also |= {
                other
                for other in simpler_than(name)
                if _alike(other, injection, amplitude, size, place, scale)
            }
            return Planted(injection, amplitude, size, tuple(sorted(also)))
    return None


def _alike(
    name: str, injection: Injection, amplitude: float, size: Size, place: Situation, scale: Scale
) -> bool:
    for _ in range(8):
        other = draw_effect(name, place)
        if other.port in (injection.port, "timing") or injection.port == "timing":
            return other.joints == injection.joints and scale.alike(injection, amplitude, size, other)
    return False


def _one_place(one: Injection, other: Injection) -> bool:
    """Tells whether two effects are one, or sit on the same joint and may be one there."""
    shared = set(one.joints) & set(other.joints)
    return one.effect == other.effect or (bool(shared) and are_one(one.effect, other.effect))


def write_case(
    folder: Path, arm: WideArm, motions: Sequence[Motion], repeats: Sequence[int | None],
    planted: Sequence[Planted], seed: int, simulate: Simulate,
) -> dict[str, Any]:  # fmt: skip
    """Simulates every motion with what is wrong, writes recordings and robot; returns what a tool is shown."""
    folder.mkdir(parents=True, exist_ok=True)
    names = []
    for i, motion in enumerate(motions):
        wrong = arm
        for one in planted:
            changed = one.injection.apply(wrong, one.amplitude, i)
            if not isinstance(changed, WideArm):
                raise TypeError(f"{one.injection.effect}: not an arm of this benchmark")
            wrong = changed
        raw = simulate(wrong.plan(motion.position, seed + i))
        if not np.all(np.isfinite(raw.true_position)):
            raise FloatingPointError(f"{folder}: the arm flew away")
        channels, rows = record(raw, wrong, seed + 500 + i)
        first = repeats[i]
        save(
            folder / f"run_{i + 1}.parquet",
            channels,
            rows,
            arm,
            None if first is None else f"run_{first + 1}",
        )
        names.append(f"run_{i + 1}.parquet")
    known = write_description(arm, folder / "robot")
    return {"robot": arm.machine.name, "known_by": known, "logs": names, "holdout": [], "without": []}


def truth_of(
    block: str, index: int, values: Values, frozen: str | None, planted: Sequence[Planted]
) -> dict[str, Any]:
    """Returns what is sealed of a case."""
    effects = [
        {
            "effect": one.injection.effect,
            "joints": list(one.injection.joints),
            "port": one.injection.port,
            "parameters": one.injection.parameters(one.amplitude),
            "also": list(one.also),
            "size": one.size.net,
            "share": one.size.share,
            "residual": one.size.residual,
        }
        for one in planted
    ]
    return {"block": block, "index": index, "frozen": frozen, "values": dict(values), "effects": effects}
