# SPDX-License-Identifier: BSD-3-Clause
"""What every general solver shares: bring a problem to normal form, or answer at once where no solver is needed."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np

from impedance_modules.safety.problem import FilterProblem
from impedance_modules.safety.solvers.normal_form import NormalForm, normal_form
from impedance_modules.safety.solvers.shifted import Shifted
from impedance_modules.safety.solvers.solution import FilterSolution, failed


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
