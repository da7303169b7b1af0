# SPDX-License-Identifier: BSD-3-Clause
"""The energy ledger once more, from the whole history of a run: docs/passivity.md with lists and numpy sums.

It keeps every command and every interval, adds up the work of each gap from its beginning, and knows the tank's level
only as the balance T = E_0 - work - charges - spilled - r U. Shares nothing with the ledger under test.
"""

import math
from dataclasses import dataclass, field

import numpy as np


@dataclass
class History:
    """A run's history; interval k lies between cycle k and k + 1, and ``acting[k]`` acts in it."""

    period: float
    ceiling: float
    speed_bound: np.ndarray
    error: np.ndarray
    deviation: np.ndarray | None
    initial: float
    potential: float
    theta: np.ndarray
    acting: list[np.ndarray]
    scale: float = 1.0
    gap: int = 0
    blind: bool = False
    interval: int = 0
    before: np.ndarray = field(default_factory=lambda: np.zeros(0))
    changes: list[np.ndarray] = field(default_factory=list)
    works: list[float] = field(default_factory=list)
    charges: list[float] = field(default_factory=list)
    spills: list[float] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.start = self.initial + self.potential
        self.before = np.zeros_like(self.theta)

    @property
    def level(self) -> float:
        gone = math.fsum(self.works) + math.fsum(self.charges) + math.fsum(self.spills) + self.worst_of_gap()
        return self.start - gone - self.scale * self.potential

    @property
    def work(self) -> float:
        return math.fsum(self.works) + self.worst_of_gap()

    def worst(self, torque: np.ndarray) -> float:
        """The most that a torque can spend in one interval."""
        return float(np.sum(np.abs(torque) * self.speed_bound) * self.period)

    def worst_of_gap(self) -> float:
        """What stands booked while nobody knows better."""
        return sum(self.worst(torque) for torque in self.acting[self.interval : self.interval + self.gap])

    def command(self, torque: np.ndarray) -> None:
        """A torque left in this cycle; in a cycle without a state it replaces the repeated one."""
        if self.gap:
            self.acting[-1] = torque.copy()
            self.blind = self.blind or len(self.acting) == self.interval + self.gap + 1
        else:
            self.acting.append(torque.copy())

    def miss(self) -> None:
        """No state came: the newest command is held on."""
        self.gap += 1
        self.acting.append(self.acting[-1].copy())

    def measure(self, theta: np.ndarray, potential: float) -> None:
        """A state came: books the intervals since the last one together, at the worst where that is cheaper."""
        torques = self.acting[self.interval : self.interval + self.gap + 1]
        spread = sum(j * self.worst(torques[j] - torques[j - 1]) for j in range(1, len(torques)))
        seen = float(torques[-1] @ (theta - self.theta)) + spread
        worst = sum(self.worst(torque) for torque in torques)
        if not self.blind and (self.gap == 0 or seen <= worst):
            self.works.append(seen)
            self.charges.append(self.charge(torques[-1] - self.before))
            self.before = torques[-1]
        else:
            self.works.append(worst)
            self.charges.append(float(np.abs(self.before) @ self.error))
            self.before = np.zeros_like(theta)
        self.interval += self.gap + 1
        self.gap, self.blind, self.theta, self.potential = 0, False, theta.copy(), potential
        self.spill()

    def charge(self, change: np.ndarray) -> float:
        """The error that a change of torque adds: at its worst, or six deviations of a random walk."""
        worst = float(np.abs(change) @ self.error)
        if self.deviation is None:
            return worst
        self.changes.append(change)
        walk = math.sqrt(float(np.sum((np.array(self.changes) * self.deviation) ** 2)))
        return max(0.0, min(worst, 6.0 * walk - math.fsum(self.charges)))

    def spill(self) -> None:
        """Throws away what is above the ceiling."""
        self.spills.append(max(0.0, self.level - self.ceiling))
