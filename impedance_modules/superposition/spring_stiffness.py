# SPDX-License-Identifier: BSD-3-Clause
r"""The stiffness that a deflected spring shows: minus the derivative of its wrench.

K = -d w / d(p, \delta) for a small displacement dp and a small world-axes rotation \delta of the frame.
With K_W the declared stiffness in world axes, \phi the spring's rotation vector, L = d\phi / d\delta and
g = K_W (dp, \phi) the gradient,

    K = B^T K_W B + diag(0, N L),    B = diag(I, L),    N = d(L(\phi)^T g_w) / d\phi.

The second part is the spring's own geometric stiffness: its load, turned. It vanishes with the load.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from impedance_modules.modules.spring import Spring, displacement
from impedance_modules.robot.pose import Pose
from impedance_modules.robot.rotation import log_jacobian, skew

Array = NDArray[np.float64]

SERIES_ANGLE = 0.3
"""Below this angle [rad] a series replaces quotients that would cancel; its error is below 1e-13."""


def spring_stiffness(spring: Spring, pose: Pose, target: Pose) -> Array:
    """Computes minus the derivative of ``spring.wrench`` by displacement and rotation of the frame.

    Returns:
        (6, 6) in world axes at the frame's origin. Unsymmetric while the spring carries a moment,
        because small world-axes rotations are no coordinates; symmetric otherwise.
    """
    offset = displacement(pose, target)
    declared = spring.in_world(spring.stiffness)
    turn = log_jacobian(offset[3:])
    B = np.eye(6)
    B[3:, 3:] = turn
    moment_gradient = declared[3:] @ offset
    K = B.T @ declared @ B
    K[3:, 3:] += _moment_derivative(offset[3:], moment_gradient) @ turn
    return K


def spring_stiffness_without_preload(spring: Spring, pose: Pose, target: Pose) -> Array:
    """Computes what the spring would show at this deflection without its load: B^T K_W B, (6, 6)."""
    B = np.eye(6)
    B[3:, 3:] = log_jacobian(displacement(pose, target)[3:])
    return B.T @ spring.in_world(spring.stiffness) @ B


def _moment_derivative(phi: Array, gradient: Array) -> Array:
    r"""Differentiates L(\phi)^T g by \phi at constant g.

    L^T g = g + \phi x g / 2 + c(\theta) \phi x (\phi x g), c = (1 - (\theta/2) cot(\theta/2)) / \theta^2.
    """
    second, slope = _second_coefficient(float(np.linalg.norm(phi)))
    across = np.cross(phi, gradient)
    return (
        -0.5 * skew(gradient)
        - second * (skew(across) + skew(phi) @ skew(gradient))
        + slope * np.outer(np.cross(phi, across), phi)
    )


def _second_coefficient(angle: float) -> tuple[float, float]:
    r"""Gives c(\theta) of the inverse left Jacobian, and c'(\theta) / \theta."""
    if angle < SERIES_ANGLE:
        x = angle**2
        second = 1 / 12 + x * (1 / 720 + x * (1 / 30240 + x * (1 / 1209600 + x / 47900160)))
        slope = 1 / 360 + x * (1 / 7560 + x * (1 / 201600 + x * (1 / 5987520 + 691 * x / 130767436800)))
        return second, slope
    half = 0.5 * angle
    cotangent, sine = half / math.tan(half), half / math.sin(half)
    return (1.0 - cotangent) / angle**2, (cotangent + sine**2 - 2.0) / angle**4
