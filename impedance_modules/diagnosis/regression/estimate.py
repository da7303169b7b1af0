# SPDX-License-Identifier: BSD-3-Clause
r"""Parameters of an accepted term with standard deviations.

Coefficients and shape share one covariance: the shape's columns d(X \beta)/d\theta stand beside X in the normal
equations, so that a parameter from a grid has an error as well. What the model leaves over its noise inflates
it (through the weights), and so does what is left of correlation in time, by (1 + \rho) / (1 - \rho), and what a model
may leave and still pass.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from impedance_modules.diagnosis.result import Estimate
from impedance_modules.diagnosis.regression.model_fit import Bench
from impedance_modules.diagnosis.regression.parameter_estimates import Refiner

Array = NDArray[np.float64]

CORRELATION_MAX = 0.9
"""Of neighbouring samples of what is left, as far as errors are inflated for it."""

ALLOWED = 1.45
"""Power over noise that a model passes with (see `lack_of_fit`): its numbers' variances are as much larger."""

STAMPS = 0.05
"""Part of a sample's period to which any time is known, however little the noise."""


def estimates(bench: Bench, refiner: Refiner, index: int, *, prismatic: bool) -> Mapping[str, Estimate]:
    """Estimates the parameters of a bench's term.

    Args:
        bench: The accepted model.
        refiner: To differentiate by the shape.
        index: Of the term.
        prismatic: Its joint slides.
    """
    term = bench.model[index]
    candidate, shape = term.candidate, dict(term.shaped.shape)
    signals = refiner.prepared[0].signals
    coefficients = np.clip(bench.of(index), term.shaped.lower, term.shaped.upper)
    symbols = [symbol for symbol in shape if symbol in candidate.effect.shape]

    def values(x: Array) -> dict[str, float]:
        moved = {**shape, **dict(zip(symbols, map(float, x[len(coefficients) :]), strict=True))}
        return candidate.effect.values(x[: len(coefficients)], moved, signals, candidate.key, candidate.port)

    point = np.concatenate([coefficients, [shape[symbol] for symbol in symbols]])
    covariance = _covariance(bench, refiner, index, symbols)
    nominal = values(point)
    slopes = _slopes(values, point, np.sqrt(np.clip(np.diag(covariance), 0.0, None)))
    out = {}
    for symbol, value in nominal.items():
        parameter = candidate.effect.description.parameter(symbol)
        unit = parameter.linear_unit if prismatic and parameter.linear_unit else parameter.unit
        variance = ALLOWED * float(slopes[symbol] @ covariance @ slopes[symbol])
        if unit == "s":
            variance += (STAMPS / refiner.prepared[0].log.rate) ** 2
        out[symbol] = Estimate(float(value), float(np.sqrt(max(variance, 0.0))), unit)
    return out


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


def _covariance(bench: Bench, refiner: Refiner, index: int, symbols: list[str]) -> Array:
    """Of coefficients and shape together, (p + s, p + s), in their own units."""
    term = bench.model[index]
    size, count = term.shaped.size, len(symbols)
    start = int(bench.starts[index])
    own = np.arange(start, start + size)
    moves = _told(bench, refiner, index)
    free = {} if moves else refiner.slopes(term, bench.of(index) * term.slot.scale)
    cross, gram = np.zeros((count, bench.size)), np.zeros((count, count))
    for r in bench.fitted:
        for g in term.groups:
            columns = [free[s][r].get(g) if s in free else None for s in symbols]
            for i, column in enumerate(columns):
                if column is None:
                    continue
                cross[i, bench.ids[g]] += bench.weights[g] * (bench.rows[r][g].T @ column)
                for j, other in enumerate(columns):
                    if other is not None:
                        gram[i, j] += bench.weights[g] * float(column @ other)
    inverse = bench.whole.inverse
    known = [i for i in range(count) if gram[i, i] > 0.0]
    out = np.zeros((size + count, size + count))
    scale = term.slot.scale
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
    return out * _inflation(bench, index)


def _told(bench: Bench, refiner: Refiner, index: int) -> bool:
    """Whether a parameter of the shape follows from the coefficients, which carry its error then."""
    candidate = bench.model[index].candidate
    shape = dict(bench.model[index].shaped.shape)
    signals = refiner.prepared[0].signals
    first, second = (
        candidate.effect.values(bench.of(index) * factor, shape, signals, candidate.key, candidate.port)
        for factor in (1.0, 1.01)
    )
    return any(first.get(s) != second.get(s) for s in shape)


def _inflation(bench: Bench, index: int) -> float:
    """By what correlation in time there is in what the model leaves where the term acts."""
    above, below = 0.0, 0.0
    for r in bench.fitted:
        left = bench.residuals(bench.whole.coefficients, r)
        for g in bench.model[index].groups:
            above += float(left[g][1:] @ left[g][:-1]) * bench.weights[g]
            below += float(left[g] @ left[g]) * bench.weights[g]
    rho = float(np.clip(above / below if below > 0.0 else 0.0, 0.0, CORRELATION_MAX))
    return (1.0 + rho) / (1.0 - rho)
