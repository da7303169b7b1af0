# SPDX-License-Identifier: BSD-3-Clause
r"""Damping from inertia and stiffness, mode by mode: c = 2 \zeta \sqrt{k m}, in many dimensions.

A mass M on springs K has modes K \Phi = M \Phi \Omega^2 with \Phi^T M \Phi = I. The damping that gives
every mode its ratio is D = M \Phi diag(2 \zeta \omega) \Phi^T M, always positive semidefinite.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from impedance_modules.modules.mobility import RANK_TOLERANCE

Array = NDArray[np.float64]


def joint_damping(stiffness: Array, inertia: Array, ratio: float) -> Array:
    r"""Damps every mode of joint springs on an arm's inertia.

    With the Cholesky factor M = L L^T and L^-1 K_j L^-T = V \Omega^2 V^T, D_j = L V 2 \zeta \Omega V^T L^T.

    Args:
        stiffness: (k,) K_j [N.m/rad], none negative.
        inertia: (k, k) M + I_r of the limb's joints [kg.m^2].
        ratio: \zeta.

    Returns:
        (k, k) D_j [N.m.s/rad].
    """
    factor = np.linalg.cholesky(inertia)
    half = np.linalg.solve(factor, np.diag(np.sqrt(stiffness)))
    squared, vectors = np.linalg.eigh(half @ half.T)
    modes = factor @ vectors
    return np.asarray((modes * (2.0 * ratio * np.sqrt(np.maximum(squared, 0.0)))) @ modes.T)


def endpoint_damping(
    stiffnesses: Sequence[Array], ratios: Sequence[float], mobility: Array
) -> tuple[Array, ...]:
    r"""Damps every mode of several springs at one point of a mechanism, split over the springs.

    The modes are those of the summed stiffness K on the inertia Y^-1. They are found from the mobility
    Y = G G^T, which exists at singular postures too: G^T K G = V \Omega^2 V^T, \phi = G v. As
    K \phi = \omega^2 Y^-1 \phi, the matrix M \Phi diag(2 \zeta \omega) \Phi^T M becomes

        D_i = \sum_m 2 \zeta_i s_im / \omega_m^3  (K \phi_m)(K \phi_m)^T,
        s_im = \phi_m^T K_i \phi_m / \omega_m^2,     \sum_i s_im = 1.

    s_im is spring i's share of mode m, so cutting a spring in two changes nothing. Directions without
    stiffness, or in which the mechanism cannot move, get no damping.

    Args:
        stiffnesses: (6, 6) K_i of each spring, positive semidefinite, world axes, all at one point.
        ratios: \zeta_i of each spring; 0 for none.
        mobility: (6, 6) Y at that point.

    Returns:
        (6, 6) D_i of each spring, at that point; each positive semidefinite.
    """
    total = np.sum(stiffnesses, axis=0)
    squared, modes = _modes(total, mobility)
    frequency = np.sqrt(squared)
    pull = (total @ modes) / frequency**1.5
    split = []
    for stiffness, ratio in zip(stiffnesses, ratios, strict=True):
        share = np.sum(modes * (stiffness @ modes), axis=0) / squared
        split.append((pull * (2.0 * ratio * np.maximum(share, 0.0))) @ pull.T)
    return tuple(split)


def _modes(stiffness: Array, mobility: Array) -> tuple[Array, Array]:
    """Finds (squared frequencies (r,), mode shapes (6, r)) of the modes that have stiffness."""
    values, vectors = np.linalg.eigh(mobility)
    movable = values > RANK_TOLERANCE * values[-1]
    factor = vectors[:, movable] * np.sqrt(values[movable])
    squared, rotation = np.linalg.eigh(factor.T @ stiffness @ factor)
    # Clipping at zero: rounding may leave a free direction with a tiny negative stiffness.
    stiff = squared > RANK_TOLERANCE * max(float(squared[-1]), 0.0)
    return squared[stiff], factor @ rotation[:, stiff]
