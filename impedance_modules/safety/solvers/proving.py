# SPDX-License-Identifier: BSD-3-Clause
"""What all solvers share: problems are looked through first, and every answer is proven in 32 digits.

A library solves the problem in plain floats, in units in which every number is moderate (``exact_form``). What it says
is a guess of which constraints act; ``exact_search`` finishes it, and finds the optimum alone where the guess is wrong
or there is none. An answer is therefore the optimum whatever the library made of it, or there is no answer.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import NamedTuple

import numpy as np

from impedance_modules.compiled import compiled
from impedance_modules.records import Vector
from impedance_modules.safety.filter_problem import FilterProblem
from impedance_modules.safety.solvers import FilterSolution, failed
from impedance_modules.safety.solvers.acting_set import ExactSearch, make_search
from impedance_modules.safety.solvers.exact_form import USABLE, ExactForm, is_problem, write_form
from impedance_modules.safety.solvers.exact_search import CONTRADICTORY, PROVEN, search, write_answer

INFINITE = 1e30
"""What libraries read in place of infinity."""

_PUSHES = 1e-9
"""A multiplier below this part of the largest is no guess that its constraint acts."""

_REFUSED = {
    1: "not a problem: a number is not finite, a bound pair is reversed or a penalty is not positive",
    2: "the metric is not positive definite",
    3: "the hard limits contradict each other: a row of zeros",
}


class Guess(NamedTuple):
    """What a library made of a problem.

    Attributes:
        multipliers: (n + m,) of the rows of ``ExactForm``, positive at upper bounds; None where it gave nothing.
        iterations: It made.
        status: In its words.
    """

    multipliers: Vector | None
    iterations: int
    status: str


@compiled
def is_inside(problem: FilterProblem) -> bool:
    """Tells whether the desired torque lies within all bounds."""
    inside = True
    for i in range(problem.desired.size):
        inside = inside and abs(problem.desired[i]) <= problem.effort_max[i]
    for r in range(problem.lower.size):
        value = 0.0
        for j in range(problem.desired.size):
            value += problem.matrix[r, j] * problem.desired[j]
        inside = inside and problem.lower[r] <= value <= problem.upper[r]
    return inside


def largest_demand(form: ExactForm) -> float:
    """How far zero change lies outside its farthest bound, in units of rows; libraries get bounds in parts of it."""
    demand = float(np.maximum(form.low[0], -form.high[0]).max())
    return demand if demand > 0.0 else 1.0


class ProvingSolver(ABC):
    """A library behind the filter's protocol (`solvers.Solver`); a problem of another shape starts it anew."""

    name: str

    def __init__(self) -> None:
        self._shape = (-1, -1)

    def solve(self, problem: FilterProblem) -> FilterSolution:
        """Solves one problem exactly (see `Solver.solve`)."""
        if problem.matrix.shape != self._shape:
            self._shape = problem.matrix.shape
            m, n = self._shape
            self._exact: ExactSearch = make_search(n, m)
            self._forget()
        # Torques of 1e200 overflow to what is no number, and are refused as that.
        with np.errstate(all="ignore"):
            return self._solve(problem)

    @abstractmethod
    def _forget(self) -> None:
        """Drops whatever was kept for problems of the last shape."""

    @abstractmethod
    def _guess(self, form: ExactForm) -> Guess:
        """Solves the problem in plain floats."""

    def _solve(self, problem: FilterProblem) -> FilterSolution:
        form = self._exact.form
        if is_problem(problem) and is_inside(problem):
            return _unchanged(problem)
        found = write_form(problem, form)
        if found != USABLE:
            return failed(_REFUSED[found], 0)
        return self._prove(problem, self._guess(form))

    def _prove(self, problem: FilterProblem, guess: Guess) -> FilterSolution:
        exact, tried = self._exact, guess.iterations
        for multipliers in (guess.multipliers, None):
            exact.side[:] = 0
            if multipliers is not None and np.isfinite(multipliers).all():
                least = _PUSHES * float(np.abs(multipliers).max())
                exact.side[multipliers > least], exact.side[multipliers < -least] = 1, -1
            ended = search(exact)
            tried += exact.steps
            if ended == PROVEN:
                return self._answer(problem, tried, f"{guess.status}, proven")
            if ended == CONTRADICTORY:
                return failed("the hard limits contradict each other", tried)
        return failed(f"{guess.status}, but no optimum could be proven", tried)

    def _answer(self, problem: FilterProblem, iterations: int, status: str) -> FilterSolution:
        m, n = problem.matrix.shape
        effort, duals = np.empty(n), np.empty(n + m)
        write_answer(problem, self._exact, effort, duals)
        return FilterSolution(effort, duals[n:], duals[:n], duals[n:] != 0.0, iterations, True, status)


def _unchanged(problem: FilterProblem) -> FilterSolution:
    m, n = problem.matrix.shape
    return FilterSolution(
        effort=problem.desired.copy(),
        row_duals=np.zeros(m),
        box_duals=np.zeros(n),
        active=np.zeros(m, dtype=np.bool_),
        iterations=0,
        solved=True,
        status="inside all limits",
    )
