# SPDX-License-Identifier: BSD-3-Clause
"""The search of causes, repeated without those that were refused: others may explain the same, and the motion, too."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace
from functools import partial

from impedance_modules.diagnosis.data.folds import DataSplit
from impedance_modules.diagnosis.data.nominal_model import NominalModel
from impedance_modules.diagnosis.model_selection.cause_search import (
    CandidateKey,
    Progress,
    search_causes,
    tested,
)
from impedance_modules.diagnosis.model_selection.evidence import Evidence
from impedance_modules.diagnosis.model_selection.external_pushes import push_notes
from impedance_modules.diagnosis.model_selection.held_out_rivals import with_likelier_rivals
from impedance_modules.diagnosis.model_selection.naming import (
    SHARE_THAT_MATTERS,
    rejection,
    terms_of,
    weighed_where_they_act,
    without_causes,
    without_unconfirmed,
    without_weightless,
)
from impedance_modules.diagnosis.residuals.preparation import Prepared
from impedance_modules.diagnosis.result import Cause
from impedance_modules.worker_processes import OrderedMap

REFUSED_MAX = 3
"""Candidates without which the causes are searched again, at most: each time takes as long as the first."""


class RepeatedSearch:
    """The causes of the residuals, searched again without those that were refused if they carried the gap.

    Attributes:
        evidence: With the causes that stand.
        notes: What was left out of rows and names, in words.
    """

    def __init__(
        self,
        prepared: tuple[Prepared, ...],
        split: DataSplit,
        model: NominalModel,
        without: Collection[str],
        progress: Progress,
        each: OrderedMap,
    ) -> None:
        """Searches; the arguments are those of `search_causes`."""
        self._search = partial(search_causes, prepared, split, model, without, progress, each)
        self._prepared, self._progress = prepared, progress
        self._refused: set[CandidateKey] = set()
        self._refusals: tuple[str, ...] = ()
        self.evidence, self.notes = self._found()

    def leave_out(self, rejected: Sequence[Cause], causes: Sequence[Cause]) -> None:
        """Does without some of the causes; where they carried what is explained, others may take their place."""
        words = tuple(rejection(cause) for cause in rejected)
        explained, theirs = (sum(cause.weight for cause in part) for part in (causes, rejected))
        if theirs >= SHARE_THAT_MATTERS * explained and len(self._refused) < REFUSED_MAX:
            self._refusals = (*self._refusals, *words)
            self._refused.update(term.key for term in terms_of(self.evidence, rejected))
            self.evidence, self.notes = self._found()
        else:
            self.evidence, uncertain = without_causes(self.evidence, rejected)
            self.notes = (*self.notes, *words, *uncertain)

    def _found(self) -> tuple[Evidence, tuple[str, ...]]:
        self._progress("evaluating candidates")
        evidence = self._search(refused=self._refused)
        evidence, elsewhere = weighed_where_they_act(evidence)
        evidence, unneeded = without_unconfirmed(evidence)
        evidence, exchanged = with_likelier_rivals(evidence)
        if exchanged:
            evidence, beside = _with_causes_beside(evidence, self._progress)
            exchanged = (*exchanged, *beside)
        evidence, weightless = without_weightless(evidence)
        pushed = push_notes(evidence.pushes, self._prepared)
        return evidence, (
            *pushed,
            *evidence.notes,
            *self._refusals,
            *elsewhere,
            *unneeded,
            *exchanged,
            *weightless,
        )


def _with_causes_beside(evidence: Evidence, progress: Progress) -> tuple[Evidence, tuple[str, ...]]:
    """Goes on with the search beside causes that took the place of others: it had stopped beside the wrong ones.

    What it finds stands if the held-out recordings, for which the others took their place, are likelier with it.
    """
    known, selector = evidence.model_fit, evidence.selector
    found = selector.go_on(known.model, progress)
    model_fit = tested(selector, found.causes, evidence.plain, evidence.prepared)
    before, after = (float(evidence.held_out_likelihood(one).sum()) for one in (known, model_fit))
    if after <= before:
        return evidence, ()
    return without_unconfirmed(replace(evidence, model_fit=model_fit, refusal=found.refusal))
