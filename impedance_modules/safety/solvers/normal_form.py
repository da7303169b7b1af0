# SPDX-License-Identifier: BSD-3-Clause
"""A filter problem as solvers like to see it: from the desired torque, then in the metric's own coordinates.

Seen from the desired torque the unknown is the change, and zero change costs nothing:

    minimise 1/2 d^T W d + ...   subject to   lower <= [d; A d] <= upper,   d = tau - desired

Every solver begins with this ``Shifted`` form: if zero lies within all bounds it is the optimum, and the desired
torque leaves the filter unchanged to the last bit.

In the metric's coordinates every number has the size of its meaning. With W = L L^T, y = L^T d and rows scaled to unit
length, g_r = (L^-1 a_r) / c_r, c_r = |L^-1 a_r|, the ``NormalForm`` is

    minimise 1/2 |y|^2 + sum_soft 1/2 s_r^2 / rho_r   subject to   lower_r - s_r <= g_r . y <= upper_r + s_r

All bounds, and with them y, are in units of the largest demand, the farthest that zero change lies outside
a row. rho_r = 1 / (penalty_r c_r^2) is the share of a demand that a soft row lets through. Iterative solvers
see the softness as explicit variables (``slack_rows``), polishing works on it directly.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular

from impedance_modules.compiled import compiled
from impedance_modules.records import Matrix, Vector
from impedance_modules.safety.filter_problem import HARD_TOLERANCE, POWER_ROW, FilterProblem, clip
from impedance_modules.safety.solvers import FilterSolution, failed

INFINITE = 1e30
"""Bounds of this size or more are absent; what solvers read in place of infinity."""

UNUSABLE, INSIDE, OUTSIDE = -1, 0, 1
"""What ``shift`` found: not a problem at all; zero change is allowed everywhere; it is not."""

_UNUSABLE = "not a problem: a number is not finite, a bound pair is reversed or a penalty is not positive"
_ABSENT = 1e-12


@compiled
def shift(problem: FilterProblem, lower: Vector, upper: Vector) -> int:
    """Writes the bounds of the change d = tau - desired: torque limits first, then rows.

    Args:
        problem: Looked through for what is no number.
        lower: (n + m,) overwritten, -INFINITE where absent.
        upper: (n + m,) overwritten, INFINITE where absent.

    Returns:
        UNUSABLE, INSIDE or OUTSIDE.
    """
    m, n = problem.matrix.shape
    total = 0.0
    inside = True
    for i in range(n):
        total += problem.desired[i]
        if not problem.effort_max[i] >= 0.0:
            return UNUSABLE
        lower[i] = max(-problem.effort_max[i] - problem.desired[i], -INFINITE)
        upper[i] = min(problem.effort_max[i] - problem.desired[i], INFINITE)
        inside = inside and lower[i] <= 0.0 <= upper[i]
        for j in range(n):
            total += problem.metric[i, j]
    for r in range(m):
        value = 0.0
        for j in range(n):
            value += problem.matrix[r, j] * problem.desired[j]
        total += value
        low, high = problem.lower[r] - value, problem.upper[r] - value
        if not (low <= high and problem.penalty[r] > 0.0):
            return UNUSABLE
        lower[n + r], upper[n + r] = max(low, -INFINITE), min(high, INFINITE)
        inside = inside and low <= 0.0 <= high
    if not math.isfinite(total):
        return UNUSABLE
    return INSIDE if inside else OUTSIDE


class Shifted:
    """Buffers for the bounds of one problem shape, refilled every cycle.

    Attributes:
        lower: (n + m,) bounds of the change: torque limits first, then rows; never infinite.
        upper: Likewise.
    """

    def __init__(self, n: int, m: int) -> None:
        self.n, self.m = n, m
        self.lower = np.zeros(n + m)
        self.upper = np.zeros(n + m)

    def fits(self, problem: FilterProblem) -> bool:
        """Whether these buffers have the problem's shape."""
        return problem.matrix.shape == (self.m, self.n)

    def fill(self, problem: FilterProblem) -> FilterSolution | None:
        """Writes the bounds; returns the outcome at once where no solver is needed.

        Returns:
            The unchanged torque if it respects everything, a failure if this is no problem, else None.
        """
        found = shift(problem, self.lower, self.upper)
        if found == UNUSABLE:
            return failed(_UNUSABLE, 0)
        return self._unchanged(problem) if found == INSIDE else None

    def _unchanged(self, problem: FilterProblem) -> FilterSolution:
        return FilterSolution(
            effort=problem.desired.copy(),
            row_duals=np.zeros(self.m),
            box_duals=np.zeros(self.n),
            active=np.zeros(self.m, dtype=np.bool_),
            iterations=0,
            solved=True,
            status="inside all limits",
        )

    def finish(
        self, problem: FilterProblem, change: Vector, duals: Vector, iterations: int, status: str
    ) -> FilterSolution:
        """The outcome of a change of torque, after a check against the hard set.

        Args:
            problem: The problem last filled.
            change: (n,) d [N.m].
            duals: (n + m,) multipliers, torque limits first; kept, so hand in a copy.
            iterations: Of the solver.
            status: In words.

        Returns:
            The solution; a failure if it is not finite or breaks the hard bounds by HARD_TOLERANCE.
        """
        n = self.n
        effort = np.empty(n)
        broken = clip(problem, change, self.upper[n + POWER_ROW], effort)
        # Written so that a comparison with NaN counts as a failure.
        if not broken <= HARD_TOLERANCE:
            return failed(f"{status}, but the answer breaks a hard limit", iterations)
        rows = duals[n:]
        return FilterSolution(effort, rows, duals[:n], rows != 0.0, iterations, True, status)


