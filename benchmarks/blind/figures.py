# SPDX-License-Identifier: BSD-3-Clause
"""Every figure of the benchmark: which cases it counts, what counts as right, with its 95 % Wilson interval.

A cause's parameters are compared with the true ones: how far off, and whether the stated interval covers the truth. An
error is measured against what differs from the robot file, not against the whole number: a rotor of 0.66 kg.m^2
that is believed to have 0.60 is off by 0.06. Components of one vector share the vector's length; places of a payload
are measured against 0.1 m, about a hand, and a spring's rest and preload against one radian of it.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.blind.answers import NO_ANSWER
from benchmarks.blind.arm_model import hand_of, read_arm, read_drive, turned
from benchmarks.blind.blocks import COUNTS, KINDS
from benchmarks.blind.judged import (
    Cases,
    Judged,
    all_found,
    any_cause_named,
    false_alarm,
    first_right,
    in_block,
    is_clear,
    is_poor,
    is_rich,
    is_right,
    is_task,
    left_open,
    not_even_contained,
    refused_with_pair,
    truth_reported,
    wrongly_named,
)

Z = 1.959964
HAND = 0.1
"""Size [m] against which the place of a payload is measured."""


@dataclass(frozen=True)
class Figure:
    """A line of the table."""

    title: str
    target: str
    count: Callable[[Cases], str]


def _rate(chosen: Callable[[Judged], bool], right: Callable[[Judged], bool]) -> Callable[[Cases], str]:
    return lambda cases: str(Rate.of([right(case) for case in cases if chosen(case)]))


def _parameter_error(cases: Cases) -> str:
    errors = [one.error for one in _compared(cases)]
    if not errors:
        return "none stated"
    middle, nine = 100 * np.quantile(errors, [0.5, 0.9])
    return f"{middle:.1f} % median, {nine:.0f} % for nine of ten, of {len(errors)}"


def _coverage(cases: Cases) -> str:
    return str(Rate.of([one.covered for one in _compared(cases) if one.covered is not None]))


def _compared(cases: Cases) -> list[Comparison]:
    right = [case for case in cases if is_clear(case) and case.first_right]
    exact = [case for case in right if case.answer.first == case.effects[0]["effect"]]
    return [
        one
        for case in exact
        for one in compare(case.answer.causes[0], case.effects[0], str(case.truth["side"]))
    ]


def _closed(cases: Cases) -> str:
    """Counts every clear case that was measured; an answer without causes closes nothing."""
    shares = [case.gap.tool / case.gap.oracle for case in cases if is_clear(case) and case.gap is not None]
    if not shares:
        return "not measured"
    middle, tenth = 100 * np.quantile(shares, [0.5, 0.1])
    return f"{middle:.0f} % median, {tenth:.0f} % at the worst tenth, of {len(shares)}"


def _promised(cases: Cases) -> str:
    gaps = [case.gap for case in cases if is_clear(case) and case.gap is not None]
    off = [abs(gap.promised - gap.tool) for gap in gaps if gap.promised is not None]
    return f"{100 * float(np.median(off)):.0f} points median of {len(off)}" if off else "not measured"


def _time(cases: Cases) -> str:
    seconds = [case.answer.seconds for case in cases]
    used = [case.answer.processor_seconds for case in cases]
    if not seconds:
        return "no cases"
    return f"{np.median(seconds):.1f} s median, {np.max(seconds):.1f} s longest; {np.median(used):.1f} s of processor"


def _memory(cases: Cases) -> str:
    memory = [case.answer.memory for case in cases if np.isfinite(case.answer.memory)]
    return f"{np.max(memory):.0f} MB" if memory else "not known"


def _silent(case: Judged) -> bool:
    return case.answer.verdict == NO_ANSWER


def _any(_: Judged) -> bool:
    return True


def _named_three(case: Judged) -> bool:
    return case.block == "N" and bool(case.effects)


def _clear_or_two(case: Judged) -> bool:
    return is_clear(case) or case.block == "C"


_ROWS: tuple[tuple[str, str, Callable[[Cases], str]], ...] = (
    (
        "first cause and joint, single effects at or above noise (A)",
        "97 % (92)",
        _rate(is_clear, first_right),
    ),
    ("truth in the reported set (A, C)", "99 % (97)", _rate(_clear_or_two, truth_reported)),
    ("false alarm on clean logs (B)", "1 % (3)", _rate(in_block("B"), false_alarm)),
    ("open set answered unexplained or partly (E)", "95 % (85)", _rate(in_block("E"), left_open)),
    ("withheld entry answered unexplained or partly (F)", "-", _rate(in_block("F"), left_open)),
    ("confident wrong name (E, F)", "2 % (8)", _rate(in_block("E", "F"), wrongly_named)),
    ("the same, names that contain the truth allowed", "-", _rate(in_block("E", "F"), not_even_contained)),
    ("poor motion refused with the right pair (D)", "95 % (88)", _rate(is_poor, refused_with_pair)),
    ("rich motion of the same decided (D)", "95 % (88)", _rate(is_rich, first_right)),
    ("two effects, both found (C)", "90 % (80)", _rate(in_block("C"), all_found)),
    ("first cause and joint, task logs with contact (G)", "-", _rate(is_task(True), first_right)),
    ("false alarm on clean task logs (G)", "-", _rate(is_task(False), any_cause_named)),
    (
        "three right names (N: friction, delay, gain of a five-joint arm)",
        "3 of 3",
        _rate(_named_three, first_right),
    ),
    ("parameter error where the cause is right (A)", "3 % (8)", _parameter_error),
    ("95 % intervals that cover the truth (A)", "93-97 % (88-99)", _coverage),
    ("held-out gap closed, of what an oracle closes (A)", "97 % (90)", _closed),
    ("promised shrink less the obtained (A)", "5 points (10)", _promised),
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
        right, reported = Rate.of([c.first_right for c in part]), Rate.of([truth_reported(c) for c in part])
        missed = Rate.of([c.answer.verdict == "no_gap" for c in part])
        rows.append(f"| {low:g} to {high:g} | {right} | {reported} | {missed} |")
    return rows


def by_block(cases: Cases) -> list[str]:
    """Returns a table of the blocks: how many were answered rightly, what was said, and what that cost."""
    rows = ["| block | right | verdicts | median s | longest s | most MB |", "|---|---|---|---|---|---|"]
    for letter in COUNTS:
        part = [case for case in cases if case.block == letter]
        if not part:
            continue
        said = Counter(case.answer.verdict for case in part).most_common()
        seconds = [case.answer.seconds for case in part]
        memory = max(case.answer.memory for case in part)
        rows.append(
            f"| {letter} | {Rate.of([is_right(case) for case in part])}"
            f" | {', '.join(f'{verdict} {times}' for verdict, times in said)}"
            f" | {np.median(seconds):.1f} | {max(seconds):.1f} | {memory:.0f} |"
        )
    return rows


def by_kind(cases: Cases) -> list[str]:
    """Returns a table of block G by what was planted."""
    rows = ["| planted in G | right | verdicts |", "|---|---|---|"]
    for kind in KINDS:
        part = [case for case in cases if case.block == "G" and case.truth.get("kind") == kind]
        said = Counter(case.answer.verdict for case in part).most_common()
        right = Rate.of([is_right(case) for case in part])
        rows.append(f"| {kind} | {right} | {', '.join(f'{verdict} {times}' for verdict, times in said)} |")
    return rows


@dataclass(frozen=True)
class Rate:
    """So many of so many."""

    hits: int
    total: int

    @classmethod
    def of(cls, flags: list[bool]) -> Rate:
        """Counts the true ones."""
        return cls(sum(flags), len(flags))

    @property
    def interval(self) -> tuple[float, float]:
        """The 95 % Wilson interval; all of [0, 1] where nothing was tried."""
        if self.total == 0:
            return 0.0, 1.0
        p, n = self.hits / self.total, self.total
        middle = (p + Z**2 / (2 * n)) / (1 + Z**2 / n)
        half = Z / (1 + Z**2 / n) * math.sqrt(p * (1 - p) / n + Z**2 / (4 * n**2))
        return max(0.0, middle - half), min(1.0, middle + half)

    def __str__(self) -> str:
        """E.g. ``92.0 % (46/50, 81-97)``."""
        if self.total == 0:
            return "no cases"
        low, high = self.interval
        return f"{100 * self.hits / self.total:.1f} % ({self.hits}/{self.total}, {100 * low:.0f}-{100 * high:.0f})"


@dataclass(frozen=True)
class Comparison:
    """One parameter: its relative error, and whether value +- 1.96 std covers the truth (None without a std)."""

    symbol: str
    error: float
    covered: bool | None


def compare(cause: Mapping[str, Any], truth: Mapping[str, Any], side: str) -> list[Comparison]:
    """Returns every parameter that a cause and the truth both state under the same key.

    Args:
        cause: As in design 3.3.
        truth: Sealed record of one effect.
        side: Of the arm.
    """
    found = []
    for key, symbols in _all_keys(truth, side).items():
        said = cause.get("parameters", {}).get(key, {})
        for symbol, true in symbols.items():
            quantity = said.get(symbol)
            if quantity is None or quantity.get("value") is None:
                continue
            off = abs(float(quantity["value"]) - true)
            spread = quantity.get("std")
            scale = _scale(symbol, symbols, key, side)
            covered = None if spread is None else off <= 1.96 * float(spread)
            if scale > 0.0:
                found.append(Comparison(symbol, off / scale, covered))
    return found


def _all_keys(truth: Mapping[str, Any], side: str) -> dict[str, dict[str, float]]:
    """Adds the other names of the same thing: a coupling both ways, a payload on the moving link of the hand."""
    keys: dict[str, dict[str, float]] = {key: dict(symbols) for key, symbols in truth["parameters"].items()}
    if truth["effect"] == "transmission_coupling":
        keys |= {"<-".join(reversed(key.split("<-"))): symbols for key, symbols in keys.items()}
    hand = hand_of(side)
    if truth["effect"] == "payload" and hand in keys:
        link = next(link for link in read_arm(side) if link.name == hand)
        if link.joint is None:
            place = np.array([keys[hand][axis] for axis in ("cx", "cy", "cz")])
            moved = link.position + turned(link.rpy) @ place
            keys[link.parent] = {"m": keys[hand]["m"], **dict(zip(("cx", "cy", "cz"), moved, strict=True))}
    return keys


def _scale(symbol: str, truth: Mapping[str, float], key: str, side: str) -> float:
    drive = read_drive(side)
    nominal = {"Ia": drive.rotor_inertia, "K": drive.spring_stiffness}
    if symbol in nominal:
        return abs(truth[symbol] - float(nominal[symbol][drive.joints.index(key)]))
    if symbol == "s":
        return abs(truth["s"] - 1.0)
    if symbol in ("rx", "ry"):
        return math.hypot(truth["rx"], truth["ry"])
    if symbol in ("cx", "cy", "cz"):
        return HAND
    if symbol == "q0":
        return 1.0
    if symbol == "preload":
        return abs(truth["k"])
    return abs(truth[symbol])
