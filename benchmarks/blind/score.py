# SPDX-License-Identifier: BSD-3-Clause
"""Opens the seals, compares every answer with its truth, and writes the tables and the list of wrong answers."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from benchmarks.blind.answers import Answer, read_answer
from benchmarks.blind.blocks import SEALED, SEALS, seal_of
from benchmarks.blind.figures import FIGURES, by_block, by_kind, by_size
from benchmarks.blind.judged import Cases, Judged, is_right
from benchmarks.blind.oracle import read_gap

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
        lines += ["", *by_kind(cases)]
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


def wrong_list(cases: Cases) -> str:
    """Returns one paragraph per wrong case, block by block; after it the blocks' counts."""
    wrong = sorted((case for case in cases if not is_right(case)), key=lambda case: (case.block, case.name))
    return "\n\n".join(describe(case) for case in wrong) + "\n"


def describe(case: Judged) -> str:
    """Returns truth, answer and the first rivals of one case."""
    motion = f" {case.truth['motion']}" if "motion" in case.truth else ""
    head = f"{case.block}{motion} {case.name}  noise x{case.truth['noise_level']:g}"
    head += f", inertias {100 * case.truth['inertia_error']:.1f} % off"
    head += f"  {case.answer.processor_seconds:.1f} s {case.answer.memory:.0f} MB"
    lines = [head, *(f"  truth   {_truth(effect)}" for effect in case.effects)]
    if not case.effects:
        lines.append("  truth   nothing")
    if case.block == "D":
        lines.append(f"  pair    {' / '.join(case.truth['pair'])}, apart {case.truth['apart']:.0f}")
    lines.append(f"  answer  {case.answer.verdict}")
    for cause in case.answer.causes[:4]:
        lines += _cause(cause)
    if case.answer.errors and not case.answer.causes:
        lines.append(f"  stderr  {case.answer.errors.strip().splitlines()[-1][:200]}")
    return "\n".join(lines)


def _truth(effect: Mapping[str, Any]) -> str:
    also = f" (or {', '.join(effect['also'])})" if effect["also"] else ""
    where = ",".join(effect["joints"]) if len(effect["joints"]) < 4 else "all joints"
    return (
        f"{effect['effect']}{also} {where or '-'} at {effect['port']}, size {_short(effect.get('size'))}"
        f" ({_short(effect.get('size_with_inertias'))} with inertias): {_numbers(effect['parameters'])}"
    )


def _cause(cause: Mapping[str, Any]) -> list[str]:
    joints = ",".join(cause.get("joints", [])) or "-"
    line = (
        f"    cause {cause['effect']} {joints} at {cause.get('port')}, weight {_short(cause.get('weight'))}"
    )
    line += f", shrink {_short(cause.get('shrink'))}: {_numbers(cause.get('parameters', {}))}"
    lines = [line]
    same = [f"{one['effect']} {','.join(one.get('joints', []))}" for one in cause.get("equivalent", [])]
    if same:
        lines.append(f"      equivalent {'; '.join(same[:5])}")
    for rival in cause.get("rivals", [])[:3]:
        lines.append(
            f"      rival {rival['effect']} {','.join(rival.get('joints', []))}: {rival.get('lost_because', '')}"
        )
    return lines


def _numbers(parameters: Mapping[str, Any]) -> str:
    parts = []
    for key, symbols in list(parameters.items())[:3]:
        words = " ".join(f"{symbol}={_value(value)}" for symbol, value in symbols.items())
        parts.append(f"{key} {words}")
    return "; ".join(parts)


def _value(value: Any) -> str:
    if isinstance(value, Mapping):
        spread = f"+-{_short(value['std'])}" if value.get("std") is not None else ""
        return f"{_short(value.get('value'))}{spread}"
    return _short(value)


def _short(value: Any) -> str:
    return f"{value:.3g}" if isinstance(value, (int, float)) else str(value)


def confusion(cases: Cases) -> dict[str, dict[str, int]]:
    """Returns truth -> first cause (or verdict) -> how often, over single effects at or above the noise."""
    table: dict[str, Counter[str]] = {}
    for case in cases:
        if case.block == "A" and case.size >= 1.0:
            table.setdefault(case.effects[0]["effect"], Counter())[
                _said(case.answer.first, case.first_right)
            ] += 1
    return {truth: dict(row.most_common()) for truth, row in sorted(table.items())}


def worst_cells(cases: Cases, most: int = 12) -> list[str]:
    """Returns a table of the most frequent mistakes in the whole benchmark's blocks of one effect."""
    wrong: Counter[tuple[str, str]] = Counter()
    for case in cases:
        one = len(case.effects) == 1 and (case.block in "AG" or case.truth.get("motion") == "rich")
        if one and case.size >= 1.0 and not case.first_right:
            wrong[case.effects[0]["effect"], case.answer.first] += 1
    rows = ["| truth | said | times |", "|---|---|---|"]
    return rows + [f"| {truth} | {said} | {times} |" for (truth, said), times in wrong.most_common(most)]


def _said(first: str, right: bool) -> str:
    return first if right else f"{first} (wrong)"
