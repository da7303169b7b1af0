# SPDX-License-Identifier: BSD-3-Clause
r"""Whether time stamps say when a sample was taken, or only when somebody wrote it down.

A drive samples by its own clock; a logger stamps when it comes to it. A stamp that is wrong by \delta makes a
position wrong by v \delta, and two differentiations make a torque of that. Which of the two it was the positions say
themselves: at the right times they are smooth.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

Array = NDArray[np.float64]

SMOOTHER = 0.8
"""Evenly counted samples are believed if they leave less than this part of the stamps' roughness."""

EVEN = 1e-3
"""Stamps that are even to this part of a step need no second opinion."""

APART = 0.5
"""Counted times further from any stamp than this part of a step mean that samples were not even."""


def steady_stamps(time: Array, position: Array) -> Array:
    """Gives the times at which samples were taken, (N,): as stamped, or evenly counted where that is smoother.

    Args:
        time: (N,) stamps [s].
        position: (N, n) [rad].
    """
    steps = np.diff(time)
    if len(time) < 4 or np.any(steps <= 0.0):
        return time
    step = float(np.median(steps))
    index = np.concatenate([[0.0], np.cumsum(np.maximum(np.round(steps / step), 1.0))])
    counted = np.polyval(np.polyfit(index, time, 1), index)
    off = np.abs(counted - time).max() / step
    if off < EVEN or off > APART:
        return time
    return counted if _roughness(counted, position) < SMOOTHER * _roughness(time, position) else time


def _roughness(time: Array, position: Array) -> float:
    """Third differences at even times, of each joint over its motion, (rms)."""
    even = np.linspace(time[0], time[-1], len(time))
    third = np.diff(CubicSpline(time, position, axis=0)(even), 3, axis=0)
    size = position.std(axis=0)
    return (
        float(np.sqrt(np.mean((third[:, size > 0.0] / size[size > 0.0]) ** 2))) if np.any(size > 0.0) else 0.0
    )
