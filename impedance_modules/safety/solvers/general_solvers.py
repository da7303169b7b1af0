# SPDX-License-Identifier: BSD-3-Clause
r"""General solvers of quadratic programs behind the filter's protocol.

They get the problem in the metric's own coordinates y = L^T d', in which the cost is |y|^2, with one explicit variable
per soft row, s_r = sqrt(rho_r) t_r:

    minimise 1/2 |(y, t)|^2   subject to   lower <= g_r . y + sqrt(rho_r) t_r <= upper,   g_r = L^-1 a'_r

Its multipliers are those of ``exact_form``. Bounds, and with them y, are in units of the largest demand.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from scipy.linalg import solve_triangular

from impedance_modules.records import Matrix, Vector
from impedance_modules.safety.solvers.exact_form import ExactForm
from impedance_modules.safety.solvers.proving import INFINITE, Guess, ProvingSolver, largest_demand

_TOLERANCE = 1e-9
_ITERATIONS = 50
_INNER_ITERATIONS = 50
_INFINITE = 1e20


class LeastNorm(NamedTuple):
    """A problem as above: matrix (n + m, n + soft), lower and upper (n + m,), INFINITE where absent."""

    matrix: Matrix
    lower: Vector
    upper: Vector


def least_norm(form: ExactForm) -> LeastNorm:
    """Writes a problem in the metric's coordinates."""
    count, n = form.rows.shape
    soft = np.flatnonzero(form.give[0])
    matrix = np.zeros((count, n + soft.size))
    matrix[:, :n] = solve_triangular(form.factor[0], form.rows.T, lower=True, check_finite=False).T
    matrix[soft, n + np.arange(soft.size)] = form.give[0, soft]
    size = largest_demand(form)
    lower, upper = np.maximum(form.low[0] / size, -INFINITE), np.minimum(form.high[0] / size, INFINITE)
    return LeastNorm(matrix, lower, upper)


class ProxsuiteSolver(ProvingSolver):
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
        self._variables = 0

    def _forget(self) -> None:
        self._program = None

    def _guess(self, form: ExactForm) -> Guess:
        self._load(least_norm(form))
        self._program.solve()
        results = self._program.results
        status = results.info.status.name.removeprefix("PROXQP_").lower().replace("_", " ")
        return Guess(np.array(results.z), int(results.info.iter), status)

    def _load(self, problem: LeastNorm) -> None:
        lower, upper = np.maximum(problem.lower, -_INFINITE), np.minimum(problem.upper, _INFINITE)
        count, variables = problem.matrix.shape
        if self._program is not None and variables == self._variables:
            self._program.update(C=problem.matrix, l=lower, u=upper)
            return
        self._variables = variables
        dense = self._proxqp.dense
        self._program = dense.QP(variables, 0, count, False, dense.HessianType.Diagonal)
        settings = self._program.settings
        settings.eps_abs, settings.eps_rel = _TOLERANCE, 0.0
        settings.max_iter, settings.max_iter_in = _ITERATIONS, _INNER_ITERATIONS
        settings.initial_guess = self._proxqp.InitialGuess.NO_INITIAL_GUESS
        hessian, gradient = np.eye(variables), np.zeros(variables)
        self._program.init(
            H=hessian, g=gradient, C=problem.matrix, l=lower, u=upper, compute_preconditioner=False
        )


class QpsolversSolver(ProvingSolver):
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

    def _guess(self, form: ExactForm) -> Guess:
        problem = least_norm(form)
        above, below = problem.upper < INFINITE, problem.lower > -INFINITE
        variables = problem.matrix.shape[1]
        quadratic = self._qpsolvers.Problem(
            P=np.eye(variables),
            q=np.zeros(variables),
            G=np.vstack([problem.matrix[above], -problem.matrix[below]]),
            h=np.concatenate([problem.upper[above], -problem.lower[below]]),
        )
        answer = self._qpsolvers.solve_problem(quadratic, solver=self._solver)
        status = f"{self._solver} {'solved' if answer.found else 'found no solution'}"
        if answer.z is None or answer.z.size == 0:
            return Guess(None, 1, status)
        multipliers = np.zeros(problem.upper.size)
        count = int(above.sum())
        multipliers[above] += answer.z[:count]
        multipliers[below] -= answer.z[count:]
        return Guess(multipliers, 1, status)
