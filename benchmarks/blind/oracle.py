# SPDX-License-Identifier: BSD-3-Clause
"""How far an answer closes the gap on the held-out motion, measured on the arm itself, beside an oracle.

The held-out run is simulated without noise on three arms: with nothing wrong, with the truth, and with what the tool
named, at the numbers it named. The gap is what the truth adds to the nominal residual, in units of noise, less what
link inertias could imitate; what the answer leaves of it counts. The oracle knows cause, joint, port and shape; it
fits the amplitude to the recorded training logs, by one Gauss-Newton step from the true one:

    a = a_0 + J^T r / J^T J,    r = residual of the log less that of the true arm without noise
"""

from __future__ import annotations

import json
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.blind.answers import read_answer
from benchmarks.blind.applied_answer import apply_answer
from benchmarks.blind.blocks import SEALED, Drawn, draw_case
from benchmarks.blind.case import apply_all
from benchmarks.blind.logs import read_log
from benchmarks.blind.noise_scale import NoiseScale
from benchmarks.blind.plant import Arm

Array = NDArray[np.float64]

STEP = 0.05
"""Relative step of the derivative by the amplitude."""
NOT_MEASURED = ("external_contact", "clock_drift")
"""No answer holds what it would need: pushes of another run, and which of the clocks it is that drifts."""


@dataclass(frozen=True)
class Gap:
    """On the held-out motion: gap over noise, shares closed by oracle and tool, and what the tool promised.

    Attributes:
        before: Rms of the gap in units of noise, over all joints and ports.
        oracle: 1 - what the oracle leaves / before.
        tool: 1 - what the tool leaves / before.
        promised: The tool's own ``shrink``, or None.
        not_worn: Effects of the answer that cannot be applied to the arm.
    """

    before: float
    oracle: float
    tool: float
    promised: float | None
    not_worn: tuple[str, ...]


def gap_of(out: Path, answers: Path, tool: str, name: str, seeds: str, truth: dict[str, Any]) -> Gap | None:
    """Measures one case with a single planted effect; None where the tool gave no answer.

    Args:
        out: Folder of the cases.
        answers: Folder of the answers.
        tool: Whose answer.
        name: Of the case.
        seeds: It was drawn from.
        truth: Its sealed record, which says block and index.
    """
    answer = read_answer(answers / tool, name, ())
    if answer is None:
        return None
    drawn = draw_case(truth["block"], truth["index"], seeds)
    unseen = next(i for i, episode in enumerate(drawn.episodes) if episode.held_out)
    scale = NoiseScale(
        drawn.bench.arm, [drawn.episodes[unseen].motion], drawn.bench.gains, drawn.bench.noise_level, 1
    )
    amplitude = _fit(drawn, out / "cases" / name)
    _, gap = scale.signature(lambda arm, _: _true(drawn, arm, unseen, None))
    _, known = scale.signature(lambda arm, _: _true(drawn, arm, unseen, amplitude))
    not_worn = apply_answer(drawn.bench.arm, list(answer.causes))[1]
    _, said = scale.signature(lambda arm, _: apply_answer(arm, list(answer.causes))[0])
    before = _rms(gap)
    closed = [1.0 - _rms(gap - one) / before for one in (known, said)]
    return Gap(before, closed[0], closed[1], answer.shrink, not_worn)


def _true(drawn: Drawn, arm: Arm, episode: int, amplitude: float | None) -> Arm:
    one = drawn.planted[0]
    return one.injection.apply(arm, one.amplitude if amplitude is None else amplitude, episode)


def _fit(drawn: Drawn, folder: Path) -> float:
    """Fits the amplitude of the one planted effect to the logs of the two motions that sized it."""
    true = drawn.planted[0].amplitude
    index = [i for i, one in enumerate(drawn.episodes) if one.repeats is None and not one.held_out][:2]
    motions = [drawn.episodes[i].motion for i in index]
    scale = NoiseScale(drawn.bench.arm, motions, drawn.bench.gains, drawn.bench.noise_level, 1)
    _, at = scale.signature(partial(_applied, drawn, 1.0))
    _, beyond = scale.signature(partial(_applied, drawn, 1.0 + STEP))
    slope = ((beyond - at) / (STEP * true)).reshape(-1)
    logs = [read_log(folder / f"run_{i + 1}.parquet").channels for i in index]
    left = scale.excess(logs, [apply_all(drawn.bench, drawn.planted, i) for i in index])
    return float(true + slope @ left.reshape(-1) / (slope @ slope))


def _applied(drawn: Drawn, factor: float, arm: Arm, episode: int) -> Arm:
    return _true(drawn, arm, episode, factor * drawn.planted[0].amplitude)


def _rms(signature: Array) -> float:
    return float(np.sqrt(np.mean(signature**2)))


def write_gap(path: Path, gap: Gap) -> None:
    """Writes one measured gap beside the answer."""
    path.write_text(json.dumps(gap.__dict__) + "\n")


def measure_gaps(out: Path, answers: Path, tool: str, jobs: int, tell: Callable[[str], None]) -> None:
    """Writes NAME.gap.json for every answered case of block A at or above the noise that has none yet."""
    sealed = json.loads((out / SEALED / "A.json").read_text())
    waiting = {
        name: truth
        for name, truth in sealed["cases"].items()
        if _counts(truth) and not gap_file(answers, tool, name).exists()
    }
    with ProcessPoolExecutor(jobs) as pool:
        asked = {
            name: pool.submit(gap_of, out, answers, tool, name, sealed["seeds"], truth)
            for name, truth in waiting.items()
        }
        for i, (name, one) in enumerate(asked.items()):
            found = one.result()
            if found is not None:
                write_gap(gap_file(answers, tool, name), found)
            tell(f"gap {i + 1}/{len(asked)} {name} {found}")


def gap_file(answers: Path, tool: str, name: str) -> Path:
    """Returns where the gap of one answer is kept."""
    return answers / tool / f"{name}.gap.json"


def read_gap(answers: Path, tool: str, name: str) -> Gap | None:
    """Returns a measured gap, or None where none was measured."""
    path = gap_file(answers, tool, name)
    if not path.exists():
        return None
    numbers: dict[str, Any] = json.loads(path.read_text())
    return Gap(**{**numbers, "not_worn": tuple(numbers["not_worn"])})


def _counts(truth: dict[str, Any]) -> bool:
    effect = truth["effects"][0]
    return effect["size"] >= 1.0 and effect["effect"] not in NOT_MEASURED
