# SPDX-License-Identifier: BSD-3-Clause
"""Varieties that development never uses: an arm, a fault of stamps, a controller, a law of friction, a kind of noise.

This file's SHA-256 stands in `frozen_seals.txt`; recordings with them are made by `generate --frozen` alone, which
refuses a changed file.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]

FROZEN: dict[str, str] = {
    "robot": "panda",
    "stamps": "written_late",
    "controller": "policy",
    "friction": "dahl",
    "noise": "growing_with_load",
}
"""Dimension -> its value that development never draws."""
HELD = 50
"""Control periods for which a policy's target stays (20 Hz at 1 kHz)."""
PANDA = "panda_description/urdf/panda.urdf"
"""Within the example-robot-data package."""


@njit(cache=True)
def dahl(record, z, v, level, step):
    """Dahl's law with exponent two over one step: dz/dx = (1 - z s0 sgn(v) / level)^2; returns torque and new z."""
    if level <= 0.0 or record.s0 <= 0.0:
        return 0.0, 0.0
    way = math.copysign(1.0, v)
    reach = level / record.s0
    left = max(1.0 - way * z / reach, 0.0)
    after = way * reach * (1.0 - left / (1.0 + left * abs(v) * step / reach))
    return record.s0 * after, after


def policy_target(position: Array, speed: Array, rng: np.random.Generator) -> Array:
    """Returns the next target (n,) of a learned policy: near the path, and jumping by a tenth of a step [rad]."""
    step = float(np.abs(speed).max()) * HELD * 0.001
    return np.asarray(position + 0.1 * step * rng.standard_normal(position.size))


def written_late(times: Array, rng: np.random.Generator) -> Array:
    """Returns stamps (m,) [s] of rows that are stamped when they are written: 1 to 5 ms late, one in fifty much later.

    A late row holds up those after it, so stamps never run backwards.
    """
    period = float(times[1] - times[0])
    late = rng.uniform(0.001, 0.005) + rng.exponential(0.05 * period, times.size)
    late += np.where(rng.random(times.size) < 0.02, rng.uniform(0.5, 3.0, times.size) * period, 0.0)
    stamps = np.maximum.accumulate(times + late)
    return np.asarray(stamps + 1e-6 * period * np.arange(times.size))


def load_share(load: Array, least: Array) -> Array:
    """Returns the factor of noise (samples, n) at torques ``load`` [N.m]: one at rest, growing by 2 % of the load."""
    return np.asarray(np.sqrt(1.0 + (0.02 * load / least) ** 2))
