# SPDX-License-Identifier: BSD-3-Clause
r"""Rotations: exponential, logarithm and its Jacobian, and the small vector products of the laws.

A rotation vector \phi = \theta a turns by \theta about the unit axis a [rad]. The laws write into an array that the
caller owns (``out``); ``exp3`` and ``log3`` give a new one.

Reference: J. Solà, J. Deray, D. Atchuthan, "A micro Lie theory for state estimation in robotics", 2018.
"""

from __future__ import annotations

import math

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.compiled import compiled

SMALL_ANGLE = 1e-4
"""Below this angle [rad] series replace quotients; their error is then below 1e-18."""

NEAR_CUT = -0.99
"""Below this cosine the sine is too small to divide by: the axis is taken from the symmetric part."""


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
def twist_angle(rotation: Array) -> float:
    r"""Returns by how much a rotation (3, 3) turns about z [rad], whatever it tilts, from -\pi to \pi.

    \phi = atan2(R_21 - R_12, R_11 + R_22), the angle of the turn about z that is nearest to R (swing and twist).
    """
    return math.atan2(rotation[1, 0] - rotation[0, 1], rotation[0, 0] + rotation[1, 1])


@compiled
def exponential(vector: Array, out: Array) -> None:
    r"""Writes the rotation matrix (3, 3) of a rotation vector (3,) [rad] (Rodrigues).

    R = I + (sin \theta / \theta) [\phi] + ((1 - cos \theta) / \theta^2) [\phi]^2
    """
    x, y, z = vector[0], vector[1], vector[2]
    square = x * x + y * y + z * z
    angle = math.sqrt(square)
    if angle < SMALL_ANGLE:
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
    r"""Writes the rotation vector (3,) [rad] of a rotation matrix (3, 3); its length is at most \pi.

    Continuous for angles below \pi. At \pi itself, the cut, both signs describe the same rotation and
    one of them is written.
    """
    out[0] = 0.5 * (rotation[2, 1] - rotation[1, 2])
    out[1] = 0.5 * (rotation[0, 2] - rotation[2, 0])
    out[2] = 0.5 * (rotation[1, 0] - rotation[0, 1])
    sine = math.sqrt(out[0] * out[0] + out[1] * out[1] + out[2] * out[2])
    cosine = 0.5 * (rotation[0, 0] + rotation[1, 1] + rotation[2, 2] - 1.0)
    angle = math.atan2(sine, cosine)
    if angle < SMALL_ANGLE:
        scale = 1.0 + angle * angle / 6.0
    elif cosine > NEAR_CUT:
        scale = angle / sine
    else:
        _logarithm_near_cut(rotation, angle, cosine, out)
        return
    for i in range(3):
        out[i] *= scale


@compiled
def _logarithm_near_cut(rotation: Array, angle: float, cosine: float, out: Array) -> None:
    """Takes the axis from the symmetric part (R + R^T) / 2 - cos I, and its sign from ``out``, the sine's axis."""
    x, y, z = out[0], out[1], out[2]
    column = 0
    for k in range(1, 3):
        if rotation[k, k] > rotation[column, column]:
            column = k
    length = 0.0
    for k in range(3):
        entry = 0.5 * (rotation[k, column] + rotation[column, k])
        if k == column:
            entry -= cosine
        out[k] = entry
        length += entry * entry
    scale = angle / math.sqrt(length)
    if out[0] * x + out[1] * y + out[2] * z < 0.0:
        scale = -scale
    for k in range(3):
        out[k] *= scale


@compiled
def log_curvature(square: float) -> float:
    r"""Returns c = (1 - (\theta/2) cot(\theta/2)) / \theta^2 of the logarithm's Jacobian; ``square`` is \theta^2.

    Finite up to and including the cut at \theta = \pi.
    """
    if square < SMALL_ANGLE * SMALL_ANGLE:
        return 1.0 / 12.0 + square / 720.0
    half = 0.5 * math.sqrt(square)
    return (1.0 - half * math.cos(half) / math.sin(half)) / square


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


