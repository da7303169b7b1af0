# SPDX-License-Identifier: BSD-3-Clause
"""Where to cut the only motion there is: stretches that move about equally, each with its filter's run-in."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from impedance_modules.diagnosis.log import InsufficientData, Log

Array = NDArray[np.float64]

RUN_IN = 0.13
"""What a filter of the widest band (20 Hz) throws away at each end [s]; stretches overlap by it on both sides."""

STRETCHES = 6
"""Most stretches that one motion is cut into."""

STRETCH_MIN = 2.0
"""Shortest stretch that is worth a fold [s]."""

SHORTEST = 0.6
"""Part of `STRETCH_MIN` below which stretches of equal motion give way to stretches of equal time."""

STRETCHES_MIN = 4
"""Fewest: one is held out, and what is left still makes folds."""

CALM_SHARE = 0.3
"""Part of a stretch's worth that goes by time alone, so that rest is not one endless stretch."""

PACE = 20.0
"""Rate at which motion is summed up; faster differences are mostly noise [Hz]."""


def cut(motion: Sequence[Log], useful: float) -> list[list[Log]]:
    """Cuts one motion, its repeats alike, into stretches of about equal motion, in order of time.

    A stretch overlaps its neighbours by what the filter throws away at least, so that no sample counts twice.

    Args:
        motion: A recording and its repeats.
        useful: Shortest stretch that the band leaves anything of [s].

    Raises:
        InsufficientData: Too short to fit on one part and to test on another.
    """
    shortest = min(motion, key=lambda log: log.samples)
    least = max(STRETCH_MIN, useful)
    pieces = min(STRETCHES, int(shortest.duration / least))
    if pieces < STRETCHES_MIN:
        raise InsufficientData(
            f"{shortest.name}: {shortest.duration:.3g} s is too short to fit one part and test on another"
            f" (valid: {STRETCHES_MIN * least:.2g} s, or several recordings)"
        )
    edges = _edges(shortest, pieces, max(SHORTEST * STRETCH_MIN, useful - 2.0 * RUN_IN))
    return [[_piece(log, edges, index) for log in motion] for index in range(pieces)]


def _edges(log: Log, pieces: int, least: float) -> list[int]:
    """Sample numbers between which every stretch is worth the same, or lasts as long if one were too short [s]."""
    step = max(1, round(log.rate / PACE))
    path = np.abs(np.diff(log.position[::step], axis=0))
    whole = path.sum(axis=0)
    moving = whole > 0.0
    motion = (path[:, moving] / whole[moving]).mean(axis=1) if moving.any() else np.zeros(len(path))
    worth = np.concatenate([[0.0], np.cumsum((1.0 - CALM_SHARE) * motion + CALM_SHARE / len(path))])
    found = np.interp(np.linspace(0.0, worth[-1], pieces + 1), worth, step * np.arange(len(worth)))
    found[-1] = log.samples
    if np.diff(found).min() < least * log.rate:
        found = np.linspace(0.0, log.samples, pieces + 1)  # nearly all motion in one place
    return [round(edge) for edge in found]


def _piece(log: Log, edges: Sequence[int], index: int) -> Log:
    run_in = int(RUN_IN * log.rate)
    last = index + 2 == len(edges)
    first, stop = max(0, edges[index] - run_in), log.samples if last else edges[index + 1] + run_in
    return log.part(first, min(stop, log.samples), f"[{index + 1}/{len(edges) - 1}]")


def most_typical(pieces: Sequence[Sequence[Log]]) -> int:
    """Finds the stretch in which the joint that moves least, compared with its average, moves most."""
    size = np.array([np.ptp(piece[0].position, axis=0) for piece in pieces])
    usual = size.mean(axis=0)
    moving = usual > 0.0
    if not moving.any():
        return len(pieces) - 1
    share = (size[:, moving] / usual[moving]).min(axis=1)
    return int(len(share) - 1 - np.argmax(share[::-1]))
