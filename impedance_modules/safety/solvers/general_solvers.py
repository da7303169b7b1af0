# SPDX-License-Identifier: BSD-3-Clause
"""ProxQP of proxsuite: a proximal augmented Lagrangian method, polished to the exact optimum.

What its use must respect, all measured: a warm start before any solve crashes the process, and later
ones call feasible problems infeasible, so every solve starts cold (which also makes the answer a
function of the problem alone); its two iteration limits are loops within loops, both need a bound;
bounds in units of the largest demand, or it stalls on demands far outside the limits.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from impedance_modules.safety.problem import FilterProblem
from impedance_modules.safety.solvers.finish import finish
from impedance_modules.safety.solvers.general_solver import GeneralSolver
from impedance_modules.safety.solvers.normal_form import NormalForm
from impedance_modules.safety.solvers.slack_form import slack_rows
from impedance_modules.safety.solvers.solution import FilterSolution

_TOLERANCE = 1e-9
_ITERATIONS = 50
_INNER_ITERATIONS = 50
_INFINITE = 1e20


class ProxsuiteSolver(GeneralSolver):
    """Keeps one ProxQP object; a problem of another shape makes a new one.

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