@compiled
def write_quaternion(rotation: Array, out: Array) -> None:
    """Writes the unit quaternion (x, y, z, w), w >= 0, of a rotation matrix (3, 3)."""
    a, b, c = rotation[0, 0], rotation[1, 1], rotation[2, 2]
    if a + b + c >= 0.0:
        r = math.sqrt(1.0 + a + b + c)
        s = 0.5 / r
        out[0] = (rotation[2, 1] - rotation[1, 2]) * s
        out[1] = (rotation[0, 2] - rotation[2, 0]) * s
        out[2] = (rotation[1, 0] - rotation[0, 1]) * s
        out[3] = 0.5 * r
        return
    i = 0
    if b > a:
        i = 1
    if c > rotation[i, i]:
        i = 2
    j, k = (i + 1) % 3, (i + 2) % 3
    r = math.sqrt(1.0 + rotation[i, i] - rotation[j, j] - rotation[k, k])
    s = 0.5 / r
    out[i] = 0.5 * r
    out[j] = (rotation[j, i] + rotation[i, j]) * s
    out[k] = (rotation[k, i] + rotation[i, k]) * s
    out[3] = (rotation[k, j] - rotation[j, k]) * s
    if out[3] < 0.0:
        for m in range(4):
            out[m] = -out[m]


@compiled
def write_rotation(quaternion: Array, out: Array) -> None:
    """Writes the rotation matrix (3, 3) of a unit quaternion (x, y, z, w)."""
    x, y, z, w = quaternion[0], quaternion[1], quaternion[2], quaternion[3]
    out[0, 0], out[0, 1], out[0, 2] = (
        1.0 - 2.0 * (y * y + z * z),
        2.0 * (x * y - z * w),
        2.0 * (x * z + y * w),
    )
    out[1, 0], out[1, 1], out[1, 2] = (
        2.0 * (x * y + z * w),
        1.0 - 2.0 * (x * x + z * z),
        2.0 * (y * z - x * w),
    )
    out[2, 0], out[2, 1], out[2, 2] = (
        2.0 * (x * z - y * w),
        2.0 * (y * z + x * w),
        1.0 - 2.0 * (x * x + y * y),
    )


def skew(vector: Array) -> Array:
    """Returns the matrix of the cross product, ``skew(a) @ b == cross(a, b)``."""
    x, y, z = vector
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def exp3(rotation_vector: Array) -> Array:
    """Turns a rotation vector (3,) [rad] into a new rotation matrix (3, 3); the law is ``exponential``."""
    out = np.empty((3, 3))
    exponential(np.asarray(rotation_vector, dtype=float), out)
    return out


def log3(rotation: Array) -> Array:
    """Turns a rotation matrix (3, 3) into a new rotation vector (3,) [rad]; the law is ``logarithm``."""
    out = np.empty(3)
    logarithm(rotation, out)
    return out


def log_jacobian(rotation_vector: Array) -> Array:
    r"""Gives how the rotation vector changes when the body turns by a small world-axes rotation, (3, 3).

    log(exp(\delta) R) = log(R) + J \delta + O(\delta^2), with the inverse left Jacobian
    J = I - [\phi] / 2 + c [\phi]^2, c = ``log_curvature``. Finite up to and including the cut at \theta = \pi.
    """
    phi = skew(np.asarray(rotation_vector, dtype=float))
    square = float(np.dot(rotation_vector, rotation_vector))
    return np.eye(3) - 0.5 * phi + log_curvature(square) * (phi @ phi)


def exponential_jacobian(rotation_vector: Array) -> Array:
    r"""Gives how fast a body turns whose rotation vector changes, (3, 3): the left Jacobian of the exponential.

    exp(\phi + \delta) = exp(J \delta) exp(\phi) + O(\delta^2), J = I + b [\phi] + c [\phi]^2 with
    b = (1 - cos \theta) / \theta^2 and c = (\theta - sin \theta) / \theta^3. For any angle; up to half a turn it is
    the inverse of ``log_jacobian``.
    """
    phi = skew(np.asarray(rotation_vector, dtype=float))
    square = float(np.dot(rotation_vector, rotation_vector))
    if square < SMALL_ANGLE * SMALL_ANGLE:
        first, second = 0.5 - square / 24.0, 1.0 / 6.0 - square / 120.0
    else:
        angle = math.sqrt(square)
        first, second = (1.0 - math.cos(angle)) / square, (angle - math.sin(angle)) / (square * angle)
    return np.eye(3) + first * phi + second * (phi @ phi)


def rotation_angle(rotations: Array) -> Array:
    r"""Gives the angle in [0, \pi] of each rotation of a stack (..., 3, 3), (...) [rad].

    \theta = atan2(|sin|, cos): exact near 0 and near half a turn, and the length of ``log3``.
    """
    turned = rotations - np.swapaxes(rotations, -1, -2)
    sine = 0.5 * np.sqrt(turned[..., 2, 1] ** 2 + turned[..., 0, 2] ** 2 + turned[..., 1, 0] ** 2)
    cosine = 0.5 * (np.trace(rotations, axis1=-2, axis2=-1) - 1.0)
    return np.asarray(np.arctan2(sine, cosine))
