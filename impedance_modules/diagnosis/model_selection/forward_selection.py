# SPDX-License-Identifier: BSD-3-Clause
"""Stage 5, forward selection: one cause is accepted at a time; each must pass on unseen recordings."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from impedance_modules.diagnosis.model_selection.acceptance import (
    BIC_MIN,
    DECIDED,
    best_of_each,
    bic_penalty,
    both_delay_torque,
    by_merit,
    further_gain,
    penalised_gain,
    promising,
    rejection_reason,
)
from impedance_modules.diagnosis.model_selection.backward_elimination import eliminate_backward, merge_delays
from impedance_modules.diagnosis.model_selection.candidate_trial import CandidateTrial, refit, try_term
from impedance_modules.diagnosis.model_selection.geared_start import geared_start_model
from impedance_modules.diagnosis.model_selection.instruments import follows_load
from impedance_modules.diagnosis.model_selection.plausibility import Plausibility
from impedance_modules.diagnosis.model_selection.richer_laws import richer_laws
from impedance_modules.diagnosis.model_selection.screening import Screening
from impedance_modules.diagnosis.regression.design_matrix import ColumnLayout, Design
from impedance_modules.diagnosis.regression.model_fit import ModelFit, ModelTerm, term_of
from impedance_modules.diagnosis.regression.parameter_estimates import beyond_simpler, correlation_surplus
from impedance_modules.diagnosis.regression.shape_refinement import ShapeRefiner

CAUSES_MAX = 30
"""More are not looked for."""

ROUNDS = 3
"""How often the search goes on after causes were removed."""

REMOVALS_MAX = 2
"""What was removed so often is not accepted again: the search would end as it did before."""

TRIED = 10
"""Candidates that are tried on held-out folds in each round."""

REFINED = 4
"""Of these, so many of the best are moved off the grid of their shapes before they are compared."""

GENERIC_TRIED = 6
"""Generic regressors that are tried beside them."""

ALMOST_ALL = 0.99
"""Part of what a law explains that a simpler one must explain to take its place."""


@dataclass(frozen=True, eq=False)
class Refusal:
    """Why a candidate that fitted best was not named."""

    trial: CandidateTrial
    reason: str


@dataclass(frozen=True, eq=False)
class Selection:
    """What was found.

    Attributes:
        causes: Accepted candidates, in the order they were found.
        refusal: Why the next best was not accepted; None where nothing was left to try.
    """

    causes: tuple[ModelTerm, ...]
    refusal: Refusal | None


class Selector:
    """Searches one design.

    Attributes:
        design: All candidates.
        folds: Fitted recordings by fold.
        screen: Ranks the candidates before they are tried.
        refiner: Moves shapes off their grid.
        resolution: Grid of the position sensors, or their noise where none is stated [rad].
    """

    def __init__(
        self, design: Design, folds: Sequence[Sequence[int]], refiner: ShapeRefiner, resolution: float
    ) -> None:
        """Prepares the screening."""
        self.design, self.folds, self.refiner, self.resolution = design, folds, refiner, resolution
        fitted = [index for fold in folds for index in fold]
        self.plausibility = Plausibility.of(refiner.prepared, fitted, resolution)
        self.screen = Screening(design, fitted)
        self._removals: Counter[tuple[str, str, str]] = Counter()
        self._generic: tuple[ModelFit | None, list[CandidateTrial]] = (None, [])
        self._tried: tuple[ModelFit | None, list[CandidateTrial]] = (None, [])

    def on(self, design: Design) -> Selector:
        """The same search on a design with other rows."""
        refiner = ShapeRefiner(design, self.refiner.prepared, self.refiner.signals)
        return Selector(design, self.folds, refiner, self.resolution)

    def model_fit(self, model: Sequence[ModelTerm]) -> ModelFit:
        """Fits a model."""
        return ModelFit(self.design, self.folds, model)

    def run(self, progress: Callable[[str], None]) -> Selection:
        """Accepts causes until the next one is rejected, then removes those that no longer pass.

        After a removal the search goes on from what remains, a few times at most.
        """
        begun = geared_start_model(self.model_fit([]), self.model_fit, self.trials, self.rejection_reason)
        for term in begun:
            progress(f"found {term.key[0]} on {term.key[1]}")
        return self.go_on(begun, progress)

    def go_on(self, begun: Sequence[ModelTerm], progress: Callable[[str], None]) -> Selection:
        """Searches as `run` does, beside causes that are known."""
        model = list(begun)
        refusal: Refusal | None = None
        for _ in range(ROUNDS):
            model, refusal = self._add_causes(model, progress)
            grown = self.simplest(merge_delays(model, self.model_fit, self.refiner))
            model = eliminate_backward(grown, self.model_fit, self.rejection_reason)
            removed = [term for term in grown if term not in model]
            if not removed:
                break
            self._removals.update(term.key for term in removed)
            model = self.reshaped(model, removed)
        return Selection(tuple(self.one_for_two(self.simplest(model))), refusal)

    def _add_causes(
        self, model: list[ModelTerm], progress: Callable[[str], None]
    ) -> tuple[list[ModelTerm], Refusal | None]:
        """Accepts one cause at a time; each new one may exchange those beside it."""
        refusal: Refusal | None = None
        while len(model) < CAUSES_MAX:
            model_fit = self.model_fit(model)
            found, refusal = self._next(model_fit)
            if found is None:
                break
            progress(f"found {found.key[0]} on {found.key[1]}")
            model = self._exchange([*model, found])
        return model, refusal

    def trial(self, model_fit: ModelFit, layout: ColumnLayout) -> CandidateTrial:
        """Tries a candidate of the grid."""
        return try_term(model_fit, term_of(self.design, layout))

    def rejection_reason(self, trial: CandidateTrial) -> str | None:
        """Why a candidate is rejected; None if it passes. The generic basis is tried last, it costs most."""
        return self._refused(trial, []) or rejection_reason(trial, self.generic(trial.model_fit))

    def _refused(self, trial: CandidateTrial, generic: Sequence[CandidateTrial]) -> str | None:
        """Why a candidate is rejected beside some generic regressors; None if it passes."""
        if self._removals[trial.term.key] >= REMOVALS_MAX:
            return "does not last beside the others: it was accepted and removed again twice"
        return (
            rejection_reason(trial, generic)
            or self.plausibility.implausible(trial)
            or self._refused_by_recordings(trial)
        )

    def unphysical(self, trial: CandidateTrial) -> str | None:
        """Why a candidate cannot be, however well it fits; None where it can."""
        return self.plausibility.unphysical(trial) or self._refused_by_recordings(trial)

    def _refused_by_recordings(self, trial: CandidateTrial) -> str | None:
        """Why what the motion needs does not confirm a candidate, or recordings deny it; None where neither is so."""
        if not self._follows_load(trial):
            return "where the motion needs torque it does not show: its column is noise of a command or a reading"
        return self.plausibility.contradiction(trial)

    def _follows_load(self, trial: CandidateTrial) -> bool:
        """Whether what is made of a command is confirmed by the torque that the motion needs."""
        term = trial.term
        shape = term.candidate.effect.by_load(term.candidate.port, term.shaped.shape)
        load = None if shape is None else self.refiner.term(term.candidate, shape, term.layout)
        return load is None or follows_load(trial, load)

    def generic(self, model_fit: ModelFit) -> list[CandidateTrial]:
        """The best generic regressors beside a model, tried once."""
        if self._generic[0] is not model_fit:
            entries = self.screen.rank(model_fit)
            generic = [entry.layout for entry in entries if entry.layout.shaped.candidate is None][
                :GENERIC_TRIED
            ]
            self._generic = (model_fit, [self.trial(model_fit, layout) for layout in generic])
        return self._generic[1]

    def _next(self, model_fit: ModelFit) -> tuple[ModelTerm | None, Refusal | None]:
        """The best candidate that passes, or why there is none."""
        trials = self.trials(model_fit)
        generic = self.generic(model_fit)
        refusal: Refusal | None = None
        for trial in by_merit(trials):
            reason = self._refused(trial, generic)
            if reason is None:
                return self._refined_term(model_fit, trial, trials), None
            refusal = refusal or Refusal(trial, reason)
        return None, refusal

    def _refined_term(
        self, model_fit: ModelFit, trial: CandidateTrial, trials: Sequence[CandidateTrial]
    ) -> ModelTerm:
        """An accepted candidate off its grid; of a delay and a lag on one joint the better one at its own best time."""
        if not trial.term.candidate.effect.nearly_linear:
            return trial.term
        alike = [
            other
            for other in trials
            if both_delay_torque(trial, other) and self.rejection_reason(other) is None
        ]
        return max((self.moved(model_fit, one) for one in [trial, *alike]), key=penalised_gain).term

    def moved(self, model_fit: ModelFit, trial: CandidateTrial) -> CandidateTrial:
        """A trial of the same candidate, off its grid."""
        return try_term(model_fit, self.refiner.refine(model_fit, trial.term))

    def trials(self, model_fit: ModelFit) -> list[CandidateTrial]:
        """Tries the most promising candidates beside a model, in their best shapes; done once for each model."""
        if self._tried[0] is not model_fit:
            own = [self.trial(model_fit, layout) for layout in promising(self.screen.rank(model_fit), TRIED)]
            self._tried = (model_fit, self.refined(model_fit, own))
        return self._tried[1]

    def refined(self, model_fit: ModelFit, trials: Sequence[CandidateTrial]) -> list[CandidateTrial]:
        """Moves the best shapes off their grid: those that fit best, however badly an odd shape does elsewhere.

        A shape with physical numbers comes before one without: of a friction that fades over more than the recording
        no number is certain, and the time that fits best may ask for less than none in the end.
        """
        shaped = [trial for trial in trials if not trial.term.generic and _moves(trial.term)]
        out = [trial for trial in trials if trial not in shaped]
        ranked = sorted(shaped, key=lambda trial: -trial.in_sample.gain)
        for old in ranked[:REFINED]:
            new = try_term(model_fit, self.refiner.refine(model_fit, old.term))
            out.append(max((old, new), key=_physical_gain))
        return [*out, *ranked[REFINED:]]

    def reshaped(self, model: Sequence[ModelTerm], removed: Sequence[ModelTerm]) -> list[ModelTerm]:
        """Finds the shapes anew of causes that share residuals with others that are gone: these had moved them.

        From the grid as well, which a few steps may not reach again.
        """
        touched = {group for term in removed for group in term.groups}
        kept = list(model)
        for index, term in enumerate(model):
            if term.generic or not _moves(term) or not touched & set(term.groups):
                continue
            rest = self.model_fit([other for other in kept if other is not kept[index]])
            grid = [
                self.trial(rest, layout) for layout in self.design.layouts if layout.shaped.key == term.key
            ]
            shapes = self.refined(rest, [try_term(rest, term), *grid])
            kept[index] = max(shapes, key=_physical_gain).term
        return kept

    def simplest(self, model: Sequence[ModelTerm]) -> list[ModelTerm]:
        """Puts simpler laws on the same joints in the place of those whose further numbers may all be chance.

        They are no less likely by what would decide between two causes.
        A spring of no stiffness for certain is an offset: both were found beside causes that are gone now. Before the
        elimination, too, which would leave nothing of a law that is only the wrong one of its kind.
        """
        kept = list(model)
        for index, term in enumerate(model):
            if beyond_simpler(self.model_fit(kept), self.refiner, index):
                continue
            rest = self.model_fit([other for other in kept if other is not term])
            own = try_term(rest, term)
            decided = DECIDED * correlation_surplus(refit(own), term.groups)
            simpler = [
                trial
                for trial in self.trials(rest)
                if trial.term.key[1] == term.key[1]
                and trial.term.layout.free < term.layout.free
                and trial.reach_on(term.groups) >= ALMOST_ALL * own.reach_on(term.groups)
                and further_gain(own, trial) < decided
                and self.rejection_reason(trial) is None
            ]
            if simpler:
                kept[index] = max(simpler, key=penalised_gain).term
        return kept

    def one_for_two(self, model: Sequence[ModelTerm]) -> list[ModelTerm]:
        """Puts one law in the place of two on the same joint and port where it is likelier than both together.

        Each of the two was accepted beside what was known then: dry friction and an offset, and then an asymmetric
        friction gains nothing beside them. Whole fits are compared: gains that were found one after the other do not
        add up to the gain of both.
        """
        kept = list(model)
        for one, other in combinations(model, 2):
            if one.key[1:] != other.key[1:] or not {id(one), id(other)} <= set(map(id, kept)):
                continue
            rest = self.model_fit([term for term in kept if term is not one and term is not other])
            single = self._single_law(rest, (one, other))
            if single is None or self.rejection_reason(single) is not None:
                continue
            both = self.model_fit([*rest.model, one, other])
            ahead = float(np.sum(refit(single).log_likelihood - both.log_likelihood))
            saved = sum(bic_penalty(try_term(rest, term)) for term in (one, other)) - bic_penalty(single)
            if ahead + saved >= 0.0:
                kept = [single.term, *rest.model]
        return kept

    def _single_law(self, rest: ModelFit, two: tuple[ModelTerm, ModelTerm]) -> CandidateTrial | None:
        """The likeliest law on the joint and port of two others; None where there is none."""
        alike = [
            self.trial(rest, layout)
            for layout in self.design.layouts
            if layout.shaped.candidate is not None
            and layout.shaped.key[1:] == two[0].key[1:]
            and layout.shaped.key not in (two[0].key, two[1].key)
        ]
        return max(self.refined(rest, alike), key=penalised_gain, default=None)

    def _exchange(self, model: list[ModelTerm]) -> list[ModelTerm]:
        """Replaces accepted causes that share a residual with the last one by others that do better beside it.

        And then the last one, which was chosen by the power it explains: another may be far more likely.
        """
        last = model[-1]
        shared = [i for i, term in enumerate(model[:-1]) if set(term.groups) & set(last.groups)]
        for index in [*shared, len(model) - 1] if shared or len(model) == 1 else []:
            model = self._better(model, index)
        return model

    def _better(self, model: list[ModelTerm], index: int) -> list[ModelTerm]:
        """Exchanges one cause for a better one beside the others, or moves its shape."""
        term, rest = model[index], [*model[:index], *model[index + 1 :]]
        model_fit = self.model_fit(rest)
        own = try_term(model_fit, term)
        rivals = [
            self.trial(model_fit, entry.layout) for entry in best_of_each(self.screen.rank(model_fit), 3)
        ]
        better = max(self.refined(model_fit, rivals), key=penalised_gain, default=own)
        ahead = penalised_gain(better) - penalised_gain(own)
        simpler = self.plausibility.of_body(own) and better.term.layout.free < own.term.layout.free
        exchanged = ahead > (0.0 if simpler else BIC_MIN) and self.rejection_reason(better) is None
        chosen = better if exchanged else self.moved(model_fit, own)
        return [*model[:index], self._richer(chosen).term, *model[index + 1 :]]

    def _richer(self, own: CandidateTrial) -> CandidateTrial:
        """The likeliest law with more numbers that is ahead by what decides; where there is none, what came in."""
        richer = self.refined(own.model_fit, richer_laws(own.model_fit, own.term, self.refiner))
        decided = DECIDED * correlation_surplus(refit(own), own.term.groups) if richer else 0.0
        ahead = [trial for trial in richer if further_gain(trial, own) > decided]
        ahead = [trial for trial in ahead if self.rejection_reason(trial) is None]
        return max(ahead, key=penalised_gain, default=own)


def _physical_gain(trial: CandidateTrial) -> tuple[bool, float]:
    """By which shapes of one candidate are compared: numbers within bounds first, then the gain."""
    return not trial.outside, trial.gain


def _moves(term: ModelTerm) -> bool:
    """Whether a shape is worth moving before a candidate is compared."""
    effect = term.candidate.effect
    return bool(effect.refined(term.shaped.shape)) and not effect.nearly_linear
