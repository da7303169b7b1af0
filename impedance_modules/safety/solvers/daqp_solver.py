# SPDX-License-Identifier: BSD-3-Clause
"""DAQP: an exact dual active-set method, the default.

Its soft constraints with individual weights are the filter's: rho = 1 / penalty in the units of the
row as given, set anew every cycle because penalties follow the inertia. Rows are given in unit length:
DAQP takes a row shorter than about 3e-6 for zero, and a zero row with a bound for a contradiction. All
rows are passed every cycle: leaving out far ones would save 2 us and cost more to decide. Where rows of
high rank contradict each other its multipliers grow so large that the torque is their small difference;
only then the answer is polished.

Every solve starts cold. That costs an iteration per active row, makes the answer a function of the
problem alone (a replay is bit-equal wherever it starts), and overwrites the marks by which DAQP
remembers a row as absent (a row that was zero) or as an equality.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from impedance_modules.compiled import compiled
from impedance_modules.records import Matrix, Record, Vector
from impedance_modules.safety.filter_problem import FilterProblem
from impedance_modules.safety.solvers import FilterSolution, failed
from impedance_modules.safety.solvers.normal_form import INFINITE, Shifted, normal_form
from impedance_modules.safety.solvers.polish import finish

_SETTINGS = {
    "primal_tol": 1e-11,  # of rows normalised by the metric: 1e-10 N.m or better
    "dual_tol": 1e-12,
    "eps_prox": 0.0,  # the metric is positive definite; never regularise
    "iter_limit": 1000,
    "eq_reduction": -1,
}
_SOFT = 8
_STIFF = 1e6
"""Multipliers beyond this nearly cancel in the torque, which loses about 2e-15 of them: polish."""

_MEANING = {
    1: "optimal",
    2: "optimal, a soft row gave way",
    -1: "the hard limits contradict each other",
    -2: "cycling",
    -3: "unbounded",
    -4: "iteration limit",
    -5: "the metric is not positive definite",
    -6: "too many rows active at the start",
}


class UnitRows(Record):
    """A problem's rows in unit length, as DAQP is given them.

    Attributes:
        matrix: (m, n).
        lower, upper: (n + m,) bounds of the change; torque limits first, -INFINITE and INFINITE where absent.
        softness: (n + m,) 1 / penalty of the scaled row; 0 for hard ones.
        inverse_length: (m,) 1 / |a_r|, 0 for a zero row.
    """

    matrix: Matrix
    lower: Vector
    upper: Vector
    softness: Vector
    inverse_length: Vector


@compiled
def scale_rows(problem: FilterProblem, unit: UnitRows) -> None:
    """Scales rows to unit length, with their bounds and softness; a zero row becomes absent.

    Args:
        problem: ``matrix`` and ``penalty`` are read.
        unit: ``lower`` and ``upper`` hold the shifted bounds; those of the rows are scaled in place.
    """
    m, n = problem.matrix.shape
    lower, upper = unit.lower, unit.upper
    for r in range(m):
        square = 0.0
        for j in range(n):
            square += problem.matrix[r, j] * problem.matrix[r, j]
        inverse = 1.0 / math.sqrt(square) if square > 0.0 else 0.0
        unit.inverse_length[r] = inverse
        unit.softness[n + r] = inverse * inverse / problem.penalty[r]
        for j in range(n):
            unit.matrix[r, j] = problem.matrix[r, j] * inverse
        low, high = lower[n + r], upper[n + r]
        present = square > 0.0
        lower[n + r] = max(low * inverse, -INFINITE) if present and low > -INFINITE else -INFINITE
        upper[n + r] = min(high * inverse, INFINITE) if present and high < INFINITE else INFINITE


class DaqpSolver:
    """Keeps one DAQP model and its memory; a problem of another shape sets it up anew.

    Args:
        model_type: ``daqp.Model``, handed in so that only `make_solver` imports the solver.
    """

    name = "daqp"

    def __init__(self, model_type: Any) -> None:
        self._model_type = model_type
        self._shifted = Shifted(0, 0)
        self._model: Any = None

    def solve(self, problem: FilterProblem) -> FilterSolution:
        """Solves one problem exactly (see `Solver.solve`)."""
        if not self._shifted.fits(problem):
            self._allocate(problem)
        outcome = self._shifted.fill(problem)
        return self._optimum(problem) if outcome is None else outcome

    def _allocate(self, problem: FilterProblem) -> None:
        m, n = problem.matrix.shape
        self._shifted = Shifted(n, m)
        self._model = None
        self._zero = np.zeros(n)
        self._metric = np.zeros((n, n))
        self._unit = UnitRows(
            matrix=np.zeros((m, n)),
            lower=np.zeros(n + m),
            upper=np.zeros(n + m),
            softness=np.zeros(n + m),
            inverse_length=np.zeros(m),
        )
        self._sense = np.zeros(n + m, dtype=np.intc)
        self._sense[n:][problem.penalty != np.inf] = _SOFT

    def _optimum(self, problem: FilterProblem) -> FilterSolution:
        shifted = self._shifted
        flag = self._load(problem)
        if flag < 0:
            self._model = None
            return failed(_MEANING.get(flag, f"exit flag {flag}"), 0)
        self._model.soft_weights(rho_l=self._unit.softness, rho_u=self._unit.softness)
        change, _, flag, info = self._model.solve()
        iterations = int(info["iterations"])
        status = _MEANING.get(flag, f"exit flag {flag}")
        if flag not in (1, 2):
            return failed(status, iterations)
        duals = np.array(info["lam"])
        stiff = np.dot(duals, duals) > _STIFF * _STIFF
        duals[shifted.n :] *= self._unit.inverse_length
        if stiff:
            form = normal_form(problem, shifted)
            guess = form.multipliers(duals)
            return finish(problem, shifted, form, guess, iterations=iterations, solved=True, status=status)
        return shifted.finish(problem, change, duals, iterations, status)

    def _load(self, problem: FilterProblem) -> int:
        unit = self._unit
        # DAQP keeps pointers to what it is given, so it gets arrays of its own.
        np.copyto(self._metric, problem.metric)
        np.copyto(unit.lower, self._shifted.lower)
        np.copyto(unit.upper, self._shifted.upper)
        scale_rows(problem, unit)
        data = (self._metric, self._zero, unit.matrix, unit.upper, unit.lower, self._sense)
        if self._model is not None:
            return int(self._model.update(*data))
        self._model = self._model_type()
        self._model.settings = _SETTINGS
        flag, _ = self._model.setup(*data)
        return int(flag)
