# SPDX-License-Identifier: BSD-3-Clause
r"""How bristles bend along a path (Dahl 1968).

Over a displacement dq in one direction their bend moves towards sgn(dq) by the share 1 - exp(-|dq| / stretch),
which is exact and knows no speed.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def bent(bristle: Array, moved: Array, stretch: Array | float) -> Array:
    """Gives the bristles' bend zeta in [-1, 1] after a displacement in one direction."""
    direction = np.sign(moved)
    return np.asarray(direction + (bristle - direction) * np.exp(-np.abs(moved) / stretch))


def follow(position: Array, stretch: float) -> Array:
    """Computes the bend (N,) along a path (N,), unbent at its start."""
    out = np.zeros(position.size)
    steps = np.diff(position)
    keep, direction = np.exp(-np.abs(steps) / stretch), np.sign(steps)
    bristle = 0.0
    for i in range(steps.size):
        bristle = direction[i] + (bristle - direction[i]) * keep[i]
        out[i + 1] = bristle
    return out
