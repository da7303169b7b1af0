# SPDX-License-Identifier: BSD-3-Clause
r"""Search of the causes: candidate columns, noise floor, forward selection, contact, tests of significance.

Two tests end the search. A cause must take more than a negligible part of a joint's load, and its numbers must differ
from none with 95 % confidence, by the errors that they are printed with.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray

from impedance_modules.arrays import Array
from impedance_modules.diagnosis.data.folds import DataSplit
from impedance_modules.diagnosis.data.nominal_model import NominalModel
from impedance_modules.diagnosis.model_selection.candidate_trial import try_term
from impedance_modules.diagnosis.model_selection.evidence import Evidence, above_negligible, negligible
from impedance_modules.diagnosis.model_selection.external_pushes import ExternalPush
from impedance_modules.diagnosis.model_selection.forward_selection import Selection, Selector
from impedance_modules.diagnosis.model_selection.load_reversals import load_reversal_note, rows_on_one_flank
from impedance_modules.diagnosis.model_selection.reversals import reversal_note, rows_without_reversals
from impedance_modules.diagnosis.model_selection.search_beside_disturbances import (
    disturbance_notes,
    without_disturbances,
)
from impedance_modules.diagnosis.model_selection.search_beside_pushes import without_pushes
from impedance_modules.diagnosis.regression.candidates import (
    Candidate,
    CandidateRegressor,
    candidate_regressors,
    list_candidates,
    shapes_of,
)
from impedance_modules.diagnosis.regression.cleaned_signals import (
    clean_signals,
    noise_of_repeats,
    without_noise_of_motion,
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
from impedance_modules.diagnosis.regression.parameter_estimates import UnwhitenedFit, beyond_chance, estimates
from impedance_modules.diagnosis.regression.sensor_noise import read_noise
from impedance_modules.diagnosis.regression.shape_refinement import ShapeRefiner
from impedance_modules.diagnosis.regression.whitening import Whitening
from impedance_modules.diagnosis.residuals.contact_mask import (
    Mask,
    contact_free_rows,
    intersect_masks,
    rows_of_link_residuals,
)
from impedance_modules.diagnosis.residuals.gap_mask import rows_of_all_residuals, rows_without_gaps
from impedance_modules.diagnosis.residuals.preparation import Prepared
from impedance_modules.effects.catalogue import CATALOGUE
from impedance_modules.effects.external_contact import ExternalContact
from impedance_modules.effects.joint_transmission import Backlash
from impedance_modules.effects.recorded_signals import Signals
from impedance_modules.worker_processes import OrderedMap, map_here

Progress = Callable[[str], None]
"""Called with a sentence for each step."""

CandidateKey = tuple[str, str, str]
"""Effect, what carries its numbers, and port."""

LinkMask = Mapping[tuple[int, int], Mask]
"""Recording and group -> (M,) rows that count."""

SIGMA = 1.96
"""Standard deviations of 95 % confidence, inflated as those in the result."""


def search_causes(
    prepared: tuple[Prepared, ...],
    split: DataSplit,
    model: NominalModel,
    without: Collection[str],
    progress: Progress,
    each: OrderedMap = map_here,
    *,
    refused: Collection[CandidateKey] = (),
) -> Evidence:
    """Finds the causes of the residuals of all recordings.

    Args:
        prepared: The recordings.
        split: Which of them are fitted, in which folds, and which are held out.
        model: The nominal model.
        without: Ids of effects that are left out of the catalogue.
        progress: Called with a sentence for each step.
        each: Where recordings are worked on, one by one.
        refused: Candidates that are left out.
    """
    # What happened at one time in one recording can be confirmed by no other: it is searched for by itself.
    bound = {effect.id for effect in CATALOGUE.values() if effect.bound_to_recording}
    candidates = [
        candidate
        for candidate in list_candidates(CATALOGUE, prepared, {*without, *bound})
        if (candidate.effect.id, candidate.key, candidate.port) not in refused
    ]

    def make(clear: LinkMask) -> Selector:
        return _selector(prepared, split, model, candidates, each, clear)

    selector, found, crossings = _without_load_reversals(make({}), make, prepared, progress)
    selector, found, notes = _without_reversals(selector, found, prepared, progress)
    pushes: tuple[ExternalPush, ...] = ()
    if ExternalContact.description.id not in without:
        selector, found, pushes = without_pushes(selector, found, prepared, progress)
    selector, found, disturbed = without_disturbances(selector, found, prepared, progress)
    plain = UnwhitenedFit(selector.refiner)
    model_fit = tested(selector, found.causes, plain, prepared)
    floor, pairs = selector.design.whitening, repeat_pairs(prepared, split.fitted)
    if pairs:
        # With the causes known, differences between repeated motions no longer raise the noise floor.
        left = [plain.left(model_fit, r) for r in range(len(prepared))]
        floor = noise_by_repeats(left, prepared, selector.design.nuisance, pairs, floor.clear)
    return Evidence(
        selector,
        split.heldout,
        prepared,
        model_fit,
        floor,
        plain,
        found.refusal,
        pushes,
        disturbed,
        (*crossings, *notes, *disturbance_notes(disturbed, prepared, selector.design.groups)),
    )


def _selector(
    prepared: tuple[Prepared, ...],
    split: DataSplit,
    model: NominalModel,
    candidates: Sequence[Candidate],
    each: OrderedMap,
    clear: LinkMask,
) -> Selector:
    """Builds the columns of all candidates, the noise floor and the design; rows in contact and at gaps are masked.

    Rows that are not ``clear`` are masked as well.
    """
    signals = _cleaned(prepared, split)
    shaped = [(candidate, shape) for candidate in candidates for shape in shapes_of(candidate, signals)]
    residuals = list(prepared[0].residuals)
    generic = generic_basis(prepared, residuals)
    regressors = candidate_regressors(shaped, prepared, signals, residuals, each)
    nuisance = build_nuisance(prepared, model.tree.inertia)
    raw = [[item.residuals[name][:, joint] for name, joint in nuisance.groups] for item in prepared]
    mask = intersect_masks(
        rows_of_link_residuals(contact_free_rows(prepared, split.fitted), nuisance.groups),
        rows_of_all_residuals(rows_without_gaps(prepared), len(nuisance.groups)),
    )
    mask = intersect_masks(mask, clear)
    floor = _floor(raw, prepared, nuisance, [*generic, *_simple_candidates(regressors)], split.fitted, mask)
    rate = prepared[0].band.rate / prepared[0].band.step
    names = [item.log.name for item in prepared]
    design = build_design([*regressors, *generic], nuisance, raw, floor, names=names, rate=rate)
    del regressors
    refiner = ShapeRefiner(design, prepared, signals)
    # Where no grid is stated, the readings' noise stands for it: a grid makes noise, too.
    unseen = model.position_resolution or max(float(read_noise(item).max()) for item in prepared)
    selector = Selector(design, split.folds, refiner, unseen)
    return selector.on(design.without(mask)) if mask else selector


def _cleaned(prepared: Sequence[Prepared], split: DataSplit) -> list[Signals]:
    """Signals of all recordings without the noise of commands and efforts, which repeats measure."""
    pairs = repeat_pairs(prepared, split.fitted)
    noise = noise_of_repeats(prepared, pairs, lambda signals: signals.drive)
    flicker = noise_of_repeats(prepared, pairs, lambda signals: signals.effort)
    return [clean_signals(without_noise_of_motion(item.signals), noise, flicker) for item in prepared]


def _without_reversals(
    selector: Selector, found: Selection, prepared: Sequence[Prepared], progress: Progress
) -> tuple[Selector, Selection, tuple[str, ...]]:
    """Repeats the search without the rows in which dry friction is not understood, and says so; else as given.

    It holds if dry friction is found again at the joints that lost rows.
    """
    sliding = rows_without_reversals(found.causes, selector.model_fit, prepared)
    if not sliding:
        return selector, found, ()
    progress("masking reversals")
    design = selector.design
    masked = selector.on(design.without(intersect_masks(design.whitening.clear, sliding)))
    again = masked.run(progress)
    dry = {group for cause in again.causes if cause.candidate.effect.dry for group in cause.groups}
    if not {group for _, group in sliding} <= dry:
        # Nothing dry is left, so dry friction is no reason to leave its reversals out.
        return selector, found, ()
    return masked, again, reversal_note(sliding, prepared, design.groups)


def _without_load_reversals(
    selector: Selector, make: Callable[[LinkMask], Selector], prepared: Sequence[Prepared], progress: Progress
) -> tuple[Selector, Selection, tuple[str, ...]]:
    """Searches without the rows in which a link may cross its play unseen, and says so; else with all rows.

    These rows are known before anything is searched: they raise the noise floor, and then all sorts of causes pass
    as explained. It holds if play is found at the joint whose load reverses.
    """
    loaded, joint = rows_on_one_flank(selector.model_fit([]), prepared)
    if joint is not None:
        progress("masking reversals of the load")
        masked = make(loaded)
        found = masked.run(progress)
        play = [
            term.candidate.joints
            for term in found.causes
            if term.candidate.effect.id == Backlash.description.id
        ]
        if (prepared[0].tree.joints[joint],) in play:
            return masked, found, (load_reversal_note(joint, loaded, prepared),)
    progress("searching")
    return selector, selector.run(progress), ()


def tested(
    selector: Selector,
    causes: Sequence[ModelTerm],
    plain: UnwhitenedFit,
    prepared: Sequence[Prepared],
) -> ModelFit:
    """Fits the causes that pass both tests of significance, again without the others until all of them do.

    Of those whose numbers may be chance the one that gains least goes first: a mass and a gain that explain the same
    are both uncertain, and one of them alone is not.
    """
    model_fit = selector.model_fit(causes)
    while True:
        seen = above_negligible(model_fit, plain, negligible(prepared, selector.design.groups))
        small = [term for term in model_fit.model if term not in seen]
        if small:
            model_fit = selector.model_fit(selector.reshaped(seen, small))
            continue
        certain = significant_terms(model_fit, selector.refiner)
        unsure = [term for term in model_fit.model if term not in certain]
        if not unsure:
            return model_fit
        least = min(unsure, key=partial(_gain_beside, selector, model_fit))
        others = [term for term in model_fit.model if term is not least]
        model_fit = selector.model_fit(selector.reshaped(others, [least]))


def _gain_beside(selector: Selector, model_fit: ModelFit, term: ModelTerm) -> float:
    """What a term gains beside the others of a model [nats]."""
    rest = selector.model_fit([other for other in model_fit.model if other is not term])
    return try_term(rest, term).gain


def significant_terms(model_fit: ModelFit, refiner: ShapeRefiner) -> list[ModelTerm]:
    """Terms whose numbers differ from no effect for certain."""
    return [
        term for index, term in enumerate(model_fit.model) if _significant(model_fit, refiner, index, term)
    ]


def _significant(model_fit: ModelFit, refiner: ShapeRefiner, index: int, term: ModelTerm) -> bool:
    effect = term.candidate.effect
    # A number that replaces the nominal one has coefficients that are zero where it does not differ.
    if effect.replaces or len(effect.description.parameters) > 1:
        return beyond_chance(model_fit, refiner, index)
    neutral = effect.description.parameters[0].neutral
    (found,) = estimates(model_fit, refiner, index, prismatic=False).values()
    return abs(found.value - neutral) > SIGMA * found.std


def _floor(
    left: Sequence[Sequence[Array]],
    prepared: Sequence[Prepared],
    nuisance: NuisanceColumns,
    flexible: Sequence[CandidateRegressor],
    fitted: Sequence[int],
    mask: Mapping[tuple[int, int], NDArray[np.bool_]],
) -> Whitening:
    pairs = repeat_pairs(prepared, fitted)
    if pairs:
        return noise_by_repeats(left, prepared, nuisance, pairs, mask)
    return noise_by_smoothness(left, prepared, nuisance, flexible, fitted, mask)


def _simple_candidates(regressors: Sequence[CandidateRegressor]) -> list[CandidateRegressor]:
    """Candidates of one joint in one shape, which the flexible model uses beside smooth functions."""
    return [
        regressor
        for regressor in regressors
        if not regressor.shape
        and regressor.width <= 3
        and len(regressor.blocks[0]) == 1
        and not _in_proportion(regressor)
    ]


def _in_proportion(regressor: CandidateRegressor) -> bool:
    """Whether a candidate is in proportion to the command.

    The flexible model may not use it: a command holds the motion without the noise of its derivatives. Together with
    an inertia's column it equals that noise, and would remove it from the noise floor.
    """
    one = regressor.candidate
    return one is not None and one.effect.proportional_to_command(one.port)
