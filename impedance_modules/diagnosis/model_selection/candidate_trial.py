# SPDX-License-Identifier: BSD-3-Clause
r"""Tries a candidate beside a fitted model: what it gains on recordings that its fit has not seen, and on all.

    gain = \sum_g (n_g / 2) \log(SSE_g^{without} / SSE_g^{with})       [nats]

over held-out folds: the log predictive likelihood of white rows with each group's level profiled out, as long as more
than the noise is left (`Design.log_likelihood`). The model is not fitted again; the candidate is added by the Schur
complement of the normal matrix:

    S = X^T W X - X^T W T A^{-1} T^T W X + \Lambda,      \beta = S^{-1} X^T W (y - T \beta_0)

T are the model's columns and A their normal matrix, X the candidate's, \Lambda the precision of its prior.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.diagnosis.regression.model_fit import (
    FLAT,
    Fit,
    ModelFit,
    ModelTerm,
)

HeldOutResiduals = Mapping[int, Sequence[Array]]
"""Recording -> group -> (M,) residual by a fit that has not seen the recording's fold."""


@dataclass(frozen=True, eq=False)
class CandidateTrial:
    """A candidate, tried beside a model.

    Attributes:
        model_fit: The model.
        term: The candidate.
        coefficients: (folds, p) without each fold, scaled.
        unseen: What model and candidate leave.
        in_sample: The fit of all fitted recordings.
    """

    model_fit: ModelFit
    term: ModelTerm
    coefficients: Array
    unseen: HeldOutResiduals
    in_sample: InSampleFit

    @cached_property
    def _sums(self) -> tuple[Array, Array]:
        """(folds, groups) squares without and with the candidate."""
        return self.model_fit.unseen_squares, self.model_fit.predicted_by_fold(self.unseen)

    @property
    def gain(self) -> float:
        """The smaller of the gains on unseen recordings and on the fitted ones [nats].

        A candidate can gain on unseen recordings by luck, where it happens to correct what the nuisance extrapolates
        badly; it then gains nothing once all are fitted. What is real gains both ways.
        """
        return min(self.unseen_gain, self.in_sample.gain)

    @cached_property
    def unseen_gains(self) -> Array:
        """(groups,) held-out gain [nats]."""
        design, counts = self.model_fit.design, self.model_fit.counts
        without, with_it = (design.log_likelihood(part.sum(axis=0), counts) for part in self._sums)
        return np.asarray(with_it - without)

    @property
    def unseen_gain(self) -> float:
        """Held-out gain of all groups [nats]."""
        return float(self.unseen_gains.sum())

    @cached_property
    def powers(self) -> Array:
        """(groups,) held-out residual power that it explains, in units of the noise."""
        without, with_it = self._sums
        return np.asarray((without - with_it).sum(axis=0))

    @cached_property
    def folds(self) -> Array:
        """(folds,) weighted gain on each fold, in the groups that the candidate touches."""
        without, with_it = self._sums
        own = list(self.term.groups)
        return np.asarray(0.5 * ((without - with_it) * self.model_fit.weights)[:, own].sum(axis=1))

    @cached_property
    def reduction(self) -> float:
        """Largest part of a touched group's held-out squares that it removes."""
        without, with_it = (part.sum(axis=0)[list(self.term.groups)] for part in self._sums)
        return float(np.max(1.0 - with_it / np.maximum(without, 1e-9)))

    @cached_property
    def narrow(self) -> float:
        """Part of its weighted gain that comes from the one group where it gains most."""
        without, with_it = self._sums
        gains = ((without - with_it) * self.model_fit.weights).sum(axis=0)
        total = float(gains.sum())
        return float(gains.max()) / total if total > 0.0 else 1.0

    @property
    def gain_elsewhere(self) -> float:
        """Held-out gain of the groups that it touches, but for the one where it gains most [nats]."""
        gains = self.unseen_gains[list(self.term.groups)]
        return float(gains.sum() - gains.max())

    @cached_property
    def spread(self) -> float:
        """Part of what it predicts that falls on other groups than the one where it predicts most."""
        power = np.zeros(len(self.model_fit.design.groups))
        for fold, own in zip(self.model_fit.folds, self.coefficients, strict=True):
            for r in fold:
                for g, block in self.term.columns[r].items():
                    steady = self.term.fixed[r].get(g)
                    torque = block @ own if steady is None else block @ own + steady
                    power[g] += self.model_fit.weights[g] * float(torque @ torque)
        total = float(power.sum())
        return 1.0 - float(power.max()) / total if total > 0.0 else 0.0

    @property
    def outside(self) -> bool:
        """Whether its coefficients leave their bounds: their mean over the folds, or those of all recordings."""
        found = np.array([self.coefficients.mean(axis=0), self.in_sample.own]) / self.term.layout.scale
        return bool(np.any(found <= self.term.shaped.lower) or np.any(found >= self.term.shaped.upper))

    @property
    def reach(self) -> float:
        """Residual power that it explains over all groups."""
        return float(self.powers.sum())

    def reach_on(self, groups: Sequence[int]) -> float:
        """Residual power that it explains in some groups."""
        return float(self.powers[list(groups)].sum())


