# SPDX-License-Identifier: BSD-3-Clause
"""Where to cut the only motion there is: stretches that move about equally, each with its filter's run-in."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from impedance_modules.diagnosis.data.log import InsufficientData, Log

Array = NDArray[np.float64]

RUN_IN = 0.13
"""What a filter of the widest band (20 Hz) throws away at each end [s]; a filter of a narrower one throws more away."""

STRETCHES = 6
"""Most stretches that one motion is cut into."""

STRETCH_MIN = 2.0
"""Stretches are at least so long where there is time for it [s]."""

SHORTEST = 0.6
"""Part of it that is enough for the fewest stretches; shorter ones of equal motion give way to those of equal time."""

STRETCHES_MIN = 4
"""Fewest: one is held out, and what is left still makes folds."""

CALM_SHARE = 0.3
"""Part of a stretch's worth that goes by time alone, so that rest is not one endless stretch."""

PACE = 20.0
"""Rate at which motion is summed up; faster differences are mostly noise [Hz]."""


def cut(motion: Sequence[Log], useful: float, run_in: float = 0.0) -> list[list[Log]]:
    """Cuts one motion, its repeats alike, into stretches of about equal motion, in order of time.

    A stretch overlaps its neighbours by what the filter throws away, so that no sample counts twice and none is lost.

    Args:
        motion: A recording and its repeats.
        useful: What must be left of a stretch [s].
        run_in: What the filter throws away at each end [s].

    Raises:
        InsufficientData: Too short to fit on one part and to test on another.
    """
    shortest = min(motion, key=lambda log: log.samples)
    run_in = max(run_in, RUN_IN)
    left = shortest.duration - 2.0 * run_in
    least = max(SHORTEST * STRETCH_MIN, useful)
    pieces = min(STRETCHES, max(int((left + 2.0 * RUN_IN) / max(STRETCH_MIN, useful)), STRETCHES_MIN))
    if left < pieces * least:
        raise InsufficientData(
            f"{shortest.name}: {shortest.duration:.3g} s is too short to fit one part and test on another"
            f" (valid: {pieces * least + 2.0 * run_in:.2g} s, or several recordings)"
        )
    edges = _edges(shortest, pieces, least, run_in)
    return [[_piece(log, edges, index, run_in) for log in motion] for index in range(pieces)]


def _edges(log: Log, pieces: int, least: float, run_in: float) -> list[int]:
    """Sample numbers between which every stretch is worth the same, or lasts as long if one were too short [s]."""
    step = max(1, round(log.rate / PACE))
    path = np.abs(np.diff(log.position[::step], axis=0))
    whole = path.sum(axis=0)
    moving = whole > 0.0
    motion = (path[:, moving] / whole[moving]).mean(axis=1) if moving.any() else np.zeros(len(path))
    worth = np.concatenate([[0.0], np.cumsum((1.0 - CALM_SHARE) * motion + CALM_SHARE / len(path))])
    found = np.interp(np.linspace(0.0, worth[-1], pieces + 1), worth, step * np.arange(len(worth)))
    lost = run_in * log.rate
    kept = np.diff(np.concatenate([[lost], found[1:-1], [log.samples - lost]]))
    if kept.min() < least * log.rate:
        found = np.linspace(lost, log.samples - lost, pieces + 1)  # nearly all motion in one place
    return [0, *(round(edge) for edge in found[1:-1]), log.samples]


def _piece(log: Log, edges: Sequence[int], index: int, run_in: float) -> Log:
    over = int(run_in * log.rate)
    last = index + 2 == len(edges)
    first, stop = max(0, edges[index] - over), log.samples if last else edges[index + 1] + over
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
