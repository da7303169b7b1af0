# SPDX-License-Identifier: BSD-3-Clause
"""One case with its truth and a tool's answer, and what counts as right in each block."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from benchmarks.blind.answers import NO_ANSWER, Answer, is_cause
from benchmarks.blind.catalogue import SUPERSETS
from benchmarks.blind.noise_scale import ALIKE, APART
from benchmarks.blind.oracle import Gap


@dataclass(frozen=True)
class Judged:
    """One case: its truth, a tool's answer, and how far that closes the gap where it was measured."""

    name: str
    truth: dict[str, Any]
    answer: Answer
    gap: Gap | None = None

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
        return bool(causes) and any(is_cause(causes, 0, effect) for effect in self.effects)

    @property
    def size(self) -> float:
        """Of the smallest planted effect, over noise; infinite where it was given by number."""
        return min((float(effect.get("size", math.inf)) for effect in self.effects), default=0.0)


Cases = Sequence[Judged]
Test = Callable[[Judged], bool]


def is_clear(case: Judged) -> bool:
    """A single effect at or above the noise."""
    return case.block == "A" and case.size >= 1.0


def in_block(*letters: str) -> Test:
    """Returns a test for some blocks."""
    return lambda case: case.block in letters


def truth_reported(case: Judged) -> bool:
    """Every planted effect is among causes and equivalents."""
    return all(set((effect["effect"], *effect["also"])) & case.answer.reported for effect in case.effects)


def false_alarm(case: Judged) -> bool:
    """A gap was seen."""
    return case.answer.verdict not in ("no_gap", "insufficient_data", NO_ANSWER)


def left_open(case: Judged) -> bool:
    """Answered that something is there which no cause explains."""
    return case.answer.verdict in ("unexplained", "partly_explained")


def wrongly_named(case: Judged) -> bool:
    """Claims to have explained what it cannot know."""
    return case.answer.named


def not_even_contained(case: Judged) -> bool:
    """As `wrongly_named`, by causes that do not all contain the true one, at its joint, or cannot be told from it."""

    def contains(at: int) -> bool:
        return any(
            is_cause(case.answer.causes, at, {**effect, "effect": name, "also": []})
            for effect in case.effects
            for name in (*SUPERSETS.get(effect["effect"], ()), *effect["also"])
        )

    return case.answer.named and not all(contains(at) for at in range(len(case.answer.causes)))


def is_poor(case: Judged) -> bool:
    """The logs hold nothing that tells the pair apart, and the cause can be seen."""
    poor = case.block == "D" and case.truth["motion"] == "poor"
    return poor and case.truth["apart"] < ALIKE and case.size >= 1.0


def is_rich(case: Judged) -> bool:
    """The cause can be seen, and told from its partner."""
    rich = case.block == "D" and case.truth["motion"] == "rich"
    return rich and case.truth["apart"] > APART and case.size >= 1.0


def refused_with_pair(case: Judged) -> bool:
    """Refused to choose, and named both."""
    refused = case.answer.verdict in ("ambiguous", "insufficient_data")
    return refused and set(case.truth["pair"]) <= case.answer.reported


def all_found(case: Judged) -> bool:
    """Every planted effect is a cause at its joint."""
    causes = case.answer.causes
    return all(any(is_cause(causes, i, effect) for i in range(len(causes))) for effect in case.effects)


def first_right(case: Judged) -> bool:
    """The first cause is right."""
    return case.first_right


def is_task(planted: bool) -> Test:
    """Returns a test for task logs, with something planted at or above the noise, or with nothing."""
    return lambda case: (
        case.block == "G" and bool(case.effects) == planted and (case.size >= 1.0 or not planted)
    )


def any_cause_named(case: Judged) -> bool:
    """Any cause was named."""
    return bool(case.answer.causes)


def is_right(case: Judged) -> bool:
    """What the block asks for; effects below the noise may be missed, but nothing else may be named."""
    if case.answer.verdict == NO_ANSWER:
        return False
    if case.block == "B":
        return not false_alarm(case)
    if case.block in "EF":
        return left_open(case)
    if case.block == "C":
        return all_found(case)
    if case.block == "D" and case.truth["motion"] == "poor":
        return refused_with_pair(case) or not is_poor(case)
    if not case.effects:
        return not any_cause_named(case)
    small = case.size < 1.0 and not case.answer.named
    return case.first_right or small
