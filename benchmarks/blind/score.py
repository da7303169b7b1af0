# SPDX-License-Identifier: BSD-3-Clause
"""Opens the seals, lays every answer beside its truth, and writes the tables."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from benchmarks.blind.answers import Answer, read_answer
from benchmarks.blind.confusion import confusion, worst_cells
from benchmarks.blind.figures import FIGURES, by_block, by_size
from benchmarks.blind.gaps import read_gap
from benchmarks.blind.generate import SEALED, SEALS, seal_of
from benchmarks.blind.judged import Judged
from benchmarks.blind.wrong import describe, wrong_list

TITLES = {"impedance": "impedance diagnose", "least-squares": "least squares", "sysid": "mujoco.sysid"}


def score_all(out: Path, answers: Path) -> str:
    """Scores every tool that was run, writes score.md, score.json and wrong_TOOL.txt, and returns score.md's text.

    Args:
        out: Folder of the cases and their sealed truth.
        answers: Folder of the answers, one folder per tool.

    Raises:
        ValueError: A sealed file is not the one whose hash was written when it was made.
    """
    check_seals(out)
    judged = {tool: judge(out, answers, tool) for tool in TITLES if (answers / tool).is_dir()}
    lines = ["| figure | target (floor) | " + " | ".join(TITLES[tool] for tool in judged) + " |"]
    lines.append("|---" * (2 + len(judged)) + "|")
    numbers: dict[str, dict[str, str]] = {}
    for figure in FIGURES:
        values = {tool: figure.count(cases) for tool, cases in judged.items()}
        numbers[figure.title] = values
        lines.append(f"| {figure.title} | {figure.target} | " + " | ".join(values.values()) + " |")
    for tool, cases in judged.items():
        lines += ["", f"{TITLES[tool]}, block by block", "", *by_block(cases)]
        lines += ["", f"{TITLES[tool]}: single effects (block A) by size over noise", "", *by_size(cases)]
        lines += ["", f"{TITLES[tool]}: most frequent wrong first causes", "", *worst_cells(cases)]
        (answers / f"wrong_{tool}.txt").write_text(wrong_list(cases))
    text = "\n".join(lines) + "\n"
    (answers / "score.md").write_text(text)
    tables = {tool: confusion(cases) for tool, cases in judged.items()}
    (answers / "score.json").write_text(
        json.dumps({"figures": numbers, "confusion": tables}, indent=1) + "\n"
    )
    return text


def show_case(out: Path, answers: Path, name: str) -> str:
    """Returns truth and every tool's answer of one case."""
    judged = {tool: judge(out, answers, tool) for tool in TITLES if (answers / tool).is_dir()}
    shown = [
        f"{TITLES[tool]}\n{describe(case)}"
        for tool, cases in judged.items()
        for case in cases
        if case.name == name
    ]
    return "\n\n".join(shown) or f"{name}: no tool has answered a case of that name in {answers}"


def check_seals(out: Path) -> None:
    """Compares every sealed file with the last hash written for it.

    Raises:
        ValueError: They differ.
    """
    seals = {}
    for line in (out / SEALS).read_text().splitlines():
        words = line.split()
        seals[words[1]] = words[0]
    for path in sorted((out / SEALED).glob("*.json")):
        if seals.get(f"{SEALED}/{path.name}") != seal_of(path):
            raise ValueError(f"{path}: not the truth that was sealed (its SHA-256 is {seal_of(path)})")


def judge(out: Path, answers: Path, tool: str) -> list[Judged]:
    """Returns every case that a tool was asked about."""
    found = []
    for sealed in sorted((out / SEALED).glob("*.json")):
        cases: dict[str, dict[str, Any]] = json.loads(sealed.read_text())["cases"]
        for name, truth in cases.items():
            answer: Answer | None = read_answer(answers / tool, name, truth.get("surroundings", []))
            if answer is not None:
                found.append(Judged(name, truth, answer, read_gap(answers, tool, name)))
    return found
