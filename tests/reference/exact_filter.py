# SPDX-License-Identifier: BSD-3-Clause
"""The exact answer to a filter problem, in decimal numbers of 100 digits, whatever its scales.

Lawson and Hanson's method for least-distance problems ("Solving Least Squares Problems", 1974, chapter 23): with the
metric W = L L^T and y = L^T (tau - desired), every finite bound is a row g . y + sqrt(rho) t <= b, and

    minimise |E u - f|  over u >= 0,   E = -[G, sqrt(rho)]^T over -b^T,   f = (0, ..., 0, 1)

has residual zero if and only if the hard bounds contradict each other; otherwise it gives the multipliers. The result
is checked against the optimality conditions to 1e-30. Shares nothing with the package but the problem's numbers.
"""

from __future__ import annotations

from dataclasses import dataclass
from decimal import Decimal, localcontext

import numpy as np
from scipy.optimize import nnls

from impedance_modules.safety.filter_problem import FilterProblem

DIGITS = 100
NOTHING = Decimal("1e-70")
"""Pivots and residuals below this part of their scale are zero."""

PROVEN = Decimal("1e-30")
"""Optimality conditions hold to this part of the largest demand."""

ROUNDING = 1e-14
"""A metric whose smallest eigenvalue, with unit diagonal, is nearer to zero than this is flat: singular to rounding."""

OPTIMUM, CONTRADICTORY, FLAT = "optimum", "contradictory", "flat"
INDEFINITE, NO_PROBLEM, TOUCHING = "indefinite", "no problem", "touching"
"""What a problem is. Touching: hard bounds contradict each other by less than the rounding of what they are made from,
so that an answer and none are both right."""

Decimals = np.ndarray


@dataclass(frozen=True)
class Exact:
    """The truth about one problem.

    Attributes:
        outcome: One of the words above.
        effort: (n,) the optimal torque, decimal [N.m]; None unless ``outcome`` is OPTIMUM.
        cost: |tau - desired| in the metric, the root of what the change costs.
    """

    outcome: str
    effort: Decimals | None = None
    cost: float = 0.0


def decimals(numbers: np.ndarray) -> Decimals:
    """The same numbers, exactly."""
    return np.array([Decimal(float(x)) for x in numbers.flat], dtype=object).reshape(numbers.shape)


def solve(problem: FilterProblem) -> Exact:
    """The truth about one problem; raises ArithmeticError where 100 digits do not suffice."""
    outcome = kind(problem)
    if outcome != OPTIMUM:
        return Exact(outcome)
    with localcontext() as context:
        context.prec = DIGITS
        exact = _solve(problem, 0.0)
        if exact.outcome == CONTRADICTORY and _solve(problem, ROUNDING).outcome == OPTIMUM:
            return Exact(TOUCHING)
        return exact


def kind(problem: FilterProblem) -> str:
    """What a problem is before its bounds are looked at; OPTIMUM where it is one."""
    numbers = (problem.metric, problem.matrix, problem.desired)
    fine = all(np.isfinite(part).all() for part in numbers) and (problem.effort_max >= 0.0).all()
    fine = (
        fine
        and (problem.lower <= problem.upper).all()
        and (np.minimum(problem.penalty, problem.kappa) > 0.0).all()
    )
    if not (fine and (problem.lower < np.inf).all() and (problem.upper > -np.inf).all()):
        return NO_PROBLEM
    value = problem.matrix @ problem.desired
    inside = (np.abs(problem.desired) <= problem.effort_max).all()
    if inside and (problem.lower <= value).all() and (value <= problem.upper).all():
        # Nothing has to change, whatever a change would cost.
        return OPTIMUM
    diagonal = np.diagonal(problem.metric)
    if (diagonal < 0.0).any() or not diagonal.any():
        return INDEFINITE
    scale = np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
    least = float(np.linalg.eigvalsh(problem.metric / scale / scale[:, None])[0])
    if least < -ROUNDING:
        return INDEFINITE
    with localcontext() as context:
        context.prec = DIGITS
        return OPTIMUM if cholesky(decimals(problem.metric)) is not None else FLAT


def cholesky(matrix: Decimals) -> Decimals | None:
    """L with L L^T = matrix, read below the diagonal; None if that is not definite."""
    size = len(matrix)
    factor = np.full((size, size), Decimal(0), dtype=object)
    for i in range(size):
        for j in range(i + 1):
            rest = matrix[i, j] - (factor[i, :j] @ factor[j, :j] if j else 0)
            if i > j:
                factor[i, j] = rest / factor[j, j]
            elif rest > NOTHING * abs(matrix[i, i]):
                factor[i, i] = rest.sqrt()
            else:
                return None
    return factor


def divide(factor: Decimals, right: Decimals) -> Decimals:
    """L^-1 right, for a vector or for columns."""
    answer = right.copy()
    for i in range(len(factor)):
        answer[i] = (right[i] - (factor[i, :i] @ answer[:i] if i else 0)) / factor[i, i]
    return answer


def divide_back(factor: Decimals, right: Decimals) -> Decimals:
    """L^-T right, for a vector."""
    answer = right.copy()
    for i in range(len(factor) - 1, -1, -1):
        answer[i] = (
            right[i] - (factor[i + 1 :, i] @ answer[i + 1 :] if i + 1 < len(factor) else 0)
        ) / factor[i, i]
    return answer