def try_term(model_fit: ModelFit, term: ModelTerm) -> CandidateTrial:
    """Tries one candidate beside a model, without each fold in turn."""
    products = {r: term_products(model_fit, term, r) for r in model_fit.fitted}
    unseen: dict[int, Sequence[Array]] = {}
    coefficients = []
    for fold, base in enumerate(model_fit.without):
        found, more, _ = add_to_fit([products[r] for r in model_fit.train(fold)], base, term)
        coefficients.append(more)
        for r in model_fit.folds[fold]:
            unseen[r] = less_term(model_fit.residuals(found, r), term, r, more)
    in_sample = fit_in_sample(model_fit, term, list(products.values()))
    return CandidateTrial(model_fit, term, np.array(coefficients), unseen, in_sample)


def refit(trial: CandidateTrial) -> ModelFit:
    """The model with the candidate, everything fitted anew."""
    model_fit = trial.model_fit
    return ModelFit(model_fit.design, model_fit.folds, [*model_fit.model, trial.term])


@dataclass(frozen=True)
class InSampleFit:
    """A candidate fitted to all recordings.

    Attributes:
        gain: [nats].
        contrast_chi_square: Of the effect's contrasts, which are zero if a simpler effect would do.
        displaced: A term of the model beside it that it drives out of its physical bounds; None where it does not.
        spread: (p,) standard deviations of its coefficients, scaled.
        beside: (K + P,) the model's coefficients beside it.
        own: (p,) its coefficients, scaled.
    """

    gain: float
    contrast_chi_square: float
    displaced: ModelTerm | None
    spread: Array
    beside: Array
    own: Array


def fit_in_sample(model_fit: ModelFit, term: ModelTerm, products: Sequence[TermProducts]) -> InSampleFit:
    """Adds a candidate to the fit of all fitted recordings; likelihood and prior together."""
    found, more, covariance = add_to_fit(products, model_fit.whole, term)
    squares = np.zeros(len(model_fit.design.groups))
    for r in model_fit.fitted:
        squares += [float(x @ x) for x in less_term(model_fit.residuals(found, r), term, r, more)]
    before, after = (
        model_fit.design.log_likelihood(part, model_fit.counts) for part in (model_fit.left, squares)
    )
    prior = float(model_fit.prior @ (model_fit.whole.coefficients**2 - found**2))
    own = float(term.layout.precision @ more**2)
    known = _weight_gain(model_fit, term, squares)
    gain = float(np.sum(after - before) + 0.5 * (prior - own))
    spread = np.sqrt(np.clip(np.diag(covariance), 0.0, None))
    return InSampleFit(
        gain,
        known * _contrast_chi_square(term, more, covariance),
        _displaced(model_fit, found),
        spread,
        found,
        more,
    )


def less_term(left: Sequence[Array], term: ModelTerm, recording: int, coefficients: Array) -> list[Array]:
    """Subtracts a candidate's part from residuals."""
    out = list(left)
    for g, block in term.columns[recording].items():
        out[g] = out[g] - block @ coefficients
    for g, steady in term.fixed[recording].items():
        out[g] = out[g] - steady
    return out


