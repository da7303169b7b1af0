# SPDX-License-Identifier: BSD-3-Clause
"""Which accepted terms are named: none that held-out recordings do not need, that may be chance, or worsens a rollout.

What is not named is no part of the model either: gap, remainder and patch are those of the named causes alone.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from impedance_modules.diagnosis.model_selection.cause_search import significant_terms
from impedance_modules.diagnosis.model_selection.evidence import Evidence
from impedance_modules.diagnosis.regression.model_fit import PRIOR_MAX, ModelFit, ModelTerm
from impedance_modules.diagnosis.result import Cause

HELD_OUT_MIN = 0.1
"""Part of the held-out squares, where a cause acts, that it must remove: twice what it had to of the others. Of 178
causes of simulated cases 32 were below it, 3 of them true (docs/wide-benchmark-history.md)."""

TAKEN_UP = PRIOR_MAX**2
"""Squares of deviations that links, weights and stamps would take up in a cause's place, from which it is needed."""

SILENT = 0.1
"""Power over the noise's below which the held-out recordings do not show a cause."""

NO_POWER = 1e-12
"""What a term that explains no power at all is given, so that weights stay above zero."""

SHARE_THAT_MATTERS = 0.05
"""Part of the gap that causes must explain together for any to be named, and one alone for its rivals to make the
verdict ambiguous; below it a cause, or what is left, is minor beside the others if it is within the tolerance, too."""


def ranked_terms(evidence: Evidence, power: Callable[[ModelFit], float]) -> list[tuple[ModelTerm, float]]:
    """Each accepted term with the power that it explains beyond those that explain more alone, or beyond all others.

    The larger of the two counts. Of two terms that explain the same, the second leaves nothing to gain in the first
    way; two that act against each other (a lean of the base and a spring that holds against it) may both make the gap
    larger alone, and only the second way shows that neither can be missed.

    Args:
        evidence: The fit.
        power: What a model leaves.
    """

    def left(model: Sequence[ModelTerm]) -> float:
        return power(evidence.selector.model_fit(model))

    order = sorted(evidence.model_fit.model, key=lambda term: left([term]))
    steps = [left(order[:count]) for count in range(len(order) + 1)]
    # Without the last one the last step but one is what is left.
    without = [*(left([*order[:i], *order[i + 1 :]]) for i in range(len(order) - 1)), *steps[-2:-1]]
    return [
        (term, max(steps[i] - steps[i + 1], without[i] - steps[-1], NO_POWER)) for i, term in enumerate(order)
    ]


def noise_power(evidence: Evidence) -> Callable[[ModelFit], float]:
    """What a model leaves in units of the noise at each frequency: the power that weights are parts of."""
    return lambda fit: float(evidence.whitened_power(fit).sum())


def held_out_part(evidence: Evidence, term: ModelTerm) -> float:
    """Part of the held-out squares, where a term acts, that it removes from what the others leave of them.

    In units of the noise, with the others fitted anew without it.
    """
    model_fit, groups = evidence.model_fit, list(term.groups)

    def squares(fit: ModelFit) -> float:
        return float(evidence.foretold_squares(fit, evidence.judges)[groups].sum())

    without = squares(_fit_without(evidence, term))
    return 1.0 - squares(model_fit) / without if without > 0.0 else 0.0


def taken_up_without(evidence: Evidence, term: ModelTerm) -> float:
    """By how much links, weights and stamps are further off without a term: sum of squares, in their deviations."""
    size = evidence.design.nuisance.size
    within, without = (
        float(np.sum(fit.whole.coefficients[:size] ** 2))
        for fit in (evidence.model_fit, _fit_without(evidence, term))
    )
    return without - within


def _fit_without(evidence: Evidence, term: ModelTerm) -> ModelFit:
    return evidence.selector.model_fit([other for other in evidence.model_fit.model if other is not term])


def weighed_where_they_act(evidence: Evidence) -> tuple[Evidence, tuple[str, ...]]:
    """Weighs causes by all recordings where some of them do not act in the held-out ones.

    A limit that no held-out recording reaches is neither confirmed nor refuted by these. It was accepted for what it
    explains of recordings that its fit had not seen.

    Returns:
        The evidence, and a sentence that says so.
    """
    silent = [term.candidate.name for term in evidence.model_fit.model if _silent(evidence, term)]
    if not silent:
        return evidence, ()
    note = f"weighed by all recordings, since the held-out ones hardly show it: {', '.join(silent)}"
    return replace(evidence, weighed=(*evidence.model_fit.fitted, *evidence.heldout)), (note,)


def _silent(evidence: Evidence, term: ModelTerm) -> bool:
    """Whether a term adds less than noise to held-out recordings, and clearly more to those that were fitted."""
    model_fit = evidence.model_fit
    held, fitted = (
        _added_power(model_fit, term, recordings) for recordings in (evidence.heldout, model_fit.fitted)
    )
    return held < SILENT < 1.0 < fitted


