# SPDX-License-Identifier: BSD-3-Clause
"""Acceptance criteria: how candidates are compared, and what a trial must show before its cause is named."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from impedance_modules.diagnosis.model_selection.candidate_trial import CandidateTrial, refit
from impedance_modules.diagnosis.model_selection.screening import ScreenedCandidate
from impedance_modules.diagnosis.regression.design_matrix import ColumnLayout

SAME_REACH = 0.95
"""Candidates that explain this part of what the best one does are as good; the one with the lower penalty is taken."""

BIC_MIN = 15.0
"""Least improvement of the Bayesian information criterion."""

DECIDED = 5.0
"""Penalised log-likelihood by which a cause must lie ahead of a rival [nats]: odds of 150 to one, very strong evidence
(Kass & Raftery 1995), of samples that are independent."""

SPECIFIC = 8.0
"""Log-likelihood by which a generic regressor must beat a cause that is none [nats]."""

SPREAD, NARROW = 0.3, 0.95
"""An effect of which more than this part falls on other joints must not gain more than that part on one, and on the
others less than evidence asks for: beside a gain of thousands of nats a few hundred are much."""

HARM_MAX = 0.15
"""Part of what it gains on some recordings that a cause may lose on others."""

REDUCTION_MIN = 0.05
"""Least part of a group's held-out squares that a cause removes."""


def best_of_each(entries: Sequence[ScreenedCandidate], most: int) -> list[ScreenedCandidate]:
    """The physical shape of each candidate with the largest penalised gain, the best candidates first."""
    found: dict[tuple[str, str, str], ScreenedCandidate] = {}
    for entry in entries:
        if entry.physical and entry.layout.shaped.candidate is not None:
            best = found.setdefault(entry.layout.shaped.key, entry)
            if entry.worth > best.worth:
                found[entry.layout.shaped.key] = entry
    return list(found.values())[:most]


def promising(entries: Sequence[ScreenedCandidate], most: int) -> list[ColumnLayout]:
    """The best candidates by likelihood, and the best by the power they would explain."""
    by_gain = best_of_each(entries, most)
    by_power = best_of_each(sorted(entries, key=lambda entry: -entry.power), most)
    return list({entry.layout.shaped.key: entry.layout for entry in [*by_gain, *by_power]}.values())


def by_merit(trials: Sequence[CandidateTrial]) -> list[CandidateTrial]:
    """Sorts trials by what they explain; of those that explain the same, the likeliest one by its penalty first."""
    left = sorted(trials, key=lambda item: -item.reach)
    out: list[CandidateTrial] = []
    while left:
        near = [item for item in left if item.reach >= SAME_REACH * left[0].reach]
        chosen = max(near, key=penalised_gain, default=left[0])
        out.append(chosen)
        left.remove(chosen)
    return out


def both_delay_torque(one: CandidateTrial, other: CandidateTrial) -> bool:
    """Whether both delay one joint's torque, by two different laws.

    The two differ in the second order of their time alone: they are compared at their own best times.
    """
    terms = one.term, other.term
    return (
        one.term.key[1] == other.term.key[1]
        and one.term.key[0] != other.term.key[0]
        and all(not term.generic and term.candidate.effect.delays_torque for term in terms)
    )


def penalised_gain(trial: CandidateTrial) -> float:
    """Held-out gain less the penalty of its parameters [nats]."""
    return trial.gain - bic_penalty(trial)


def bic_penalty(trial: CandidateTrial) -> float:
    """Penalty of a candidate's parameters by the Bayesian information criterion, and of its choice of shapes [nats]."""
    shaped = trial.term.shaped
    samples = float(np.max(trial.model_fit.counts[list(trial.term.groups)]))
    searched = np.log(max(trial.model_fit.design.shapes[shaped.key], 1))
    return float(0.5 * trial.term.layout.free * np.log(max(samples, 2.0)) + searched)


def further_gain(richer: CandidateTrial, simpler: CandidateTrial) -> float:
    """What a richer law gains beyond a simpler one that it contains, penalties of both included [nats].

    It must gain it on unseen recordings, on all of them fitted together, and once everything is fitted anew beside
    each: the smallest difference counts. A number that is chance gains half a nat in the fit, and by luck a few more
    where a fold is predicted badly; links that are stiff beside a large gap lend it the rest.
    """
    unseen = richer.unseen_gain - simpler.unseen_gain
    fitted = richer.in_sample.gain - simpler.in_sample.gain
    anew = float(np.sum(refit(richer).log_likelihood - refit(simpler).log_likelihood))
    return min(unseen, fitted, anew) - (bic_penalty(richer) - bic_penalty(simpler))


def rejection_reason(trial: CandidateTrial, generic: Sequence[CandidateTrial]) -> str | None:
    """Why a candidate is rejected; None if it passes."""
    gain = 2.0 * (trial.gain - bic_penalty(trial))
    lost, won = -float(np.minimum(trial.folds, 0.0).sum()), float(np.maximum(trial.folds, 0.0).sum())
    checks: tuple[tuple[bool, str], ...] = (
        (
            gain < BIC_MIN,
            f"gains too little for its parameters on unseen recordings (BIC {gain:.1f}, needs {BIC_MIN:g})",
        ),
        (
            trial.reduction < REDUCTION_MIN,
            f"removes only {100 * trial.reduction:.1f} % of the residual on unseen recordings",
        ),
        (lost > HARM_MAX * won, "helps on some recordings and harms on others"),
        (trial.outside, "its parameters are at the end of what is physical, or beyond"),
        (
            trial.in_sample.displaced is not None,
            "beside it another cause would leave what is physical",
        ),
        (
            trial.spread > SPREAD and trial.narrow > NARROW and 2.0 * trial.gain_elsewhere < BIC_MIN,
            "it should show on several joints and helps on one alone",
        ),
        (
            any(_does_better(rival, trial) for rival in generic),
            "a generic smooth function of the same signals does better: not specific",
        ),
    )
    return next((reason for holds, reason in checks if holds), None)


def _does_better(rival: CandidateTrial, trial: CandidateTrial) -> bool:
    """Whether a generic regressor with no more coefficients does clearly better where a candidate acts.

    Of many drawn at random, one is always about as good as a simple law, an offset of a joint that hardly moves.
    """
    own = trial.term.groups
    if not set(own) & set(rival.term.groups) or rival.term.layout.free > trial.term.layout.free:
        return False
    return rival.gain > trial.gain + SPECIFIC
