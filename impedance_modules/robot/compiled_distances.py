# SPDX-License-Identifier: BSD-3-Clause
"""How measured distances change with the joints, and how long each cannot matter: see ``distances``."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from impedance_modules.compiled import compiled

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


@compiled
def free_time(
    distance: float,
    closing: float,
    margin: float,
    approach_time: float,
    horizon: float,
    quickest: float,
    longest: float,
) -> float:
    """Bounds from below how long a pair cannot matter [s]; ``Distances.free_time`` says of what."""
    closing = max(closing, 0.0)
    room = distance - margin - (closing + quickest * horizon) * approach_time
    if room <= 0.0:
        return 0.0
    slope = quickest * approach_time + closing
    return min(longest, (math.sqrt(slope * slope + 2.0 * quickest * room) - slope) / quickest)


@compiled
def book(
    pairs: Indices,
    shapes: Indices,
    found: Array,
    jacobian: Array,
    moving: Array,
    velocity: Array,
    constants: Array,
    cycle: int,
    distance: Array,
    gradient: Array,
    due: Indices,
) -> None:
    """Writes down what was measured in one cycle, and when each pair is measured again.

    Args:
        pairs: (m,) which ones.
        shapes: (m,) the nearest pair of shapes of each.
        found: (m, 7) distance [m], normal, closest point on the first shape (world axes).
        jacobian: (6, n) the joints' twists at the world's origin, linear then angular.
        moving: (shape pairs, n) 1 where a joint moves the second shape, -1 the first, 0 both or none.
        velocity: (n,) of the joints [rad/s].
        constants: (6,) margin, approach time, horizon, quickest, longest, period.
        cycle: Now.
        distance: (pairs,) [m]; overwritten, as the following.
        gradient: (pairs, n) G; zero where a pair cannot matter in this cycle.
        due: (pairs,) cycle in which each is measured again.
    """
    n = velocity.size
    margin, approach_time, horizon, quickest, longest, period = constants
    for k in range(pairs.size):
        pair = pairs[k]
        x, y, z = found[k, 1], found[k, 2], found[k, 3]
        a, b, c = found[k, 4], found[k, 5], found[k, 6]
        # n . velocity of a point p of a link is n . v_0 + (p x n) . w; both closest points lie on one line along n.
        p, q, r = b * z - c * y, c * x - a * z, a * y - b * x
        rate = 0.0
        for j in range(n):
            mark = moving[shapes[k], j]
            entry = 0.0
            if mark != 0.0:
                entry = mark * (
                    x * jacobian[0, j]
                    + y * jacobian[1, j]
                    + z * jacobian[2, j]
                    + p * jacobian[3, j]
                    + q * jacobian[4, j]
                    + r * jacobian[5, j]
                )
            gradient[pair, j] = entry
            rate += entry * velocity[j]
        free = free_time(found[k, 0], -rate, margin, approach_time, horizon, quickest, longest)
        distance[pair] = found[k, 0]
        if free >= period:
            gradient[pair] = 0.0
        due[pair] = _slot(due, cycle, cycle + max(1, int(free / period)))


@compiled
def _slot(due: Indices, cycle: int, latest: int) -> int:
    """Finds the last cycle up to ``latest`` in which nothing else is due yet; the next one if there is none."""
    while latest > cycle + 1 and (due == latest).any():
        latest -= 1
    return latest
