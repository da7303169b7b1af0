# SPDX-License-Identifier: BSD-3-Clause
"""General solvers of quadratic programs behind the filter's protocol, their answers polished to the exact optimum."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any

import numpy as np

from impedance_modules.records import Vector
from impedance_modules.safety.filter_problem import FilterProblem
from impedance_modules.safety.solvers import FilterSolution, failed
from impedance_modules.safety.solvers.normal_form import (
    INFINITE,
    NormalForm,
    Shifted,
    normal_form,
    slack_rows,
)
from impedance_modules.safety.solvers.polish import finish

_TOLERANCE = 1e-9
_ITERATIONS = 50
_INNER_ITERATIONS = 50
_INFINITE = 1e20


class GeneralSolver(ABC):
    """A solver of quadratic programs behind the filter's interface; a problem of another shape starts it anew."""

    def __init__(self) -> None:
        self._shifted = Shifted(0, 0)

    def solve(self, problem: FilterProblem) -> FilterSolution:
        """Solves one problem (see `Solver.solve`)."""
        if not self._shifted.fits(problem):
            m, n = problem.matrix.shape
            self._shifted = Shifted(n, m)
            self._forget()
        outcome = self._shifted.fill(problem)
        if outcome is not None:
            return outcome
        try:
            form = normal_form(problem, self._shifted)
        except np.linalg.LinAlgError:
            return failed("the metric is not positive definite", 0)
        return self._optimum(problem, form)

    @abstractmethod
    def _forget(self) -> None:
        """Drops whatever was kept for problems of the last shape."""

    @abstractmethod
    def _optimum(self, problem: FilterProblem, form: NormalForm) -> FilterSolution:
        """Solves the normal form."""


class ProxsuiteSolver(GeneralSolver):
    """ProxQP of proxsuite, a proximal augmented Lagrangian method; a problem of another shape makes a new one.

    What its use must respect, all measured: a warm start before any solve crashes the process, and later
    ones call feasible problems infeasible, so every solve starts cold (which also makes the answer a
    function of the problem alone); its two iteration limits are loops within loops, both need a bound;
    bounds in units of the largest demand, or it stalls on demands far outside the limits.

    Args:
        proxqp: The module ``proxsuite.proxqp``, handed in so that only `make_solver` imports it.
    """

    name = "proxsuite"

    def __init__(self, proxqp: Any) -> None:
        super().__init__()
        self._proxqp = proxqp
        self._program: Any = None

    def _forget(self) -> None:
        self._program = None

    def _optimum(self, problem: FilterProblem, form: NormalForm) -> FilterSolution:
        self._load(form)
        self._program.solve()
        results = self._program.results
        status = results.info.status
        return finish(
            problem,
            self._shifted,
            form,
            np.array(results.z),
            iterations=int(results.info.iter),
            solved=status == self._proxqp.QPSolverOutput.PROXQP_SOLVED,
            status=status.name.removeprefix("PROXQP_").lower().replace("_", " "),
        )

    def _load(self, form: NormalForm) -> None:
        matrix = slack_rows(form)
        lower, upper = np.maximum(form.lower, -_INFINITE), np.minimum(form.upper, _INFINITE)
        if self._program is not None:
            self._program.update(C=matrix, l=lower, u=upper)
            return
        count, variables = matrix.shape
        dense = self._proxqp.dense
        self._program = dense.QP(variables, 0, count, False, dense.HessianType.Diagonal)
        settings = self._program.settings
        settings.eps_abs, settings.eps_rel = _TOLERANCE, 0.0
        settings.max_iter, settings.max_iter_in = _ITERATIONS, _INNER_ITERATIONS
        settings.initial_guess = self._proxqp.InitialGuess.NO_INITIAL_GUESS
        hessian, gradient = np.eye(variables), np.zeros(variables)
        self._program.init(H=hessian, g=gradient, C=matrix, l=lower, u=upper, compute_preconditioner=False)


class QpsolversSolver(GeneralSolver):
    """Any dense solver that qpsolvers finds installed; slower than a native one, for comparison.

    Args:
        solver: Name as qpsolvers knows it.
        qpsolvers: The module, handed in so that only `make_solver` imports it.
    """

    def __init__(self, solver: str, qpsolvers: Any) -> None:
        super().__init__()
        self.name = f"qpsolvers:{solver}"
        self._solver = solver
        self._qpsolvers = qpsolvers

    def _forget(self) -> None:
        """Nothing is kept from problem to problem."""

    def _optimum(self, problem: FilterProblem, form: NormalForm) -> FilterSolution:
        multipliers, found = self._multipliers(form)
        status = f"{self._solver} {'solved' if found else 'found no solution'}"
        if multipliers is None:
            return failed(status, 1)
        return finish(problem, self._shifted, form, multipliers, iterations=1, solved=found, status=status)

    def _multipliers(self, form: NormalForm) -> tuple[Vector | None, bool]:
        matrix = slack_rows(form)
        above, below = form.upper < INFINITE, form.lower > -INFINITE
        variables = matrix.shape[1]
        quadratic = self._qpsolvers.Problem(
            P=np.eye(variables),
            q=np.zeros(variables),
            G=np.vstack([matrix[above], -matrix[below]]),
            h=np.concatenate([form.upper[above], -form.lower[below]]),
        )
        answer = self._qpsolvers.solve_problem(quadratic, solver=self._solver)
        if answer.z is None:
            return None, False
        multipliers = np.zeros(form.upper.size)
        count = int(above.sum())
        multipliers[above] += answer.z[:count]
        multipliers[below] -= answer.z[count:]
        return multipliers, bool(answer.found)
