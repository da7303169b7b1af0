# SPDX-License-Identifier: BSD-3-Clause
"""Readings of all joints at once, compiled: noise, grid, and the filtered velocity."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from impedance_modules.compiled import compiled

Array = NDArray[np.float64]

OFFSET, LAG_SHARE, POSITION, ESTIMATE, VELOCITY = range(5)
"""Rows of the readings: encoder offset [rad], share of the estimate passed on, and what was last reported."""


@compiled
def read_encoders(
    readings: Array, truth: Array, noise: Array, grid: float, period: float, share: float
) -> None:
    """Measures the true positions (n,) once more, ``period`` [s] after the last, and follows with the velocity.

    ``noise`` (n,) is added before rounding to ``grid`` [rad]; ``share`` of a new difference enters the estimate.
    """
    for i in range(truth.size):
        measured = on_grid(truth[i] + readings[OFFSET, i] + noise[i], grid)
        difference = (measured - readings[POSITION, i]) / period
        readings[ESTIMATE, i] += share * (difference - readings[ESTIMATE, i])
        readings[VELOCITY, i] += readings[LAG_SHARE, i] * (readings[ESTIMATE, i] - readings[VELOCITY, i])
        readings[POSITION, i] = measured


@compiled
def report(readings: Array, load: Array, noise: Array, grid: float, out: Array) -> None:
    """Writes position, velocity and effort (3, n); the effort is ``load`` (n,) with noise, on its grid [N.m]."""
    for i in range(load.size):
        out[0, i], out[1, i] = readings[POSITION, i], readings[VELOCITY, i]
        out[2, i] = on_grid(load[i] + noise[i], grid)


@compiled
def on_grid(value: float, grid: float) -> float:
    """Rounds to the nearest multiple of ``grid``; 0 leaves the value as it is."""
    return float(np.rint(value / grid) * grid) if grid > 0.0 else value
