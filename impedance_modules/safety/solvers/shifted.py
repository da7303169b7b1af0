# SPDX-License-Identifier: BSD-3-Clause
"""The same problem seen from the desired torque: unknown is the change, and zero change is free.

    minimise 1/2 d^T W d + ...   subject to   lower <= [d; A d] <= upper,   d = tau - desired

Every solver works on this form: if zero lies within all bounds it is the optimum, and the desired
torque leaves the filter unchanged to the last bit.
"""

from __future__ import annotations

import numpy as np

from impedance_modules.safety.problem import FilterProblem, Vector
from impedance_modules.safety.solvers.compiled import INSIDE, UNUSABLE, land, shift
from impedance_modules.safety.solvers.solution import FilterSolution, failed

INFINITE = 1e30
"""Bounds of this size or more are absent; what solvers read in place of infinity."""

HARD_TOLERANCE = 1e-7
"""Most that a solver may break a hard bound [N.m] before its answer counts as a failure."""

_UNUSABLE = "not a problem: a number is not finite, a bound pair is reversed or a penalty is not positive"


class Shifted:
    """Buffers for the bounds of one problem shape, refilled every cycle.

    Attributes:
        lower: (n + m,) bounds of the change: torque limits first, then rows; never infinite.
        upper: Likewise.
    """

    def __init__(self, n: int, m: int) -> None:
        self.n, self.m = n, m
        self.lower = np.zeros(n + m)
        self.upper = np.zeros(n + m)

    def fits(self, problem: FilterProblem) -> bool:
        """Whether these buffers have the problem's shape."""
        return problem.matrix.shape == (self.m, self.n)

    def fill(self, problem: FilterProblem) -> FilterSolution | None:
        """Writes the bounds; returns the outcome at once where no solver is needed.

        Returns:
            The unchanged torque if it respects everything, a failure if this is no problem, else None.
        """
        found = shift(
            problem.desired,
            problem.effort_max,
            problem.matrix,
            problem.lower,
            problem.upper,
            problem.penalty,
            problem.metric,
            INFINITE,
            self.lower,
            self.upper,
        )
        if found == UNUSABLE:
            return failed(_UNUSABLE, 0)
        return self._unchanged(problem) if found == INSIDE else None

    def _unchanged(self, problem: FilterProblem) -> FilterSolution:
        return FilterSolution(
            effort=problem.desired.copy(),
            row_duals=np.zeros(self.m),
            box_duals=np.zeros(self.n),
            active=np.zeros(self.m, dtype=np.bool_),
            iterations=0,
            solved=True,
            status="inside all limits",
        )

    def finish(
        self, problem: FilterProblem, change: Vector, duals: Vector, iterations: int, status: str
    ) -> FilterSolution:
        """The outcome of a change of torque, after a check against the hard set.

        Args:
            problem: The problem last filled.
            change: (n,) d [N.m].
            duals: (n + m,) multipliers, torque limits first; kept, so hand in a copy.
            iterations: Of the solver.
            status: In words.

        Returns:
            The solution; a failure if it is not finite or breaks the hard bounds by HARD_TOLERANCE.
        """
        n, power = self.n, problem.layout.power
        effort = np.empty(n)
        broken = land(
            problem.desired,
            problem.effort_max,
            problem.matrix[power],
            self.upper[n + power],
            change,
            effort,
        )
        # Written so that a comparison with NaN counts as a failure.
        if not broken <= HARD_TOLERANCE:
            return failed(f"{status}, but the answer breaks a hard limit", iterations)
        rows = duals[n:]
        return FilterSolution(effort, rows, duals[:n], rows != 0.0, iterations, True, status)
