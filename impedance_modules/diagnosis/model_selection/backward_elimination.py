# SPDX-License-Identifier: BSD-3-Clause
"""Which accepted causes still earn their place now that all of them are known.

A cause may fail because a later one took part of its work over, and the later one may be nothing without it: a friction
whose asymmetry balances an offset outweighs itself once the offset is gone. Dropped one after the other, both would be
lost; so what only leans on another goes first, if that other stands without it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from impedance_modules.diagnosis.model_selection.candidate_trial import CandidateTrial, try_term
from impedance_modules.diagnosis.regression.model_fit import ModelFit, ModelTerm, term_of
from impedance_modules.diagnosis.regression.parameter_estimates import ShapeRefiner
from impedance_modules.effects.effect import Effect

JOINTS_MIN = 3
"""Joints that must be late for a common reason to be thought of."""

GIVEN_UP = 5.0
"""Log-likelihood that the common name may cost on a joint [nats]."""


def eliminate_backward(
    model: Sequence[ModelTerm],
    make: Callable[[Sequence[ModelTerm]], ModelFit],
    rejection_reason: Callable[[CandidateTrial], str | None],
) -> list[ModelTerm]:
    """Removes causes that no longer earn their place beside the others.

    Args:
        model: Accepted causes, in the order they were found.
        make: Fits a model.
        rejection_reason: Why a trial does not earn its place; None if it does.
    """

    def stands(term: ModelTerm, beside: Sequence[ModelTerm]) -> bool:
        return rejection_reason(try_term(make(beside), term)) is None

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


def merge_delays(
    model: Sequence[ModelTerm], make: Callable[[Sequence[ModelTerm]], ModelFit], refiner: ShapeRefiner
) -> list[ModelTerm]:
    """Exchanges lags for delays where most joints could be late alike and the recordings hardly mind.

    Args:
        model: Accepted causes.
        make: Fits a model.
        refiner: Moves shapes off their grid.
    """
    kept = list(model)
    late = {term.key[1] for term in kept if term.candidate.effect.delays_torque}
    delayed = {term.key[1] for term in kept if _shared_delay(term.candidate.effect)}
    if len(late) < JOINTS_MIN or not delayed:
        return kept
    for index, term in enumerate(model):
        effect = term.candidate.effect
        if not effect.delays_torque or effect.shared_by_joints or term.key[1] in delayed:
            continue
        better = _delay(kept, term, make, refiner)
        if better is None:
            continue
        old, new = make(kept), make([*kept[:index], better, *kept[index + 1 :]])
        if 0.5 * float((new.left - old.left) @ old.weights) <= GIVEN_UP:
            kept[index] = better
    return kept


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
