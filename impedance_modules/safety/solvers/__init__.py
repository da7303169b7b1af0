# SPDX-License-Identifier: BSD-3-Clause
"""Second of the filter's three steps: interchangeable solvers behind one protocol.

The robot file names one; each library is imported only when asked for. ``active_set.py`` solves easy problems inside
the cycle; what it leaves undecided comes here.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from impedance_modules.errors import BadInput, nearest
from impedance_modules.records import Vector
from impedance_modules.safety.filter_problem import FilterLayout, FilterProblem, make_problem

_PREFIX = "qpsolvers:"


@dataclass(frozen=True)
class FilterSolution:
    r"""Outcome of one solve. Without ``solved`` there is no torque to read.

    With multipliers positive at an upper bound and negative at a lower one, the optimum satisfies
    W (effort - desired) + A^T row_duals + box_duals = 0.

    Attributes:
        effort: (n,) filtered torque [N.m]; None if unsolved.
        row_duals: (m,) multipliers of the rows; None if unsolved.
        box_duals: (n,) multipliers of the torque limits; None if unsolved.
        active: (m,) True for rows that change the torque; None if unsolved.
        iterations: Of the solver; 0 where nothing had to be solved.
        solved: The optimum was found, and checked against the hard set.
        status: In words.
    """

    effort: Vector | None
    row_duals: Vector | None
    box_duals: Vector | None
    active: NDArray[np.bool_] | None
    iterations: int
    solved: bool
    status: str


class Solver(Protocol):
    """Finds the optimum of a filter problem; never raises on numbers, never returns a guess."""

    @property
    def name(self) -> str:
        """As `make_solver` knows it."""

    def solve(self, problem: FilterProblem) -> FilterSolution:
        """Solves one problem; bounded time, ``solved`` False on failure."""


def failed(status: str, iterations: int) -> FilterSolution:
    """The outcome without a torque."""
    return FilterSolution(None, None, None, None, iterations, False, status)


def make_solver(name: str) -> Solver:
    """Makes a solver.

    Args:
        name: ``daqp`` (exact, fastest), ``proxsuite``, or ``qpsolvers:<name>`` for any dense solver that
            qpsolvers finds installed.

    Raises:
        BadInput: For an unknown name, with the valid ones.
    """
    if name == "daqp":
        return _exercised(_make_daqp())
    if name == "proxsuite":
        return _exercised(_make_proxsuite())
    if name.startswith(_PREFIX):
        return _exercised(_make_qpsolvers(name.removeprefix(_PREFIX)))
    valid = ("daqp", "proxsuite", f"{_PREFIX}<name>")
    raise BadInput(f"no solver '{name}' (valid: {', '.join(valid)}){nearest(name, valid[:2])}")


def _exercised(solver: Solver) -> Solver:
    """Solves a small problem first, so that no control cycle waits for code to load or compile."""
    problem = make_problem(FilterLayout(("joint",), ()), np.ones(1))
    problem.desired[:] = 2.0
    for limit in (math.inf, 1.0):
        problem.effort_max[:] = limit
        solver.solve(problem)
    return solver


def _make_daqp() -> Solver:
    import daqp  # noqa: PLC0415

    from impedance_modules.safety.solvers.daqp_solver import DaqpSolver  # noqa: PLC0415

    return DaqpSolver(daqp.Model)


def _make_proxsuite() -> Solver:
    from proxsuite import proxqp  # noqa: PLC0415

    from impedance_modules.safety.solvers.general_solvers import ProxsuiteSolver  # noqa: PLC0415

    return ProxsuiteSolver(proxqp)


def _make_qpsolvers(name: str) -> Solver:
    import qpsolvers  # noqa: PLC0415

    from impedance_modules.safety.solvers.general_solvers import QpsolversSolver  # noqa: PLC0415

    installed = tuple(sorted(qpsolvers.dense_solvers))
    if name not in installed:
        raise BadInput(
            f"qpsolvers has no installed dense solver '{name}' "
            f"(valid: {', '.join(_PREFIX + other for other in installed)}){nearest(name, installed)}"
        )
    return QpsolversSolver(name, qpsolvers)
