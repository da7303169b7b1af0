# SPDX-License-Identifier: BSD-3-Clause
"""Stages 3 to 6: candidates, noise, the search for causes, and contact set aside on the way."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from impedance_modules.diagnosis.data.folds import Arrangement
from impedance_modules.diagnosis.data.nominal_model import NominalModel
from impedance_modules.diagnosis.model_selection.evidence import Evidence, felt, negligible
from impedance_modules.diagnosis.model_selection.external_pushes import Push, find_pushes, moments_clear
from impedance_modules.diagnosis.model_selection.forward_selection import Selector
from impedance_modules.diagnosis.regression.candidates import (
    CandidateRegressor,
    candidate_regressors,
    list_candidates,
    shapes_of,
)
from impedance_modules.diagnosis.regression.cleaned_signals import (
    clean_signals,
    noise_of_repeats,
    with_stationary_joints,
)
from impedance_modules.diagnosis.regression.design_matrix import build_design
from impedance_modules.diagnosis.regression.generic_basis import generic_basis
from impedance_modules.diagnosis.regression.model_fit import ModelFit, ModelTerm
from impedance_modules.diagnosis.regression.noise_floor import (
    noise_by_repeats,
    noise_by_smoothness,
    repeat_pairs,
)
from impedance_modules.diagnosis.regression.nuisance_columns import NuisanceColumns, build_nuisance
from impedance_modules.diagnosis.regression.parameter_estimates import ShapeRefiner, UnwhitenedFit, estimates
from impedance_modules.diagnosis.regression.whitening import Whitening
from impedance_modules.diagnosis.residuals.contact_mask import (
    both,
    contact_aside,
    on_links,
)
from impedance_modules.diagnosis.residuals.preparation import Prepared
from impedance_modules.effects.catalogue import CATALOGUE

Array = NDArray[np.float64]
Progress = Callable[[str], None]
"""Called with a sentence for each step."""

CONTACT = "external_contact"
"""Bound to one recording's time: no other recording can confirm it, so it has a procedure of its own (`contact`)."""

POORER = 1.2
"""Squares that a search without moments of contact may leave, over those that the causes found with them leave."""

IN_PROPORTION_TO_COMMAND = ("torque_gain", "controller_gain")
"""Effects in proportion to what was asked for, which a flexible model may not use.

A command knows the motion without the noise of its differences, and an inertia's column with it: together they are
that noise, and would take it from any floor.
"""

SIGMA = 1.5
"""Standard deviations, inflated as those in the answer are."""

NEUTRAL = {"torque_gain": 1.0}
"""Number of an effect that changes nothing, where it is not zero."""


def explain(
    prepared: tuple[Prepared, ...],
    arrangement: Arrangement,
    model: NominalModel,
    without: Collection[str],
    progress: Progress,
) -> Evidence:
    """Finds the causes of what recordings leave, in all that is known of them.

    Args:
        prepared: The recordings.
        arrangement: Which of them are fitted, in which folds, and which are unseen.
        model: What was believed.
        without: Ids of effects that are left out of the catalogue.
        progress: Called with a sentence for each step.
    """
    residuals = list(prepared[0].residuals)
    pairs = repeat_pairs(prepared, arrangement.fitted)
    noise = noise_of_repeats(prepared, pairs, lambda signals: signals.drive)
    flicker = noise_of_repeats(prepared, pairs, lambda signals: signals.effort)
    signals = [clean_signals(with_stationary_joints(item.signals), noise, flicker) for item in prepared]
    shaped = [
        (candidate, shape)
        for candidate in list_candidates(CATALOGUE, prepared, {*without, CONTACT})
        for shape in shapes_of(candidate, signals)
    ]
    generic = generic_basis(prepared, residuals)
    regressors = candidate_regressors(shaped, prepared, signals, residuals)
    nuisance = build_nuisance(prepared, model.tree.inertia)
    raw = [[item.residuals[name][:, joint] for name, joint in nuisance.groups] for item in prepared]
    aside = on_links(contact_aside(prepared), nuisance.groups)
    floor = _floor(raw, prepared, nuisance, [*generic, *_simple(regressors)], arrangement.fitted, aside)
    rate = prepared[0].band.rate / prepared[0].band.step
    names = [item.log.name for item in prepared]
    design = build_design([*regressors, *generic], nuisance, raw, floor, names=names, rate=rate)
    del regressors
    selector = Selector(
        design, arrangement.folds, ShapeRefiner(design, prepared, signals), model.position_resolution
    )
    if aside:
        selector = selector.on(design.without(aside))
    contact = CONTACT in CATALOGUE and CONTACT not in without
    return _search(selector, prepared, arrangement, progress, contact=contact)


