# SPDX-License-Identifier: BSD-3-Clause
r"""The least joint stiffness with which an arm does not fold under any force of a range.

A wrench F_b on the hand that the joint springs carry turns with no joint, but its lever arms do: the arm
returns by itself only if

    H = diag(K) + S - sym(\Gamma(F_b))   is positive definite       (design 4; Rancourt & Hogan 2001)

S is what other springs give in joint space. \Gamma is linear in F_b, so that a range of forces is safe if its two
ends are. Among all K that reach this bound the one with the smallest sum is taken: joint springs that do no more
than keep the links from folding leave the hand to its own springs, as the thesis wanted (5.1.2).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linprog

from impedance_modules.errors import BadInput
from impedance_modules.superposition.net_stiffness import gamma

Array = NDArray[np.float64]

ROUNDS = 400
"""Most cutting planes' rounds; a seven-joint arm takes about thirty."""

TOLERANCE = 1e-5
"""By how much, as a share of the largest stiffness, the bound may be missed."""


def unloading(jacobian: Array, others: Array, wrenches: Sequence[Array]) -> list[Array]:
    r"""Gives sym(\Gamma(F_b)) - S (k, k) for each wrench (6,): what diag(K) must outweigh [N.m/rad].

    Args:
        jacobian: (6, k) of the hand.
        others: (k, k) S.
        wrenches: F_b in world axes at the hand [N, N.m].
    """
    turned = (gamma(jacobian, wrench) for wrench in wrenches)
    return [0.5 * (g + g.T) - 0.5 * (others + others.T) for g in turned]


def folding_share(stiffness: Array, loads: Sequence[Array]) -> float:
    """Finds the largest share s at which s K just folds under the worst load; 0 where it never does.

    Args:
        stiffness: (k,) K, above zero.
        loads: From ``unloading``.
    """
    root = 1.0 / np.sqrt(stiffness)
    highest = max(float(np.linalg.eigvalsh(root[:, None] * load * root)[-1]) for load in loads)
    return max(0.0, highest)


def least_stiffness(loads: Sequence[Array], least: Array, most: float) -> Array:
    """Finds K (k,) of the smallest sum with diag(K) - load positive semidefinite for all loads.

    By cutting planes: every direction u in which a K still folds says u^2 . K >= u . load u, which is linear.

    Args:
        loads: From ``unloading``.
        least: (k,) lower bounds for other reasons [N.m/rad].
        most: Upper bound of every joint [N.m/rad].

    Raises:
        BadInput: No K below ``most`` holds these loads.
    """
    k = least.size
    cuts = [(u, load) for load in loads for u in np.eye(k)]
    for _ in range(ROUNDS):
        rows = np.array([-(u**2) for u, _ in cuts])
        bounds = np.array([-(u @ load @ u) for u, load in cuts])
        found = linprog(np.ones(k), A_ub=rows, b_ub=bounds, bounds=[(low, most) for low in least])
        if found.x is None:
            break
        new = list[tuple[Array, Array]]()
        for load in loads:
            values, vectors = np.linalg.eigh(np.diag(found.x) - load)
            missed = values < -TOLERANCE * max(1.0, float(found.x.max()))
            new += [(vector, load) for vector in vectors[:, missed].T]
        if not new:
            return _on_the_bound(np.asarray(found.x), loads, least)
        cuts += new
    raise BadInput(
        f"no joint stiffness up to {most:g} N.m/rad keeps the arm from folding (valid: less force, or another posture)"
    )


def _on_the_bound(stiffness: Array, loads: Sequence[Array], least: Array) -> Array:
    """Removes what the cuts' tolerance leaves: K just folds, or stands on its lower bounds."""
    share = folding_share(np.maximum(stiffness, 1e-9), loads)
    return np.maximum(stiffness * max(share, 1.0), least)
