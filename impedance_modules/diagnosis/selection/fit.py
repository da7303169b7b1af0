# SPDX-License-Identifier: BSD-3-Clause
r"""One fit: accepted causes by least squares, the bodies' inertias held by their prior.

    \min_\beta \sum_g w_g |y_g - X_g \beta|^2 + |\beta_{nuisance}|^2,   w_g = \kappa_g / s_g^2

s_g is the size of what is left of a group, \kappa_g the part of its samples that are independent.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impedance_modules.diagnosis.design import Design, Indices, Slot

Array = NDArray[np.float64]

FLAT = 1e-9
"""Precision that keeps a direction the data do not see finite, in scaled coefficients."""


@dataclass(frozen=True, eq=False)
class Fit:
    """Coefficients of all columns; zero where a column takes no part.

    Attributes:
        coefficients: (total,) in scaled columns.
        active: Indices of the fitted columns, nuisance first.
        inverse: Inverse of the normal matrix over ``active``: their covariance.
    """

    coefficients: Array
    active: NDArray[np.intp]
    inverse: Array

    def of(self, slot: Slot) -> Array:
        """Coefficients of one candidate, in its own units."""
        return np.asarray(self.coefficients[slot.columns] / slot.scale)

    def covariance_of(self, slot: Slot) -> Array:
        """Covariance of one candidate's coefficients, (p, p), in its own units."""
        place = np.searchsorted(self.active, slot.columns)
        return self.inverse[np.ix_(place, place)] / np.outer(slot.scale, slot.scale)


def fit(design: Design, recordings: Sequence[int], model: Sequence[Slot], weights: Array) -> Fit:
    """Fits a model's candidates and the nuisance to some recordings.

    Args:
        design: The sums.
        recordings: Indices of the recordings that are fitted.
        model: Candidates that take part.
        weights: (groups,) w_g.
    """
    columns = [slot.columns for slot in model]
    active = np.sort(np.concatenate([np.arange(design.nuisance), *columns])).astype(np.intp)
    steady = [slot.fixed for slot in model if slot.fixed is not None]
    size = len(active)
    precision = np.full(design.total, FLAT)
    precision[: design.nuisance] = 1.0
    for slot in model:
        precision[slot.columns] += slot.precision
    A = np.diag(precision[active])
    b = np.zeros(size)
    for group, ids in enumerate(design.ids):
        here = np.flatnonzero(np.isin(ids, active, assume_unique=True))
        there = np.searchsorted(active, ids[here])
        gram = sum_gram(design, recordings, group, here + 1, np.concatenate([[0], here + 1]))
        A[np.ix_(there, there)] += weights[group] * gram[:, 1:]
        b[there] += weights[group] * gram[:, 0]
        fixed = np.flatnonzero(np.isin(ids, steady)) + 1
        b[there] -= weights[group] * sum_gram(design, recordings, group, here + 1, fixed).sum(axis=1)
    inverse = np.linalg.inv(A)
    coefficients = np.zeros(design.total)
    coefficients[active] = inverse @ b
    coefficients[steady] = 1.0
    return Fit(coefficients, active, inverse)


def extend(design: Design, recordings: Sequence[int], base: Fit, slot: Slot, weights: Array) -> Fit:
    """Adds one candidate to a fit: only the equations that it touches are looked at again.

    The covariance of the result is that of the base; use `fit` where it matters.
    """
    cross, own, right = against(design, recordings, slot, base, weights)
    if slot.fixed is not None:
        right = right - steady_shift(design, recordings, slot, weights)
    pull = base.inverse @ cross.T
    schur = own - cross @ pull
    schur[np.diag_indices_from(schur)] += FLAT * (1.0 + np.diag(own)) + slot.precision
    found = np.linalg.solve(schur, right)
    coefficients = base.coefficients.copy()
    coefficients[base.active] -= pull @ found
    coefficients[slot.columns] = found
    if slot.fixed is not None:
        coefficients[slot.fixed] = 1.0
    return Fit(coefficients, base.active, base.inverse)


def against(
    design: Design, recordings: Sequence[int], slot: Slot, base: Fit, weights: Array
) -> tuple[Array, Array, Array]:
    """Candidate against model (p, active), against itself (p, p), and against what is left (p,)."""
    active, coefficients = base.active, base.coefficients
    size = len(slot.columns)
    cross, own, right = np.zeros((size, len(active))), np.zeros((size, size)), np.zeros(size)
    place = np.full(design.total, len(active), dtype=np.intp)
    place[active] = np.arange(len(active))
    for group in slot.groups:
        ids = design.ids[group]
        mine = np.searchsorted(ids, slot.columns) + 1
        inside = np.flatnonzero(place[ids] < len(active))
        block = sum_gram(design, recordings, group, mine, np.arange(len(ids) + 1))
        cross[:, place[ids[inside]]] += weights[group] * block[:, inside + 1]
        own += weights[group] * block[:, mine]
        used = np.flatnonzero(coefficients[ids])
        right += weights[group] * (block[:, 0] - block[:, used + 1] @ coefficients[ids[used]])
    return cross, own, right


def steady_shift(design: Design, recordings: Sequence[int], slot: Slot, weights: Array) -> Array:
    """What a candidate's part without a coefficient takes from its right side, (p,)."""
    shift = np.zeros(len(slot.columns))
    for group in slot.groups if slot.fixed is not None else ():
        ids = design.ids[group]
        steady = np.flatnonzero(ids == slot.fixed) + 1
        mine = np.searchsorted(ids, slot.columns) + 1
        shift += weights[group] * sum_gram(design, recordings, group, mine, steady)[:, 0]
    return shift


def squares(design: Design, recordings: Sequence[int], coefficients: Array) -> Array:
    """Sums of squares that coefficients leave in each group, (groups,)."""
    out = np.zeros(len(design.groups))
    for group, ids in enumerate(design.ids):
        values = coefficients[ids]
        used = np.flatnonzero(values)
        vector = np.concatenate([[1.0], -values[used]])
        pick = np.concatenate([[0], used + 1])
        out[group] = vector @ sum_gram(design, recordings, group, pick, pick) @ vector
    return np.maximum(out, 1e-18)


def sum_gram(design: Design, recordings: Sequence[int], group: int, rows: Indices, columns: Indices) -> Array:
    """Adds a block of some recordings' sums up; index 0 is y."""
    pick = np.ix_(rows, columns)
    return np.asarray(sum(design.gram[recording][group][pick] for recording in recordings))


def prediction_variance(design: Design, recordings: Sequence[int], found: Fit) -> Array:
    """Mean variance that the coefficients' own uncertainty gives to each group's prediction, (groups,)."""
    out = np.zeros(len(design.groups))
    for group, ids in enumerate(design.ids):
        here = np.flatnonzero(np.isin(ids, found.active, assume_unique=True))
        there = np.searchsorted(found.active, ids[here])
        gram = sum_gram(design, recordings, group, here + 1, here + 1)
        out[group] = np.sum(gram * found.inverse[np.ix_(there, there)]) / design.count(recordings, group)
    return out