def _solve(problem: FilterProblem, relaxed: float) -> Exact:
    """The optimum with hard bounds wider by a part of their terms."""
    n = problem.desired.size
    factor = cholesky(decimals(problem.metric))
    if factor is None:
        return Exact(OPTIMUM, decimals(problem.desired), 0.0)
    stacked = decimals(np.vstack([np.eye(n), problem.matrix]))
    value = stacked @ decimals(problem.desired)
    rows = divide(factor, stacked.T).T
    sides, bounds, softness = [], [], []
    limits = (
        np.concatenate([problem.effort_max, problem.upper]),
        np.concatenate([-problem.effort_max, problem.lower]),
    )
    for c in range(len(stacked)):
        square = rows[c] @ rows[c]
        hard = c < n or problem.penalty[c - n] == np.inf
        for sign, bound in zip((1, -1), limits, strict=True):
            if not np.isfinite(bound[c]):
                continue
            room = sign * (Decimal(float(bound[c])) - value[c])
            if hard and relaxed:
                terms = abs(stacked[c]) @ abs(decimals(problem.desired)) + abs(Decimal(float(bound[c])))
                room += Decimal(relaxed) * terms
            if square == 0:
                if hard and room < 0:
                    return Exact(CONTRADICTORY)
                continue
            length = square.sqrt()
            sides.append(sign * rows[c] / length)
            bounds.append(room / length)
            softness.append(Decimal(0) if hard else 1 / (Decimal(float(problem.penalty[c - n])) * square))
    demand = max((-b for b in bounds), default=Decimal(0))
    if demand <= 0:
        return Exact(OPTIMUM, decimals(problem.desired), 0.0)
    limit = np.array([b / demand for b in bounds], dtype=object)
    multipliers = least_distance(np.array(sides), limit, np.array(softness, dtype=object))
    if multipliers is None:
        return Exact(CONTRADICTORY)
    y = -(np.array(sides).T @ multipliers) * demand
    change = divide_back(factor, y)
    return Exact(OPTIMUM, decimals(problem.desired) + change, float((y @ y).sqrt()))


def least_distance(rows: Decimals, bounds: Decimals, softness: Decimals) -> Decimals | None:
    """Multipliers of the point nearest to zero with rows . y <= bounds + softness x multiplier; None without one."""
    gram = rows @ rows.T
    for r, soft in enumerate(softness):
        gram[r, r] += soft
    system = gram + np.multiply.outer(bounds, bounds)
    weights, acting = _begin(rows, bounds, softness, system)
    for _ in range(50 * len(bounds)):
        rest = 1 + bounds @ weights
        if rest <= NOTHING:
            return None
        slope = -bounds - system @ weights
        slope[acting] = 0
        joining = int(np.argmax(slope))
        if slope[joining] <= PROVEN * rest / 10:
            break
        acting = sorted({*acting, joining})
        weights, acting = _toward(system, bounds, acting, weights)
    multipliers = weights / (1 + bounds @ weights)
    slack = gram @ multipliers + bounds
    if min(slack) < -PROVEN or max(abs(slack[multipliers > 0])) > PROVEN:
        raise ArithmeticError("100 digits do not suffice")
    return multipliers


def _begin(
    rows: Decimals, bounds: Decimals, softness: Decimals, system: Decimals
) -> tuple[Decimals, list[int]]:
    """A start near the end, from the same problem in double precision; or zero."""
    weights = np.full(len(bounds), Decimal(0), dtype=object)
    plain = np.asarray(bounds, dtype=float)
    wide = np.vstack(
        [-np.asarray(rows, dtype=float).T, np.diag(-np.sqrt(np.asarray(softness, dtype=float))), -plain]
    )
    target = np.zeros(len(wide))
    target[-1] = 1.0
    try:
        found, _ = nnls(wide, target, maxiter=20 * len(bounds))
    except (RuntimeError, ValueError):
        return weights, []
    acting = [int(r) for r in np.flatnonzero(found > 0.0)]
    while acting:
        factor = cholesky(system[np.ix_(acting, acting)])
        if factor is None:
            return weights, []
        point = divide_back(factor, divide(factor, -bounds[acting]))
        wrong = int(np.argmin(point))
        if point[wrong] > 0:
            weights[acting] = point
            return weights, acting
        del acting[wrong]
    return weights, []


def _toward(
    system: Decimals, bounds: Decimals, acting: list[int], weights: Decimals
) -> tuple[Decimals, list[int]]:
    """The best weights of the acting rows, going there only as far as weights stay positive, row by row."""
    while True:
        factor = cholesky(system[np.ix_(acting, acting)])
        if factor is None:
            raise ArithmeticError("a row that joins depends on those that act")
        point = divide_back(factor, divide(factor, -bounds[acting]))
        if min(point) > 0:
            weights = weights * 0
            weights[acting] = point
            return weights, acting
        before = weights[acting]
        steps = [(b / (b - p), k) for k, (b, p) in enumerate(zip(before, point, strict=True)) if p <= 0]
        step, leaving = min(steps)
        weights = weights.copy()
        weights[acting] = before + step * (point - before)
        weights[acting[leaving]] = Decimal(0)
        acting = [r for k, r in enumerate(acting) if k != leaving]
