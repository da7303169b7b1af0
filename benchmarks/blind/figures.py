# SPDX-License-Identifier: BSD-3-Clause
"""Every figure of the benchmark: which cases it counts, and what counts as right."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.blind.answers import NO_ANSWER, Answer, is_cause, parameter_pairs
from benchmarks.blind.blocks import ALIKE
from benchmarks.blind.catalogue import SUPERSETS
from benchmarks.blind.wilson import Rate

APART = 40.0
"""Sum of squares over noise above which a good method must tell two causes apart."""


@dataclass(frozen=True)
class Judged:
    """One case: its truth and a tool's answer."""

    name: str
    truth: dict[str, Any]
    answer: Answer

    @property
    def block(self) -> str:
        """Letter of the block."""
        return str(self.truth["block"])

    @property
    def effects(self) -> list[dict[str, Any]]:
        """What was planted."""
        return list(self.truth["effects"])

    @property
    def first_right(self) -> bool:
        """The first cause is the (or a) planted one, at its joint."""
        causes = self.answer.causes
        return bool(causes) and any(is_cause(causes[0], effect) for effect in self.effects)

    @property
    def size(self) -> float:
        """Of the smallest planted effect, over noise."""
        return min((float(effect["size"]) for effect in self.effects), default=0.0)


Cases = Sequence[Judged]


@dataclass(frozen=True)
class Figure:
    """A line of the table."""

    title: str
    target: str
    count: Callable[[Cases], str]


def _rate(chosen: Callable[[Judged], bool], right: Callable[[Judged], bool]) -> Callable[[Cases], str]:
    return lambda cases: str(Rate.of([right(case) for case in cases if chosen(case)]))


def _clear(case: Judged) -> bool:
    return case.block == "A" and case.size >= 1.0


def _block(*letters: str) -> Callable[[Judged], bool]:
    return lambda case: case.block in letters


def _truth_reported(case: Judged) -> bool:
    return all(set((effect["effect"], *effect["also"])) & case.answer.reported for effect in case.effects)


def _alarmed(case: Judged) -> bool:
    return case.answer.verdict not in ("no_gap", "insufficient_data", NO_ANSWER)


def _left_open(case: Judged) -> bool:
    return case.answer.verdict in ("unexplained", "partly_explained")


def _wrongly_named(case: Judged) -> bool:
    return case.answer.named


def _not_even_contained(case: Judged) -> bool:
    allowed = {name for effect in case.effects for name in SUPERSETS.get(effect["effect"], ())}
    return case.answer.named and case.answer.first not in allowed


def _poor(case: Judged) -> bool:
    """The logs hold nothing that tells the pair apart, and the cause can be seen."""
    return (
        case.block == "D"
        and case.truth["motion"] == "poor"
        and case.truth["apart"] < ALIKE
        and case.size >= 1.0
    )


def _rich(case: Judged) -> bool:
    """The cause can be seen, and told from its partner."""
    return (
        case.block == "D"
        and case.truth["motion"] == "rich"
        and case.truth["apart"] > APART
        and case.size >= 1.0
    )


def _refused_with_pair(case: Judged) -> bool:
    refused = case.answer.verdict in ("ambiguous", "insufficient_data")
    return refused and set(case.truth["pair"]) <= case.answer.reported


def _all_found(case: Judged) -> bool:
    return all(any(is_cause(cause, effect) for cause in case.answer.causes) for effect in case.effects)


def _parameter_error(cases: Cases) -> str:
    errors = [abs(value - true) / abs(true) for value, true, _ in _pairs(cases) if true != 0.0]
    return f"{100 * float(np.median(errors)):.1f} % median of {len(errors)}" if errors else "none stated"


def _coverage(cases: Cases) -> str:
    return str(
        Rate.of([abs(value - true) <= 1.96 * std for value, true, std in _pairs(cases) if std is not None])
    )


