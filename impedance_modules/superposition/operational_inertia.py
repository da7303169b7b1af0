# SPDX-License-Identifier: BSD-3-Clause
r"""What a push at a point of a mechanism meets: operational inertia, or mobility where that is singular.

\Lambda = (J (M + I_r)^-1 J^T)^-1 (thesis eq. 3.15, 4.26). At a singular posture the mechanism cannot move
in some direction; \Lambda does not exist there, while the mobility Y = J (M + I_r)^-1 J^T does.
(6, 6) matrices, linear then angular, world axes, at the named point. Ellipsoids show how large such a matrix, or one
of damping or stiffness, is in which direction.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.modules.mobility import carry_mobility, mobility
from impedance_modules.robot.pose import carry

LARGEST_CONDITION = 1e9
"""Condition number of the mobility (SI units) beyond which an inertia is said not to exist."""


@dataclass(frozen=True)
class OperationalInertia:
    """Inertia that a force at a point accelerates.

    Attributes:
        inertia: (6, 6) Lambda [kg, kg.m, kg.m^2]; None where the mechanism is singular.
        mobility: (6, 6) Y, its inverse, which always exists.
    """

    inertia: Array | None
    mobility: Array

    def carried(self, offset: Array) -> OperationalInertia:
        """Carries it to another point O of the same body; ``offset`` (3,) from O to here [m]."""
        inertia = None if self.inertia is None else carry_inertia(self.inertia, offset)
        return OperationalInertia(inertia, carry_mobility(self.mobility, offset))


def operational_inertia(jacobian: Array, inverse_inertia: Array) -> OperationalInertia:
    """Computes what a push at a frame meets.

    With (M + I_r)^-1 = C C^T and the triangular R of (J C)^T = Q R, Lambda = R^-1 R^-T: inverting R instead
    of Y = R^T R keeps twice the digits near singular postures.

    Args:
        jacobian: (6, k) J of the frame over the limb's joints.
        inverse_inertia: (k, k) (M + I_r)^-1 of the same joints; with I_r = 0 the bare links'.
    """
    found = mobility(jacobian, inverse_inertia)
    if jacobian.shape[1] < jacobian.shape[0]:  # fewer joints than directions: some cannot be moved in
        return OperationalInertia(None, found)
    triangle = np.linalg.qr((jacobian @ np.linalg.cholesky(inverse_inertia)).T, mode="r")
    if _exists(found, float(np.linalg.cond(triangle)) ** 2):
        half = np.linalg.inv(triangle)
        return OperationalInertia(half @ half.T, found)
    return OperationalInertia(None, found)


def from_mobility(found: Array) -> OperationalInertia:
    """Inverts a mobility where that means something (condition at most ``LARGEST_CONDITION``)."""
    if not _exists(found, float(np.linalg.cond(found))):
        return OperationalInertia(None, found)
    inverse = np.linalg.inv(found)
    return OperationalInertia(0.5 * (inverse + inverse.T), found)


def carry_inertia(at_hand: Array, offset: Array) -> Array:
    """Carries an inertia, damping or stiffness matrix from H to O: X^T Lambda_H X.

    Args:
        at_hand: (6, 6) at H, world axes.
        offset: (3,) from O to H [m]; X = ``carry(offset)`` maps O's twist to H's.
    """
    X = carry(offset)
    return X.T @ at_hand @ X


def without_reflected_inertia(inverse_inertia: Array, reflected_inertia: Array) -> Array:
    """Gives M^-1 from (M + I_r)^-1 (k, k) and I_r (k,), for comparison with the bare links."""
    links = np.linalg.inv(inverse_inertia) - np.diag(reflected_inertia)
    return np.asarray(np.linalg.inv(0.5 * (links + links.T)), dtype=np.float64)


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


def _exists(found: Array, condition: float) -> bool:
    return bool(np.any(found)) and condition <= LARGEST_CONDITION
