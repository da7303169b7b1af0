# SPDX-License-Identifier: BSD-3-Clause
"""Stage 6: for each cause, what else could be it, and why the others lost."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from impedance_modules.diagnosis.model_selection.acceptance import (
    bic_penalty,
    both_delay_torque,
    penalised_gain,
    promising,
)
from impedance_modules.diagnosis.model_selection.candidate_trial import CandidateTrial, try_term
from impedance_modules.diagnosis.model_selection.forward_selection import Selector
from impedance_modules.diagnosis.model_selection.plausibility import CONTRAST_MIN
from impedance_modules.diagnosis.regression.candidates import Candidate
from impedance_modules.diagnosis.regression.model_fit import ModelFit, ModelTerm, part_of
from impedance_modules.diagnosis.result import Rival, Standing

ASKED = 8
"""Rivals that are tried beside each cause."""

EQUAL_SIGMA = 3.0
"""Fewer standard errors than this between two candidates: the recordings cannot tell them apart ..."""

EQUAL_LOSS = 0.01
"""... if also no more than this part of the explained power lies between them."""

DECIDED = 15.0
"""Log-likelihood by which a cause must lie ahead [nats], standard errors too, where hardly any power does."""

DECISIVE = 150.0
"""Log-likelihood [nats] beyond which a few moments may make the difference: they are enough, where more than
`EQUAL_LOSS` of the power lies between."""

DELAYS_DECIDED = 7.5
"""Log-likelihood by which a delay must lie ahead of a lag, or a lag of a delay, and by `EQUAL_SIGMA` too [nats]."""


def judge_rivals(
    selector: Selector, causes: Sequence[ModelTerm], term: ModelTerm
) -> tuple[tuple[Rival, ...], tuple[Rival, ...], Standing]:
    """Tries every promising candidate in a cause's place, the other causes kept.

    Returns:
        Those that cannot be told from it; the others with the reason why they lost; and how far the cause stands out
        from these.
    """
    model_fit = selector.model_fit([other for other in causes if other is not term])
    own = try_term(model_fit, term)
    held = {other.key for other in causes}
    equal: list[Rival] = []
    lost: list[Rival] = []
    beaten = [0.0]
    asked = [
        layout
        for layout in promising(selector.screen.rank(model_fit), ASKED)
        if layout.shaped.key not in held
    ]
    for found in selector.refined(model_fit, [selector.trial(model_fit, layout) for layout in asked]):
        rival = selector.moved(model_fit, found) if both_delay_torque(own, found) else found
        candidate = rival.term.candidate
        other = not same_name(candidate, term.candidate)
        if (
            other
            and (_equal(own, rival) or _equal_refitted(own, rival))
            and (selector.plausibility.unphysical(rival) is None or _open(rival, own))
        ):
            equal.append(_named(candidate, "fits unseen recordings as well"))
        else:
            lost.append(_named(candidate, _reason(own, rival)))
            if other and not contains(rival, own):
                beaten.append(penalised_gain(rival))
    gain = penalised_gain(own)
    return tuple(dict.fromkeys(equal)), tuple(dict.fromkeys(lost)), Standing(gain, gain - max(beaten))


def same_name(one: Candidate, other: Candidate) -> bool:
    """Whether two candidates are one answer: one effect on the same joints."""
    return one.effect.id == other.effect.id and one.key == other.key


def contains(rival: CandidateTrial, own: CandidateTrial) -> bool:
    """Whether the rival is the cause with more parameters: then it lost by being no better.

    Either its symbols say so, or that what makes it more than a simpler law is not there for certain.
    """
    more, less = rival.term.candidate, own.term.candidate
    larger = set(more.effect.description.symbols) > set(less.effect.description.symbols)
    if "body" in more.effect.description.keys and "body" in less.effect.description.keys:
        larger = rival.term.layout.free > own.term.layout.free
    empty = (
        bool(more.effect.contrasts)
        and rival.in_sample.contrast_chi_square < CONTRAST_MIN
        and not less.effect.contrasts
    )
    return more.key == less.key and (larger or empty)


def _named(candidate: Candidate, reason: str) -> Rival:
    return Rival(candidate.effect.id, candidate.joints, reason)


def _equal(own: CandidateTrial, rival: CandidateTrial) -> bool:
    groups = own.term.groups
    mine, its = own.reach_on(groups), rival.reach_on(groups)
    if mine <= 0.0 or (contains(rival, own) and not _alone(rival, own)):
        return False
    loss = (mine - its) / mine
    ahead = own.advantage(rival) >= EQUAL_SIGMA
    if both_delay_torque(own, rival):
        return not (ahead and own.gain - rival.gain > DELAYS_DECIDED)
    if loss < EQUAL_LOSS:
        return not (ahead and own.gain - rival.gain > DECIDED)
    return loss < 5.0 * EQUAL_LOSS and not ahead and own.gain - rival.gain < DECISIVE


def _equal_refitted(own: CandidateTrial, rival: CandidateTrial) -> bool:
    """Whether a rival that is as good a part of the power is so by its evidence, too, once all is fitted beside it.

    A trial keeps the weights of the model without the cause. Where the gap is large they are small, and the links'
    errors stay within a prior that nothing moves: a cause that can imitate these errors too, a load beside a constant
    torque, would seem ahead by what the nuisance explains as soon as the gap is closed.
    """
    groups = own.term.groups
    mine, its = own.reach_on(groups), rival.reach_on(groups)
    if mine <= 0.0 or contains(rival, own) or mine - its >= EQUAL_LOSS * mine:
        return False
    first, second = (_refitted(trial) for trial in (own, rival))
    return _log_likelihood(first) - bic_penalty(own) <= _log_likelihood(second) - bic_penalty(rival) + DECIDED


def _refitted(trial: CandidateTrial) -> ModelFit:
    """The model with the candidate, everything fitted anew."""
    model_fit = trial.model_fit
    return ModelFit(model_fit.design, model_fit.folds, [*model_fit.model, trial.term])


def _log_likelihood(model_fit: ModelFit) -> float:
    """Of the fitted recordings as they are predicted without their fold, each group's level profiled out [nats]."""
    left = np.sum([[float(x @ x) for x in parts] for parts in model_fit.unseen.values()], axis=0)
    return float(-0.5 * np.sum(model_fit.counts * np.log(np.maximum(left, 1e-9))))


