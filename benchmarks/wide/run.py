# SPDX-License-Identifier: BSD-3-Clause
"""Asks `impedance diagnose` about every case, in a folder that holds copies of its recordings and its robot alone."""

from __future__ import annotations

import json
import shutil
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.blind.run import ask_waiting, measured
from benchmarks.wide.thresholds import changes_of

ANSWERS, CASES, SEALED = "answers", "cases", "sealed"


@dataclass(frozen=True)
class Selection:
    """Which cases are asked about: blocks and names (all where empty), ``again``, processor time [s], and how.

    ``changes`` are NAME=VALUE of hand-set numbers of the diagnosis (`benchmarks.wide.thresholds`).
    """

    blocks: tuple[str, ...] = ()
    cases: tuple[str, ...] = ()
    again: bool = False
    timeout: float = 240.0
    jobs: int = 1
    tolerance: float | None = None
    changes: tuple[str, ...] = ()


def run_all(out: Path, answers: Path, selection: Selection, tell: Callable[[str], None]) -> None:
    """Asks about all chosen cases that have no answer yet; stopped and started again it goes on."""
    changes_of(selection.changes)  # a name that is wrong is refused before the first case
    answers.mkdir(parents=True, exist_ok=True)
    names = [
        name for name in names_of(out, selection.blocks) if not selection.cases or name in selection.cases
    ]

    def one(name: str) -> str:
        record = run_case(out / CASES / name, selection, answers / f"{name}.json")
        (answers / f"{name}.run.json").write_text(json.dumps(record) + "\n")
        return (
            f"{name} exit {record['exit']} {record['processor_seconds']:.1f} s {record['memory_mb']:.0f} MB"
        )

    ask_waiting(names, answers, one, tell, again=selection.again, jobs=selection.jobs)


def names_of(out: Path, blocks: Sequence[str]) -> list[str]:
    """Returns the case names of some blocks in alphabetic order, which says nothing about the truth."""
    found: list[str] = []
    for sealed in sorted((out / SEALED).glob("*.json")):
        truth = json.loads(sealed.read_text())
        if not blocks or truth["block"] in blocks:
            found += list(truth["cases"])
    return sorted(found)


def run_case(case: Path, selection: Selection, answer: Path, program: Sequence[str] = ()) -> dict[str, Any]:
    """Asks about one case; returns exit, wall and processor seconds, memory [MB] and the end of what was printed.

    ``program`` are the words after ``python -m`` that stand for ``impedance``, where it is another one.
    """
    shown = json.loads((case / "case.json").read_text())
    with tempfile.TemporaryDirectory(prefix="wide-") as room:
        for name in shown["logs"]:
            shutil.copy(case / name, room)
        shutil.copytree(case / "robot", Path(room) / shown["robot"])
        asked = words(shown, selection, answer.resolve())
        changed = ["benchmarks.wide.thresholds", *selection.changes, "--"] if selection.changes else None
        started = program or changed or ["impedance_modules"]
        return measured([sys.executable, "-m", *started, *asked], Path(room), selection.timeout)


def words(shown: dict[str, Any], selection: Selection, answer: Path) -> list[str]:
    """Returns the words of the command, as a stranger with this robot and these recordings would type them."""
    tolerance = [] if selection.tolerance is None else ["--tolerance", str(selection.tolerance)]
    return ["diagnose", *shown["logs"], *model_words(shown), "--json", str(answer), *tolerance]


def model_words(shown: Mapping[str, Any]) -> list[str]:
    """Returns the words that name the robot of a case: its folder where it has a robot file, its URDF otherwise."""
    robot = shown["robot"]
    if shown["known_by"] == "robot_file":
        return ["--robot", f"./{robot}"]
    return ["--urdf", f"{robot}/{robot}.urdf"]
