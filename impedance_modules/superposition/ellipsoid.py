# SPDX-License-Identifier: BSD-3-Clause
"""Ellipsoids of the 3x3 blocks of inertia, mobility, damping and stiffness: how much, in which direction."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Ellipsoid:
    """Principal values of a symmetric 3x3 matrix A: the push along u is u^T A u per unit motion.

    Attributes:
        half_axes: (..., 3) eigenvalues in ascending order, in the matrix's units. A negative one marks a
            direction of unstable stiffness; nothing is squared or rooted.
        directions: (..., 3, 3) right-handed unit vectors in world axes, one per column.
    """

    half_axes: Array
    directions: Array


def ellipsoid(block: Array) -> Ellipsoid:
    """Finds the principal axes of the symmetric part of a (3, 3) block, or of each in a stack (..., 3, 3)."""
    values, vectors = np.linalg.eigh(0.5 * (block + np.swapaxes(block, -1, -2)))
    vectors[np.linalg.det(vectors) < 0.0, :, 2] *= -1.0
    return Ellipsoid(values, vectors)


def linear_ellipsoid(matrix: Array) -> Ellipsoid:
    """Takes the linear block of a (6, 6): the hand moves without turning."""
    return ellipsoid(matrix[:3, :3])


def angular_ellipsoid(matrix: Array) -> Ellipsoid:
    """Takes the angular block of a (6, 6): the hand turns about its origin without moving."""
    return ellipsoid(matrix[3:, 3:])


def apparent_mass(mobility: Array, direction: Array) -> float | None:
    """Gives the mass that a push on a hand free to turn meets, 1 / (u^T Y_v u) [kg].

    Args:
        mobility: (6, 6) Y at the hand.
        direction: (3,) unit vector u of the push, world axes.

    Returns:
        The mass; None where the hand cannot move that way at all.
    """
    admitted = float(direction @ mobility[:3, :3] @ direction)
    return None if admitted <= 0.0 else 1.0 / admitted