def _alone(rival: CandidateTrial, own: CandidateTrial) -> bool:
    """Whether what makes the rival more than the cause does as well by itself: then neither can be told apart."""
    rows = np.array(rival.term.candidate.effect.contrasts)
    if rows.size == 0 or not np.all(np.count_nonzero(rows, axis=1) == 1):
        return False
    kept = np.flatnonzero(rows.any(axis=0))
    part = try_term(rival.model_fit, part_of(rival.term, kept))
    mine, its = own.reach_on(own.term.groups), part.reach_on(own.term.groups)
    return mine - its < EQUAL_LOSS * mine


def _open(rival: CandidateTrial, own: CandidateTrial) -> bool:
    """Whether what makes the rival more than the cause could be as large as the cause, for all that is seen.

    A joint that stands still at one place tells nothing about a stiffness beside an offset, not even its sign. Columns
    are scaled to one.
    """
    rows = np.array(rival.term.candidate.effect.contrasts)
    if rows.size == 0 or not np.all(np.count_nonzero(rows, axis=1) == 1):
        return False
    kept = np.flatnonzero(rows.any(axis=0))
    return bool(np.all(rival.in_sample.spread[kept] > np.abs(own.in_sample.own).max()))


def _reason(own: CandidateTrial, rival: CandidateTrial) -> str:
    mine, its = own.reach_on(own.term.groups), rival.reach_on(own.term.groups)
    if its <= 0.0:
        return "explains nothing on unseen recordings"
    if contains(rival, own):
        return "contains the cause, and its further parameters gain nothing on unseen recordings"
    share = 100.0 * its / mine if mine > 0.0 else 0.0
    if its > mine and bic_penalty(rival) > bic_penalty(own):
        return "does no better than its further parameters cost"
    return f"explains {share:.0f} % of what the cause explains on unseen recordings"
