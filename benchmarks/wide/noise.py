# SPDX-License-Identifier: BSD-3-Clause
"""Noise of the sensors, by kind; drawn before a run, so that a run with and one without an effect have the same."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from benchmarks.wide.frozen import load_share
from benchmarks.wide.plan import PERIOD, Sensing

Array = NDArray[np.float64]

IDEAL = 1e-12
"""Grid [rad] of a sensor that rounds nothing."""
MEMORY = 0.008
"""Time constant of coloured noise [s]."""


class Noise:
    """Noise of one run, and the sensors' grids.

    Attributes:
        positions: (samples, 2, n), of which the first row is added to positions [rad].
        position_grid: [rad].
    """

    def __init__(self, sensing: Sensing, drawn: Array) -> None:
        """Takes the sensors and what was drawn for them, (samples, 2, n); zeros make ideal sensors."""
        self._sensing, self._efforts, self._ideal = sensing, drawn[:, 1], not drawn.any()
        self.positions = drawn
        self.position_grid = IDEAL if self._ideal else sensing.position_grid

    def add_to_efforts(self, told: Array, felt: Array) -> Array:
        """Returns efforts (samples, n) with noise, on their grid; ``felt`` is the torque through the sensor [N.m]."""
        if self._ideal:
            return told
        noise, grid = self._efforts, self._sensing.effort_grid
        if self._sensing.noise == "growing_with_load":
            noise = noise * load_share(felt, self._sensing.effort_noise)
        return np.asarray(np.round((told + noise) / grid) * grid)


def white(source: np.random.Generator, shape: tuple[int, int, int]) -> Array:
    """Returns independent samples."""
    return source.standard_normal(shape)


def coloured(source: np.random.Generator, shape: tuple[int, int, int]) -> Array:
    """Returns white noise of positions and noise of efforts that remembers for some milliseconds."""
    drawn = source.standard_normal(shape)
    keep = np.exp(-PERIOD / MEMORY)
    drawn[:, 1] = lfilter([np.sqrt(1 - keep**2)], [1.0, -keep], drawn[:, 1], axis=0)
    return drawn


def quantised(source: np.random.Generator, shape: tuple[int, int, int]) -> Array:
    """Returns little more than what dithers a coarse grid: half of white noise."""
    return 0.5 * source.standard_normal(shape)


KINDS: dict[str, Callable[[np.random.Generator, tuple[int, int, int]], Array]] = {
    "white": white,
    "coloured": coloured,
    "quantised": quantised,
    "growing_with_load": white,
}


def draw_noise(sensing: Sensing, count: int, n: int, seed: int | None) -> Noise:
    """Draws a run's noise; without a seed the sensors are ideal, grids included."""
    if seed is None:
        return Noise(sensing, np.zeros((count, 2, n)))
    drawn = KINDS[sensing.noise](np.random.default_rng(seed), (count, 2, n))
    drawn[:, 0] *= sensing.position_noise
    drawn[:, 1] *= sensing.effort_noise
    return Noise(sensing, drawn)
