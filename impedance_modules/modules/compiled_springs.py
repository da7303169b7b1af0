# SPDX-License-Identifier: BSD-3-Clause
r"""The modules' law compiled for the control loop; it must agree with the clear one in this package.

Everything is in world axes at the frame's origin. Per spring s on frame f with target X_WT:

    e = [p - p_T; log(R R_T^T)],   U = e^T K e / 2,   w = -dU + F - D V,   \tau = J_f^T w

Functions write into arrays they are given and allocate nothing but small stack-like scratch.
``tests/laws/test_compiled_modules.py`` holds them against ``spring.py`` and ``joint_bias.py``.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from impedance_modules.compiled import compiled

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


@compiled
def rotation_error(rotation: Array, target: Array, error: Array) -> None:
    r"""Writes \phi = log(R R_T^T) [rad] in world axes into ``error[3:6]``."""
    product = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            product[i, j] = 0.0
            for k in range(3):
                product[i, j] += rotation[i, k] * target[j, k]
    x = 0.5 * (product[2, 1] - product[1, 2])
    y = 0.5 * (product[0, 2] - product[2, 0])
    z = 0.5 * (product[1, 0] - product[0, 1])
    sine = math.sqrt(x * x + y * y + z * z)
    cosine = 0.5 * (product[0, 0] + product[1, 1] + product[2, 2] - 1.0)
    angle = math.atan2(sine, cosine)
    if angle < 1e-4:
        scale = 1.0 + angle * angle / 6.0
    elif cosine > -0.99:
        scale = angle / sine
    else:
        _error_near_cut(product, x, y, z, angle, cosine, error)
        return
    error[3], error[4], error[5] = scale * x, scale * y, scale * z


@compiled
def _error_near_cut(
    product: Array, x: float, y: float, z: float, angle: float, cosine: float, error: Array
) -> None:
    column = 0
    for k in range(1, 3):
        if product[k, k] > product[column, column]:
            column = k
    length = 0.0
    for k in range(3):
        entry = 0.5 * (product[k, column] + product[column, k])
        if k == column:
            entry -= cosine
        error[3 + k] = entry
        length += entry * entry
    scale = angle / math.sqrt(length)
    if error[3] * x + error[4] * y + error[5] * z < 0.0:
        scale = -scale
    for k in range(3):
        error[3 + k] *= scale


@compiled
def turn_moment(error: Array, moment: Array) -> None:
    r"""Replaces the gradient with respect to \phi by the one with respect to a world rotation.

    m -> J^T m with J = I - [\phi]/2 + c [\phi]^2 the Jacobian of the logarithm, so
    J^T m = m + \phi x m / 2 + c \phi x (\phi x m).
    """
    a, b, c = error[3], error[4], error[5]
    square = a * a + b * b + c * c
    if square < 1e-8:
        second = 1.0 / 12.0 + square / 720.0
    else:
        half = 0.5 * math.sqrt(square)
        second = (1.0 - half * math.cos(half) / math.sin(half)) / square
    x, y, z = moment[3], moment[4], moment[5]
    u, v, w = b * z - c * y, c * x - a * z, a * y - b * x
    moment[3] = x + 0.5 * u + second * (b * w - c * v)
    moment[4] = y + 0.5 * v + second * (c * u - a * w)
    moment[5] = z + 0.5 * w + second * (a * v - b * u)


@compiled
def spring_energies(
    stiffness: Array,
    slots: Indices,
    rotation: Array,
    translation: Array,
    target_rotation: Array,
    target_translation: Array,
) -> float:
    """Sums U over all springs [J] at poses (frames, ...) and targets (springs, ...)."""
    total = 0.0
    error = np.empty(6)
    for s in range(slots.size):
        f = slots[s]
        for k in range(3):
            error[k] = translation[f, k] - target_translation[s, k]
        rotation_error(rotation[f], target_rotation[s], error)
        for i in range(6):
            for j in range(6):
                total += 0.5 * error[i] * stiffness[s, i, j] * error[j]
    return total


@compiled
def spring_efforts(
    stiffness: Array,
    damping: Array,
    force: Array,
    slots: Indices,
    rotation: Array,
    translation: Array,
    jacobian: Array,
    moved_by: Indices,
    target_rotation: Array,
    target_translation: Array,
    scale: float,
    v: Array,
    wrench: Array,
    effort: Array,
) -> float:
    """Writes wrench (springs, 6) and effort (springs, n) of every spring; returns their energy [J].

    ``scale`` in [0, 1] multiplies stiffness (a relaxed potential), not damping or axis forces. ``moved_by`` (2, frames)
    holds the first and one past the last joint that moves each frame; torques on others are not written.
    """
    total = 0.0
    error = np.empty(6)
    gradient = np.empty(6)
    twist = np.empty(6)
    for s in range(slots.size):
        f = slots[s]
        first, last = moved_by[0, f], moved_by[1, f]
        for k in range(3):
            error[k] = translation[f, k] - target_translation[s, k]
        rotation_error(rotation[f], target_rotation[s], error)
        for i in range(6):
            twist[i] = 0.0
            for j in range(first, last):
                twist[i] += jacobian[f, i, j] * v[j]
        for i in range(6):
            gradient[i] = 0.0
            for j in range(6):
                gradient[i] += scale * stiffness[s, i, j] * error[j]
            total += 0.5 * error[i] * gradient[i]
        turn_moment(error, gradient)
        for i in range(6):
            wrench[s, i] = force[s, i] - gradient[i]
            for j in range(6):
                wrench[s, i] -= damping[s, i, j] * twist[j]
        effort[s, first:last] = 0.0
        for i in range(6):
            for j in range(first, last):
                effort[s, j] += jacobian[f, i, j] * wrench[s, i]
    return total


@compiled
def bias_energy(stiffness: Array, rest: Array, q: Array) -> float:
    """Returns (q - rest)^T K_j (q - rest) / 2 [J]; all (n,)."""
    total = 0.0
    for j in range(q.size):
        total += 0.5 * stiffness[j] * (q[j] - rest[j]) ** 2
    return total


@compiled
def bias_efforts(
    stiffness: Array,
    damping: Array,
    rest: Array,
    limb_of_joint: Indices,
    coupled: Indices,
    scale: float,
    q: Array,
    v: Array,
    effort: Array,
) -> float:
    """Writes -K_j (q - rest) - D_j v of each limb into effort (limbs, n); returns the energy [J].

    ``coupled`` (2, n) holds the first and one past the last joint that a joint's damping can couple it with.
    """
    total = 0.0
    effort[:, :] = 0.0
    for j in range(q.size):
        limb = limb_of_joint[j]
        pull = scale * stiffness[j] * (q[j] - rest[j])
        total += 0.5 * pull * (q[j] - rest[j])
        for k in range(coupled[0, j], coupled[1, j]):
            pull += damping[j, k] * v[k]
        effort[limb, j] -= pull
    return total
