# SPDX-License-Identifier: BSD-3-Clause
r"""Rotations as rotation vectors: exponential, logarithm, and the logarithm's Jacobian.

A rotation vector \phi = \theta a turns by \theta about the unit axis a. All functions take and
return float64 arrays of shape (3,) or (3, 3).

Reference: J. Solà, J. Deray, D. Atchuthan, "A micro Lie theory for state estimation in robotics", 2018.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

SMALL_ANGLE = 1e-4
"""Below this angle [rad] series replace quotients; their error is then below 1e-18."""


def skew(vector: Array) -> Array:
    """Returns the matrix of the cross product, ``skew(a) @ b == cross(a, b)``."""
    x, y, z = vector
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def exp3(rotation_vector: Array) -> Array:
    r"""Turns a rotation vector [rad] into a rotation matrix (Rodrigues).

    R = I + (sin \theta / \theta) [\phi] + ((1 - cos \theta) / \theta^2) [\phi]^2
    """
    phi = skew(np.asarray(rotation_vector, dtype=float))
    angle = math.sqrt(float(np.dot(rotation_vector, rotation_vector)))
    if angle < SMALL_ANGLE:
        first, second = 1.0 - angle**2 / 6.0, 0.5 - angle**2 / 24.0
    else:
        first, second = math.sin(angle) / angle, (1.0 - math.cos(angle)) / angle**2
    return np.eye(3) + first * phi + second * (phi @ phi)


def log3(rotation: Array) -> Array:
    r"""Turns a rotation matrix into the rotation vector [rad] of length at most \pi.

    Continuous for angles below \pi. At \pi itself, the cut, both signs describe the same rotation and
    one of them is returned.
    """
    vector = 0.5 * np.array(
        [
            rotation[2, 1] - rotation[1, 2],
            rotation[0, 2] - rotation[2, 0],
            rotation[1, 0] - rotation[0, 1],
        ]
    )
    sine = math.sqrt(float(vector @ vector))
    cosine = 0.5 * (float(np.trace(rotation)) - 1.0)
    angle = math.atan2(sine, cosine)
    if angle < SMALL_ANGLE:
        return vector * (1.0 + angle**2 / 6.0)
    if cosine > -0.99:
        return vector * (angle / sine)
    return _log3_near_cut(rotation, vector, angle, cosine)


def rotation_angle(rotations: Array) -> Array:
    r"""Gives the angle in [0, \pi] of each rotation of a stack (..., 3, 3), (...) [rad].

    \theta = atan2(|sin|, cos): exact near 0 and near half a turn, and the length of ``log3``.
    """
    turned = rotations - np.swapaxes(rotations, -1, -2)
    sine = 0.5 * np.sqrt(turned[..., 2, 1] ** 2 + turned[..., 0, 2] ** 2 + turned[..., 1, 0] ** 2)
    cosine = 0.5 * (np.trace(rotations, axis1=-2, axis2=-1) - 1.0)
    return np.asarray(np.arctan2(sine, cosine))


def _log3_near_cut(rotation: Array, vector: Array, angle: float, cosine: float) -> Array:
    """Takes the axis from the symmetric part, where the sine is too small to divide by."""
    symmetric = 0.5 * (rotation + rotation.T) - cosine * np.eye(3)
    column = int(np.argmax(np.diag(symmetric)))
    axis = symmetric[:, column] / np.linalg.norm(symmetric[:, column])
    if float(axis @ vector) < 0.0:
        axis = -axis
    return np.asarray(angle * axis)


def log_jacobian(rotation_vector: Array) -> Array:
    r"""Gives how the rotation vector changes when the body turns by a small world-axes rotation.

    log(exp(\delta) R) = log(R) + J \delta + O(\delta^2), with the inverse left Jacobian
    J = I - [\phi] / 2 + (1 / \theta^2 - (1 + cos \theta) / (2 \theta sin \theta)) [\phi]^2.

    Finite up to and including the cut at \theta = \pi.
    """
    phi = skew(np.asarray(rotation_vector, dtype=float))
    angle = math.sqrt(float(np.dot(rotation_vector, rotation_vector)))
    if angle < SMALL_ANGLE:
        second = 1.0 / 12.0 + angle**2 / 720.0
    else:
        half = 0.5 * angle
        second = (1.0 - half * math.cos(half) / math.sin(half)) / angle**2
    return np.eye(3) - 0.5 * phi + second * (phi @ phi)
