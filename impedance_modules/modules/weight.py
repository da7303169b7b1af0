# SPDX-License-Identifier: BSD-3-Clause
"""Sharing one wrench on the object over the hands that hold it, e.g. the object's own weight."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from impedance_modules.robot.pose import carry

Array = NDArray[np.float64]

STANDARD_GRAVITY = 9.81
"""[m/s^2], along -z of the world; the value robots and simulators here use."""


def share_wrench(offsets: Array, wrench: Array) -> Array:
    """Splits a wrench at the object's origin over the hands, with the least effort.

    Minimises sum (|f_i|^2 + |t_i|^2 / l^2) subject to sum X_i^T w_i = W, exactly; l is the mean distance
    of the hands, which makes forces and moments comparable.

    Args:
        offsets: (h, 3) from the object's origin to each hand [m], world axes.
        wrench: (6,) W at the origin, world axes [N, N.m].

    Returns:
        (h, 6) wrench that each hand puts on the object, at the hand, world axes.
    """
    length = float(np.mean(np.linalg.norm(offsets, axis=1)))
    # A hand at the very origin has no lever: any length then gives the same split.
    scale = np.array([1.0] * 3 + [length if length > 0.0 else 1.0] * 3)
    grasp_map = np.hstack([carry(offset).T * scale for offset in offsets])
    solution = np.linalg.pinv(grasp_map) @ wrench
    return np.asarray(solution.reshape(len(offsets), 6) * scale)


def carry_weight(offsets: Array, mass: float) -> Array:
    """Shares the wrench m g upwards that holds the object's weight; (h, 6) as ``share_wrench``."""
    return share_wrench(offsets, np.array([0.0, 0.0, mass * STANDARD_GRAVITY, 0.0, 0.0, 0.0]))
