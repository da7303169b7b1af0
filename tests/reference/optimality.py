# SPDX-License-Identifier: BSD-3-Clause
"""How far an answer to a filter problem is from meeting the optimality conditions, in decimal numbers of 100 digits.

Each condition is measured against the sum of the sizes of its own terms, so units of torque, rows and metric do not
matter, and neither does how the answer was found.
"""

from __future__ import annotations

from decimal import Decimal, localcontext

import numpy as np

from impedance_modules.safety.filter_problem import FilterProblem
from tests.reference.exact_filter import DIGITS, decimals


def residual(problem: FilterProblem, effort: np.ndarray, duals: np.ndarray) -> float:
    """The largest part by which a condition is missed; infinity where a number is not finite.

    Args:
        problem: Any problem of finite numbers; infinite bounds are absent.
        effort: (n,) torque [N.m].
        duals: (n + m,) multipliers, torque limits first, positive at upper bounds.
    """
    if not (np.isfinite(effort).all() and np.isfinite(duals).all()):
        return np.inf
    with localcontext() as context:
        context.prec = DIGITS
        return float(max(_stationarity(problem, effort, duals), *_bounds(problem, effort, duals)))


def _stationarity(problem: FilterProblem, effort: np.ndarray, duals: np.ndarray) -> Decimal:
    """W (tau - desired) + A^T lambda + mu = 0."""
    n = effort.size
    change, force = decimals(effort) - decimals(problem.desired), decimals(duals)
    metric, matrix = decimals(problem.metric), decimals(problem.matrix)
    rest = abs(metric @ change + matrix.T @ force[n:] + force[:n])
    # A torque of this many digits cannot be nearer: its own rounding moves the terms by this much.
    size = abs(metric) @ (abs(decimals(effort)) + abs(decimals(problem.desired)))
    size = size + abs(matrix).T @ abs(force[n:]) + abs(force[:n])
    # A joint that costs nothing, in numbers known to rounding, may cost a little.
    diagonal = np.diagonal(problem.metric)
    least = (
        Decimal(float(diagonal[diagonal > 0.0].min(initial=np.inf))) if (diagonal > 0.0).any() else Decimal(0)
    )
    size = size + np.where(diagonal > 0.0, 0, 1) * least * abs(change)
    return max((r / s if s else r) for r, s in zip(rest, size, strict=True))


def _bounds(problem: FilterProblem, effort: np.ndarray, duals: np.ndarray) -> list[Decimal]:
    """Each bound holds, by its slack if it is soft, and acts only where it is met."""
    n = effort.size
    torque, force = decimals(effort), decimals(duals)
    parts = []
    rows = decimals(np.vstack([np.eye(n), problem.matrix]))
    high = np.concatenate([problem.effort_max, problem.upper])
    low = np.concatenate([-problem.effort_max, problem.lower])
    penalty = np.concatenate([np.full(n, np.inf), problem.penalty])
    for c in range(len(rows)):
        if not rows[c].any():
            continue
        slack = force[c] / Decimal(float(penalty[c])) if np.isfinite(penalty[c]) else Decimal(0)
        value, size = rows[c] @ torque - slack, abs(rows[c]) @ abs(torque) + abs(slack)
        for bound, side in ((high[c], 1), (low[c], -1)):
            acts = force[c] * side > 0
            if not np.isfinite(bound):
                parts.append(Decimal("inf") if acts else Decimal(0))
                continue
            beyond = side * (value - Decimal(float(bound)))
            size = size + abs(Decimal(float(bound)))
            off = abs(beyond) if acts else max(beyond, Decimal(0))
            parts.append(off / size if size else off)
    return parts
