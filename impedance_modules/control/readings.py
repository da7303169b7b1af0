# SPDX-License-Identifier: BSD-3-Clause
"""What the last control cycle came to, read from its memory by name."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from impedance_modules.control.memory import CLOCK, FOUND, GRANTED, PAID, TOO_FAST, TRIED, CycleMemory
from impedance_modules.safety.compiled_lane import CERTIFIED, INSIDE, UNDECIDED
from impedance_modules.safety.compiled_ledger import LEVEL, SCALE, STARVED
from impedance_modules.safety.solvers.solution import FilterSolution

Array = NDArray[np.float64]


class CycleReadings:
    """Read-only numbers of the last cycle.

    Attributes:
        memory: Every number of the last cycle, by name.
    """

    def __init__(self, memory: CycleMemory) -> None:
        self.memory = memory
        self._solution: FilterSolution | None = None
        self._effort, self._result = memory["effort"], memory["result"]
        self._clock, self._book_scalars = memory["clock"], memory["book_scalars"]

    @property
    def effort(self) -> Array:
        """(n,) torque that may leave [N.m]; only after ``tick`` or ``brake`` returned 0."""
        return self._effort

    @property
    def clock(self) -> float:
        """Phase clock [s]; slower than time when the tank is short."""
        return float(self._clock[CLOCK])

    @property
    def level(self) -> float:
        """Energy in the tank [J]."""
        return float(self._book_scalars[LEVEL])

    @property
    def spring_scale(self) -> float:
        """Part of the declared springs that is in force, 1 unless the tank had to relax them."""
        return float(self._book_scalars[SCALE])

    @property
    def granted(self) -> float:
        """Part of the last motion of the equilibria that the tank could pay."""
        return float(self._clock[GRANTED])

    @property
    def starved_time(self) -> float:
        """For how long the tank has reduced torque or springs [s]."""
        return float(self._book_scalars[STARVED])

    @property
    def too_fast(self) -> int:
        """First joint beyond its speed bound in the last interval, or n."""
        return int(self._result[TOO_FAST])

    @property
    def paid(self) -> float:
        """Scale in [0, 1] that the guarantee put on the last torque."""
        return float(self._result[PAID])

    @property
    def solved(self) -> bool:
        """Whether the last tick found a filtered torque."""
        if self._solution is not None:
            return self._solution.solved
        return bool(self._result[FOUND] != UNDECIDED)

    @property
    def changed(self) -> bool:
        """Whether the filter gave another torque than the modules desired; not where there was no torque to filter."""
        if self._solution is not None:
            return self._solution.solved and self._solution.iterations > 0
        return bool(self._result[FOUND] == CERTIFIED)

    @property
    def acting(self) -> int:
        """Number of filter rows that changed the last torque; costs less than asking ``solution``."""
        if self._solution is not None:
            active = self._solution.active
            return 0 if active is None else int(np.count_nonzero(active))
        if self._result[FOUND] != CERTIFIED:
            return 0
        return int(np.count_nonzero(self.memory["duals"][self._effort.size :]))

    @property
    def solution(self) -> FilterSolution | None:
        """Of the last filter problem; None when it was not reached."""
        if self._solution is None and self._result[FOUND] != UNDECIDED:
            self._solution = self._lane_solution()
        return self._solution

    def _forget_answer(self) -> None:
        """Drops the filter's last answer, in a cycle that asks it nothing."""
        self._solution = None
        self._result[FOUND], self._result[TRIED] = UNDECIDED, 0.0

    def _lane_solution(self) -> FilterSolution:
        """Puts what the fast lane found into the words that every solver uses."""
        duals, n = self.memory["duals"].copy(), self._effort.size
        inside = self._result[FOUND] == INSIDE
        return FilterSolution(
            effort=self.memory["filtered"].copy(),
            row_duals=duals[n:],
            box_duals=duals[:n],
            active=duals[n:] != 0.0,
            iterations=int(self._result[TRIED]),
            solved=True,
            status="inside all limits" if inside else "optimal, certified",
        )
