# SPDX-License-Identifier: BSD-3-Clause
r"""A candidate added to a fitted model without fitting it all again: the normal matrix's Schur complement.

    S = X^T W X - X^T W T A^{-1} T^T W X + \Lambda,      \beta = S^{-1} X^T W (y - T \beta_0)

T are the model's columns and A their normal matrix, X the candidate's, \Lambda the precision of its prior.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impedance_modules.diagnosis.regression.model_fit import FLAT, Bench, Fit
from impedance_modules.diagnosis.regression.term import Term

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Seen:
    """A candidate fitted to all recordings.

    Attributes:
        gain: [nats].
        essence: Chi-square of what makes it this effect.
        displaced: A term of the model beside it that it drives out of its physical bounds; None where it does not.
        spread: (p,) standard deviations of its coefficients, scaled.
        beside: (K + P,) the model's coefficients beside it.
        own: (p,) its coefficients, scaled.
    """

    gain: float
    essence: float
    displaced: Term | None
    spread: Array
    beside: Array
    own: Array


def seen_by_all(bench: Bench, term: Term) -> Seen:
    """Looks at the fit of all recordings, in likelihood and prior together."""
    found, more, covariance = extended(bench, bench.fitted, bench.whole, term)
    squares = np.zeros(len(bench.design.groups))
    for r in bench.fitted:
        squares += [float(x @ x) for x in with_term(bench.residuals(found, r), term, r, more)]
    ratio = np.log(np.maximum(bench.left, 1e-9) / np.maximum(squares, 1e-9))
    prior = float(bench.prior @ (bench.whole.coefficients**2 - found**2))
    own = float(term.slot.precision @ more**2)
    known = _sharpening(bench, term, squares)
    gain = float(0.5 * (bench.counts @ ratio + prior - own))
    spread = np.sqrt(np.clip(np.diag(covariance), 0.0, None))
    return Seen(gain, known * _essence(term, more, covariance), _displaced(bench, found), spread, found, more)


def _displaced(bench: Bench, coefficients: Array) -> Term | None:
    """The first term of a model that coefficients leave outside its bounds for certain, and which was inside."""
    spread = np.sqrt(np.diag(bench.whole.inverse))
    for term, start in zip(bench.model, bench.starts, strict=False):
        own = slice(start, start + term.shaped.size)
        lower, upper = term.shaped.lower * term.slot.scale, term.shaped.upper * term.slot.scale

        def beyond(values: Array, lower: Array = lower, upper: Array = upper) -> Array:
            return np.maximum(lower - values, values - upper)

        now, before = beyond(coefficients[own]), beyond(bench.whole.coefficients[own])
        if np.any((now > spread[own]) & (now > before)):
            return term
    return None


def _sharpening(bench: Bench, term: Term, squares: Array) -> float:
    """By how much the rows that a candidate touches weigh more once it takes part.

    A gap that is not understood counts for little, and so would everything that is read off its rows; where
    the candidate closes it, its own numbers are known as well as what is left then allows.
    """
    touched = list(term.groups)
    weights = 1.0 / np.maximum(squares[touched] / bench.counts[touched], 1.0)
    return float(max(1.0, np.min(weights / bench.weights[touched])))


def _essence(term: Term, coefficients: Array, covariance: Array) -> float:
    """Chi-square of the sums that make an effect what it is (Wald); infinite where every coefficient does."""
    rows = () if term.generic else term.candidate.effect.essence
    if not rows or len(rows[0]) != len(coefficients):
        return float("inf")
    L = np.array(rows) / term.slot.scale
    found = L @ coefficients
    return float(found @ np.linalg.pinv(L @ covariance @ L.T, hermitian=True) @ found)


def with_term(left: Sequence[Array], term: Term, recording: int, coefficients: Array) -> list[Array]:
    """Takes a candidate's part out of residuals."""
    out = list(left)
    for g, block in term.columns[recording].items():
        out[g] = out[g] - block @ coefficients
    for g, steady in term.fixed[recording].items():
        out[g] = out[g] - steady
    return out


def extended(bench: Bench, recordings: Sequence[int], base: Fit, term: Term) -> tuple[Array, Array, Array]:
    """Adds a candidate to a fit; returns the model's coefficients, its own and their covariance."""
    size = term.shaped.size
    steady = bool(term.fixed[recordings[0]])
    width = size + steady
    cross, own, right = np.zeros((width, bench.size)), np.zeros((width, width)), np.zeros(width)
    for r in recordings:
        for g, block in term.columns[r].items():
            X = np.column_stack([block, term.fixed[r][g]]) if steady else block
            ids, rows = bench.ids[g], bench.rows[r][g]
            left = bench.target[r][g] - rows @ base.coefficients[ids]
            cross[:, ids] += bench.weights[g] * (X.T @ rows)
            own += bench.weights[g] * (X.T @ X)
            right += bench.weights[g] * (X.T @ left)
    pull = base.inverse @ cross.T
    schur = own - cross @ pull
    matrix = schur[:size, :size] + np.diag(FLAT * (1.0 + np.diag(own)[:size]) + term.slot.precision)
    covariance = np.linalg.inv(matrix)
    found = covariance @ (right[:size] - schur[:size, size:].sum(axis=1))
    whole = np.append(found, np.ones(int(steady)))
    return base.coefficients - pull @ whole, np.asarray(found), np.asarray(covariance)
