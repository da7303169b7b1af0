# SPDX-License-Identifier: BSD-3-Clause
"""Measures the gaps of all answered cases of block A in parallel, and keeps them beside the answers."""

from __future__ import annotations

import json
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

from benchmarks.blind.generate import SEALED
from benchmarks.blind.oracle import Gap, gap_of, write_gap

NOT_MEASURED = ("external_contact", "clock_drift")
"""No answer holds what it would need: pushes of another run, and which of the clocks it is that drifts."""


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
