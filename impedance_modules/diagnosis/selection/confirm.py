# SPDX-License-Identifier: BSD-3-Clause
"""The last word on accepted causes: each must explain something on the recordings that no step has seen."""

from __future__ import annotations

from collections.abc import Sequence

from impedance_modules.diagnosis.selection.bench import Bench
from impedance_modules.diagnosis.selection.select import Selector
from impedance_modules.diagnosis.selection.term import Term


def confirmed(selector: Selector, causes: Sequence[Term], unseen: Sequence[int]) -> tuple[Term, ...]:
    """Leaves causes out that make it worse where no fit has looked, the worst first.

    Args:
        selector: Fits models.
        causes: Accepted ones.
        unseen: Held-out recordings.
    """
    kept = list(causes)
    while kept:
        bench = selector.bench(kept)
        gains = [_explained(bench, index, unseen) for index in range(len(kept))]
        worst = min(range(len(kept)), key=lambda i: gains[i])
        if gains[worst] > 0.0:
            break
        del kept[worst]
    return tuple(kept)


def _explained(bench: Bench, index: int, recordings: Sequence[int]) -> float:
    """Weighted squares that would be left more without a cause's torque, all else as it is."""
    term, start, total = bench.model[index], int(bench.starts[index]), 0.0
    own = bench.whole.coefficients[start : start + term.shaped.size]
    for r in recordings:
        left = bench.residuals(bench.whole.coefficients, r)
        for g, block in term.columns[r].items():
            torque = block @ own + term.fixed[r].get(g, 0.0)
            total += float(bench.weights[g] * (torque @ torque + 2.0 * (left[g] @ torque)))
    return total
