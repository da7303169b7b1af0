# SPDX-License-Identifier: BSD-3-Clause
"""Motions that cannot separate two causes at one joint: one speed, one direction, one tone, no motion.

The other joints do just enough to be in the log. Every shape is exact: nothing is scaled or faded afterwards.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from benchmarks.blind.excitation import fade_in, smooth

Array = NDArray[np.float64]

PoorShape = Callable[[Array, np.random.Generator], Array]
"""Time (samples,) -> deviation of the one joint from the centre (samples,) [rad]."""


def one_speed(time: Array, rng: np.random.Generator) -> Array:
    """Back and forth at one speed, without a rest."""
    speed, period = rng.uniform(0.1, 0.2), rng.uniform(4.0, 6.0)
    return _triangle(time + 0.25 * period, period, speed)


def one_speed_small(time: Array, rng: np.random.Generator) -> Array:
    """As `one_speed`, so small that the arm's weight hardly changes."""
    return _triangle(time + rng.uniform(0.0, 0.5), rng.uniform(0.8, 1.2), 0.08)


def one_way(time: Array, rng: np.random.Generator) -> Array:
    """Creeps in one direction from before the first sample until after the last."""
    return np.asarray(rng.uniform(0.02, 0.03) * (time - 0.5 * time[-1]) * rng.choice([-1.0, 1.0]))


def held(time: Array, rng: np.random.Generator) -> Array:  # noqa: ARG001
    """Does not move."""
    return np.zeros(time.size)


def slow_tone(time: Array, rng: np.random.Generator) -> Array:
    """One slow sinusoid."""
    return np.asarray(0.45 * fade_in(time) * np.sin(2 * np.pi * rng.uniform(0.2, 0.35) * time))


def _triangle(time: Array, period: float, speed: float) -> Array:
    part = (time / period) % 1.0
    wave = 4 * np.abs(part - 0.5) - 1.0
    return smooth(wave * speed * period / 4, 0.06)
