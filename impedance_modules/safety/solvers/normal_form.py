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
from impedance_modules.safety.solvers.shifted import INFINITE, Shifted

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
