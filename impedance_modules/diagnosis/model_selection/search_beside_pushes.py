# SPDX-License-Identifier: BSD-3-Clause
"""The search beside pushes from outside: looked for with what calm moments say, then left out while causes are found.

A push is no property of the robot. Where it lasts, links and other causes would be fitted to it; so it is looked for in
what a model leaves that was fitted to the other moments, and the search is repeated without its rows.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from impedance_modules.arrays import Array
from impedance_modules.diagnosis.model_selection.calm_moments import calm_rows
from impedance_modules.diagnosis.model_selection.evidence import negligible
from impedance_modules.diagnosis.model_selection.external_pushes import (
    ExternalPush,
    find_pushes,
    rows_without_pushes,
    torque_of,
)
from impedance_modules.diagnosis.model_selection.forward_selection import Selection, Selector
from impedance_modules.diagnosis.regression.model_fit import ModelFit, ModelTerm
from impedance_modules.diagnosis.residuals.contact_mask import intersect_masks, rows_of_link_residuals
from impedance_modules.diagnosis.residuals.preparation import Prepared
from impedance_modules.effects.residual_kinds import uses_motion

SQUARES_RATIO_MAX = 1.2
"""Largest ratio of the squares left by a search on masked rows to those left by the causes found on all rows."""


def without_pushes(
    selector: Selector, found: Selection, prepared: Sequence[Prepared], progress: Callable[[str], None]
) -> tuple[Selector, Selection, tuple[ExternalPush, ...]]:
    """Repeats the search with pushes masked; returns what was given where there is no push."""
    model_fit = selector.model_fit(found.causes)
    pushes = _noticeable_pushes(model_fit, prepared, _calm_coefficients(selector, model_fit, prepared))
    if not pushes:
        return selector, found, ()
    progress("masking moments of contact")
    touched = rows_of_link_residuals(rows_without_pushes(pushes, prepared), selector.design.groups)
    masked = selector.on(selector.design.without(intersect_masks(selector.design.whitening.clear, touched)))
    again = masked.run(progress)
    if not fits_as_well(masked, again.causes, found.causes):
        return selector, found, ()  # the first causes explain the same rows better: there was no push
    return masked, again, _refitted_pushes(selector, masked, again.causes, prepared) or pushes


def _calm_coefficients(selector: Selector, model_fit: ModelFit, prepared: Sequence[Prepared]) -> Array | None:
    """The model's coefficients by the moments of usual power; None where there are no others, or too many.

    Where noise is small a push of two seconds pulls the links' inertias along, and all other moments with them.
    """
    rows = calm_rows(model_fit, prepared)
    if not rows:
        return None
    calm = selector.on(selector.design.without(intersect_masks(selector.design.whitening.clear, rows)))
    terms = _moved(model_fit.model, calm)
    return None if terms is None else calm.model_fit(terms).whole.coefficients


def _moved(causes: Sequence[ModelTerm], selector: Selector) -> list[ModelTerm] | None:
    """Causes on the rows of another search; None where one of them does not show there."""
    terms = [selector.refiner.term(term.candidate, term.shaped.shape, term.layout) for term in causes]
    known = [term for term in terms if term is not None]
    return known if len(known) == len(terms) else None


def _noticeable_pushes(
    model_fit: ModelFit, prepared: Sequence[Prepared], coefficients: Array | None = None
) -> tuple[ExternalPush, ...]:
    """Pushes of more than a negligible torque on some joint."""
    pushes = find_pushes(model_fit, prepared, coefficients)
    if not pushes:
        return ()
    groups = model_fit.design.groups
    least = negligible(prepared, groups)
    moved = [(g, joint) for g, (residual, joint) in enumerate(groups) if uses_motion(residual)]
    torques = [torque_of(push, prepared[push.recording]) for push in pushes]
    return tuple(
        push
        for push, torque in zip(pushes, torques, strict=True)
        if any(torque[joint] > least[g] for g, joint in moved)
    )


def _refitted_pushes(
    selector: Selector, masked: Selector, causes: Sequence[ModelTerm], prepared: Sequence[Prepared]
) -> tuple[ExternalPush, ...]:
    """The pushes again, by a model that was fitted without them, so that they no longer bias the links' parameters."""
    model = _moved(causes, selector)
    if model is None:
        return ()
    return _noticeable_pushes(
        selector.model_fit(model), prepared, masked.model_fit(causes).whole.coefficients
    )


def fits_as_well(masked: Selector, causes: Sequence[ModelTerm], first: Sequence[ModelTerm]) -> bool:
    """Whether causes found on masked rows explain these rows about as well as those found on all rows."""
    moved = [masked.refiner.term(term.candidate, term.shaped.shape, term.layout) for term in first]
    known = [term for term in moved if term is not None]
    return float(masked.model_fit(causes).left.sum()) <= SQUARES_RATIO_MAX * float(
        masked.model_fit(known).left.sum()
    )
