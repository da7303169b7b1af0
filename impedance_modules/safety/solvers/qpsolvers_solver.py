# SPDX-License-Identifier: BSD-3-Clause
"""Any dense solver that qpsolvers finds installed, polished to the exact optimum."""

from __future__ import annotations

from typing import Any

import numpy as np

from impedance_modules.safety.problem import FilterProblem, Vector
from impedance_modules.safety.solvers.finish import finish
from impedance_modules.safety.solvers.general_solver import GeneralSolver
from impedance_modules.safety.solvers.normal_form import NormalForm
from impedance_modules.safety.solvers.shifted import INFINITE
from impedance_modules.safety.solvers.slack_form import slack_rows
from impedance_modules.safety.solvers.solution import FilterSolution, failed


class QpsolversSolver(GeneralSolver):
    """A solver behind qpsolvers' interface; slower than a native one, for comparison.

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
