# SPDX-License-Identifier: BSD-3-Clause
"""Rates with the interval that they deserve."""

from __future__ import annotations

import math
from dataclasses import dataclass

Z = 1.959964


@dataclass(frozen=True)
class Rate:
    """So many of so many."""

    hits: int
    total: int

    @classmethod
    def of(cls, flags: list[bool]) -> Rate:
        """Counts the true ones."""
        return cls(sum(flags), len(flags))

    @property
    def interval(self) -> tuple[float, float]:
        """The 95 % Wilson interval; all of [0, 1] where nothing was tried."""
        if self.total == 0:
            return 0.0, 1.0
        p, n = self.hits / self.total, self.total
        middle = (p + Z**2 / (2 * n)) / (1 + Z**2 / n)
        half = Z / (1 + Z**2 / n) * math.sqrt(p * (1 - p) / n + Z**2 / (4 * n**2))
        return max(0.0, middle - half), min(1.0, middle + half)

    def __str__(self) -> str:
        """E.g. ``92.0 % (46/50, 81-97)``."""
        if self.total == 0:
            return "no cases"
        low, high = self.interval
        return f"{100 * self.hits / self.total:.1f} % ({self.hits}/{self.total}, {100 * low:.0f}-{100 * high:.0f})"
