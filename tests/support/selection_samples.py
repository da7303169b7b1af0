# SPDX-License-Identifier: BSD-3-Clause
"""Small designs of random rows for the selection of causes, so that a fit of it can be done again by least squares."""

from __future__ import annotations

from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np

from impedance_modules.diagnosis.regression.candidates import ShapedCandidate
from impedance_modules.diagnosis.regression.design_matrix import ColumnLayout, Design
from impedance_modules.diagnosis.regression.model_fit import ModelFit, ModelTerm, term_of

GROUPS = (("link", 0), ("link", 1), ("actuator", 1))
RECORDINGS, ROWS, NUISANCE = 5, 90, 2
FOLDS = ((0, 1), (2,), (3,))
"""The last recording is held out."""


def layout(
    key: tuple[str, str, str],
    places: dict[int, int],
    size: int,
    *,
    fixed: bool = False,
    bounds: tuple[float, float] = (-np.inf, np.inf),
    scale: Sequence[float] | None = None,
    precision: Sequence[float] | None = None,
    candidate: Any = None,
) -> ColumnLayout:
    """A candidate that stands at some columns; generic unless a candidate is given."""
    lower, upper = (np.full(size, bound) for bound in bounds)
    return ColumnLayout(
        ShapedCandidate(candidate, {}, size, fixed, lower, upper, key),
        places,
        np.ones(size) if scale is None else np.array(scale),
        np.zeros(size) if precision is None else np.array(precision),
        np.zeros(size, dtype=bool),
    )


def random_design(random: np.random.Generator, layouts: Sequence[ColumnLayout], rate: float = 20.0) -> Design:
    """Rows of unit noise, nuisance and candidates' columns, all random; a cause is added by ``with_cause``."""
    count = len(GROUPS)
    width = [
        max([0, *(own.places[g] + own.shaped.width for own in layouts if g in own.places)])
        for g in range(count)
    ]

    def rows(columns: Sequence[int]) -> tuple[tuple[np.ndarray, ...], ...]:
        return tuple(
            tuple(random.standard_normal((ROWS + 3 * r, columns[g])) for g in range(count))
            for r in range(RECORDINGS)
        )

    noise = tuple(tuple(block[:, 0] for block in found) for found in rows([1] * count))
    nuisance = SimpleNamespace(size=NUISANCE, ids=(np.arange(NUISANCE),) * count, groups=GROUPS)
    whitening = SimpleNamespace(
        rows=lambda r, g, many: many,
        part=np.array([1.0, 0.9, 0.8]),
        weak=False,
        clear={},
        doubt=np.ones(count),
    )
    names = tuple(f"run{r}" for r in range(RECORDINGS))
    Z = tuple(tuple(0.3 * block for block in found) for found in rows([NUISANCE] * count))
    X = tuple(tuple(block.astype(np.float32) for block in found) for found in rows(width))
    return Design(GROUPS, names, nuisance, whitening, noise, noise, Z, X, tuple(layouts), rate)


def with_cause(design: Design, own: ColumnLayout, coefficients: Sequence[float]) -> Design:
    """The same rows with a candidate's torque in them."""
    term = term_of(design, own)
    y = [list(found) for found in design.y]
    for r, found in enumerate(term.columns):
        for g, block in found.items():
            y[r][g] = y[r][g] + block @ np.array(coefficients) + term.fixed[r].get(g, 0.0)
    rows = tuple(tuple(found) for found in y)
    return Design(
        design.groups, design.names, design.nuisance, design.whitening, rows, rows, design.Z, design.X,
        design.layouts, design.rate,
    )  # fmt: skip


def fitted(design: Design, *model: ModelTerm) -> ModelFit:
    """A model on the folds."""
    return ModelFit(design, FOLDS, model)


def least_squares(
    model_fit: ModelFit, terms: Sequence[ModelTerm], recordings: Sequence[int]
) -> tuple[np.ndarray, np.ndarray]:
    """Coefficients and covariance of nuisance and terms together at a fit's weights, in one system of equations."""
    design = model_fit.design
    sizes = [NUISANCE, *(term.shaped.size for term in terms)]
    first = np.cumsum([0, *sizes])
    prior = np.concatenate([np.ones(NUISANCE), *(term.layout.precision for term in terms)])
    A, b = np.diag(prior), np.zeros(first[-1])
    for r in recordings:
        for g in range(len(design.groups)):
            rows = np.zeros((len(design.y[r][g]), first[-1]))
            rows[:, :NUISANCE] = design.Z[r][g]
            target = design.y[r][g].copy()
            for k, term in enumerate(terms):
                if g in term.columns[r]:
                    rows[:, first[k + 1] : first[k + 2]] = term.columns[r][g]
                    target -= term.fixed[r].get(g, 0.0)
            A += model_fit.weights[g] * rows.T @ rows
            b += model_fit.weights[g] * rows.T @ target
    return np.linalg.solve(A, b), np.linalg.inv(A)
