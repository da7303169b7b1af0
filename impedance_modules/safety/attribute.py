# SPDX-License-Identifier: BSD-3-Clause
"""Third of the filter's three steps: which row changed the torque, and at which module's cost."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from impedance_modules.records import Matrix, Vector
from impedance_modules.safety.filter_problem import FilterLayout, FilterProblem
from impedance_modules.safety.solvers import FilterSolution

_SUM_TOLERANCE = 1e-6


@dataclass(frozen=True)
class Reduction:
    """The part of a torque change that one row asked of one module.

    Attributes:
        row: Label of the row, e.g. ``position <joint>`` or ``torque <joint>``.
        module: Name of the module; None where no module pushes against the row, i.e. the arm's own motion
            or place does (too fast, outside its range).
        change: (n,) torque change [N.m]; all of them sum to effort - desired.
        amount: Its Euclidean length [N.m].
    """

    row: str
    module: str | None
    change: Vector
    amount: float


def attribute(
    problem: FilterProblem,
    layout: FilterLayout,
    solution: FilterSolution,
    module_names: Sequence[str],
    module_efforts: Matrix,
) -> list[Reduction]:
    r"""Splits the filter's change of torque over rows and modules, without remainder.

    Over rows it is exact, by the optimality conditions: effort - desired = sum_r -W^-1 a_r lambda_r,
    torque limits included. Within a row, each module bears the share of its push against that row,

        p_k = max(0, sign(lambda_r) a_r . tau_k),   share_k = p_k / sum p,

    so who pulls away from a limit pays nothing; where nobody pushes, no module is named. Rows that
    contradict each other have large parts that nearly cancel: read them as a conflict, not as torque.

    Args:
        problem: As solved.
        layout: Names of its rows.
        solution: Of that problem.
        module_names: k names.
        module_efforts: (k, n) torque of each module; they sum to ``problem.desired``.

    Returns:
        Reductions, largest first; empty if the torque passed unchanged.

    Raises:
        ValueError: If the solution is not solved, or the modules do not sum to the desired torque.
    """
    if solution.row_duals is None or solution.box_duals is None:
        raise ValueError(f"nothing to attribute: the filter did not solve ({solution.status})")
    missing = float(np.abs(module_efforts.sum(axis=0) - problem.desired).max(initial=0.0))
    if missing > _SUM_TOLERANCE * max(1.0, float(np.abs(problem.desired).max(initial=0.0))):
        raise ValueError(
            f"the modules' efforts miss the desired torque by {missing:.3g} N.m; list every module, "
            "with whatever else was added as a module of its own"
        )
    duals = np.concatenate([solution.box_duals, solution.row_duals])
    acting = np.flatnonzero(duals)
    if acting.size == 0:
        return []
    rows = np.vstack([np.eye(layout.n), problem.matrix])[acting]
    changes = -np.linalg.solve(problem.metric, (rows * duals[acting, None]).T).T
    pushes = np.maximum(0.0, np.sign(duals[acting])[:, None] * (rows @ module_efforts.T))
    labels = layout.box_labels + layout.labels
    found = [
        reduction
        for index, change, push in zip(acting, changes, pushes, strict=True)
        for reduction in _split(labels[index], change, push, module_names)
    ]
    return sorted(found, key=lambda reduction: -reduction.amount)


def _split(label: str, change: Vector, push: Vector, names: Sequence[str]) -> list[Reduction]:
    total = float(push.sum())
    if total <= 0.0:
        return [_reduction(label, None, change)]
    return [
        _reduction(label, name, change * (part / total))
        for name, part in zip(names, push, strict=True)
        if part > 0.0
    ]


def _reduction(label: str, module: str | None, change: Vector) -> Reduction:
    return Reduction(label, module, change, float(np.linalg.norm(change)))