@dataclass(frozen=True, eq=False)
class TermProducts:
    """Weighted products of a candidate's columns with one recording's rows; they serve the fits of all folds.

    Attributes:
        cross: (p, K + P) with the model's columns.
        own: (p, p) with themselves.
        right: (p,) with the target.
    """

    cross: Array
    own: Array
    right: Array


def term_products(model_fit: ModelFit, term: ModelTerm, recording: int) -> TermProducts:
    """Computes a candidate's products with a recording; its part without a coefficient is its last column."""
    steady = term.fixed[recording]
    width = term.shaped.size + bool(steady)
    cross, own, right = np.zeros((width, model_fit.size)), np.zeros((width, width)), np.zeros(width)
    for g, block in term.columns[recording].items():
        X = np.column_stack([block, steady[g]]) if steady else block
        weight, rows = model_fit.weights[g], model_fit.rows[recording][g]
        cross[:, model_fit.ids[g]] += weight * (X.T @ rows)
        own += weight * (X.T @ X)
        right += weight * (X.T @ model_fit.target[recording][g])
    return TermProducts(cross, own, right)


def add_to_fit(products: Sequence[TermProducts], base: Fit, term: ModelTerm) -> tuple[Array, Array, Array]:
    """Adds a candidate to a fit of some recordings, given its products with each.

    Returns:
        The model's coefficients, its own and their covariance.
    """
    size = term.shaped.size
    cross, own, right = (
        np.sum(parts, axis=0)
        for parts in ([x.cross for x in products], [x.own for x in products], [x.right for x in products])
    )
    right = right - cross @ base.coefficients
    steady = len(right) > size
    pull = base.inverse @ cross.T
    schur = own - cross @ pull
    matrix = schur[:size, :size] + np.diag(FLAT * (1.0 + np.diag(own)[:size]) + term.layout.precision)
    covariance = np.linalg.inv(matrix)
    found = covariance @ (right[:size] - schur[:size, size:].sum(axis=1))
    whole = np.append(found, np.ones(int(steady)))
    return base.coefficients - pull @ whole, np.asarray(found), np.asarray(covariance)


def _displaced(model_fit: ModelFit, coefficients: Array) -> ModelTerm | None:
    """The first term of a model that is significantly outside its bounds now, and was not before."""
    spread = np.sqrt(np.diag(model_fit.whole.inverse))
    for term, start in zip(model_fit.model, model_fit.starts, strict=False):
        own = slice(start, start + term.shaped.size)
        lower, upper = term.shaped.lower * term.layout.scale, term.shaped.upper * term.layout.scale

        def beyond(values: Array, lower: Array = lower, upper: Array = upper) -> Array:
            return np.maximum(lower - values, values - upper)

        now, before = beyond(coefficients[own]), beyond(model_fit.whole.coefficients[own])
        if np.any((now > spread[own]) & (now > before)):
            return term
    return None


def _weight_gain(model_fit: ModelFit, term: ModelTerm, squares: Array) -> float:
    """By how much the rows that a candidate touches weigh more once it is part of the model.

    Rows with a large unexplained residual have small weights, and the candidate's numbers would look uncertain; where
    the candidate explains that residual, its numbers are known as well as what is left then allows.
    """
    touched = list(term.groups)
    weights = 1.0 / np.maximum(squares[touched] / model_fit.counts[touched], 1.0)
    return float(max(1.0, np.min(weights / model_fit.weights[touched])))


def _contrast_chi_square(term: ModelTerm, coefficients: Array, covariance: Array) -> float:
    """Wald chi-square of an effect's contrasts; infinite for an effect without any."""
    rows = () if term.generic else term.candidate.effect.contrasts
    if not rows or len(rows[0]) != len(coefficients):
        return float("inf")
    L = np.array(rows) / term.layout.scale
    found = L @ coefficients
    return float(found @ np.linalg.pinv(L @ covariance @ L.T, hermitian=True) @ found)
