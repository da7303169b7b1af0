# SPDX-License-Identifier: BSD-3-Clause
r"""Parameters of a fitted term and their standard deviations.

Coefficients and shape share one covariance: the shape's columns are beside X in the normal equations, so that a
parameter from a grid has an error as well (profile likelihood to second order),

    C = f (P + A)^{-1},      f = 1.45 (1 + \rho) / (1 - \rho)

P the priors' precision, A what the rows say: less by what the model leaves over its noise (through the weights). f
stands for its correlation in time, and for what a model may leave and still pass. Priors are inflated as well: where
one is wrong, a mass by a sixth, a cause that makes up for it would be certain.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from scipy.stats import chi2

from impedance_modules.arrays import Array
from impedance_modules.diagnosis.regression.design_matrix import scaled_block
from impedance_modules.diagnosis.regression.model_fit import ModelFit, ModelTerm
from impedance_modules.diagnosis.regression.shape_refinement import ShapeRefiner
from impedance_modules.diagnosis.result import Estimate

CORRELATION_MAX = 0.9
"""Of neighbouring samples of what is left, as far as errors are inflated for it."""

ALLOWED = 1.45
"""Power over noise that a model passes with (see `lack_of_fit`): its numbers' variances are as much larger."""

CONFIDENCE = 0.95
"""With which a cause's numbers must differ from none."""

RANK = 1e-9
"""Directions of a covariance with less than this part of the largest are none."""

STAMPS = 0.05
"""Part of a sample's period to which any time is known, however little the noise."""


class UnwhitenedFit:
    """Unwhitened columns of the terms that a diagnosis reports, evaluated once each."""

    def __init__(self, refiner: ShapeRefiner) -> None:
        """Takes what can evaluate candidates."""
        self._refiner, self.design = refiner, refiner.design
        self._kept: dict[int, tuple[ModelTerm, list[dict[int, Array]]]] = {}

    def _columns(self, term: ModelTerm) -> Sequence[Mapping[int, Array]]:
        if id(term) not in self._kept:
            regressor = self._refiner.regressor(term.candidate, term.shaped.shape)
            rows = []
            for r, raw in enumerate(self.design.raw):
                rows.append(
                    {
                        g: scaled_block(regressor, term.layout, r, self.design.groups[g], len(raw[g])).astype(
                            float
                        )
                        for g in term.groups
                    }
                    if regressor is not None
                    else {}
                )
            self._kept[id(term)] = (term, rows)
        return self._kept[id(term)][1]

    def torque(self, model_fit: ModelFit, index: int, recording: int) -> dict[int, Array]:
        """What one term of a model's fit on all recordings adds to a recording: group -> (M,) in the group's unit."""
        term, start = model_fit.model[index], int(model_fit.starts[index])
        own = model_fit.whole.coefficients[start : start + term.shaped.size]
        whole = np.append(own, np.ones(int(term.shaped.fixed)))
        return {g: block @ whole for g, block in self._columns(term)[recording].items()}

    def left(self, model_fit: ModelFit, recording: int) -> list[Array]:
        """What a model's fit on all recordings leaves of a recording: group -> (M,) in the group's unit."""
        design = self.design
        coefficients = model_fit.whole.coefficients
        out = [
            raw - columns @ coefficients[ids]
            for raw, columns, ids in zip(
                design.raw[recording], design.nuisance.columns[recording], design.nuisance.ids, strict=True
            )
        ]
        for index in range(len(model_fit.model)):
            for g, torque in self.torque(model_fit, index, recording).items():
                out[g] = out[g] - torque
        return out

    def left_by_terms(self, model_fit: ModelFit, terms: Sequence[int], recording: int) -> list[Array]:
        """What some terms alone leave of a recording: links, weights and stamps stay as the nominal model has them."""
        out = list(self.design.raw[recording])
        for index in terms:
            for g, torque in self.torque(model_fit, index, recording).items():
                out[g] = out[g] - torque
        return out


