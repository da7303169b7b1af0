# SPDX-License-Identifier: BSD-3-Clause
"""Which accepted causes still earn their place now that all of them are known.

A cause may fail because a later one took part of its work over, and the later one may be nothing without it: a friction
whose asymmetry balances an offset outweighs itself once the offset is gone. Dropped one after the other, both would be
lost; so what only leans on another goes first, if that other stands without it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from impedance_modules.diagnosis.regression.model_fit import Bench
from impedance_modules.diagnosis.regression.term import Term
from impedance_modules.diagnosis.model_selection.candidate_trial import Trial, try_term


def pruned(
    model: Sequence[Term],
    make: Callable[[Sequence[Term]], Bench],
    objection: Callable[[Trial], str | None],
) -> list[Term]:
    """Removes causes that no longer earn their place beside the others.

    Args:
        model: Accepted causes, in the order they were found.
        make: Fits a model.
        objection: Why a trial does not earn its place; None if it does.
    """

    def stands(term: Term, beside: Sequence[Term]) -> bool:
        return objection(try_term(make(beside), term)) is None

    kept = list(model)
    for term in model:
        if term not in kept or stands(term, _without(kept, term)):
            continue
        rest = _without(kept, term)
        near = [other for other in rest if set(other.groups) & set(term.groups)]
        leaning = [
            other
            for other in near
            if stands(other, _without(kept, other)) and not stands(other, _without(rest, other))
        ]
        upright = _without(rest, *leaning)
        kept = (
            [other for other in kept if other not in leaning] if leaning and stands(term, upright) else rest
        )
    return kept


def _without(model: Sequence[Term], *terms: Term) -> list[Term]:
    return [other for other in model if other not in terms]
