# SPDX-License-Identifier: BSD-3-Clause
"""Laws of dry friction with more numbers than an accepted one, on equal terms with it: they reverse as it does.

How the sign changes at a reversal is a shape (`effects.dry_reversals`): that of an accepted law has been moved off its
grid, and on the grid a law of several numbers has few such shapes. Compared there it loses by its reversals, however
certain its further numbers are.
"""

from __future__ import annotations

from impedance_modules.diagnosis.model_selection.candidate_trial import CandidateTrial, try_term
from impedance_modules.diagnosis.regression.model_fit import ModelFit, ModelTerm
from impedance_modules.diagnosis.regression.shape_refinement import ShapeRefiner
from impedance_modules.effects.dry_reversals import of_reversals, without_reversals


def richer_laws(model_fit: ModelFit, term: ModelTerm, refiner: ShapeRefiner) -> list[CandidateTrial]:
    """Tries laws that have a dry law's numbers and more in its place, in every shape of their own.

    Args:
        model_fit: The other causes.
        term: The dry law, on one joint at one port; of any other effect there are none.
        refiner: Evaluates shapes that are not on the grid.
    """
    if term.generic or not term.candidate.effect.dry:
        return []
    reversals, symbols = of_reversals(term.shaped.shape), set(term.candidate.effect.description.symbols)
    tried: list[CandidateTrial] = []
    seen: list[tuple[str, dict[str, float]]] = []
    for layout in model_fit.design.layouts:
        candidate = layout.shaped.candidate
        if candidate is None or not candidate.effect.dry or layout.shaped.key[1:] != term.key[1:]:
            continue
        own = candidate.effect.id, without_reversals(layout.shaped.shape)
        if not symbols < set(candidate.effect.description.symbols) or own in seen:
            continue
        seen.append(own)
        like = refiner.term(candidate, {**own[1], **reversals})
        if like is not None:
            tried.append(try_term(model_fit, like))
    return tried
