# SPDX-License-Identifier: BSD-3-Clause
"""A fixed block of memory between the control loop, which puts rows, and one thread, which takes them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

RING_BYTES = 32_000_000
"""Memory of a ring: 26 s at 1 kHz and 150 columns."""


class RowRing:
    """Rows of numbers, each with an integer label, for one producer and one consumer without a lock.

    ``put`` alone writes ``_head`` and ``release`` alone writes ``_tail``; both only grow, so a stale value
    seen by the other side is merely cautious.
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
