# SPDX-License-Identifier: BSD-3-Clause
"""The ablation table: every figure with all rules, and what changes without each of them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from benchmarks.wide.ablation import WITH_ALL, asked_without
from benchmarks.wide.rules import LeftOut, rules_named
from benchmarks.wide.score import FIGURES, Cases, Figure, judge

SHOWN = tuple(figure for figure in FIGURES if figure.blocks != "ABCDE")


def ablation_table(folders: Mapping[Path, Path], groups: Sequence[LeftOut] | None = None) -> str:
    """Compares the answers without each rule with those with all.

    Args:
        folders: Cases -> answers that `ablation.watch_all` and `ablate` left.
        groups: Rules that were left out, one row each; all of them one by one for None.

    Returns:
        A table in Markdown: with all rules the rates; without a rule the cases that become right and wrong in each
        figure, or a dash where no answer became either.

    Raises:
        ValueError: No case was watched, or a case in which a rule mattered was not asked without it.
    """
    every = [case for out, answers in folders.items() for case in judge(out, answers / WITH_ALL)]
    if not every:
        raise ValueError("no case was asked (valid: folders that `generate` made, blocks that they have)")
    figures = [figure for figure in SHOWN if any(figure.counts(case) for case in every)]
    rows = [
        "| left out | what it does | mattered in | " + " | ".join(figure.title for figure in figures) + " |",
        "|---" * (3 + len(figures)) + "|",
        f"| none | | {len(every)} cases | "
        + " | ".join(str(figure.rate(every)) for figure in figures)
        + " |",
    ]
    shown = rules_named([]) if groups is None else groups
    return "\n".join([*rows, *(_row(left, folders, figures) for left in shown)]) + "\n"


def _row(left: LeftOut, folders: Mapping[Path, Path], figures: Sequence[Figure]) -> str:
    pairs = [pair for out, answers in folders.items() for pair in _pairs(left, out, answers)]
    cells = [_changes(figure, pairs) for figure in figures]
    return f"| {left.name.replace(',', ', ')} | {left.does} | {len(pairs)} | " + " | ".join(cells) + " |"


def _pairs(left: LeftOut, out: Path, answers: Path) -> Iterator[Cases]:
    """A case with all rules and without some, where that may have made a difference."""
    without = {case.name: case for case in judge(out, answers / left.name)}
    for case in judge(out, answers / WITH_ALL):
        if not asked_without(left, answers, case.name):
            continue
        if case.name not in without:
            raise ValueError(f"{case.name} was not asked without {left.name} (valid: `ablate` first)")
        yield (case, without[case.name])


def _changes(figure: Figure, pairs: Sequence[Cases]) -> str:
    """Cases that a figure counts without a rule and did not count with it, and the other way."""
    counted = [(figure.right(one), figure.right(other)) for one, other in pairs if figure.counts(one)]
    more = sum(not before and after for before, after in counted)
    less = sum(before and not after for before, after in counted)
    return " ".join([*([f"+{more}"] if more else []), *([f"-{less}"] if less else [])]) or "-"
