# SPDX-License-Identifier: BSD-3-Clause
"""Where bodies can touch: one point per hand, and small spheres on the rim of a held object.

A hand touches with the origin of its frame, so a surface is met where the hand frame meets it. A box
touches with its eight corners, a cylinder (axis z) with eight points of each rim, a sphere with itself.
"""

from __future__ import annotations

import itertools
import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Point = tuple[Array, float]

CORNER_RADIUS = 2e-3
"""Of the small spheres [m]; they lie inside the shape and touch its faces from within."""

RIM_POINTS = 8


def hand_point() -> Point:
    """Gives a hand's point of contact: centre (3,) in the hand frame [m], radius [m]."""
    return np.zeros(3), 0.0


def object_points(shape: str, size: tuple[float, ...]) -> tuple[Point, ...]:
    """Gives the object's points of contact: centres (3,) in its own axes [m], radii [m]."""
    if shape == "sphere":
        return ((np.zeros(3), 0.5 * size[0]),)
    radius = min(CORNER_RADIUS, 0.25 * min(size))
    if shape == "box":
        reach = [0.5 * edge - radius for edge in size]
        signs = itertools.product((-1.0, 1.0), repeat=3)
        return tuple((np.multiply(sign, reach), radius) for sign in signs)
    across, along = 0.5 * size[0] - radius, 0.5 * size[1] - radius
    angles = [2.0 * math.pi * k / RIM_POINTS for k in range(RIM_POINTS)]
    return tuple(
        (np.array([across * math.cos(angle), across * math.sin(angle), end]), radius)
        for end in (-along, along)
        for angle in angles
    )
