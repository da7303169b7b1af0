# SPDX-License-Identifier: BSD-3-Clause
"""Thins a recording out: a low-pass without delay, then every n-th sample, piece by piece."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray
from scipy.signal import firwin, kaiserord, oaconvolve

from impedance_modules.episode.imports.blocks import Block
from impedance_modules.episode.imports.import_map import ImportMap
from impedance_modules.errors import BadFile, BadInput

ATTENUATION = 60.0
"""Of what would fold back below half the new rate [dB]."""

WIDEST_PASS = 0.9
"""Largest pass band, as a part of half the new rate: a steeper filter would blur the ends of the log."""

Matrix = NDArray[np.float64]

UNEVEN = 0.5
"""Part of a step by which a time may be off for samples to count as even."""


def decimated(blocks: Iterator[Block], what: ImportMap) -> Iterator[Block]:
    """Yields every n-th sample of the filtered recording, at its own time.

    A symmetric FIR filter (Kaiser window) of odd length delays nothing; beyond its ends the recording is
    continued by its point reflection, 2 x_0 - x_i, which keeps value and slope.

    Raises:
        BadFile: The pass band does not fit below half the new rate.
        BadInput: Uneven samples, or fewer than the filter is long.
    """
    thinning = what.decimation
    if thinning is None:
        yield from blocks
        return
    first = next(blocks, None)
    if first is None:
        return
    taps = _filter(first, what)
    half = len(taps) // 2
    if len(first.time) <= half:
        raise BadInput(
            f"{what.document.path}: decimate: the filter needs {half + 1} samples, and there are {len(first.time)}"
            " (valid: a longer log, a smaller 'low_pass', or no 'decimate')"
        )
    step = float(np.median(np.diff(first.time)))
    _check_even(first.time, step, what)
    window = _Window(tuple(first.columns), taps, thinning.keep_every)
    window.add(_mirrored(_matrix(first)[: half + 1], head=True))
    window.add(_matrix(first), first)
    for block in blocks:
        _check_even(np.concatenate([window.times[-1:], block.time]), step, what)
        window.add(_matrix(block), block)
        yield window.thinned()
    window.add(_mirrored(window.values[-half - 1 :], head=False))
    yield window.thinned()


class _Window:
    """The samples that are in memory; ``values`` reaches half a filter beyond ``times`` on both sides."""

    def __init__(self, names: tuple[str, ...], taps: Matrix, keep_every: int) -> None:
        self.values = np.empty((0, len(names)))
        self.times = np.empty(0)
        self._places = np.empty(0, dtype=np.int64)
        self._names = names
        self._taps = taps
        self._keep_every = keep_every
        self._next = 0

    def add(self, values: Matrix, of: Block | None = None) -> None:
        """Appends samples, or, without a block, what lies beyond an end of the recording."""
        self.values = np.vstack([self.values, values])
        if of is not None:
            self.times = np.concatenate([self.times, of.time])
            self._places = np.concatenate([self._places, of.places])

    def thinned(self) -> Block:
        """Filters what has neighbours on both sides, keeps every n-th sample of it, and forgets the rest."""
        ready = len(self.values) - len(self._taps) + 1
        filtered = oaconvolve(self.values, self._taps[:, None], mode="valid", axes=0)
        keep = slice(self._next, ready, self._keep_every)
        columns = {name: filtered[keep, index].copy() for index, name in enumerate(self._names)}
        block = Block(self.times[:ready][keep], columns, self._places[:ready][keep])
        self._next = (self._next - ready) % self._keep_every
        self.values, self.times, self._places = self.values[ready:], self.times[ready:], self._places[ready:]
        return block


def _filter(first: Block, what: ImportMap) -> Matrix:
    """Designs the filter: pass band up to ``low_pass``, stop band from half the new rate."""
    thinning = what.decimation
    if thinning is None or len(first.time) < 2:
        raise BadInput(f"{what.document.path}: decimate: a single sample cannot be thinned out")
    rate = 1.0 / float(np.median(np.diff(first.time)))
    edge = 0.5 * rate / thinning.keep_every
    if thinning.low_pass > WIDEST_PASS * edge:
        message = (
            f"{thinning.low_pass:g} Hz at {rate:g} Hz and every {thinning.keep_every}th sample: at most"
            f" {WIDEST_PASS * edge:g} Hz fit"
        )
        raise BadFile([what.document.problem(("decimate", "low_pass"), message)])
    taps, beta = kaiserord(ATTENUATION, (edge - thinning.low_pass) / (0.5 * rate))
    window = ("kaiser", beta)
    designed: Matrix = firwin(taps | 1, 0.5 * (edge + thinning.low_pass), window=window, fs=rate)
    return designed


def _matrix(block: Block) -> Matrix:
    values: Matrix = np.column_stack(list(block.columns.values()))
    return values


def _mirrored(part: Matrix, *, head: bool) -> Matrix:
    """The point reflection of ``half + 1`` samples about the outermost, which itself is left out."""
    mirrored: Matrix = 2.0 * part[0] - part[:0:-1] if head else 2.0 * part[-1] - part[-2::-1]
    return mirrored


def _check_even(time: Matrix, step: float, what: ImportMap) -> None:
    off = np.abs(np.diff(time) - step) > UNEVEN * step
    if off.any():
        row = int(np.argmax(off))
        raise BadInput(
            f"{what.document.path}: decimate: the samples are not even: {np.diff(time)[row]:.4g} s after"
            f" t = {time[row]:.6g} s, where {step:.4g} s is usual (valid: even samples, or no 'decimate')"
        )
