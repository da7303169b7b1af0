# SPDX-License-Identifier: BSD-3-Clause
"""Backward elimination: removes accepted causes that no longer pass now that all of them are known; merges delays.

A cause may fail because a later one explains part of what it explained, and the later one may fail without it: an
asymmetric friction that balances an offset is too large once the offset is gone. Removed one after the other, both
would be lost. So what passes only beside another is removed first, if that other passes without it.

Joint by joint a delay and a lag of the motor differ by little; near the noise, chance would name some joints' one and
some the other. A delayed bus delays all commands and is one cause: lags become delays where hardly anything is lost.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from impedance_modules.diagnosis.model_selection.candidate_trial import CandidateTrial, try_term
from impedance_modules.diagnosis.regression.model_fit import ModelFit, ModelTerm, term_of
from impedance_modules.diagnosis.regression.shape_refinement import ShapeRefiner
from impedance_modules.effects.effect import Effect

JOINTS_MIN = 3
"""Joints that must be delayed for a common reason to be considered."""

LOSS_MAX = 5.0
"""Log-likelihood that may be lost on a joint by the common cause [nats]."""


def eliminate_backward(
    model: Sequence[ModelTerm],
    make: Callable[[Sequence[ModelTerm]], ModelFit],
    rejection_reason: Callable[[CandidateTrial], str | None],
) -> list[ModelTerm]:
    """Removes causes that no longer pass beside the others.

    Args:
        model: Accepted causes, in the order they were found.
        make: Fits a model.
        rejection_reason: Why a trial is rejected; None if it passes.
    """

    def passes(term: ModelTerm, beside: Sequence[ModelTerm]) -> bool:
        return rejection_reason(try_term(make(beside), term)) is None

    kept = list(model)
    for term in model:
        if term not in kept or passes(term, _without(kept, term)):
            continue
        rest = _without(kept, term)
        near = [other for other in rest if set(other.groups) & set(term.groups)]
        dependent = [
            other
            for other in near
            if passes(other, _without(kept, other)) and not passes(other, _without(rest, other))
        ]
        independent = _without(rest, *dependent)
        kept = (
            [other for other in kept if other not in dependent]
            if dependent and passes(term, independent)
            else rest
        )
    return kept


def merge_delays(
    model: Sequence[ModelTerm], make: Callable[[Sequence[ModelTerm]], ModelFit], refiner: ShapeRefiner
) -> list[ModelTerm]:
    """Replaces lags by delays where a common delay explains the recordings about as well.

    Args:
        model: Accepted causes.
        make: Fits a model.
        refiner: Moves shapes off their grid.
    """
    kept = list(model)
    delaying = {term.key[1] for term in kept if term.candidate.effect.delays_torque}
    delayed = {term.key[1] for term in kept if _shared_delay(term.candidate.effect)}
    if len(delaying) < JOINTS_MIN or not delayed:
        return kept
    lags = [
        term
        for term in kept
        if term.candidate.effect.delays_torque
        and not term.candidate.effect.shared_by_joints
        and term.key[1] not in delayed
    ]
    # Together first: the stamps' common error makes up for one joint's delay that is taken alone for a lag.
    for some in (lags, *([lag] for lag in lags)) if len(lags) > 1 else (lags,):
        kept = _delayed_as_well(kept, some, make, refiner)
    return kept


def _delayed_as_well(
    model: list[ModelTerm],
    lags: Sequence[ModelTerm],
    make: Callable[[Sequence[ModelTerm]], ModelFit],
    refiner: ShapeRefiner,
) -> list[ModelTerm]:
    """The model with delays in place of some lags that it still has, if that explains about as much."""
    left = [lag for lag in lags if lag in model]
    delays = {id(lag): _delay(model, lag, make, refiner) for lag in left}
    if not left or None in delays.values():
        return model
    changed = [delays.get(id(term)) or term for term in model]
    old, new = make(model), make(changed)
    return changed if 0.5 * float((new.left - old.left) @ old.weights) <= LOSS_MAX else model


def _without(model: Sequence[ModelTerm], *terms: ModelTerm) -> list[ModelTerm]:
    return [other for other in model if other not in terms]


def _shared_delay(effect: Effect) -> bool:
    """Whether an effect is a delay that all joints can have for one reason."""
    return effect.delays_torque and effect.shared_by_joints


def _delay(
    model: Sequence[ModelTerm],
    lag: ModelTerm,
    make: Callable[[Sequence[ModelTerm]], ModelFit],
    refiner: ShapeRefiner,
) -> ModelTerm | None:
    """The delay that does best in a lag's place; None where none was ever a candidate."""
    rest = make([other for other in model if other is not lag])
    layouts = [
        layout
        for layout in rest.design.layouts
        if layout.shaped.candidate is not None
        and layout.shaped.candidate.key == lag.candidate.key
        and _shared_delay(layout.shaped.candidate.effect)
    ]
    trials = [try_term(rest, term_of(rest.design, layout)) for layout in layouts]
    if not trials:
        return None
    return refiner.refine(rest, max(trials, key=lambda trial: trial.in_sample.gain).term)
