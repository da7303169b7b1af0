# SPDX-License-Identifier: BSD-3-Clause
r"""Cross products, rotations and their logarithm, compiled, writing into memory that the caller owns.

The plain versions, with their derivations, are in ``robot.rotation``; a test keeps both equal.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from impedance_modules.compiled import compiled

Array = NDArray[np.float64]


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
