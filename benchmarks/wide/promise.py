# SPDX-License-Identifier: BSD-3-Clause
"""What a diagnosis promises, and what its patch does to a recording that the diagnosis never saw.

One recording of a case is withheld; the others are diagnosed, and the patch is written. Then the withheld recording
is laid over the model as it was, and over the model with the patch:

    promised = gap.shrink of the diagnosis
    obtained = 1 - sqrt(sum_g max(0, after_g^2 / floor_g^2 - 1) / sum_g max(0, before_g^2 / floor_g^2 - 1))

over the residuals g of all joints, before_g, after_g their rms without and with the patch, floor_g the noise of the
withheld recording. Nothing is fitted to the withheld recording, links neither.
"""

from __future__ import annotations

import json
import shutil
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.blind.run import ask_waiting, measured
from benchmarks.wide.run import CASES, Selection, model_words, names_of

LEAST_LOGS = 3
"""Recordings that a case must have: two that are diagnosed, one of them held out, and the one that is withheld."""
POINTS = (5.0, 10.0)
"""Differences [points] whose share of cases is printed: the target, and the floor."""


@dataclass(frozen=True)
class Promise:
    """Of one case: the shares of the gap that were promised and obtained.

    Attributes:
        verdict: Of the diagnosis.
        promised: ``gap.shrink``; None where there is no gap.
        obtained: On the withheld recording; None where nothing was promised, or it has no gap.
        causes: ids of the patch.
    """

    verdict: str
    promised: float | None
    obtained: float | None
    causes: tuple[str, ...]


def keep_promises(
    out: Path, answers: Path, blocks: Sequence[str], jobs: int, tell: Callable[[str], None]
) -> str:
    """Measures all cases with enough recordings that have no record yet; returns the table."""
    answers.mkdir(parents=True, exist_ok=True)
    names = [name for name in names_of(out, blocks) if len(_shown(out / CASES / name)["logs"]) >= LEAST_LOGS]

    def one(name: str) -> str:
        promise = promise_of(out / CASES / name)
        (answers / f"{name}.run.json").write_text(json.dumps(asdict(promise)) + "\n")
        return f"{name} {promise}"

    ask_waiting(names, answers, one, tell, again=False, jobs=jobs)
    read = [json.loads((answers / f"{name}.run.json").read_text()) for name in names]
    return table([Promise(**{**item, "causes": tuple(item["causes"])}) for item in read])


def promise_of(case: Path) -> Promise:
    """Withholds the last recording of a case, diagnoses the others, and applies the patch to it.

    Raises:
        ValueError: The withheld recording got no answer.
    """
    shown = _shown(case)
    *given, withheld = shown["logs"]
    with tempfile.TemporaryDirectory(prefix="promise-") as folder:
        room = Path(folder)
        shutil.copytree(case / "robot", room / shown["robot"])
        for name in shown["logs"]:
            shutil.copy(case / name, room)
        said = _ask(room, shown, [*given, "--patch", "found.yaml"])
        if said is None:
            return Promise("no answer", None, None, ())
        causes = tuple(str(effect["effect"]) for effect in (said["patch"] or {"effects": ()})["effects"])
        promised = said["gap"]["shrink"]
        if promised is None or not causes:
            return Promise(said["verdict"], promised, None, causes)
        whole = [given[0], "--holdout", withheld]
        before = _ask(room, shown, whole)
        after = _ask(room, shown, [*whole, "--effects", "found.yaml"])
    if before is None or after is None:
        raise ValueError(f"{case.name}: {withheld} got no answer")
    return Promise(said["verdict"], promised, obtained(before["gap"], after["gap"]), causes)


def obtained(before: Mapping[str, Any], after: Mapping[str, Any]) -> float | None:
    """Share of a recording's gap that a patch closes; None where there is no gap beyond the noise.

    Args:
        before: ``gap`` of the diagnosis of the recording with the model as it was.
        after: The same with the patch. Of both the ``before`` is used, in which nothing is fitted.
    """
    left = {(gap["joint"], gap["residual"]): gap["before"] for gap in after["per_port"]}
    squares = np.array(
        [
            [max(0.0, (rms / gap["noise_floor"]) ** 2 - 1.0) for rms in (gap["before"], left[key])]
            for gap in before["per_port"]
            if (key := (gap["joint"], gap["residual"])) in left
        ]
    )
    whole, rest = np.sum(squares, axis=0)
    return None if whole <= 0.0 else float(1.0 - np.sqrt(rest / whole))


def table(promises: Sequence[Promise]) -> str:
    """Returns how far promises are from what was obtained: median, nine of ten, and shares within some points."""
    rows = [
        "| verdict | cases | promised | obtained | promised less obtained: median, nine of ten | within 5, 10 points |"
    ]
    rows.append("|---|---|---|---|---|---|")
    kept = [item for item in promises if item.obtained is not None]
    for verdict in sorted({item.verdict for item in kept}):
        rows.append(_row(verdict, [item for item in kept if item.verdict == verdict]))
    rows.append(_row("all", kept))
    return "\n".join([*rows, "", f"{len(promises) - len(kept)} more cases promised nothing.", ""])


def _row(title: str, promises: Sequence[Promise]) -> str:
    said = 100.0 * np.array([item.promised for item in promises], dtype=float)
    got = 100.0 * np.array([item.obtained for item in promises], dtype=float)
    if not promises:
        return f"| {title} | 0 | | | | |"
    apart = np.abs(said - got)
    within = ", ".join(f"{int(np.sum(apart <= points))}/{len(apart)}" for points in POINTS)
    return (
        f"| {title} | {len(apart)} | {np.median(said):.0f} % | {np.median(got):.0f} % | {np.median(said - got):+.1f},"
        f" {np.quantile(apart, 0.9):.1f} | {within} |"
    )


def _ask(room: Path, shown: Mapping[str, Any], words: Sequence[str]) -> dict[str, Any] | None:
    answer = room / "answer.json"
    answer.unlink(missing_ok=True)
    command = ["diagnose", *words, *model_words(shown), "--json", answer.name]
    measured([sys.executable, "-m", "impedance_modules", *command], room, Selection().timeout)
    if not answer.exists():
        return None
    found: dict[str, Any] = json.loads(answer.read_text())
    return found


def _shown(case: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((case / "case.json").read_text())
    return found
