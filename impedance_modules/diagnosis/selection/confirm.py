# SPDX-License-Identifier: BSD-3-Clause
"""The last word on accepted causes: each must explain, on the recordings that no step has seen, what it promises."""

from __future__ import annotations

from collections.abc import Sequence

from impedance_modules.diagnosis.selection.bench import Bench
from impedance_modules.diagnosis.selection.select import Selector
from impedance_modules.diagnosis.selection.term import Term

CONFIRMED = 0.02
"""Least part of what a cause explains per fitted sample that it must explain per unseen one."""


def confirmed(selector: Selector, causes: Sequence[Term], unseen: Sequence[int]) -> tuple[Term, ...]:
    """Leaves causes out that carry nothing where no fit has looked, the emptiest first.

    Args:
        selector: Fits models.
        causes: Accepted ones.
        unseen: Held-out recordings.
    """
    kept = list(causes)
    while kept:
        bench = selector.bench(kept)
        shares = [_share(selector, bench, term, unseen) for term in kept]
        worst = min(range(len(kept)), key=lambda i: shares[i])
        if shares[worst] >= CONFIRMED:
            break
        del kept[worst]
    return tuple(kept)


def _share(selector: Selector, bench: Bench, term: Term, unseen: Sequence[int]) -> float:
    """What a cause explains per unseen sample over what it explains per fitted one, where it acts."""
    without = selector.bench([other for other in bench.model if other is not term])
    fitted, held = (_explained(bench, without, term, part) for part in (bench.fitted, unseen))
    return held / fitted if fitted > 0.0 else 0.0


def _explained(bench: Bench, without: Bench, term: Term, recordings: Sequence[int]) -> float:
    """Weighted squares per sample that a model leaves more of without the cause."""
    groups = list(term.groups)
    less = bench.squares(bench.whole.coefficients, recordings)[groups]
    more = without.squares(without.whole.coefficients, recordings)[groups]
    counts = bench.design.count(recordings)[groups]
    return float(((more - less) * bench.weights[groups]).sum() / counts.sum())
