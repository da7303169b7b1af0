# SPDX-License-Identifier: BSD-3-Clause
r"""Fits of one model, on all recordings and without each fold: causes by least squares, nuisance held by its prior.

    \min_{\nu, \beta} \sum_g w_g |y_g - Z_g \nu - X_g \beta|^2 + |\nu|^2,      w_g = 1 / max(1, s_g^2)

Rows are white and of unit noise; s_g^2 is what is left of a group over its noise, so that a group that is not
understood yet does not distort the nuisance that it shares with others.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from impedance_modules.arrays import Array, Indices
from impedance_modules.diagnosis.regression.candidates import Candidate, ShapedCandidate
from impedance_modules.diagnosis.regression.design_matrix import ColumnLayout, Design
from impedance_modules.diagnosis.regression.prediction import foretold_squares

FLAT = 1e-9
"""Precision that keeps a direction the data do not see finite, in scaled coefficients."""

PRIOR_MAX = 3.0
"""A nuisance further out than so many standard deviations of its prior is none: the rows are trusted less until
it is back, because what moves it there is something that the model lacks."""

DOWNWEIGHTINGS = 12
"""How often they are trusted half as much at most."""

ROUNDS = 3
"""How often fit and weights are repeated in turn."""


@dataclass(frozen=True, eq=False)
class ModelTerm:
    """A shaped candidate with its columns.

    Attributes:
        layout: Its description.
        columns: Recording -> group -> (M, p) whitened and scaled.
        fixed: Recording -> group -> (M,) whitened part without a coefficient; empty where there is none.
    """

    layout: ColumnLayout
    columns: tuple[Mapping[int, Array], ...]
    fixed: tuple[Mapping[int, Array], ...]

    @property
    def shaped(self) -> ShapedCandidate:
        """The candidate in its shape."""
        return self.layout.shaped

    @property
    def key(self) -> tuple[str, str, str]:
        """Effect, carrier and port."""
        return self.layout.shaped.key

    @property
    def groups(self) -> tuple[int, ...]:
        """Groups that it touches."""
        return self.layout.groups

    @property
    def generic(self) -> bool:
        """Whether it is generic, without physics."""
        return self.layout.shaped.candidate is None

    @property
    def candidate(self) -> Candidate:
        """The physical candidate.

        Raises:
            TypeError: It is generic.
        """
        if self.layout.shaped.candidate is None:
            raise TypeError("a generic basis has no physical candidate")
        return self.layout.shaped.candidate


@dataclass(frozen=True, eq=False)
class Fit:
    """Coefficients in scaled columns, nuisance first, then term by term.

    Attributes:
        coefficients: (K + P,).
        normal: (K + P, K + P) normal matrix, priors included.
    """

    coefficients: Array
    normal: Array

    @cached_property
    def inverse(self) -> Array:
        """(K + P, K + P) of the normal matrix: the coefficients' covariance where the model is right."""
        return np.asarray(np.linalg.inv(self.normal))


