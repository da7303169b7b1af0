# SPDX-License-Identifier: BSD-3-Clause
r"""Plausibility: reasons in a candidate's own numbers to reject it, however well it fits."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.diagnosis.data.rigid_tree import can_exist
from impedance_modules.diagnosis.model_selection.candidate_trial import CandidateTrial
from impedance_modules.diagnosis.model_selection.instruments import SLOW, comes_back, holds_when_slow
from impedance_modules.diagnosis.regression.model_fit import PRIOR_MAX, ModelTerm
from impedance_modules.diagnosis.regression.noise_floor import repeat_pairs
from impedance_modules.diagnosis.residuals.preparation import Prepared
from impedance_modules.effects.recorded_signals import Signals

CONTRAST_MIN = 12.0
"""Least chi-square of what makes an effect this effect: three and a half standard deviations of one number."""


@dataclass(frozen=True, eq=False)
class Plausibility:
    """What the robot and its recordings allow a candidate to be.

    Attributes:
        signals: Of the fitted recordings, as recorded.
        bodies: Link -> (10,) its inertial parameters.
        pairs: Recordings that repeat each other.
        resolution: Grid of the position sensors, or their noise where none is stated [rad].
        slow: Frequency up to which a motion is slow [cycles per row].
    """

    signals: Sequence[Signals]
    bodies: Mapping[str, Array]
    pairs: Sequence[tuple[int, int]]
    resolution: float
    slow: float

    @classmethod
    def of(cls, prepared: Sequence[Prepared], fitted: Sequence[int], resolution: float) -> Plausibility:
        """Reads it off recordings, of which some are fitted."""
        band = prepared[0].band
        return cls(
            signals=[prepared[index].signals for index in fitted],
            bodies={body.link: body.inertia for body in prepared[0].tree.bodies},
            pairs=repeat_pairs(prepared, fitted),
            resolution=resolution,
            slow=SLOW * band.cutoff * band.step / band.rate,
        )

    def implausible(self, trial: CandidateTrial) -> str | None:
        """Why a trial's own numbers reject it."""
        if trial.in_sample.contrast_chi_square < CONTRAST_MIN:
            return "what makes it this effect rather than a simpler one is not there for certain"
        return self.unphysical(trial)

    def unphysical(self, trial: CandidateTrial) -> str | None:
        """Why a trial's numbers cannot be: too fine to be seen, no body's, or beyond bounds."""
        checks: tuple[tuple[Callable[[], bool], str], ...] = (
            (
                lambda: any(_contains_law(other, trial.term) for other in trial.model_fit.model),
                "another cause on the same joint contains it",
            ),
            (
                lambda: not comes_back(trial, self.pairs),
                "what it explains does not come back when the motion does: noise, and the arm's answer to it",
            ),
            (
                lambda: not holds_when_slow(trial, self.slow),
                "what it explains is fast noise, of which its column has its part: the slow motion does not show it",
            ),
            (
                lambda: _moves_nuisance(trial),
                "beside it links, weights or stamps would be further off than anything stated allows",
            ),
            (
                lambda: trial.outside,
                "its parameters are at the end of what is physical, or beyond",
            ),
        )
        return next((reason for holds, reason in checks if holds()), None) or self._of_numbers(trial)

    def _of_numbers(self, trial: CandidateTrial) -> str | None:
        """What its numbers say against it in their own units."""
        term, effect = trial.term, trial.term.candidate.effect
        body = self.bodies.get(term.candidate.key)
        change = trial.coefficients.mean(axis=0) / term.layout.scale
        if body is not None and len(change) == len(body) and not can_exist(body, change):
            return "no body has such an inertia: its mass would be negative somewhere"
        reason = effect.unresolved(term.shaped.shape, self.resolution)
        return reason or next(iter(effect.relations(self._values(trial))), None)

    def contradiction(self, trial: CandidateTrial) -> str | None:
        """What the recordings themselves say against its numbers."""
        candidate = trial.term.candidate
        return candidate.effect.contradicted(
            self._values(trial), [candidate.site(signals) for signals in self.signals]
        )

    def _values(self, trial: CandidateTrial) -> Mapping[str, float]:
        term = trial.term
        change = trial.coefficients.mean(axis=0) / term.layout.scale
        return term.candidate.effect.values(change, term.shaped.shape, term.candidate.site(self.signals[0]))

    def of_body(self, trial: CandidateTrial) -> bool:
        """Whether a trial is about a body: several numbers, of which one may be a rotor's or an offset's."""
        return trial.term.candidate.key in self.bodies


def _moves_nuisance(trial: CandidateTrial) -> bool:
    """Whether beside a candidate something with a prior is surely further out than its prior allows, and than before.

    A gain and links that are lighter by as much take all torque away, the noise first. Beside a gap that is very large
    priors do not hold, and the first of several causes does not bring them back.
    """
    size = trial.model_fit.design.nuisance.size
    spread = np.sqrt(np.diag(trial.model_fit.whole.inverse)[:size])
    allowed = np.maximum(np.abs(trial.model_fit.whole.coefficients[:size]), PRIOR_MAX)
    return bool(np.any(np.abs(trial.in_sample.beside[:size]) - allowed > spread))


def _contains_law(one: ModelTerm, other: ModelTerm) -> bool:
    """Whether one law of friction has the other's numbers among its own: they would share them out at will."""
    laws = [term.candidate.effect for term in (one, other)]
    if one.key[1:] != other.key[1:] or not all(law.dry for law in laws):
        return False
    more, less = (set(law.description.symbols) for law in laws)
    return more > less
