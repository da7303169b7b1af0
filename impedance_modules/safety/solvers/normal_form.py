# SPDX-License-Identifier: BSD-3-Clause
"""The problem in the metric's own coordinates, where every number has the size of its meaning.

With W = L L^T, y = L^T d and rows scaled to unit length, g_r = (L^-1 a_r) / c_r, c_r = |L^-1 a_r|:

    minimise 1/2 |y|^2 + sum_soft 1/2 s_r^2 / rho_r   subject to   lower_r - s_r <= g_r . y <= upper_r + s_r

All bounds, and with them y, are in units of the largest demand, the farthest that zero change lies outside
a row. rho_r = 1 / (penalty_r c_r^2) is the share of a demand that a soft row lets through. Iterative solvers
see the softness as explicit variables, polishing works on it directly.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular

from impedance_modules.safety.problem import FilterProblem, Matrix, Vector
from impedance_modules.safety.solvers.compiled import INSIDE, UNUSABLE, land, shift
from impedance_modules.safety.solvers.solution import FilterSolution, failed

_ABSENT = 1e-12


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


INFINITE = 1e30
"""Bounds of this size or more are absent; what solvers read in place of infinity."""

HARD_TOLERANCE = 1e-7
"""Most that a solver may break a hard bound [N.m] before its answer counts as a failure."""

_UNUSABLE = "not a problem: a number is not finite, a bound pair is reversed or a penalty is not positive"


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
        found = shift(
            problem.desired,
            problem.effort_max,
            problem.matrix,
            problem.lower,
            problem.upper,
            problem.penalty,
            problem.metric,
            INFINITE,
            self.lower,
            self.upper,
        )
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
        n, power = self.n, problem.layout.power
        effort = np.empty(n)
        broken = land(
            problem.desired,
            problem.effort_max,
            problem.matrix[power],
            self.upper[n + power],
            change,
            effort,
        )
        # Written so that a comparison with NaN counts as a failure.
        if not broken <= HARD_TOLERANCE:
            return failed(f"{status}, but the answer breaks a hard limit", iterations)
        rows = duals[n:]
        return FilterSolution(effort, rows, duals[:n], rows != 0.0, iterations, True, status)


def slack_rows(form: NormalForm) -> Matrix:
    """Constraint matrix over (y, t).

    Returns:
        (N, n + soft), the soft constraints' columns in their order.
    """
    count, n = form.rows.shape
    soft = np.flatnonzero(form.softness > 0.0)
    matrix = np.zeros((count, n + soft.size))
    matrix[:, :n] = form.rows
    matrix[soft, n + np.arange(soft.size)] = np.sqrt(form.softness[soft])
    return matrix
