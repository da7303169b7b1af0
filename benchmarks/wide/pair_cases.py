# SPDX-License-Identifier: BSD-3-Clause
"""Block D: one arm with one cause, seen by a motion that cannot tell it from another and by one that can.

Pairs and poor motions are the blind benchmark's; arms, clocks, channels, controllers and engines vary as in the other
blocks. Whether logs can tell is measured on what they would hold without noise: what is left of the cause's residuals
once the partner imitates it best and links wrong by 3 % are allowed for, as a sum of squares over the noise of all
logs together.
"""

from __future__ import annotations

import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import count, islice
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.blind.case import ports_beside
from benchmarks.blind.excitation import RATE, Motion, choose_centre, poor_motion
from benchmarks.blind.injection import Injection, Situation
from benchmarks.blind.pair_cases import PAIRS, Pair
from benchmarks.wide.arms import WideArm, draw_arm, rigid
from benchmarks.wide.cases import MEASURED, SEEDS, Made, Planted, cut, truth_of, write_case
from benchmarks.wide.design import Values, draw_cases
from benchmarks.wide.effects import DRY, draw_effect, possible, twins
from benchmarks.wide.logs import SPARE
from benchmarks.wide.motions import draw_motions, peaks_of, repeated_after
from benchmarks.wide.plan import PERIOD, Plan, RawLog
from benchmarks.wide.size import Scale, Simulate, Size, left_by

Array = NDArray[np.float64]

LEAD = 3.0
"""Seconds that a poor motion goes on before its log begins: the start from rest would tell what the motion cannot."""
ALIKE, APART = 20.0, 100.0
"""Sum of squares, over all logs, below which no method can tell a pair, and above which a good one must."""
LARGEST = 3.0
"""Largest size of a cause in poor logs, over the least that counts as seen."""
TRIES = 6
"""Arms and joints that are drawn for one pair before the next pair has its turn."""
DRAWS = 60
"""Of an effect until it sits at a port where the pair is a pair."""


@dataclass(frozen=True)
class Seen:
    """A cause in one set of logs: motions, which repeats which, its size there, and how far its partner is apart."""

    motions: list[Motion]
    repeats: list[int | None]
    planted: Planted
    apart: float