def estimates(
    model_fit: ModelFit, refiner: ShapeRefiner, index: int, *, prismatic: bool
) -> Mapping[str, Estimate]:
    """Estimates the parameters of a fitted model's term.

    Args:
        model_fit: The accepted model.
        refiner: To differentiate by the shape.
        index: Of the term.
        prismatic: Its joint slides.
    """
    term = model_fit.model[index]
    candidate, shape = term.candidate, dict(term.shaped.shape)
    site = candidate.site(refiner.prepared[0].signals)
    coefficients = np.clip(model_fit.of(index), term.shaped.lower, term.shaped.upper)
    symbols = list(candidate.effect.refined(shape))

    def values(x: Array) -> dict[str, float]:
        moved = {**shape, **dict(zip(symbols, map(float, x[len(coefficients) :]), strict=True))}
        return candidate.effect.values(x[: len(coefficients)], moved, site)

    point = np.concatenate([coefficients, [shape[symbol] for symbol in symbols]])
    covariance = _covariance(model_fit, refiner, index, symbols)
    nominal = values(point)
    slopes = _slopes(values, point, np.sqrt(np.clip(np.diag(covariance), 0.0, None)))
    out = {}
    for symbol, value in nominal.items():
        parameter = candidate.effect.description.parameter(symbol)
        unit = parameter.linear_unit if prismatic and parameter.linear_unit else parameter.unit
        variance = float(slopes[symbol] @ covariance @ slopes[symbol])
        if unit == "s":
            variance += (STAMPS / refiner.prepared[0].log.rate) ** 2
        out[symbol] = Estimate(float(value), float(np.sqrt(max(variance, 0.0))), unit)
    return out


def beyond_chance(model_fit: ModelFit, refiner: ShapeRefiner, index: int) -> bool:
    r"""Whether the numbers of a term are surely not those of no effect, by the errors that they are printed with.

        c^T C^{-1} c > \chi^2_{95 \%}(rank of C)      c counted from where the effect is none

    A law that filters the command also fits the command's noise; and what a model leaves is no white noise, so that
    a gain of likelihood alone is too easily had. True for a term that is there without coefficients.
    """
    term = model_fit.model[index]
    if term.shaped.size == 0:
        return True
    found = term.candidate.effect.from_none(model_fit.of(index), term.shaped.shape)
    return _differs(found, _own_covariance(model_fit, refiner, index))


def beyond_simpler(model_fit: ModelFit, refiner: ShapeRefiner, index: int) -> bool:
    r"""Whether what makes a term more than a simpler law is surely there, by the errors that its numbers have.

        (L c)^T (L C L^T)^{-1} L c > \chi^2_{95 \%}(rank of L C L^T)

    L holds the effect's contrasts, which are zero where a simpler law would do; c lies within its bounds. True for an
    effect without any.
    """
    term = model_fit.model[index]
    rows = term.candidate.effect.contrasts
    if not rows or len(rows[0]) != term.shaped.size:
        return True
    L = np.array(rows)
    found = np.clip(model_fit.of(index), term.shaped.lower, term.shaped.upper)
    return _differs(L @ found, L @ _own_covariance(model_fit, refiner, index) @ L.T)


def _own_covariance(model_fit: ModelFit, refiner: ShapeRefiner, index: int) -> Array:
    """Of a term's coefficients, (p, p), in their own units."""
    term = model_fit.model[index]
    symbols = list(term.candidate.effect.refined(term.shaped.shape))
    return _covariance(model_fit, refiner, index, symbols)[: term.shaped.size, : term.shaped.size]


def _differs(values: Array, covariance: Array) -> bool:
    """Whether values (p,) with a covariance (p, p) are surely not all zero."""
    # In units of each value's own error: inertias have very different ones.
    spread = np.sqrt(np.clip(np.diag(covariance), np.finfo(float).tiny, None))
    parts, axes = np.linalg.eigh(covariance / np.outer(spread, spread))
    known = parts > RANK * parts[-1]
    along = (axes[:, known].T @ (values / spread)) ** 2 / parts[known]
    return float(along.sum()) > float(chi2.ppf(CONFIDENCE, int(known.sum())))


