# SPDX-License-Identifier: BSD-3-Clause
"""From a solver's answer in metric coordinates to a filter solution, exact where possible."""

from __future__ import annotations

import numpy as np

from impedance_modules.safety.problem import FilterProblem, Vector
from impedance_modules.safety.solvers.normal_form import NormalForm
from impedance_modules.safety.solvers.polish import polish
from impedance_modules.safety.solvers.shifted import Shifted
from impedance_modules.safety.solvers.solution import FilterSolution, failed


def finish(
    problem: FilterProblem,
    shifted: Shifted,
    form: NormalForm,
    guess: Vector,
    *,
    iterations: int,
    solved: bool,
    status: str,
) -> FilterSolution:
    """Polishes a solver's multipliers and checks the result.

    A polished answer satisfies the optimality conditions, so it counts whatever the solver said of its
    own; an unpolished one counts only if the solver said solved.

    Args:
        problem: The problem solved.
        shifted: Its bounds.
        form: The same in metric coordinates.
        guess: (N,) multipliers of the solver.
        iterations: Of the solver.
        solved: What the solver said.
        status: In its words.
    """
    exact = polish(form, guess) if np.isfinite(guess).all() else None
    if exact is not None:
        change, duals = form.change(exact.y), form.duals(exact.multipliers)
        return shifted.finish(problem, change, duals, iterations, f"{status}, polished")
    if solved:
        change, duals = form.change(-(form.rows.T @ guess)), form.duals(guess)
        return shifted.finish(problem, change, duals, iterations, f"{status}, to the solver's tolerance")
    return failed(status, iterations)
