# SPDX-License-Identifier: BSD-3-Clause
"""A solver by its name in the robot file; each library is imported only when asked for."""

from __future__ import annotations

import math

from impedance_modules.errors import BadInput, nearest
from impedance_modules.safety.problem import FilterLayout, FilterWorkspace
from impedance_modules.safety.solvers.solution import Solver

_PREFIX = "qpsolvers:"


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
    problem = FilterWorkspace(FilterLayout(("joint",), ())).problem
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

    from impedance_modules.safety.solvers.qpsolvers_solver import QpsolversSolver  # noqa: PLC0415

    installed = tuple(sorted(qpsolvers.dense_solvers))
    if name not in installed:
        raise BadInput(
            f"qpsolvers has no installed dense solver '{name}' "
            f"(valid: {', '.join(_PREFIX + other for other in installed)}){nearest(name, installed)}"
        )
    return QpsolversSolver(name, qpsolvers)
