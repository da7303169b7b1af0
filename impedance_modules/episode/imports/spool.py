# SPDX-License-Identifier: BSD-3-Clause
"""Rows of numbers on disk: so that merging the streams of a long bag needs no memory that grows with it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

_BUFFERED = 4096
"""Rows that wait in memory."""


class Spool:
    """Appends rows of a fixed width to a file, and gives them back as one array on disk."""

    def __init__(self, path: Path, width: int) -> None:
        """Makes the file.

        Args:
            path: Of a temporary file.
            width: Numbers in a row.
        """
        self.rows = 0
        self._path = path
        self._width = width
        self._held: list[Sequence[float]] = []
        path.touch()

    def append(self, row: Sequence[float]) -> None:
        """Adds one row."""
        self._held.append(row)
        self.rows += 1
        if len(self._held) >= _BUFFERED:
            self._flush()

    def array(self) -> NDArray[np.float64]:
        """Returns all rows, (rows, width), read from disk as they are used."""
        self._flush()
        if not self.rows:
            return np.empty((0, self._width))
        return np.memmap(self._path, dtype=np.float64, mode="r", shape=(self.rows, self._width))

    def _flush(self) -> None:
        if self._held:
            with self._path.open("ab") as stream:
                np.array(self._held, dtype=np.float64).tofile(stream)
            self._held = []
