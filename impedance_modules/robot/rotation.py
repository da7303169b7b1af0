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

from impedance_modules.compiled import compiled

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


@compiled
def dot(a: Array, b: Array) -> float:
    """Returns a . b of two vectors (3,)."""
    return float(a[0] * b[0] + a[1] * b[1] + a[2] * b[2])


@compiled
def add_cross(a: Array, b: Array, out: Array) -> None:
    """Adds a x b to ``out`` (3,)."""
    out[0] += a[1] * b[2] - a[2] * b[1]
    out[1] += a[2] * b[0] - a[0] * b[2]
    out[2] += a[0] * b[1] - a[1] * b[0]


@compiled
def turn(rotation: Array, vector: Array, out: Array) -> None:
    """Writes R v into ``out`` (3,), which must not be ``vector``."""
    for i in range(3):
        out[i] = rotation[i, 0] * vector[0] + rotation[i, 1] * vector[1] + rotation[i, 2] * vector[2]


@compiled
def turn_back(rotation: Array, vector: Array, out: Array) -> None:
    """Writes R^T v into ``out`` (3,), which must not be ``vector``."""
    for i in range(3):
        out[i] = rotation[0, i] * vector[0] + rotation[1, i] * vector[1] + rotation[2, i] * vector[2]


@compiled
def compose(a: Array, b: Array, out: Array) -> None:
    """Writes A B into ``out`` (3, 3), which must be neither."""
    for i in range(3):
        for j in range(3):
            out[i, j] = a[i, 0] * b[0, j] + a[i, 1] * b[1, j] + a[i, 2] * b[2, j]


@compiled
def exponential(vector: Array, out: Array) -> None:
    """Writes the rotation matrix of a rotation vector [rad] into ``out`` (3, 3) (Rodrigues)."""
    x, y, z = vector[0], vector[1], vector[2]
    square = x * x + y * y + z * z
    angle = math.sqrt(square)
    if angle < 1e-4:
        first, second = 1.0 - square / 6.0, 0.5 - square / 24.0
    else:
        first, second = math.sin(angle) / angle, (1.0 - math.cos(angle)) / square
    out[0, 0] = 1.0 - second * (y * y + z * z)
    out[1, 1] = 1.0 - second * (x * x + z * z)
    out[2, 2] = 1.0 - second * (x * x + y * y)
    out[0, 1], out[1, 0] = second * x * y - first * z, second * x * y + first * z
    out[0, 2], out[2, 0] = second * x * z + first * y, second * x * z - first * y
    out[1, 2], out[2, 1] = second * y * z - first * x, second * y * z + first * x


@compiled
def logarithm(rotation: Array, out: Array) -> None:
    """Writes the rotation vector [rad] of a rotation well below half a turn into ``out`` (3,)."""
    out[0] = 0.5 * (rotation[2, 1] - rotation[1, 2])
    out[1] = 0.5 * (rotation[0, 2] - rotation[2, 0])
    out[2] = 0.5 * (rotation[1, 0] - rotation[0, 1])
    sine = math.sqrt(out[0] * out[0] + out[1] * out[1] + out[2] * out[2])
    cosine = 0.5 * (rotation[0, 0] + rotation[1, 1] + rotation[2, 2] - 1.0)
    angle = math.atan2(sine, cosine)
    scale = 1.0 + angle * angle / 6.0 if angle < 1e-4 else angle / sine
    for i in range(3):
        out[i] *= scale


@compiled
def add_rotation_rate(vector: Array, velocity: Array, out: Array) -> None:
    r"""Adds the rate of a rotation vector \phi, exp(\phi) turning from a fixed start, at velocity \omega.

    \phi' = \omega - [\phi]\omega / 2 + [\phi]^2 \omega / 12, up to fourth order in \phi; world axes.
    """
    x = vector[1] * velocity[2] - vector[2] * velocity[1]
    y = vector[2] * velocity[0] - vector[0] * velocity[2]
    z = vector[0] * velocity[1] - vector[1] * velocity[0]
    out[0] += velocity[0] - 0.5 * x + (vector[1] * z - vector[2] * y) / 12.0
    out[1] += velocity[1] - 0.5 * y + (vector[2] * x - vector[0] * z) / 12.0
    out[2] += velocity[2] - 0.5 * z + (vector[0] * y - vector[1] * x) / 12.0