def make_pair(index: int, seeds: str, frozen: str | None, folder: Path, simulate: Simulate) -> list[Made]:
    """Makes the poor and the rich logs of one arm, and writes them below ``folder``.

    Args:
        index: Of the case in its block.
        seeds: One of `SEEDS`.
        frozen: Dimension that has its frozen value, or None.
        folder: Where the cases' folders go.
        simulate: Runs a plan on the engine that it names.
    """
    values, mark = _values(index, seeds, frozen), 0 if frozen is None else zlib.crc32(frozen.encode())
    pairs = pairs_for(values, dry=frozen == "friction")
    for attempt in count():
        rng = np.random.default_rng((SEEDS[seeds], ord("D"), index, mark, attempt))
        pair = pairs[(index + attempt // TRIES) % len(pairs)]
        drawn = _draw(pair, draw_arm(values, rng), rng, simulate)
        if drawn is not None:
            break
    made = []
    arm, *both = drawn
    for motion, seen in zip(("poor", "rich"), both, strict=True):
        name = f"{int(rng.integers(16**10)):010x}"
        run = without_lead(simulate) if motion == "poor" else simulate
        seed = int(rng.integers(2**31))
        shown = write_case(folder / name, arm, seen.motions, seen.repeats, [seen.planted], seed, run)
        truth = truth_of("D", index, values, frozen, [seen.planted])
        told = {"motion": motion, "pair": [pair.truth, pair.partner], "apart": seen.apart}
        made.append(Made(name, shown, truth | told))
    return made


def _values(index: int, seeds: str, frozen: str | None) -> dict[str, str]:
    """Returns the values of one case; in long or many recordings a poor motion tells most pairs after all."""
    seed = (SEEDS[seeds], ord("D"), 0 if frozen is None else zlib.crc32(frozen.encode()))
    short = (one for one in draw_cases(seed, frozen) if int(one["seconds"]) * int(one["logs"]) <= 40)
    return next(islice(short, index, None))


def pairs_for(values: Values, *, dry: bool) -> list[Pair]:
    """Returns the pairs that the logged channels can show; with ``dry`` those with a dry friction as the cause."""
    return [
        pair for pair in PAIRS
        if all(possible(name, values) for name in (pair.truth, pair.partner)) and _ports(pair, values)
        and (not dry or pair.truth in DRY)
    ]  # fmt: skip


def _ports(pair: Pair, values: Values) -> tuple[str, ...]:
    return tuple(port for port in pair.ports if not (values["streams"] == "joint" and port == "actuator"))


def _draw(
    pair: Pair, arm: WideArm, rng: np.random.Generator, simulate: Simulate
) -> tuple[WideArm, Seen, Seen] | None:
    """Draws joint, motions and size once; None where the cause is not seen in both, or told in the wrong one."""
    seconds, logs = float(arm.values["seconds"]) + SPARE, int(arm.values["logs"])
    whole = logs * (seconds - SPARE) / min(seconds - SPARE, MEASURED)
    joint = int(rng.integers(len(arm.drive.joints)))
    motions, repeats = _poor_motions(pair, arm, joint, seconds, logs, rng)
    cause = _drawn(pair.truth, _ports(pair, arm.values), _place(arm, joint, motions, rng))
    if cause is None:
        return None
    partner = _drawn(pair.partner, ports_beside(cause.port), _place(arm, joint, motions, rng))
    if partner is None:
        return None
    scale = Scale(arm, cut(motions[0], LEAD), int(rng.integers(2**31)), without_lead(simulate))
    imitation = scale.signature(partner, partner.first)
    amplitude = _amplitude(scale, cause, imitation, whole)
    if amplitude is None:
        return None
    poor = _seen(scale, cause, amplitude, imitation, whole)
    if poor.apart > ALIKE:  # not quite in proportion: once more
        amplitude *= float(np.sqrt(0.7 * ALIKE / poor.apart))
        poor = _seen(scale, cause, amplitude, imitation, whole)
    if poor.apart > ALIKE or poor.size.over(1.0) < 1.0:
        return None
    others, again = draw_motions(arm.values, rigid(arm.machine).model, arm.drive, seconds, logs, rng)
    scale = Scale(arm, cut(others[0]), int(rng.integers(2**31)), simulate)
    rich = _seen(scale, cause, amplitude, scale.signature(partner, partner.first), whole)
    if rich.apart < APART or rich.size.over(1.0) < 1.0:
        return None
    also = twins(cause, arm.values)
    return (
        arm,
        Seen(motions, repeats, Planted(cause, amplitude, poor.size, also), poor.apart),
        Seen(others, again, Planted(cause, amplitude, rich.size, also), rich.apart),
    )


@dataclass(frozen=True)
class _Told:
    """How large a cause is in some logs, and how far its partner is apart."""

    size: Size
    apart: float


def _amplitude(scale: Scale, cause: Injection, imitation: Mapping[str, Array], whole: float) -> float | None:
    """Returns the amplitude that is as large as the partner can still imitate, `LARGEST` times the least at most.

    Both effects are taken as proportional to their amplitudes; what came out is measured afterwards. None where the
    cause would be too small to be seen.
    """
    seen = scale.signature(cause, cause.first)
    over = max(scale.size_of(seen).over(1.0), 1e-6)
    most = np.sqrt(0.7 * ALIKE / max(whole * left_by(imitation, seen), 1e-9))
    amplitude = min(cause.first * float(min(most, LARGEST / over)), cause.most)
    return amplitude if over * amplitude >= cause.first else None


def _seen(
    scale: Scale, cause: Injection, amplitude: float, imitation: Mapping[str, Array], whole: float
) -> _Told:
    seen = scale.signature(cause, amplitude)
    return _Told(scale.size_of(seen), whole * left_by(imitation, seen))


def _poor_motions(
    pair: Pair, arm: WideArm, joint: int, seconds: float, logs: int, rng: np.random.Generator
) -> tuple[list[Motion], list[int | None]]:
    """Draws motions of which one joint always makes the same; they begin `LEAD` before their logs."""
    model = rigid(arm.machine).model
    time = np.arange(round((LEAD + seconds) * RATE)) / RATE
    path, centre = pair.motion(time, rng), choose_centre(model, arm.drive, rng)
    return repeated_after(arm.values, logs, lambda: poor_motion(path, joint, centre, model, arm.drive, rng))


def _place(arm: WideArm, joint: int, motions: Sequence[Motion], rng: np.random.Generator) -> Situation:
    return Situation(arm, joint, motions[0].position.mean(axis=0), *peaks_of(motions), rng)


def _drawn(name: str, ports: Sequence[str], place: Situation) -> Injection | None:
    """Draws an effect until it sits on one joint, at one of the ports, and no second name is as true; else None."""
    law = place.arm.values["friction"] if isinstance(place.arm, WideArm) else ""
    for _ in range(DRAWS):
        found = draw_effect(name, place)
        pure = not found.also or law in ("constraint", "regularised")
        if found.port in ports and found.joints == (place.name,) and pure:
            return found
    return None


def without_lead(simulate: Simulate) -> Simulate:
    """Returns a simulation whose logs begin `LEAD` after its motion."""
    first = round(LEAD / PERIOD)

    def simulated(plan: Plan) -> RawLog:
        raw = simulate(plan)
        return RawLog(
            raw.position[first:], raw.effort[first:], raw.command[first:], raw.target[first:],
            raw.true_position[first:], raw.true_velocity[first:],
        )  # fmt: skip

    return simulated
