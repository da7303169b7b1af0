# SPDX-License-Identifier: BSD-3-Clause
"""Between motors and joints: ratios, and motors that feel more than their own joint."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

Matrix = NDArray[np.float64]


def transmission_matrix(entry: Mapping[str, Any], joints: Sequence[str]) -> Matrix:
    """Returns R: how far each motor turns for each joint.

    theta = R q, so that q = R^-1 theta, and, because the power is the same on both sides, tau = R^T tau_motor.

    Args:
        entry: ``matrix``, or ``ratio`` with or without ``coupling``; checked already.
        joints: Order of rows (motors) and columns (joints).

    Returns:
        (joints, joints), motor units for one joint unit.
    """
    if "matrix" in entry:
        return np.array(entry["matrix"], dtype=np.float64)
    place = {joint: index for index, joint in enumerate(joints)}
    matrix = np.diag(np.array(entry["ratio"], dtype=np.float64))
    for motor, others in entry.get("coupling", {}).items():
        for other, turns in others.items():
            matrix[place[motor], place[other]] = turns
    return matrix


def positions_at_joints(matrix: Matrix, motor: Matrix) -> Matrix:
    """Returns q = R^-1 theta for each row; velocities alike.

    Args:
        matrix: R (joints, joints).
        motor: (samples, joints) [rad] or [rad/s] at the motors.
    """
    return np.asarray(np.linalg.solve(matrix, motor.T).T, dtype=np.float64)


def efforts_at_joints(matrix: Matrix, motor: Matrix) -> Matrix:
    """Returns tau = R^T tau_motor for each row, (samples, joints) [N.m]."""
    return motor @ matrix