@dataclass(frozen=True)
class NormalForm:
    """One problem in metric coordinates, N = n + m constraints, torque limits first.

    Attributes:
        factor: (n, n) L.
        rows: (N, n) g, unit length; zero where a row is absent.
        lower: (N,) -INFINITE where absent.
        upper: (N,) INFINITE where absent.
        softness: (N,) rho; 0 for hard constraints.
        scale: (N,) c; 1 where a row is absent.
        size: Unit of y, multipliers and bounds: the largest demand any row makes.
    """

    factor: Matrix
    rows: Matrix
    lower: Vector
    upper: Vector
    softness: Vector
    scale: Vector
    size: float

    def change(self, y: Vector) -> Vector:
        """Change of torque of a point, d = L^-T y [N.m]."""
        change: Vector = solve_triangular(self.factor, y, lower=True, trans=1, check_finite=False)
        return change * self.size

    def duals(self, multipliers: Vector) -> Vector:
        """Multipliers of the original rows, size lambda / c."""
        duals: Vector = multipliers * (self.size / self.scale)
        return duals

    def multipliers(self, duals: Vector) -> Vector:
        """Inverse of `duals`."""
        multipliers: Vector = duals * (self.scale / self.size)
        return multipliers


def normal_form(problem: FilterProblem, shifted: Shifted) -> NormalForm:
    """Carries a problem, with its bounds already shifted, into metric coordinates.

    Raises:
        numpy.linalg.LinAlgError: If the metric is not positive definite.
    """
    n = shifted.n
    factor: Matrix = np.linalg.cholesky(problem.metric).astype(np.float64, copy=False)
    stacked = np.vstack([np.eye(n), problem.matrix])
    rows = solve_triangular(factor, stacked.T, lower=True, check_finite=False).T
    length = np.linalg.norm(rows, axis=1)
    present = length > _ABSENT
    scale = np.where(present, length, 1.0)
    hardness = np.concatenate([np.full(n, np.inf), problem.penalty]) * scale * scale
    lower = _scaled(shifted.lower, scale, present, -INFINITE)
    upper = _scaled(shifted.upper, scale, present, INFINITE)
    demand = float(np.maximum(lower, -upper).max())
    size = demand if demand > 0.0 else 1.0
    return NormalForm(
        factor=factor,
        rows=np.where(present[:, None], rows / scale[:, None], 0.0),
        lower=np.where(lower > -INFINITE, lower / size, -INFINITE),
        upper=np.where(upper < INFINITE, upper / size, INFINITE),
        softness=1.0 / hardness,
        scale=scale,
        size=size,
    )


def _scaled(bound: Vector, scale: Vector, present: NDArray[np.bool_], absent: float) -> Vector:
    finite = present & (np.abs(bound) < INFINITE)
    return np.where(finite, bound / scale, absent)


def slack_rows(form: NormalForm) -> Matrix:
    """The normal form with one explicit variable per soft row, for solvers without soft constraints.

    z = (y, t) with s_r = sqrt(rho_r) t_r: minimise 1/2 |z|^2 subject to
    lower <= g_r . y + sqrt(rho_r) t_r <= upper. Its multipliers are those of the normal form.

    Returns:
        (N, n + soft), the soft constraints' columns in their order.
    """
    count, n = form.rows.shape
    soft = np.flatnonzero(form.softness > 0.0)
    matrix = np.zeros((count, n + soft.size))
    matrix[:, :n] = form.rows
    matrix[soft, n + np.arange(soft.size)] = np.sqrt(form.softness[soft])
    return matrix
