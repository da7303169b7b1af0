# SPDX-License-Identifier: BSD-3-Clause
"""Causes that fail on the held-out recordings, and rivals that are likelier by all recordings together.

On a small part of a joint's range a ripple, a spring and an offset are one thing; the held-out recording may go
beyond it. Where a cause leaves more than noise of it, a rival takes its place that is likelier by all recordings
together (`rivals.lead_of`).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from impedance_modules.diagnosis.model_selection.acceptance import DECIDED, best_of_each
from impedance_modules.diagnosis.model_selection.candidate_trial import refit, try_term
from impedance_modules.diagnosis.model_selection.evidence import Evidence
from impedance_modules.diagnosis.model_selection.rivals import ASKED, lead_of
from impedance_modules.diagnosis.regression.model_fit import ModelTerm
from impedance_modules.diagnosis.regression.parameter_estimates import correlation_surplus

LACKING = 3.0
"""Power over noise beyond which a group of the held-out recordings is not understood."""


def with_likelier_rivals(evidence: Evidence) -> tuple[Evidence, tuple[str, ...]]:
    """Exchanges causes that fail on the held-out recordings for rivals that are likelier on all.

    Returns:
        The evidence with the others fitted again, and a sentence for each that was exchanged.
    """
    notes: list[str] = []
    for term in evidence.model_fit.model:
        rival = _likelier(evidence, term) if _fails(evidence, term) else None
        if rival is None:
            continue
        model = [rival if other is term else other for other in evidence.model_fit.model]
        evidence = replace(evidence, model_fit=evidence.selector.model_fit(model))
        notes.append(
            f"not named: {term.candidate.name}: it fails on the held-out recordings, and by all together"
            f" {rival.candidate.name} is likelier"
        )
    return evidence, tuple(notes)


def _fails(evidence: Evidence, term: ModelTerm) -> bool:
    """Whether the model leaves more than noise of the held-out recordings where a term acts."""
    return bool(np.any(evidence.foretold_power(evidence.model_fit)[list(term.groups)] > LACKING))


def _likelier(evidence: Evidence, term: ModelTerm) -> ModelTerm | None:
    """What may stand in a term's place and is likelier by all recordings; None where nothing is, for certain."""
    selector = evidence.selector
    rest = selector.model_fit([other for other in evidence.model_fit.model if other is not term])
    own = try_term(rest, term)
    entries = best_of_each(selector.screen.rank(rest), ASKED)
    rivals = [
        trial
        for trial in selector.refined(rest, [selector.trial(rest, entry.layout) for entry in entries])
        if trial.term.key != term.key and selector.rejection_reason(trial) is None
    ]
    beside = refit(own)
    lead = lead_of(own, beside, evidence.held_out_likelihood)
    ahead, best = min(((lead(rival), i) for i, rival in enumerate(rivals)), default=(0.0, 0))
    needed = DECIDED * correlation_surplus(beside, term.groups)
    return rivals[best].term if ahead < -needed else None
