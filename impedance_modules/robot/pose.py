# SPDX-License-Identifier: BSD-3-Clause
r"""Pose of one frame in another, X_AB, and what it does to twists and wrenches.

Notation: X_AB turns coordinates in B into coordinates in A, p_A = R_AB p_B + p_AB. Twists V = (v, w)
and wrenches F = (f, t) are ordered linear, angular.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.robot.rotation import skew


@dataclass(frozen=True)
class Pose:
    """Rotation (3, 3) and translation (3,) [m] of a frame B in a frame A."""

    rotation: Array
    translation: Array

    @staticmethod
    def identity() -> Pose:
        """Returns the pose that changes nothing."""
        return Pose(np.eye(3), np.zeros(3))

    def __matmul__(self, other: Pose) -> Pose:
        """Composes X_AB @ X_BC = X_AC."""
        return Pose(self.rotation @ other.rotation, self.rotation @ other.translation + self.translation)

    def inverse(self) -> Pose:
        """Returns X_BA."""
        return Pose(self.rotation.T, -self.rotation.T @ self.translation)


def carry(offset: Array) -> Array:
    r"""Maps the twist at one point of a rigid body to the twist at another, both in world axes.

    V_H = X V_O with X = [[I, -[r]], [0, I]], r = p_OH the offset from O to H [m], world axes.
    Its transpose carries a wrench the other way: F_O = X^T F_H.

    Returns:
        (6, 6) matrix X.
    """
    X = np.eye(6)
    X[:3, 3:] = -skew(offset)
    return X


def rotate_six(rotation: Array) -> Array:
    """Returns the (6, 6) matrix that turns both halves of a six-vector by ``rotation``."""
    turned = np.zeros((6, 6))
    turned[:3, :3] = rotation
    turned[3:, 3:] = rotation
    return turned
