# SPDX-License-Identifier: BSD-3-Clause
r"""Reported velocities that were computed from the reported positions say nothing that those do not say.

Many loggers store differences of the logged positions as velocities:

    v_k = a (q_k - q_{k-1}) / h_k + b (q_{k+1} - q_k) / h_{k+1}

backward (b = 0), forward (a = 0) or central (a = b = 1/2, or weighted by the steps), h the steps of the stamps or of
the clock. Such a velocity has the positions' noise and no other, and the differences' own frequency response, which
is no filter of the robot. Compared with the derivative of the positions it would look like physics.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from impedance_modules.arrays import Array

ORDER = 6
"""Of the differences that show the noise of positions: a motion has next to nothing left there."""

NEAR = 0.1
"""Part of the noise that differences of the positions have; a velocity that is nearer to them was made of them."""

MOST_ROWS = 0.8
"""Part of the rows that must be so near: lost rows, and the ends, are not."""

LEAST_NOISE = math.sqrt(0.5)
"""Noise of a difference over one step, in units of the positions' noise per step: that of central ones, the least."""

MEDIAN_OF_NORMAL = 0.6745
"""Median size of a normal variable, in standard deviations."""

ROWS_MIN = 50
"""Fewest rows that tell."""

WHOLE = 0.1
"""By how much the weights of both slopes may differ from one in sum: lost rows lengthen the mean step."""

FITS = 3
"""Rounds of the fit, each on the rows that fitted best before."""


def computed_joints(velocity: Array, position: Array, time: Array) -> NDArray[np.bool_]:
    """Marks the joints (n,) whose velocities (N, n) are differences of positions (N, n) at stamps (N,) [s].

    Joints that stand still, and positions without noise, tell nothing: they are taken to be as all others are, where
    these agree, and not to be computed where they differ.
    """
    told = [_is_difference(*columns, time) for columns in zip(velocity.T, position.T, strict=True)]
    known = [one for one in told if one is not None]
    everywhere = bool(known) and all(known)
    return np.array([everywhere if one is None else one for one in told])


def _is_difference(velocity: Array, position: Array, time: Array) -> bool | None:
    """Says it of one joint; None where nothing can be told."""
    steps = np.diff(time)
    noise = LEAST_NOISE * _noise(position) / float(np.mean(steps))
    if noise == 0.0 or not velocity.any() or len(position) < ROWS_MIN:
        return None
    return any(_fits(velocity[1:-1], slopes, NEAR * noise) for slopes in _slopes(position, steps))


def _noise(position: Array) -> float:
    """White noise of positions (N,) by their differences of a high order, (rms)."""
    differences = np.abs(np.diff(position, ORDER))
    return float(np.median(differences) / MEDIAN_OF_NORMAL / np.sqrt(math.comb(2 * ORDER, ORDER)))


def _slopes(position: Array, steps: Array) -> Iterator[Array]:
    """Gives the backward and the forward slope at the inner rows, (N - 2, 2), by three ways to count the time."""
    before, after = np.diff(position)[:-1], np.diff(position)[1:]
    # The mean: rows that waited in a buffer are stamped together.
    yield np.column_stack([before, after]) / float(np.mean(steps))
    backward, forward = before / steps[:-1], after / steps[1:]
    yield np.column_stack([backward, forward])
    share = steps[1:] / (steps[:-1] + steps[1:])
    yield 2.0 * np.column_stack([share * backward, (1.0 - share) * forward])


def _fits(velocity: Array, slopes: Array, near: float) -> bool:
    """Says whether some mean of two slopes (M, 2) is within ``near`` of the velocity (M,) in most rows."""
    left = np.abs(velocity - slopes.mean(axis=1))
    for _ in range(FITS):
        kept = left <= np.quantile(left, MOST_ROWS)
        weights = np.linalg.lstsq(slopes[kept], velocity[kept], rcond=None)[0]
        left = np.abs(velocity - slopes @ weights)
    whole = abs(float(weights.sum()) - 1.0) < WHOLE
    return whole and float(np.quantile(left, MOST_ROWS)) <= near
