# SPDX-License-Identifier: BSD-3-Clause
"""Damping as it is felt at a hand: the joint dampers seen through the arm, plus the dampers at the hand."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from impedance_modules.superposition.net_stiffness import SINGULAR, through_arm

Array = NDArray[np.float64]


def hand_damping(jacobian: Array, joint_damping: Array, end_damping: Array) -> Array | None:
    """Computes B = (J D_j^-1 J^T)^-1 + D_end.

    Args:
        jacobian: (6, k) J of the hand.
        joint_damping: (k, k) D_j [N.m.s/rad].
        end_damping: (6, 6) D_end at the hand, world axes.

    Returns:
        (6, 6) [N.s/m, N.s, N.m.s]; None where D_j or the posture is singular.
    """
    values = np.linalg.svd(joint_damping, compute_uv=False)
    if values[-1] <= SINGULAR * values[0]:
        return None
    joint_part = through_arm(jacobian, joint_damping)
    return None if joint_part is None else joint_part + end_damping
