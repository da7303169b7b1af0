# SPDX-License-Identifier: BSD-3-Clause
"""The optimum for a known set of acting constraints, by a method that stands stiff penalties.

Writing the optimality system in the multipliers subtracts forces that may be 1e7 times the torque
they leave. In the unknown y it is a least-squares problem instead,

    minimise |y|^2 + sum_soft (g_r . y - b_r)^2 / rho_r   subject to   g_r . y = b_r for hard r,

solved by orthogonal transformations, hard constraints first, the stiffest rows on top.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import qr, solve_triangular

from impedance_modules.safety.problem import Matrix, Vector
from impedance_modules.safety.solvers.normal_form import NormalForm

_INDEPENDENT = 1e-12


def acting_optimum(form: NormalForm, acting: NDArray[np.intp], bound: Vector) -> tuple[Vector, Vector]:
    """Optimum if exactly these constraints act.

    Args:
        form: The problem in metric coordinates.
        acting: Indices of the acting constraints.
        bound: b of each.

    Returns:
        (y (n,), multipliers (N,)); parallel hard constraints: the first independent ones bear the load.
    """
    softness = form.softness[acting]
    hard, soft = acting[softness == 0.0], acting[softness > 0.0]
    basis, triangle, kept = _range(form.rows[hard])
    inside = basis[:, : kept.size]
    fixed = inside @ solve_triangular(triangle, bound[softness == 0.0][kept], trans=1)
    y = fixed + _free_part(form, soft, bound[softness > 0.0], fixed, basis[:, kept.size :])
    multipliers = np.zeros(form.softness.size)
    multipliers[soft] = (form.rows[soft] @ y - bound[softness > 0.0]) / form.softness[soft]
    force = -(y + form.rows[soft].T @ multipliers[soft])
    multipliers[hard[kept]] = solve_triangular(triangle, inside.T @ force)
    # (g . y - b) / rho loses digits where rho is small; what then misses in y + G^T lambda = 0 is put back.
    missing = y + form.rows[acting].T @ multipliers[acting]
    multipliers[acting] -= np.linalg.lstsq(form.rows[acting].T, missing, rcond=_INDEPENDENT)[0]
    return y, multipliers


def _range(rows: Matrix) -> tuple[Matrix, Matrix, NDArray[np.intp]]:
    """Orthonormal basis whose first columns span the rows, their triangle, and which rows are independent."""
    if len(rows) == 0:
        n = rows.shape[1]
        return np.eye(n), np.zeros((0, 0)), np.zeros(0, dtype=np.intp)
    basis, triangle, order = qr(rows.T, pivoting=True, check_finite=False)
    rank = int((np.abs(np.diagonal(triangle)) > _INDEPENDENT).sum())
    return basis, triangle[:rank, :rank], order[:rank]


def _free_part(
    form: NormalForm, soft: NDArray[np.intp], bound: Vector, fixed: Vector, free: Matrix
) -> Vector:
    """What the soft rows make of the directions that hard constraints leave."""
    if soft.size == 0 or free.shape[1] == 0:
        return np.zeros(fixed.size)
    stiffness = 1.0 / np.sqrt(form.softness[soft])
    order = np.argsort(-stiffness)
    weight, rows = stiffness[order], form.rows[soft[order]]
    above = weight[:, None] * (rows @ free)
    right = np.concatenate([weight * (bound[order] - rows @ fixed), np.zeros(free.shape[1])])
    system = np.vstack([above, np.eye(free.shape[1])])
    basis, triangle, order = qr(system, mode="economic", pivoting=True, check_finite=False)
    part = np.empty(free.shape[1])
    part[order] = solve_triangular(triangle, basis.T @ right, check_finite=False)
    return np.asarray(free @ part)
