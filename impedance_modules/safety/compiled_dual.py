# SPDX-License-Identifier: BSD-3-Clause
"""The linear algebra of the fast lane: the metric's factor, unit rows, multipliers, and back to torques."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from impedance_modules.compiled import compiled

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

PIVOT = 1e-9
"""Acting rows closer to parallel than this are left to the solver."""

CANCELLING = 1e6
"""Multipliers beyond this nearly cancel in the torque: left to the solver, which polishes."""


@compiled
def unit_row(
    constraint: int, matrix: Array, reach: Indices, coupled: Indices, factor: Array, row: Array
) -> float:
    """Writes g = L^-1 a / |L^-1 a| of a constraint, torque limits first; returns the length |L^-1 a|."""
    n = row.size
    row[:] = 0.0
    first, last = constraint, constraint + 1
    if constraint < n:
        row[constraint] = 1.0
    else:
        first, last = reach[0, constraint - n], reach[1, constraint - n]
        for j in range(first, last):
            row[j] = matrix[constraint - n, j]
    square = 0.0
    for i in range(first, n):
        total = row[i]
        for j in range(coupled[0, i], i):
            total -= factor[i, j] * row[j]
        row[i] = total / factor[i, i]
        square += row[i] * row[i]
    length = math.sqrt(square)
    for i in range(first, n):
        row[i] /= length
    return length


@compiled
def meet(rows: Array, last: int, softness: float, gram: Array) -> None:
    """Writes how the last row meets all others, g_r . g_s, and itself."""
    for s in range(last + 1):
        total = softness if s == last else 0.0
        for j in range(rows.shape[1]):
            total += rows[last, j] * rows[s, j]
        gram[last, s] = gram[s, last] = total


@compiled
def solve_multipliers(gram: Array, bound: Array, count: int, multiplier: Array) -> bool:
    """Solves gram lambda = -bound; False where rows are parallel or multipliers nearly cancel."""
    half = np.empty((count, count))
    for r in range(count):
        multiplier[r] = -bound[r]
        for s in range(r + 1):
            total = gram[r, s]
            for k in range(s):
                total -= half[r, k] * half[s, k]
            if s < r:
                half[r, s] = total / half[s, s]
                multiplier[r] -= half[r, s] * multiplier[s]
            elif total > PIVOT:
                half[r, r] = math.sqrt(total)
                multiplier[r] /= half[r, r]
            else:
                return False
    largest = 0.0
    for r in range(count - 1, -1, -1):
        for k in range(r + 1, count):
            multiplier[r] -= half[k, r] * multiplier[k]
        multiplier[r] /= half[r, r]
        largest = max(largest, abs(multiplier[r]))
    return largest < CANCELLING


@compiled
def write_change(
    rows: Array, multiplier: Array, count: int, coupled: Indices, factor: Array, change: Array
) -> None:
    """Writes d = -L^-T sum lambda g."""
    n = change.size
    for j in range(n):
        change[j] = 0.0
    for k in range(count):
        for j in range(n):
            change[j] -= multiplier[k] * rows[k, j]
    for i in range(n - 1, -1, -1):
        change[i] /= factor[i, i]
        for j in range(coupled[0, i], i):
            change[j] -= factor[i, j] * change[i]


@compiled
def factor_metric(metric: Array, coupled: Indices, factor: Array) -> bool:
    """Factors W = L L^T within each tree of joints; False if W is not positive definite."""
    for i in range(metric.shape[0]):
        for j in range(coupled[0, i], i + 1):
            total = metric[i, j]
            for k in range(coupled[0, i], j):
                total -= factor[i, k] * factor[j, k]
            if i == j:
                if not total > 0.0:
                    return False
                factor[i, i] = math.sqrt(total)
            else:
                factor[i, j] = total / factor[j, j]
    return True
