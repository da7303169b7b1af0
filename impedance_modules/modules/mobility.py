# SPDX-License-Identifier: BSD-3-Clause
"""Mobility: how readily a point of a mechanism moves, the inverse of inertia that always exists.

Y = J (M + I_r)^-1 J^T maps a wrench at the point to the acceleration from rest that it causes.
All matrices are (6, 6), linear then angular, world axes, [1/kg, 1/(kg.m), 1/(kg.m^2)].
"""

from __future__ import annotations

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.robot.pose import carry

RANK_TOLERANCE = 1e-12
"""Share of the largest eigenvalue below which a direction counts as immobile."""


def mobility(jacobian: Array, inverse_inertia: Array) -> Array:
    """Computes Y = J (M + I_r)^-1 J^T from J (6, k) and (M + I_r)^-1 (k, k)."""
    found = jacobian @ inverse_inertia @ jacobian.T
    return 0.5 * (found + found.T)


def carry_mobility(at_hand: Array, offset: Array) -> Array:
    """Carries a mobility from H to another point O of the same body, Y_O = X^-1 Y_H X^-T.

    Args:
        at_hand: (6, 6) Y_H.
        offset: (3,) from O to H [m]; X = ``carry(offset)`` maps O's twist to H's.
    """
    back = carry(-offset)
    return back @ at_hand @ back.T


def parallel_sum(first: Array, second: Array) -> Array:
    """Joins two mechanisms rigidly at one point: Y = Y_1 (Y_1 + Y_2)^+ Y_2.

    Equals (Y_1^-1 + Y_2^-1)^-1 where both inverses exist, and stays right where they do not: what one
    mechanism cannot do, the pair cannot do (Anderson and Duffin, 1969).
    """
    total = first + second
    joined = first @ np.linalg.pinv(total, rcond=RANK_TOLERANCE, hermitian=True) @ second
    return 0.5 * (joined + joined.T)
