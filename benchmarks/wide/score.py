# SPDX-License-Identifier: BSD-3-Clause
"""Opens the seals and counts: every figure for all cases and for each value of each dimension, and the worst value.

A case that got no answer (a refusal, too) is wrong in every figure, and is counted apart as well. Recordings that a
tool may refuse with reason (`doubled` stamps) are therefore seen in their own line.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.blind.answers import NO_ANSWER, is_cause, read_answer
from benchmarks.blind.figures import Rate
from benchmarks.blind.judged import Judged, all_found, left_open, truth_reported, wrongly_named
from benchmarks.wide.blocks import SEALS, check_seals
from benchmarks.wide.design import DIMENSIONS
from benchmarks.wide.effects import DRY
from benchmarks.wide.reliability import brier_score, table_of
from benchmarks.wide.run import CASES, SEALED

Cases = Sequence[Judged]
FEW = 5
"""Cases that a value must have to be called the worst."""


@dataclass(frozen=True)
class Figure:
    """A column of the tables: title, blocks that it counts, what counts, and whether few or many are good.

    Of block D it counts the logs of one ``motion``, poor or rich, where one is given.
    """

    title: str
    blocks: str
    right: Callable[[Judged], bool]
    more_is_better: bool = True
    motion: str | None = None

    def rate(self, cases: Cases) -> Rate:
        """Counts the cases of its blocks."""
        return Rate.of([self.right(case) for case in cases if self.counts(case)])

    def counts(self, case: Judged) -> bool:
        """Tells whether a case is one of those that it counts."""
        return case.block in self.blocks and self.motion in (None, case.truth.get("motion"))


def clean(case: Judged) -> bool:
    """Nothing was found where nothing is."""
    return case.answer.verdict == "no_gap"


def explained(case: Judged) -> bool:
    """Explained, by true causes alone."""
    causes = case.answer.causes
    return case.answer.named and all(
        any(is_cause(causes, at, effect) for effect in case.effects) for at in range(len(causes))
    )


def refused_with_pair(case: Judged) -> bool:
    """Ambiguous, and one cause and its equivalents hold truth and partner, both at the true joint."""
    joints, pair = set(case.effects[0]["joints"]), set(case.truth["pair"])

    def names(cause: Mapping[str, Any]) -> set[str]:
        every = (cause, *cause.get("equivalent", []))
        return {str(one["effect"]) for one in every if set(one.get("joints", [])) & joints}

    return case.answer.verdict == "ambiguous" and any(pair <= names(cause) for cause in case.answer.causes)


def decided(case: Judged) -> bool:
    """The first cause is the true one, and no choice is left open."""
    return case.first_right and case.answer.verdict != "ambiguous"


def found_and_answered(case: Judged) -> bool:
    """Every planted effect is a cause or equivalent to one."""
    return case.answer.verdict != NO_ANSWER and truth_reported(case)


def silent(case: Judged) -> bool:
    """No answer at all: a refusal, an error, or the time was up."""
    return case.answer.verdict == NO_ANSWER


FIGURES = (
    Figure("clean without alarm (B)", "B", clean),
    Figure("first cause and joint (A)", "A", lambda case: case.first_right),
    Figure("in the set (A)", "A", found_and_answered),
    Figure("explained, by it alone (A)", "A", explained),
    Figure("all of two or three (C)", "C", all_found),
    Figure("poor motion refused with the pair (D)", "D", refused_with_pair, motion="poor"),
    Figure("rich motion decided (D)", "D", decided, motion="rich"),
    Figure("left open (E)", "E", left_open),
    Figure("confident wrong name (E)", "E", wrongly_named, more_is_better=False),
    Figure("no answer (all)", "ABCDE", silent, more_is_better=False),
)


def score_all(out: Path, answers: Path) -> str:
    """Scores development and each frozen variety apart; writes score.md and wrong.txt beside the answers.

    Raises:
        ValueError: Nothing was made there, or a sealed file is not the one whose hash was written when it was.
    """
    if not (out / SEALS).exists():
        raise ValueError(f"{out}: no cases with a sealed truth (valid: a folder that `generate` made)")
    check_seals(out)
    cases = judge(out, answers)
    lines: list[str] = []
    frozen = sorted({str(case.truth["frozen"]) for case in cases if case.truth["frozen"] is not None})
    for variety in (None, *frozen):
        part = [case for case in cases if case.truth["frozen"] == variety]
        if part:
            title = (
                "development" if variety is None else f"frozen {variety}: {part[0].truth['values'][variety]}"
            )
            lines += [f"### {title}", "", *overview(part), "", *by_value(part), ""]
    lines += [
        "### single effects",
        "",
        *by_effect(cases),
        "",
        "### probabilities",
        "",
        *by_probability(cases),
    ]
    text = "\n".join(lines) + "\n"
    (answers / "score.md").write_text(text)
    (answers / "wrong.txt").write_text(wrong_list(out, answers, cases))
    return text


def judge(out: Path, answers: Path) -> list[Judged]:
    """Returns every case that was asked about."""
    found = []
    for sealed in sorted((out / SEALED).glob("*.json")):
        for name, truth in json.loads(sealed.read_text())["cases"].items():
            answer = read_answer(answers, name, [])
            if answer is not None:
                found.append(Judged(name, truth, answer))
    return found


def overview(cases: Cases) -> list[str]:
    """Returns one row per figure: all cases, those that were answered, and the worst value of any dimension."""
    rows = ["| figure | all | answered | worst value |", "|---|---|---|---|"]
    answered = [case for case in cases if not silent(case)]
    for figure in FIGURES:
        worst = _worst(figure, cases)
        rows.append(f"| {figure.title} | {figure.rate(cases)} | {figure.rate(answered)} | {worst} |")
    seconds = sorted(case.answer.processor_seconds for case in answered)
    within = [flag for case in cases if case.block == "A" and case.first_right for flag in covered(case)]
    rows.append(f"| 95 % intervals that cover the truth (A, right ones) | {Rate.of(within)} | | |")
    if seconds:
        rows.append(
            f"| processor time | {seconds[len(seconds) // 2]:.0f} s median, {seconds[-1]:.0f} s longest | | |"
        )
    return rows


def covered(case: Judged) -> list[bool]:
    """Tells, for each number that truth and first cause both state, whether value +- 1.96 std covers the truth."""
    cause, flags = case.answer.causes[0], []
    for effect in case.effects:
        for key, symbols in effect["parameters"].items() if effect["effect"] == cause["effect"] else ():
            said = cause.get("parameters", {}).get(key, {})
            for symbol, true in symbols.items():
                quantity = said.get(symbol) or {}
                if quantity.get("value") is not None and quantity.get("std") is not None:
                    flags.append(abs(float(quantity["value"]) - true) <= 1.96 * float(quantity["std"]))
    return flags


def by_probability(cases: Cases) -> list[str]:
    """Returns, by the probability that a cause is said with, how many of those causes are true."""
    said: list[float] = []
    true: list[bool] = []
    for case in cases:
        for at, cause in enumerate(case.answer.causes):
            if cause.get("probability") is not None:
                said.append(float(cause["probability"]))
                true.append(any(is_cause(case.answer.causes, at, effect) for effect in case.effects))
    if not said:
        return ["No cause has a probability."]
    return [*table_of(said, true), "", f"Brier score {brier_score(said, true):.3f} of {len(said)} causes."]


def by_value(cases: Cases) -> list[str]:
    """Returns one row per value of every dimension, one column per figure."""
    rows = ["| dimension | value | " + " | ".join(figure.title for figure in FIGURES) + " |"]
    rows.append("|---" * (2 + len(FIGURES)) + "|")
    for dimension in DIMENSIONS:
        for value, part in _parts(dimension, cases):
            rates = " | ".join(_short(figure.rate(part)) for figure in FIGURES)
            rows.append(f"| {dimension} | {value} | {rates} |")
    return rows


def by_effect(cases: Cases) -> list[str]:
    """Returns one row per effect of block A."""
    rows = ["| effect | first | in the set | explained | first causes said |", "|---|---|---|---|---|"]
    single = [case for case in cases if case.block == "A" and case.effects]
    for effect in sorted({case.effects[0]["effect"] for case in single}):
        part = [case for case in single if case.effects[0]["effect"] == effect]
        rates = " | ".join(_short(figure.rate(part)) for figure in FIGURES[1:4])
        rows.append(f"| {effect} | {rates} | {', '.join(case.answer.first for case in part)} |")
    return rows


def _parts(dimension: str, cases: Cases) -> list[tuple[str, list[Judged]]]:
    """Returns the cases of each value; a law of friction counts where dry friction was planted."""
    if dimension == "friction":
        cases = [case for case in cases if any(one["effect"] in DRY for one in case.effects)]
    found: dict[str, list[Judged]] = {}
    for case in cases:
        found.setdefault(case.truth["values"][dimension], []).append(case)
    return sorted(found.items(), key=lambda item: (len(item[0]) if item[0].isdigit() else 0, item[0]))


def _worst(figure: Figure, cases: Cases) -> str:
    found = []
    for dimension in DIMENSIONS:
        for value, part in _parts(dimension, cases):
            rate = figure.rate(part)
            if rate.total >= FEW:
                share = rate.hits / rate.total
                found.append((share if figure.more_is_better else -share, f"{dimension} {value}: {rate}"))
    return min(found)[1] if found else "too few cases"


def _short(rate: Rate) -> str:
    if rate.total == 0:
        return "-"
    low, high = rate.interval
    return f"{rate.hits}/{rate.total} ({100 * low:.0f}-{100 * high:.0f})"


def is_right(case: Judged) -> bool:
    """What the block asks for."""
    pair = refused_with_pair if case.truth.get("motion") == "poor" else decided
    tests = {"B": clean, "A": explained, "C": all_found, "D": pair, "E": left_open}
    return case.answer.verdict != NO_ANSWER and tests[case.block](case)


def wrong_list(out: Path, answers: Path, cases: Cases) -> str:
    """Returns one paragraph for each case that is not right."""
    wrong = sorted((case for case in cases if not is_right(case)), key=lambda case: (case.block, case.name))
    return "\n\n".join(describe(out, answers, case) for case in wrong) + "\n"


def show_case(out: Path, answers: Path, name: str) -> str:
    """Returns truth and answer of one case."""
    found = [describe(out, answers, case) for case in judge(out, answers) if case.name == name]
    return "\n".join(found) or f"{name}: no answer to a case of that name in {answers}"


def describe(out: Path, answers: Path, case: Judged) -> str:
    """Returns dimensions, truth and answer of one case."""
    lines = [f"{case.block} {case.name}  {case.answer.processor_seconds:.0f} s  {out / CASES / case.name}"]
    lines.append("  " + ", ".join(f"{key} {value}" for key, value in case.truth["values"].items()))
    lines += [f"  truth   {_truth(effect)}" for effect in case.effects] or ["  truth   nothing"]
    if case.block == "D":
        lines.append(
            f"  {case.truth['motion']}, {case.truth['apart']:.3g} apart: {' or '.join(case.truth['pair'])}"
        )
    lines.append(
        f"  answer  {case.answer.verdict}"
        + ("" if case.block != "A" else f", first {_yes(case.first_right)}")
    )
    lines += [f"    {_cause(cause)}" for cause in case.answer.causes[:5]]
    lines += _remainder(answers / f"{case.name}.json")
    if case.answer.errors:
        lines.append(f"    said    {case.answer.errors.strip().splitlines()[-1][:300]}")
    return "\n".join(lines)


def _remainder(path: Path) -> list[str]:
    """Returns what the answer says of the remainder and of the recordings."""
    if not path.exists():
        return []
    said = json.loads(path.read_text())
    lines = [f"    left    {(said.get('remainder') or {}).get('structure', '')}"]
    return lines + [f"    warned  {text}" for text in (said.get("data") or {}).get("warnings", [])[:3]]


def _yes(right: bool) -> str:
    return "right" if right else "wrong"


def _truth(effect: Mapping[str, Any]) -> str:
    also = f" (or {', '.join(effect['also'])})" if effect["also"] else ""
    where = ",".join(effect["joints"]) if len(effect["joints"]) < 4 else "all joints"
    return (
        f"{effect['effect']}{also} {where or '-'} at {effect['port']}, size {effect['size']:.3g}"
        f" in {effect['residual']},"
        f" {100 * effect['share']:.2g} % of the range: {_numbers(effect['parameters'])}"
    )


def _cause(cause: Mapping[str, Any]) -> str:
    same = [f"{one['effect']} {','.join(one.get('joints', []))}" for one in cause.get("equivalent", [])]
    line = f"{cause['effect']} {','.join(cause.get('joints', [])) or '-'} at {cause.get('port')}"
    line += f", weight {cause.get('weight', 0):.3g}: {_numbers(cause.get('parameters', {}))}"
    return line + (f"; equivalent {'; '.join(same[:4])}" if same else "")


def _numbers(parameters: Mapping[str, Any]) -> str:
    parts = []
    for key, symbols in list(parameters.items())[:3]:
        words = " ".join(f"{symbol}={_value(value)}" for symbol, value in symbols.items())
        parts.append(f"{key} {words}")
    return "; ".join(parts)


def _value(value: Any) -> str:
    if isinstance(value, Mapping):
        return _value(value.get("value"))
    return f"{value:.3g}" if isinstance(value, (int, float)) else str(value)
