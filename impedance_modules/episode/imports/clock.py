# SPDX-License-Identifier: BSD-3-Clause
"""Watches the time of a recording as it goes by: it runs forwards, and at one rate."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from impedance_modules.episode.imports.blocks import Block
from impedance_modules.errors import BadInput

STRETCH = 32
"""Samples whose typical step is compared with that of the whole."""

OTHER_RATE = 1.5
"""Ratio of typical steps from which two stretches have different rates."""

OTHER_SHARE = 0.1
"""Part of a recording that must have another rate before it counts: a computer may stumble."""


class Clock:
    """Takes the blocks of one recording in order.

    Attributes:
        samples: So far.
    """

    def __init__(self, path: Path, row_word: str) -> None:
        """Starts before the first sample.

        Args:
            path: First source, for messages.
            row_word: What a row is called there.
        """
        self.samples = 0
        self._path = path
        self._row_word = row_word
        self._first = 0.0
        self._last: float | None = None
        self._steps: list[float] = []
        self._stretch_places: list[int] = []

    def take(self, block: Block) -> None:
        """Looks at the next samples.

        Raises:
            BadInput: Time stands still or runs backwards.
        """
        time = block.time
        if self._last is None:
            self._first = float(time[0])
            before, places = time, block.places[1:]
        else:
            before, places = np.concatenate([[self._last], time]), block.places
        steps = np.diff(before)
        wrong = steps <= 0.0
        if wrong.any():
            row = int(np.argmax(wrong))
            how = "repeats" if steps[row] == 0.0 else "runs backwards:"
            raise BadInput(
                f"{self._path}:{places[row]}: time {how} {before[row + 1]:.9g} s after {before[row]:.9g} s in this"
                f" {self._row_word} (valid: rising times; sort the log, or remove what was written twice)"
            )
        for start in range(0, len(steps) - STRETCH + 1, STRETCH):
            self._steps.append(float(np.median(steps[start : start + STRETCH])))
            self._stretch_places.append(int(places[start]))
        if self.samples + len(time) <= STRETCH and len(steps):
            self._steps, self._stretch_places = [float(np.median(steps))], [int(places[0])]
        self.samples += len(time)
        self._last = float(time[-1])

    @property
    def duration(self) -> float:
        """From the first sample to the last [s]."""
        return 0.0 if self._last is None else self._last - self._first

    @property
    def rate(self) -> float:
        """Typical samples per second [Hz]."""
        return 1.0 / self._typical

    @property
    def _typical(self) -> float:
        """A step that really occurs: with two rates the mean of both would be neither."""
        return sorted(self._steps)[len(self._steps) // 2]

    def finish(self) -> None:
        """Judges the whole.

        Raises:
            BadInput: No or one sample, or parts of different rates.
        """
        if self.samples < 2:
            count = "no sample" if self.samples == 0 else "a single sample: nothing can be seen to move"
            raise BadInput(f"{self._path}: {count} (valid: two or more)")
        steps = np.array(self._steps)
        ratio = steps / self._typical
        other = (ratio > OTHER_RATE) | (ratio < 1.0 / OTHER_RATE)
        lasting = other[1:] & other[:-1]
        if np.count_nonzero(other) >= max(2.0, OTHER_SHARE * len(steps)) and lasting.any():
            stretch = int(np.argmax(lasting))
            raise BadInput(
                f"{self._path}:{self._stretch_places[stretch]}: about {1.0 / steps[stretch]:.4g} Hz from this"
                f" {self._row_word} on, and {self.rate:.4g} Hz elsewhere (valid: one rate; split the log there)"
            )
