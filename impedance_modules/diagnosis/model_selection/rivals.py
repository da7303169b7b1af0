# SPDX-License-Identifier: BSD-3-Clause
"""Stage 6: for each cause, what else could be it, and why the others lost."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.diagnosis.model_selection.acceptance import (
    DECIDED,
    bic_penalty,
    further_gain,
    penalised_gain,
    promising,
)
from impedance_modules.diagnosis.model_selection.candidate_trial import CandidateTrial, refit, try_term
from impedance_modules.diagnosis.model_selection.forward_selection import Selector
from impedance_modules.diagnosis.model_selection.plausibility import CONTRAST_MIN
from impedance_modules.diagnosis.model_selection.richer_laws import richer_laws
from impedance_modules.diagnosis.regression.candidates import Candidate
from impedance_modules.diagnosis.regression.model_fit import ModelFit, ModelTerm, part_of
from impedance_modules.diagnosis.regression.parameter_estimates import correlation_surplus
from impedance_modules.diagnosis.result import Rival, Standing
from impedance_modules.effects.effect_description import Port

ASKED = 20
"""Rivals that are tried beside each cause: friction alone has eight laws at two places."""

Likelihood = Callable[[ModelFit], Array]
"""(groups,) log-likelihood of held-out recordings under a model that was fitted without them [nats]."""

Lead = Callable[[CandidateTrial], float]
"""By how much a cause is likelier than a rival [nats]."""


@dataclass(frozen=True)
class Comparison:
    """A cause beside its rivals.

    Attributes:
        equal: Those that cannot be told from it.
        elsewhere: Other ports at which the same effect cannot be told from it.
        lost: The others, with the reason why.
        standing: How far the cause stands out from these.
    """

    equal: tuple[Rival, ...]
    elsewhere: tuple[Port, ...]
    lost: tuple[Rival, ...]
    standing: Standing


def judge_rivals(
    selector: Selector, causes: Sequence[ModelTerm], term: ModelTerm, held_out: Likelihood
) -> Comparison:
    """Tries every promising candidate in a cause's place, the other causes kept.

    ``held_out`` is the log-likelihood of recordings that no step of the search has fitted.
    """
    model_fit = selector.model_fit([other for other in causes if other is not term])
    own = try_term(model_fit, term)
    beside = refit(own)
    lead = lead_of(own, beside, held_out)
    decided = DECIDED * correlation_surplus(beside, own.term.groups)
    held = {other.key for other in causes}
    equal: list[Rival] = []
    elsewhere: list[Port] = []
    lost: list[Rival] = []
    beaten = [0.0]
    asked = [
        layout
        for layout in promising(selector.screen.rank(model_fit), ASKED)
        if layout.shaped.key not in held | {term.key}
    ]
    tried = [selector.trial(model_fit, layout) for layout in asked]
    for rival in best_of_names(
        selector.refined(model_fit, tried), richer_laws(model_fit, term, selector.refiner)
    ):
        candidate = rival.term.candidate
        other = not same_name(candidate, term.candidate)
        reason = _lost(selector, own, rival, lead, decided)
        if reason is not None:
            at = "" if other else f"at the {_place(candidate)}: "
            lost.append(_named(candidate, at + reason))
            if other and not contains(rival, own):
                beaten.append(penalised_gain(rival))
        elif other:
            equal.append(_named(candidate, "fits unseen recordings as well"))
        else:
            elsewhere.append(candidate.port)
    gain = penalised_gain(own)
    return Comparison(
        equal=tuple(dict.fromkeys(equal)),
        elsewhere=tuple(dict.fromkeys(elsewhere)),
        lost=tuple(dict.fromkeys(lost)),
        standing=Standing(gain, gain - max(beaten)),
    )


def best_of_names(trials: Sequence[CandidateTrial], more: Sequence[CandidateTrial]) -> list[CandidateTrial]:
    """Some trials, with others of the same candidate in their place where these are likelier."""
    best = {trial.term.key: trial for trial in trials}
    for trial in more:
        known = best.get(trial.term.key)
        if known is None or penalised_gain(trial) > penalised_gain(known):
            best[trial.term.key] = trial
    return list(best.values())


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


def _place(candidate: Candidate) -> str:
    return candidate.effect.description.place(candidate.port).replace("_", " ")


def _named(candidate: Candidate, reason: str) -> Rival:
    return Rival(candidate.effect.id, candidate.joints, reason)


def _lost(
    selector: Selector,
    own: CandidateTrial,
    rival: CandidateTrial,
    lead: Lead,
    decided: float,
) -> str | None:
    """Why a rival lost; None where it cannot be told from the cause."""
    if not _equal(own, rival, lead, decided):
        return _reason(own, rival)
    return None if _open(rival, own) else selector.unphysical(rival)


def _equal(own: CandidateTrial, rival: CandidateTrial, lead: Lead, decided: float) -> bool:
    """Whether nothing decides between a cause and a rival that there is evidence for.

    Samples of what both leave that follow each other are no new evidence: ``decided`` grows as the errors of numbers
    do.
    """
    groups = own.term.groups
    mine, its = own.reach_on(groups), rival.reach_on(groups)
    if mine <= 0.0 or its <= 0.0 or penalised_gain(rival) <= 0.0:
        return False
    if contains(rival, own) and not _alone(rival, own):
        return further_gain(rival, own) > 0.0 and lead(rival) < 0.0
    return lead(rival) < decided


def lead_of(own: CandidateTrial, beside: ModelFit, held_out: Likelihood) -> Lead:
    """By how much a cause is likelier than a rival, given all recordings and each one's penalty [nats].

    A trial keeps the weights of the model without the cause. Where the gap is large they are small, and the links'
    errors stay within a prior that nothing moves: a cause that can imitate these errors too, a load beside a constant
    torque, would seem ahead by what the nuisance explains as soon as the gap is closed. So a cause leads by what it is
    ahead in the trial and once everything is fitted beside each of the two, whichever is less. The held-out recordings
    count as they are predicted by the latter: on a small part of a joint's range a ripple is a spring, beyond it not.
    What a rival gains more where the cause does not act does not count: it may be right there, and wrong here.

    Args:
        own: The cause.
        beside: The model with it, everything fitted anew.
        held_out: Log-likelihood of the held-out recordings.
    """
    mine = cache(lambda: (beside.log_likelihood, held_out(beside)))

    def here(ahead: Array, total: float) -> float:
        """A lead in all groups less what the rival gains more elsewhere."""
        return total + max(0.0, -float(np.delete(ahead, own.term.groups).sum()))

    def lead(rival: CandidateTrial) -> float:
        fitted = refit(rival)
        tried = here(own.unseen_gains - rival.unseen_gains, own.gain - rival.gain)
        anew, unseen = (
            one - its for one, its in zip(mine(), (fitted.log_likelihood, held_out(fitted)), strict=True)
        )
        ahead = min(tried, here(anew, float(anew.sum()))) + here(unseen, float(unseen.sum()))
        return ahead - (bic_penalty(own) - bic_penalty(rival))

    return lead


def _alone(rival: CandidateTrial, own: CandidateTrial) -> bool:
    """Whether what makes the rival more than the cause does as well by itself: then neither can be told apart.

    Dry friction that falls with the speed does not exist by itself: it would fall to nothing.
    """
    effect = rival.term.candidate.effect
    rows = np.array(effect.contrasts)
    if effect.dry or rows.size == 0 or not np.all(np.count_nonzero(rows, axis=1) == 1):
        return False
    kept = np.flatnonzero(rows.any(axis=0))
    part = try_term(rival.model_fit, part_of(rival.term, kept))
    return penalised_gain(own) - penalised_gain(part) < DECIDED


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
