# SPDX-License-Identifier: BSD-3-Clause
"""The command ``impedance`` beside simulated robots whose clock goes slower than real time by a factor.

As a program, ``python -m tests.support.slow_clock FACTOR VERB ...``. The control loop then counts by a clock that goes
as slowly: a torque is late that took longer than a period of the robots.
"""

from __future__ import annotations

import sys
import time

from impedance_modules.cli.main import main, use_one_thread


class SlowClock:
    """In the place of the module ``time`` in the control loop, which asks it for ``perf_counter`` alone."""

    def __init__(self, slower: float) -> None:
        self._slower = slower

    def perf_counter(self) -> float:
        """Time by the robots' clock, up to a constant [s]."""
        return time.perf_counter() / self._slower


if __name__ == "__main__":
    use_one_thread()
    from impedance_modules.control import loop

    loop.time = SlowClock(float(sys.argv.pop(1)))  # type: ignore[assignment]
    main()