def _slopes(values: Callable[[Array], dict[str, float]], point: Array, roots: Array) -> dict[str, Array]:
    """Derivatives of all parameters by coefficients and shape, by differences."""
    nominal = values(point)
    slopes = {symbol: np.zeros(len(point)) for symbol in nominal}
    for i, root in enumerate(roots):
        step = np.zeros(len(point))
        step[i] = max(1e-3 * root, 1e-9 * abs(point[i]), 1e-12)
        moved = values(point + step)
        for symbol in nominal:
            slopes[symbol][i] = (moved[symbol] - nominal[symbol]) / step[i]
    return slopes


def _covariance(model_fit: ModelFit, refiner: ShapeRefiner, index: int, symbols: list[str]) -> Array:
    """Of coefficients and shape together, (p + s, p + s), in their own units."""
    term = model_fit.model[index]
    size, count = term.shaped.size, len(symbols)
    start = int(model_fit.starts[index])
    own = np.arange(start, start + size)
    moves = _told(model_fit, refiner, index)
    free = {} if moves else refiner.slopes(term, model_fit.of(index) * term.layout.scale)
    cross, gram = np.zeros((count, model_fit.size)), np.zeros((count, count))
    for r in model_fit.fitted:
        for g in term.groups:
            columns = [free[s][r].get(g) if s in free else None for s in symbols]
            for i, column in enumerate(columns):
                if column is None:
                    continue
                cross[i, model_fit.ids[g]] += model_fit.weights[g] * (model_fit.rows[r][g].T @ column)
                for j, other in enumerate(columns):
                    if other is not None:
                        gram[i, j] += model_fit.weights[g] * float(column @ other)
    inverse = model_fit.whole.inverse
    known = [i for i in range(count) if gram[i, i] > 0.0]
    out = np.zeros((size + count, size + count))
    scale = term.layout.scale
    base = inverse[np.ix_(own, own)]
    if known:
        pull = cross[known] @ inverse
        schur = gram[np.ix_(known, known)] - pull @ cross[known].T
        shape_part = np.linalg.pinv(schur, hermitian=True)
        into = pull[:, own]
        base = base + into.T @ shape_part @ into
        place = [size + i for i in known]
        out[np.ix_(place, place)] = shape_part
        out[np.ix_(range(size), place)] = -(into.T @ shape_part) / scale[:, None]
        out[np.ix_(place, range(size))] = out[np.ix_(range(size), place)].T
    out[:size, :size] = base / np.outer(scale, scale)
    return out * ALLOWED * correlation_surplus(model_fit, term.groups)


def _told(model_fit: ModelFit, refiner: ShapeRefiner, index: int) -> bool:
    """Whether a parameter of the shape follows from the coefficients, which carry its error then."""
    candidate = model_fit.model[index].candidate
    shape = dict(model_fit.model[index].shaped.shape)
    site = candidate.site(refiner.prepared[0].signals)
    first, second = (
        candidate.effect.values(model_fit.of(index) * factor, shape, site) for factor in (1.0, 1.01)
    )
    return any(first.get(s) != second.get(s) for s in shape)


def correlation_surplus(model_fit: ModelFit, groups: Sequence[int]) -> float:
    r"""How many samples of what a model leaves in some groups say as much as one that is independent.

    (1 + \rho) / (1 - \rho), \rho the correlation of samples that follow each other.
    """
    above, below = 0.0, 0.0
    for r in model_fit.fitted:
        left = model_fit.left_of(r)
        for g in groups:
            above += float(left[g][1:] @ left[g][:-1]) * model_fit.weights[g]
            below += float(left[g] @ left[g]) * model_fit.weights[g]
    rho = float(np.clip(above / below if below > 0.0 else 0.0, 0.0, CORRELATION_MAX))
    return (1.0 + rho) / (1.0 - rho)
