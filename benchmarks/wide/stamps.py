# SPDX-License-Identifier: BSD-3-Clause
"""Clocks of recordings: when samples are taken, what their stamps say, and which rows are lost or written twice."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.wide.frozen import written_late as late_stamps

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Rows:
    """The rows of a recording.

    Attributes:
        taken: (m,) when each sample is taken [s].
        stamps: (m,) what is written [s].
        kept: Index of the sample in each row.
    """

    taken: Array
    stamps: Array
    kept: NDArray[np.int64]


def _all(times: Array) -> NDArray[np.int64]:
    return np.arange(times.size)


def even(times: Array, rng: np.random.Generator) -> Rows:  # noqa: ARG001
    """Even and right."""
    return Rows(times, times, _all(times))


def jitter(times: Array, rng: np.random.Generator) -> Rows:
    """Samples are even, stamps scatter by a twentieth of the period."""
    period = times[1] - times[0]
    error = np.clip(0.05 * rng.standard_normal(times.size), -0.2, 0.2) * period
    return Rows(times, times + error, _all(times))


def uneven(times: Array, rng: np.random.Generator) -> Rows:
    """Samples are taken unevenly, by a tenth of the period, and the stamps say when."""
    period = times[1] - times[0]
    taken = times + np.clip(0.1 * rng.standard_normal(times.size), -0.3, 0.3) * period
    return Rows(np.maximum(taken, 0.0), np.maximum(taken, 0.0) + 1e-9 * np.arange(times.size), _all(times))


def dropped(times: Array, rng: np.random.Generator) -> Rows:
    """One row in a hundred is lost, and once five in a row."""
    keep = rng.random(times.size) > 0.01
    first = int(rng.integers(times.size // 4, times.size // 2))
    keep[first : first + 5] = False
    keep[0] = True
    return Rows(times, times[keep], np.flatnonzero(keep))


def doubled(times: Array, rng: np.random.Generator) -> Rows:
    """One row in two hundred is written twice, with its stamp."""
    rows = np.repeat(_all(times), 1 + (rng.random(times.size) < 0.005))
    return Rows(times, times[rows], rows)


def bursts(times: Array, rng: np.random.Generator) -> Rows:
    """Rows wait in a buffer and are stamped when it is written: four to nine at a time."""
    period, stamps, at = times[1] - times[0], times.copy(), 0
    while at < times.size:
        end = min(at + int(rng.integers(4, 10)), times.size)
        stamps[at:end] = times[end - 1] + 0.02 * period * np.arange(end - at)
        at = end
    return Rows(times, stamps, _all(times))


def drifting(times: Array, rng: np.random.Generator) -> Rows:
    """The stamps' clock is fast by a ten-thousandth and wanders by a third of a period."""
    period = times[1] - times[0]
    wander = 0.3 * period * np.sin(2 * np.pi * times / rng.uniform(5.0, 9.0))
    return Rows(times, times * 1.0001 + wander, _all(times))


def written_late(times: Array, rng: np.random.Generator) -> Rows:
    """See `frozen.written_late`."""
    return Rows(times, late_stamps(times, rng), _all(times))


STAMPS: dict[str, Callable[[Array, np.random.Generator], Rows]] = {
    "even": even,
    "jitter": jitter,
    "uneven": uneven,
    "dropped": dropped,
    "doubled": doubled,
    "bursts": bursts,
    "drifting": drifting,
    "written_late": written_late,
}
