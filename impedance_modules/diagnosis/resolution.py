# SPDX-License-Identifier: BSD-3-Clause
"""The grid that a joint's positions were rounded to, read off the positions themselves."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

FINEST = 1e-9
"""Differences below it are rounding of the file [rad]."""

FEWEST = 20
"""Fewer gaps than this say nothing about a grid."""

NEAR = 20.0
"""Gaps of up to so many steps are compared with whole numbers of them."""


def grid_of(positions: Array) -> float:
    """Finds the step of the grid that positions (N,) lie on; zero where they lie on none.

    Args:
        positions: One joint's [rad or m].
    """
    places = np.unique(np.round(positions / FINEST)) * FINEST
    gaps = np.diff(places)
    if len(gaps) < FEWEST:
        return 0.0
    step = float(gaps.min())
    near = gaps[gaps < NEAR * step]
    counts = near / step
    on_grid = np.abs(counts - np.round(counts)) < 0.02 + FINEST / step
    return float(np.median(near / np.round(counts))) if len(near) >= FEWEST and on_grid.all() else 0.0