def _added_power(model_fit: ModelFit, term: ModelTerm, recordings: Sequence[int]) -> float:
    """Largest mean square, over groups, of what a term adds to recordings, in units of the noise."""
    start = int(model_fit.starts[model_fit.model.index(term)])
    own = model_fit.whole.coefficients[start : start + term.shaped.size]
    powers = []
    for group in term.groups:
        parts = [term.columns[r][group] @ own + term.fixed[r].get(group, 0.0) for r in recordings]
        powers.append(float(np.mean(np.concatenate(parts) ** 2)))
    return max(powers)


def without_unconfirmed(evidence: Evidence) -> tuple[Evidence, tuple[str, ...]]:
    """Leaves out the terms that the held-out recordings do not need, one after the other, the least first.

    Of two that explain the same, one stays. What links, weights and stamps explain in a term's place as well is needed
    all the same if they would have to be further off than is likely. Beside pushes and knocks that make all of the gap
    no term is needed.

    Returns:
        The evidence with the others fitted again, and a sentence for each that was left out.
    """
    notes: list[str] = []
    while evidence.model_fit.model:
        term, least = min(
            ((term, _needed_part(evidence, term)) for term in evidence.model_fit.model),
            key=lambda item: item[1],
        )
        if least >= HELD_OUT_MIN and evidence.outside_share < 1.0:
            break
        where = (
            "what acts from outside makes all of the gap"
            if least >= HELD_OUT_MIN
            else "held-out recordings do not need it"
        )
        notes.append(f"not named: {term.candidate.name}: {where}")
        evidence = _without(evidence, [term])
    return evidence, tuple(notes)


def _needed_part(evidence: Evidence, term: ModelTerm) -> float:
    """Part of the held-out squares that needs a term, or one where links, weights and stamps hold only beside it.

    A term that makes the held-out recordings worse is not needed, whatever it spares the links.
    """
    part = held_out_part(evidence, term)
    return 1.0 if 0.0 <= part < HELD_OUT_MIN and taken_up_without(evidence, term) > TAKEN_UP else part


def without_weightless(evidence: Evidence) -> tuple[Evidence, tuple[str, ...]]:
    """Leaves out the terms that explain no power of the held-out recordings, one after the other.

    What such a term removes where it acts, the links' numbers that were fitted beside it add elsewhere.

    Returns:
        The evidence with the others fitted again, and a sentence for each that was left out.
    """
    notes: list[str] = []
    while True:
        ranked = ranked_terms(evidence, noise_power(evidence))
        term = next((term for term, gain in ranked if gain <= NO_POWER), None)
        if term is None:
            return evidence, tuple(notes)
        notes.append(
            f"not named: {term.candidate.name}: it explains no power of all held-out residuals together"
        )
        evidence = _without(evidence, [term])


def without_uncertain(evidence: Evidence) -> tuple[Evidence, tuple[str, ...]]:
    """Leaves out terms whose numbers may be chance once others have been left out, the least first.

    Each refit judges the others anew: of two terms that explain the same, one stays.

    Returns:
        The evidence with the others fitted again, and a sentence for each that was left out.
    """
    notes: list[str] = []
    while True:
        certain = significant_terms(evidence.model_fit, evidence.selector.refiner)
        unsure = [entry for entry in ranked_terms(evidence, noise_power(evidence)) if entry[0] not in certain]
        if not unsure:
            return evidence, tuple(notes)
        term, _ = min(unsure, key=lambda entry: entry[1])
        notes.append(f"not named: {term.candidate.name}, whose numbers alone are within chance")
        evidence = _without(evidence, [term])


def rejected_by_motion(causes: Sequence[Cause]) -> tuple[Cause, ...]:
    """Causes with which the simulated motion is worse than without."""
    return tuple(
        cause for cause in causes if cause.rollout is not None and cause.rollout.verdict == "worsens"
    )


def rejection(cause: Cause) -> str:
    """Says why a cause is not named: the simulated motion rejects it, or it is hardly true."""
    where = (
        f"not named: {cause.effect} on {', '.join(cause.joints) or 'all joints'} ({cause.port} port), which"
    )
    if cause.probability is not None:
        return f"{where} explains {100 * cause.weight:.2g} % of the gap and is {100 * cause.probability:.0f} % likely"
    worse = "" if cause.rollout is None else f", error power by {1.0 / cause.rollout.ratio:.3g}"
    return f"{where} explains torque but makes the simulated motion worse{worse}"


def terms_of(evidence: Evidence, causes: Sequence[Cause]) -> list[ModelTerm]:
    """Terms of the model that stand for causes."""
    keys = {(cause.effect, cause.port) for cause in causes}
    return [term for term in evidence.model_fit.model if (term.key[0], term.key[2]) in keys]


def without_causes(evidence: Evidence, causes: Sequence[Cause]) -> tuple[Evidence, tuple[str, ...]]:
    """Leaves out causes, and then those that are not certain alone.

    Returns:
        The evidence with the others fitted again, and a sentence for each of these.
    """
    return without_uncertain(_without(evidence, terms_of(evidence, causes)))


def _without(evidence: Evidence, left_out: Sequence[ModelTerm]) -> Evidence:
    """Fits the other terms again, in their own shapes, or simpler laws where these need no more beside the others."""
    kept = [term for term in evidence.model_fit.model if term not in left_out]
    selector = evidence.selector
    return replace(
        evidence, model_fit=selector.model_fit(selector.simplest(selector.reshaped(kept, left_out)))
    )
