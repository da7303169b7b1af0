# SPDX-License-Identifier: BSD-3-Clause
"""A thread that asks ``Stops`` every few milliseconds what must be sent, whatever the control loop is doing."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

LOOK = 0.005
"""How often it looks [s]; less than the shortest of ``StopRules``'s times."""

HELD_UP = 0.02
"""A look that comes this much after the last one [s]: not only the robot was silent, this whole process stood still."""


class Watchdog:
    """Calls one function until it is stopped.

    Attributes:
        looks: How often it has looked.
    """

    def __init__(self, look: Callable[[], None]) -> None:
        self.looks = 0
        self._look = look
        self._wake = threading.Event()
        self._stopped = False
        self._thread = threading.Thread(target=self._watch, daemon=True, name="watchdog")

    def start(self) -> None:
        """Begins to watch."""
        self._thread.start()

    def hurry(self) -> None:
        """Has it look now."""
        self._wake.set()

    def stop(self) -> None:
        """Ends it; returns when the last look is over."""
        self._stopped = True
        self._wake.set()
        if self._thread.is_alive():
            self._thread.join()

    def _watch(self) -> None:
        looked = time.monotonic()
        while not self._stopped:
            if time.monotonic() - looked > HELD_UP:
                # What the robot said meanwhile is in the sockets: who reads them comes first, then silence is judged.
                time.sleep(LOOK)
            self._look()
            self.looks += 1
            looked = time.monotonic()
            self._wake.wait(LOOK)
            self._wake.clear()
