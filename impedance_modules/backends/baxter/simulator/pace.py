# SPDX-License-Identifier: BSD-3-Clause
"""Keeps the double's clock beside the wall's: no drift while the machine keeps up, an honest slip when it does not."""

from __future__ import annotations

import time
from collections.abc import Callable

from impedance_modules.backends.baxter.simulator.parameters import TICK

PATIENCE = 0.05
"""Ticks that are late are made up for; beyond this lateness they are given up [s]."""


class Pacer:
    """Says when the next tick is due.

    Attributes:
        slipped: By how much the double's clock is behind the wall's in all [s].
    """

    def __init__(
        self,
        clock: Callable[[], float] = time.perf_counter,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        self._clock, self._sleep = clock, sleep
        self._start = clock()
        self._ticks = 0
        self.slipped = 0.0

    def wait(self) -> float:
        """Sleeps until the next tick; returns how much time was given up just now [s]."""
        self._ticks += 1
        early = self._start + self._ticks * TICK - self._clock()
        if early > 0.0:
            self._sleep(early)
        if early >= -PATIENCE:
            return 0.0
        self._start -= early
        self.slipped -= early
        return -early