class ModelFit:
    """One model and all its fits.

    Attributes:
        design: The rows.
        folds: Recordings by fold.
        model: Terms that take part.
        fitted: Recordings that are fitted.
        whole: The fit on all of them.
        weights: (groups,) w_g.
        starts: Index of each term's first coefficient.
    """

    def __init__(self, design: Design, folds: Sequence[Sequence[int]], model: Sequence[ModelTerm]) -> None:
        """Fits a model on all folds."""
        self.design, self.model = design, tuple(model)
        self.folds = tuple(tuple(fold) for fold in folds)
        self.fitted = tuple(index for fold in self.folds for index in fold)
        sizes = [term.shaped.size for term in self.model]
        self.starts = design.nuisance.size + np.cumsum([0, *sizes], dtype=np.intp)
        self.size = int(self.starts[-1])
        self.ids: tuple[Indices, ...] = tuple(self._ids(g) for g in range(len(design.groups)))
        self.rows = tuple(
            tuple(self._rows(r, g) for g in range(len(design.groups))) for r in range(len(design.y))
        )
        self.target = tuple(
            tuple(self._target(r, g) for g in range(len(design.groups))) for r in range(len(design.y))
        )
        self._summed: dict[tuple[int, tuple[int, ...]], tuple[Array, Array]] = {}
        self._left: dict[int, list[Array]] = {}
        self.counts = design.count(self.fitted)
        self.weights = np.ones(len(design.groups))
        self.whole = self.fit(self.fitted)
        for _ in range(ROUNDS - 1):
            left = self.squares(self.whole.coefficients, self.fitted)
            self.weights = 1.0 / np.maximum(left / self.counts, 1.0)
            self.whole = self.fit(self.fitted)
        for _ in range(DOWNWEIGHTINGS):
            if np.abs(self.whole.coefficients[: design.nuisance.size]).max(initial=0.0) <= PRIOR_MAX:
                break
            self.weights = 0.5 * self.weights
            self.whole = self.fit(self.fitted)

    def _ids(self, group: int) -> Indices:
        own = [
            np.arange(start, start + term.shaped.size)
            for term, start in zip(self.model, self.starts, strict=False)
            if group in term.layout.places
        ]
        return np.concatenate([self.design.nuisance.ids[group], *own]).astype(np.intp)

    def _rows(self, recording: int, group: int) -> Array:
        own = [term.columns[recording][group] for term in self.model if group in term.layout.places]
        nuisance = self.design.Z[recording][group]
        return np.concatenate([nuisance, *own], axis=1) if own else nuisance

    def _target(self, recording: int, group: int) -> Array:
        steady = [term.fixed[recording][group] for term in self.model if group in term.fixed[recording]]
        return (
            np.asarray(self.design.y[recording][group] - sum(steady))
            if steady
            else self.design.y[recording][group]
        )

    def _normal(self, recording: int, group: int) -> tuple[Array, Array]:
        """Normal matrix and right side of a group's rows in one recording."""
        T, k = self.rows[recording][group], self.design.Z[recording][group].shape[1]
        gram = np.empty((T.shape[1], T.shape[1]))
        gram[:k, :k] = self.design.nuisance_gram[recording][group]
        gram[k:] = T[:, k:].T @ T
        gram[:k, k:] = gram[k:, :k].T
        return gram, T.T @ self.target[recording][group]

    @cached_property
    def _normals(self) -> Mapping[int, tuple[tuple[Array, Array], ...]]:
        """Fitted recording -> group -> normal matrix and right side."""
        groups = range(len(self.design.groups))
        return {r: tuple(self._normal(r, g) for g in groups) for r in self.fitted}

    def _sums(self, group: int, recordings: tuple[int, ...]) -> tuple[Array, Array]:
        """Normal matrix and right side of a group, summed over recordings once: only the weights change."""
        known = self._summed.get((group, recordings))
        if known is None:
            parts = [self._normals[r][group] for r in recordings]
            known = np.asarray(sum(gram for gram, _ in parts)), np.asarray(sum(right for _, right in parts))
            self._summed[group, recordings] = known
        return known

    @cached_property
    def prior(self) -> Array:
        """(K + P,) precision of each coefficient's prior."""
        own = [term.layout.precision + FLAT for term in self.model]
        return np.concatenate([np.ones(self.design.nuisance.size), *own])

    def fit(self, recordings: Sequence[int]) -> Fit:
        """Fits the model to some recordings."""
        A, b = np.diag(self.prior), np.zeros(self.size)
        for g, ids in enumerate(self.ids):
            gram, right = self._sums(g, tuple(recordings))
            A[np.ix_(ids, ids)] += self.weights[g] * gram
            b[ids] += self.weights[g] * right
        return Fit(np.asarray(np.linalg.solve(A, b)), A)

    def residuals(self, coefficients: Array, recording: int) -> list[Array]:
        """What coefficients leave of a recording: group -> (M,) whitened."""
        return [
            self.target[recording][g] - self.rows[recording][g] @ coefficients[ids]
            for g, ids in enumerate(self.ids)
        ]

    def left_of(self, recording: int) -> list[Array]:
        """What the whole fit leaves of a recording: group -> (M,) whitened; computed once."""
        if recording not in self._left:
            self._left[recording] = self.residuals(self.whole.coefficients, recording)
        return self._left[recording]

    @cached_property
    def left(self) -> Array:
        """(groups,) sum of squares that the whole fit leaves on the fitted recordings."""
        parts = [[float(x @ x) for x in self.left_of(r)] for r in self.fitted]
        return np.asarray(np.sum(parts, axis=0))

    def squares(self, coefficients: Array, recordings: Sequence[int]) -> Array:
        """(groups,) sums of squares that coefficients leave."""
        parts = [[float(x @ x) for x in self.residuals(coefficients, r)] for r in recordings]
        return np.asarray(np.sum(parts, axis=0))

    def train(self, fold: int) -> tuple[int, ...]:
        """Recordings of all folds but one."""
        return tuple(index for other, found in enumerate(self.folds) if other != fold for index in found)

    @cached_property
    def without(self) -> tuple[Fit, ...]:
        """The fits without each fold."""
        return tuple(self.fit(self.train(fold)) for fold in range(len(self.folds)))

    @cached_property
    def unseen(self) -> dict[int, list[Array]]:
        """Recording -> group -> (M,) residual by the fit that has not seen its fold."""
        return {
            r: self.residuals(found.coefficients, r)
            for fold, found in zip(self.folds, self.without, strict=True)
            for r in fold
        }

    @cached_property
    def unseen_squares(self) -> Array:
        """(folds, groups) squares of these residuals as predictions."""
        return self.predicted_by_fold(self.unseen)

    def predicted_by_fold(self, left: Mapping[int, Sequence[Array]]) -> Array:
        """(folds, groups) squares of what fits without each fold leave of it, by what they can foretell."""
        return np.array([self.predicted_squares(left, fold) for fold in self.folds])

    def predicted_squares(self, left: Mapping[int, Sequence[Array]], unseen: Sequence[int]) -> Array:
        """(groups,) squares of what a fit leaves of unseen recordings, by what it can foretell of their links.

        Causes stand as they are, so that each is judged by its own numbers (`regression.prediction`).

        Args:
            left: Recording -> group -> (M,) residual by the fit, whitened.
            unseen: A fold, by the fit of the others; or held-out recordings, by the whole fit.
        """
        residuals, columns = [left[r] for r in unseen], [self.design.Z[r] for r in unseen]
        more = [r for r in unseen if r not in self.fitted]
        covariance = self._nuisance_covariance(more) if more else self._fitted_covariance
        return foretold_squares(residuals, columns, self.design.nuisance.ids, self.weights, covariance)

    @cached_property
    def _fitted_covariance(self) -> Array:
        """(K, K) covariance of the nuisance given the causes, by its prior and the fitted recordings."""
        return self._nuisance_covariance(())

    def _nuisance_covariance(self, more: Sequence[int]) -> Array:
        """The same by more recordings, too."""
        size = self.design.nuisance.size
        A = self.whole.normal[:size, :size].copy()
        for r in more:
            for g, ids in enumerate(self.design.nuisance.ids):
                A[np.ix_(ids, ids)] += self.weights[g] * self.design.nuisance_gram[r][g]
        return np.asarray(np.linalg.inv(A))

    @cached_property
    def log_likelihood(self) -> Array:
        """(groups,) of the fitted recordings as predicted without their fold [nats]."""
        return self.design.log_likelihood(self.unseen_squares.sum(axis=0), self.counts)

    def of(self, index: int, found: Fit | None = None) -> Array:
        """Coefficients of one term in its own units, by the whole fit unless another is given."""
        start, term = self.starts[index], self.model[index]
        values = (found or self.whole).coefficients[start : start + term.shaped.size]
        return np.asarray(values / term.layout.scale)


def term_of(design: Design, layout: ColumnLayout) -> ModelTerm:
    """Cuts a candidate's columns out of the design."""
    size, width = layout.shaped.size, layout.shaped.width
    blocks = [
        {
            group: block[group][:, first : first + width].astype(float)
            for group, first in layout.places.items()
        }
        for block in design.X
    ]
    return ModelTerm(
        layout=layout,
        columns=tuple({group: block[:, :size] for group, block in found.items()} for found in blocks),
        fixed=tuple(
            {group: block[:, size] for group, block in found.items() if width > size} for found in blocks
        ),
    )


def part_of(term: ModelTerm, kept: NDArray[np.intp]) -> ModelTerm:
    """Keeps some of a term's coefficients."""
    layout = term.layout
    shaped = replace(
        layout.shaped, size=len(kept), lower=layout.shaped.lower[kept], upper=layout.shaped.upper[kept]
    )
    return ModelTerm(
        layout=ColumnLayout(
            shaped, layout.places, layout.scale[kept], layout.precision[kept], layout.unseen[kept]
        ),
        columns=tuple({g: block[:, kept] for g, block in found.items()} for found in term.columns),
        fixed=term.fixed,
    )
