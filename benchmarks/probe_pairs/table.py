# SPDX-License-Identifier: BSD-3-Clause
"""The finished cases as tables: rates with Wilson's 95 % intervals, and one line for each direction of each pair."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from benchmarks.blind.figures import Rate
from benchmarks.probe_pairs.pairs import pair_cases

Case = Mapping[str, Any]

WORDS = {
    "both": "names both",
    "set": "names others beside it",
    "right": "right at once",
    "later": "right, not first",
    "partner": "names the partner alone",
    "other": "names another",
    "nothing": "no cause",
    "refused": "data refused",
}
"""Outcome of a diagnosis -> how the table says it."""


def finished(folder: Path) -> list[Case]:
    """Reads the cases that are done, in the order of the pairs."""
    paths = [folder / case.name / "case.json" for case in pair_cases()]
    return [json.loads(path.read_text()) for path in paths if path.is_file()]


def table(cases: Sequence[Case]) -> str:
    """Lays finished cases out as Markdown."""
    return "\n".join([*_rates(cases), "", *_lines(cases)])


def _rates(cases: Sequence[Case]) -> Iterator[str]:
    tried = [case for case in cases if "left_out" not in case]
    open_ones = [case for case in tried if case["before"] in ("both", "set", "refused")]
    probed = [case for case in open_ones if "after" in case]
    expected = [case for case in probed if _expected(case) in ("yes", "perhaps")]
    yield "| directions of pairs | |"
    yield "|---|---|"
    yield f"| recorded with a poor motion | {len(tried)} |"
    yield f"| named both, or data refused | {_share(tried, lambda c: c['before'] in ('both', 'refused'))} |"
    yield f"| named the partner alone | {_share(tried, lambda c: c['before'] == 'partner')} |"
    yield f"| of the open ones: right after the probe | {_share(probed, lambda c: c['after'] == 'right')} |"
    yield f"| of these where `probe` said yes or perhaps | {_share(expected, lambda c: c['after'] == 'right')} |"
    yield f"| wrong name alone after the probe | {_share(probed, lambda c: c['after'] in ('partner', 'other'))} |"


def _share(cases: Sequence[Case], holds: Any) -> str:
    return str(Rate.of([bool(holds(case)) for case in cases]))


def _expected(case: Case) -> str:
    """What the probe expects of its questions about truth and partner; empty without such a question."""
    asked = [
        "yes" if answered else "no" if reason else "perhaps"
        for question, answered, reason in case.get("probe", {}).get("questions", ())
        if case["truth"] in question and case["partner"] in question
    ]
    return next((word for word in ("no", "perhaps", "yes") if word in asked), "")


def _lines(cases: Sequence[Case]) -> Iterator[str]:
    yield "| withheld | confusable with | poor motion | before | probe expects | after |"
    yield "|---|---|---|---|---|---|"
    for case in cases:
        if "left_out" in case:
            yield f"| `{case['truth']}` | `{case['partner']}` | not recorded: {case['left_out']} | | | |"
            continue
        after = WORDS.get(case.get("after", ""), "not probed" if "probe" not in case else "no recording")
        yield (
            f"| `{case['truth']}` | `{case['partner']}` | {case['motion']} | {WORDS[case['before']]} "
            f"| {_expected(case)} | {after} |"
        )