def _search(
    selector: Selector,
    prepared: tuple[Prepared, ...],
    arrangement: Arrangement,
    progress: Progress,
    *,
    contact: bool,
) -> Evidence:
    """Finds the causes, sets moments of contact aside, and judges the noise once more with all of that known."""
    found = selector.run(progress)
    pushes = find_pushes(selector.model_fit(found.causes), prepared) if contact else ()
    if pushes:
        progress("setting moments of contact aside")
        touched = on_links(moments_clear(pushes, prepared), selector.design.groups)
        moments = both(selector.design.whitening.clear, touched)
        narrowed = selector.on(selector.design.without(moments))
        again = narrowed.run(progress)
        if _as_good(narrowed, again.causes, found.causes):
            pushes = _measured(selector, narrowed, again.causes, prepared) or pushes
            selector, found = narrowed, again
        else:
            pushes = ()  # what the causes explain better on the very same rows was no push
    model_fit, plain = selector.model_fit(found.causes), UnwhitenedFit(selector.refiner)
    for kept in (
        felt(model_fit, plain, negligible(prepared, selector.design.groups)),
        certain(model_fit, selector.refiner),
        confirmed(model_fit, selector.model_fit, arrangement.heldout),
    ):
        model = [term for term in model_fit.model if term in kept]
        model_fit = model_fit if len(model) == len(model_fit.model) else selector.model_fit(model)
    floor, pairs = selector.design.whitening, repeat_pairs(prepared, arrangement.fitted)
    if pairs:
        # With the causes known, repeats that did not quite repeat no longer leak into the floor.
        left = [plain.left(model_fit, r) for r in range(len(prepared))]
        clear = selector.design.whitening.clear
        floor = noise_by_repeats(left, prepared, selector.design.nuisance, pairs, clear)
    return Evidence(selector, arrangement.heldout, prepared, model_fit, floor, plain, found.refusal, pushes)


def certain(model_fit: ModelFit, refiner: ShapeRefiner) -> list[ModelTerm]:
    """Terms of a fitted model whose number is there for certain; those of several numbers are not judged here."""
    return [term for index, term in enumerate(model_fit.model) if _certain(model_fit, refiner, index, term)]


def _certain(model_fit: ModelFit, refiner: ShapeRefiner, index: int, term: ModelTerm) -> bool:
    effect = term.candidate.effect
    if len(effect.description.parameters) != 1 or effect.replaces:
        return True
    (found,) = estimates(model_fit, refiner, index, prismatic=False).values()
    return abs(found.value - NEUTRAL.get(effect.id, 0.0)) > SIGMA * found.std


def confirmed(
    model_fit: ModelFit, refit: Callable[[Sequence[ModelTerm]], ModelFit], heldout: Sequence[int]
) -> list[ModelTerm]:
    """Terms of a fitted model without which more is left of the unseen recordings; all of them where repeats exist.

    Args:
        model_fit: The model.
        refit: Fits a model with fewer terms.
        heldout: The unseen recordings.
    """
    if not model_fit.design.whitening.weak:
        return list(model_fit.model)
    with_all = model_fit.squares(model_fit.whole.coefficients, heldout)
    kept = []
    for term in model_fit.model:
        rest = refit([other for other in model_fit.model if other is not term])
        without = rest.squares(rest.whole.coefficients, heldout)
        groups = list(term.groups)
        if float(with_all[groups].sum()) < float(without[groups].sum()):
            kept.append(term)
    return kept


def _measured(
    selector: Selector, narrowed: Selector, causes: Sequence[ModelTerm], prepared: Sequence[Prepared]
) -> tuple[Push, ...]:
    """The pushes again, by a model that was fitted without them: the links' numbers no longer bend to them."""
    known = [selector.refiner.term(term.candidate, term.shaped.shape, term.layout) for term in causes]
    model = [term for term in known if term is not None]
    if len(model) < len(known):
        return ()
    return find_pushes(selector.model_fit(model), prepared, narrowed.model_fit(causes).whole.coefficients)


def _as_good(narrowed: Selector, causes: Sequence[ModelTerm], first: Sequence[ModelTerm]) -> bool:
    """Whether causes found without some rows explain the others about as well as those found with all rows do."""
    moved = [narrowed.refiner.term(term.candidate, term.shaped.shape, term.layout) for term in first]
    known = [term for term in moved if term is not None]
    return float(narrowed.model_fit(causes).left.sum()) <= POORER * float(
        narrowed.model_fit(known).left.sum()
    )


def _floor(  # noqa: PLR0917 - all of them belong together
    left: Sequence[Sequence[Array]],
    prepared: Sequence[Prepared],
    nuisance: NuisanceColumns,
    flexible: Sequence[CandidateRegressor],
    fitted: Sequence[int],
    aside: Mapping[tuple[int, int], NDArray[np.bool_]],
) -> Whitening:
    pairs = repeat_pairs(prepared, fitted)
    if pairs:
        return noise_by_repeats(left, prepared, nuisance, pairs, aside)
    return noise_by_smoothness(left, prepared, nuisance, flexible, fitted)


def _simple(regressors: Sequence[CandidateRegressor]) -> list[CandidateRegressor]:
    """Candidates of one joint in one shape: what a flexible model may use besides smooth functions."""
    return [
        regressor
        for regressor in regressors
        if not regressor.shape
        and regressor.width <= 3
        and len(regressor.blocks[0]) == 1
        and not (regressor.key[0] in IN_PROPORTION_TO_COMMAND and regressor.key[2] == "actuator")
    ]
