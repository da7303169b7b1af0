# SPDX-License-Identifier: BSD-3-Clause
"""An independent, slow and exact solver of filter problems, in extended precision.

The dual of the filter problem, one non-negative multiplier per finite bound, is solved by Lawson and
Hanson's method for least-distance problems (scipy's nnls) to find which bounds act; then the
optimality system of those bounds is solved by Gaussian elimination in long double and every
optimality condition is checked there. A checked answer is the optimum: the problem is strictly
convex. Shares nothing with the solvers under test.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import nnls

from impedance_modules.safety.filter_problem import FilterProblem

LONG = np.longdouble


def gauss(matrix: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Solves by elimination with partial pivoting; columns of a dependent row get zero."""
    a, b = matrix.astype(LONG), right.astype(LONG)
    size = len(a)
    for k in range(size):
        p = k + int(np.argmax(abs(a[k:, k])))
        if abs(a[p, k]) < LONG(1e-17) * abs(matrix).max():
            raise ZeroDivisionError
        a[[k, p]], b[[k, p]] = a[[p, k]], b[[p, k]]
        factor = a[k + 1 :, k] / a[k, k]
        a[k + 1 :] -= factor[:, None] * a[k]
        b[k + 1 :] -= np.multiply.outer(factor, b[k])
    x = np.zeros_like(b)
    for k in range(size - 1, -1, -1):
        x[k] = (b[k] - a[k, k + 1 :] @ x[k + 1 :]) / a[k, k]
    return x


def one_sided(problem: FilterProblem) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """(rows, bounds, softness, index) of c . d <= bound + rho lambda, normalised in the metric."""
    n = len(problem.desired)
    stacked = np.vstack([np.eye(n), problem.matrix]).astype(LONG)
    high = np.concatenate([problem.effort_max, problem.upper]).astype(LONG) - stacked @ problem.desired
    low = np.concatenate([-problem.effort_max, problem.lower]).astype(LONG) - stacked @ problem.desired
    soft = np.concatenate([np.zeros(n), 1.0 / problem.penalty]).astype(LONG)
    inverse = gauss(problem.metric, np.eye(n))
    length = np.sqrt(np.maximum(np.einsum("ri,ij,rj->r", stacked, inverse, stacked), 0))
    present = length > 1e-12
    up, down = present & np.isfinite(high), present & np.isfinite(low)
    scale = np.concatenate([length[up], length[down]])
    rows = np.vstack([stacked[up], -stacked[down]]) / scale[:, None]
    bounds = np.concatenate([high[up], -low[down]]) / scale
    softness = np.concatenate([soft[up], soft[down]]) / scale**2
    return rows, bounds, softness, inverse


def solve(problem: FilterProblem) -> np.ndarray:
    """The optimal torque [N.m]; raises ArithmeticError where it cannot prove optimality."""
    rows, bounds, softness, inverse = one_sided(problem)
    size = max(LONG(1), abs(np.minimum(bounds, 0)).max())
    bounds = bounds / size
    acting = first_guess(rows, bounds, softness, inverse)
    gram = rows @ inverse @ rows.T + np.diag(softness)
    for _ in range(400):
        multipliers = np.zeros(len(bounds), dtype=LONG)
        multipliers[acting] = equalities(gram, bounds, acting)
        if (multipliers < -1e-15).any():
            acting = acting[acting != np.argmin(multipliers)]
            continue
        broken = -(gram @ multipliers) - bounds
        broken[acting] = 0
        if broken.max() <= 1e-13:
            change = -(inverse @ (rows.T @ multipliers)) * size
            return np.asarray(problem.desired.astype(LONG) + change, dtype=float)
        acting = np.append(acting, np.argmax(broken))
    raise ArithmeticError("no proof of optimality")


def equalities(gram: np.ndarray, bounds: np.ndarray, acting: np.ndarray) -> np.ndarray:
    """Multipliers of the acting bounds; a bound that repeats the others gets none."""
    kept: list[int] = []
    answer = np.zeros(len(acting), dtype=LONG)
    for place, bound in enumerate(acting):
        chosen = [int(acting[k]) for k in kept]
        if kept:
            rest = gauss(gram[np.ix_(chosen, chosen)], gram[chosen, bound])
            left = gram[bound, bound] - gram[bound, chosen] @ rest
        else:
            left = gram[bound, bound]
        if left > 1e-15:
            kept.append(place)
    if kept:
        chosen = [int(acting[k]) for k in kept]
        answer[kept] = gauss(gram[np.ix_(chosen, chosen)], -bounds[chosen])
    return answer


def first_guess(
    rows: np.ndarray, bounds: np.ndarray, softness: np.ndarray, inverse: np.ndarray
) -> np.ndarray:
    """Which bounds act, from Lawson and Hanson's least-distance form."""
    factor = np.linalg.cholesky(np.asarray(inverse, dtype=float))
    wide = np.hstack([np.asarray(rows, float) @ factor, np.diag(np.sqrt(np.asarray(softness, float)))])
    system = np.vstack([-wide.T, -np.asarray(bounds, float)[None]])
    target = np.zeros(len(system))
    target[-1] = 1.0
    weights, _ = nnls(system, target, maxiter=50 * len(bounds))
    return np.flatnonzero(weights > 1e-14)
