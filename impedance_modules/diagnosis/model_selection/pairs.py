# SPDX-License-Identifier: BSD-3-Clause
"""Two causes that need each other: alone each makes unseen recordings worse, together both earn their place.

A joint with friction of its own and a coupled motor is such a case: either alone is fitted to what the other does,
and fails where that is absent.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from impedance_modules.diagnosis.regression.model_fit import Bench
from impedance_modules.diagnosis.model_selection.screening import Look, Screen
from impedance_modules.diagnosis.regression.term import Term, term_of
from impedance_modules.diagnosis.model_selection.candidate_trial import Trial, try_term

FIRST, SECOND = 16, 4
"""Candidates that are taken for granted in turn, and partners that are tried beside each."""

LACKING = 3.0
"""Residual power over noise above which a group is not understood and worth a search for pairs."""

Objection = Callable[[Trial], str | None]
Best = Callable[[Sequence[Look], int], list[Look]]


def find_pair(
    screen: Screen, bench: Bench, make: Callable[[Sequence[Term]], Bench], best: Best, objection: Objection
) -> tuple[Term, Term] | None:
    """Finds two candidates of which each earns its place beside the other.

    Args:
        screen: First looks.
        bench: The model that no single candidate betters.
        make: Fits a model.
        best: The best physical shape of each candidate.
        objection: Why a trial does not earn its place; None if it does.
    """
    lacking = bench.left / bench.counts > LACKING
    firsts = [look for look in best(screen.look(bench), 4 * FIRST) if lacking[list(look.slot.groups)].any()]
    for first in firsts[:FIRST]:
        one = term_of(bench.design, first.slot)
        beside = make([*bench.model, one])
        near = [
            look for look in best(screen.look(beside), 2 * SECOND) if set(look.slot.groups) & set(one.groups)
        ]
        for second in near[:SECOND]:
            other = term_of(bench.design, second.slot)
            if objection(try_term(beside, other)) is not None:
                continue
            if objection(try_term(make([*bench.model, other]), one)) is None:
                return one, other
    return None