def _pairs(cases: Cases) -> list[tuple[float, float, float | None]]:
    right = [case for case in cases if _clear(case) and case.first_right]
    exact = [case for case in right if case.answer.first == case.effects[0]["effect"]]
    return [pair for case in exact for pair in parameter_pairs(case.answer.causes[0], case.effects[0])]


def _closed(cases: Cases) -> str:
    shares = [case.answer.shrink for case in cases if _clear(case) and case.answer.shrink is not None]
    return f"{100 * float(np.median(shares)):.0f} % median of {len(shares)}" if shares else "none stated"


def _time(cases: Cases) -> str:
    seconds = [case.answer.seconds for case in cases]
    return f"{np.median(seconds):.1f} s median, {np.max(seconds):.1f} s longest" if seconds else "no cases"


def _memory(cases: Cases) -> str:
    memory = [case.answer.memory for case in cases if np.isfinite(case.answer.memory)]
    return f"{np.max(memory):.0f} MB" if memory else "not known"


def _silent(case: Judged) -> bool:
    return case.answer.verdict == "no answer"


def _first(case: Judged) -> bool:
    return case.first_right


def _rich_or_clear(case: Judged) -> bool:
    return _clear(case) or case.block == "C"


def _task(planted: bool) -> Callable[[Judged], bool]:
    return lambda case: case.block == "G" and bool(case.effects) == planted


def _blamed(case: Judged) -> bool:
    return bool(case.answer.causes)


def _any(_: Judged) -> bool:
    return True


_ROWS: tuple[tuple[str, str, Callable[[Cases], str]], ...] = (
    ("first cause and joint, single effects at or above noise (A)", "97 % (92)", _rate(_clear, _first)),
    ("truth in the reported set (A, C)", "99 % (97)", _rate(_rich_or_clear, _truth_reported)),
    ("false alarm on clean logs (B)", "1 % (3)", _rate(_block("B"), _alarmed)),
    ("open set answered unexplained or partly (E)", "95 % (85)", _rate(_block("E"), _left_open)),
    ("withheld entry answered unexplained or partly (F)", "-", _rate(_block("F"), _left_open)),
    ("confident wrong name (E, F)", "2 % (8)", _rate(_block("E", "F"), _wrongly_named)),
    ("the same, names that contain the truth allowed", "-", _rate(_block("E", "F"), _not_even_contained)),
    ("poor motion refused with the right pair (D)", "95 % (88)", _rate(_poor, _refused_with_pair)),
    ("rich motion of the same decided (D)", "95 % (88)", _rate(_rich, _first)),
    ("two effects, both found (C)", "90 % (80)", _rate(_block("C"), _all_found)),
    ("first cause and joint, task logs with contact (G)", "-", _rate(_task(True), _first)),
    ("false alarm on clean task logs (G)", "-", _rate(_task(False), _blamed)),
    ("parameter error where the cause is right (A)", "3 % (8)", _parameter_error),
    ("95 % intervals that cover the truth (A)", "93-97 % (88-99)", _coverage),
    ("held-out gap closed (A; an oracle closes all)", "97 % (90)", _closed),
    ("no answer at all", "0", _rate(_any, _silent)),
    ("wall time per case", "5 s (30 s)", _time),
    ("memory, largest", "1 GB", _memory),
)

FIGURES: tuple[Figure, ...] = tuple(Figure(*row) for row in _ROWS)


def by_size(cases: Cases) -> list[str]:
    """Returns a table of block A: how often the first cause is right, by size over noise."""
    rows = ["| size | first cause and joint | truth reported | no gap |", "|---|---|---|---|"]
    for low, high in ((0.0, 0.8), (0.8, 2.0), (2.0, np.inf)):
        part = [case for case in cases if case.block == "A" and low <= case.size < high]
        right, reported = Rate.of([c.first_right for c in part]), Rate.of([_truth_reported(c) for c in part])
        missed = Rate.of([c.answer.verdict == "no_gap" for c in part])
        rows.append(f"| {low:g} to {high:g} | {right} | {reported} | {missed} |")
    return rows
