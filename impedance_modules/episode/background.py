# SPDX-License-Identifier: BSD-3-Clause
"""What stands between the control loop and slow work (encoding, fsync, rerun): a thread, and a ring of rows."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from impedance_modules.errors import ImpedanceError

Job = Callable[[bool], None]
"""Does what is waiting; the argument is True the last time. Handles the failures that it expects."""

LONGEST_PAUSE = 0.02
"""Jobs wait no longer than this for a control loop that has stopped calling `Background.free_for` [s]."""

RING_BYTES = 32_000_000
"""Memory of a ring: 26 s at 1 kHz and 150 columns."""


class Background:
    """Calls its jobs every ``period`` seconds, at once when woken, and a last time when stopped.

    A job that raises is a mistake in this package: Python prints the traceback, the thread ends, and `check`
    raises.
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
        self._free_until = math.inf
        self._free = threading.Event()
        self._thread = threading.Thread(target=self._run, name="episode-background", daemon=True)
        self._thread.start()

    def register(self, job: Job) -> None:
        """Adds a job to every later round."""
        self._jobs.append(job)

    def wake(self) -> None:
        """Starts the next round now; never waits."""
        self._wake.set()

    def free_for(self, seconds: float) -> None:
        """Called by the control loop: leaves the interpreter to the jobs for a while [s], counted from now.

        A thread that computes in Python takes the interpreter from the loop again and again, 0.1 ms and more each time,
        and a cycle that takes 0.3 ms alone lasts 5. So jobs that call `pause` between small pieces of work do it
        while the loop waits for the next state. Before the first call, jobs never pause.
        """
        self._free_until = time.monotonic() + seconds
        if not self._free.is_set():
            self._free.set()

    def pause(self) -> None:
        """Called by a job about every 0.1 ms: waits until the control loop leaves it the interpreter."""
        if time.monotonic() > self._free_until:
            self._free.clear()
            if not self._free.wait(LONGEST_PAUSE):
                self._free_until = math.inf

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
        self._free_until = math.inf
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


class RowRing:
    """Rows of numbers, each with an integer label, for one producer and one consumer without a lock.

    ``put`` alone writes ``_head`` and ``release`` alone writes ``_tail``; both only grow, so a stale value
    seen by the other side is never unsafe.
    """

    def __init__(self, width: int) -> None:
        self._capacity = max(RING_BYTES // (8 * width), 1024)
        self._rows = np.empty((self._capacity, width))
        # Touched now: a page that the control loop is the first to write costs it up to 5 ms.
        self._rows.fill(0.0)
        self._labels = np.empty(self._capacity, np.int32)
        self._head = 0
        self._tail = 0

    @property
    def received(self) -> int:
        """Rows put so far."""
        return self._head

    @property
    def released(self) -> int:
        """Rows released so far."""
        return self._tail

    @property
    def full(self) -> bool:
        """Whether the next `put` would overwrite a row that was not released."""
        return self._head - self._tail >= self._capacity

    @property
    def empty(self) -> bool:
        """Whether every row was released."""
        return self._head == self._tail

    def put(self, row: NDArray[np.float64], label: int) -> None:
        """Copies one row in; the caller has made sure that the ring is not full."""
        slot = self._head % self._capacity
        self._rows[slot] = row
        self._labels[slot] = label
        self._head += 1

    def peek(self) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
        """Returns copies of the rows (n, width) and labels (n,) that wait; `release` frees them."""
        slots = np.arange(self._tail, self._head) % self._capacity
        return self._rows[slots], self._labels[slots]

    def release(self, count: int) -> None:
        """Frees the oldest ``count`` rows."""
        self._tail += count
