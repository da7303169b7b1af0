# SPDX-License-Identifier: BSD-3-Clause
"""What every solver takes and gives."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from impedance_modules.safety.problem import FilterProblem, Vector


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
