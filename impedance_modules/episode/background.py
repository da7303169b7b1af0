# SPDX-License-Identifier: BSD-3-Clause
"""One thread that does a recording's slow work (encoding, fsync, rerun) beside the control loop."""

from __future__ import annotations

import threading
from collections.abc import Callable

from impedance_modules.errors import ImpedanceError

Job = Callable[[bool], None]
"""Does what has piled up; the argument is True the last time. Keeps its own expected failures."""


class Background:
    """Calls its jobs every ``period`` seconds, at once when woken, and a last time when stopped.

    A job that raises is a mistake in this package: Python prints the traceback, the thread ends, `check`
        tells.
    """

    def __init__(self, period: float) -> None:
        """Starts the thread.

        Args:
            period: Longest wall time between two rounds [s].
        """
        self._period = period
        self._jobs: list[Job] = []
        self._wake = threading.Event()
        self._stopping = False
        self._finished = False
        self._thread = threading.Thread(target=self._run, name="episode-background", daemon=True)
        self._thread.start()

    def register(self, job: Job) -> None:
        """Adds a job to every later round."""
        self._jobs.append(job)

    def wake(self) -> None:
        """Starts the next round now; never waits."""
        self._wake.set()

    def check(self) -> None:
        """Makes sure that the thread still works, or ended as asked.

        Raises:
            ImpedanceError: A job raised.
        """
        if not self._thread.is_alive() and not self._finished:
            raise ImpedanceError("the recording thread ended on an error; its traceback is above")

    def stop(self) -> None:
        """Runs every job a last time and ends the thread. May be called twice.

        Raises:
            ImpedanceError: A job raised.
        """
        self._stopping = True
        self._wake.set()
        self._thread.join()
        self.check()

    def _run(self) -> None:
        while not self._finished:
            self._wake.wait(self._period)
            self._wake.clear()
            last = self._stopping
            for job in tuple(self._jobs):
                job(last)
            self._finished = last
