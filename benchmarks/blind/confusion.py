# SPDX-License-Identifier: BSD-3-Clause
"""Who is taken for whom."""

from __future__ import annotations

from collections import Counter

from benchmarks.blind.judged import Cases


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
