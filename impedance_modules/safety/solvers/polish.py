# SPDX-License-Identifier: BSD-3-Clause
"""Turns a nearly optimal answer into the optimum, by guessing which constraints act and checking.

A residual tolerance bounds how far a row is broken, not how far the torque is off; near a row that
is barely active the torque can be wrong by 1 N.m at 1e-6. Once the acting set is known the optimum
is one linear solve, and the optimality conditions prove it.

That solve must stand stiff penalties: writing the optimality system in the multipliers subtracts forces that may be
1e7 times the torque they leave. In the unknown y it is a least-squares problem instead,

    minimise |y|^2 + sum_soft (g_r . y - b_r)^2 / rho_r   subject to   g_r . y = b_r for hard r,

solved by orthogonal transformations, hard constraints first, the stiffest rows on top.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import qr, solve_triangular

from impedance_modules.records import Matrix, Vector
from impedance_modules.safety.filter_problem import FilterProblem
from impedance_modules.safety.solvers import FilterSolution, failed
from impedance_modules.safety.solvers.normal_form import NormalForm, Shifted

_ROUNDS = 30
_TOLERANCE = 1e-11
_INDEPENDENT = 1e-12

Sides = NDArray[np.int8]


def finish(
    problem: FilterProblem,
    shifted: Shifted,
    form: NormalForm,
    guess: Vector,
    *,
    iterations: int,
    solved: bool,
    status: str,
) -> FilterSolution:
    """Polishes a solver's multipliers and checks the result.

    A polished answer satisfies the optimality conditions, so it counts whatever the solver said of its
    own; an unpolished one counts only if the solver said solved.

    Args:
        problem: The problem solved.
        shifted: Its bounds.
        form: The same in metric coordinates.
        guess: (N,) multipliers of the solver.
        iterations: Of the solver.
        solved: What the solver said.
        status: In its words.
    """
    exact = polish(form, guess) if np.isfinite(guess).all() else None
    if exact is not None:
        change, duals = form.change(exact.y), form.duals(exact.multipliers)
        return shifted.finish(problem, change, duals, iterations, f"{status}, polished")
    if solved:
        change, duals = form.change(-(form.rows.T @ guess)), form.duals(guess)
        return shifted.finish(problem, change, duals, iterations, f"{status}, to the solver's tolerance")
    return failed(status, iterations)


@dataclass(frozen=True)
class Polished:
    """An optimum in metric coordinates: y (n,), multipliers (N,)."""

    y: Vector
    multipliers: Vector


def polish(form: NormalForm, guess: Vector) -> Polished | None:
    """Exact optimum, from the signs of approximate multipliers.

    The optimum of the acting constraints is exact; those with the wrong sign leave, broken ones join,
    until nothing changes: then all optimality conditions hold.

    Args:
        form: The problem in metric coordinates.
        guess: (N,) approximate multipliers, positive at upper bounds.

    Returns:
        The optimum, to about 1e-11 in the conditions, or None if 30 rounds did not find it.
    """
    noise = 1e-9 * max(1.0, float(np.abs(guess).max()))
    sides: Sides = (guess > noise).astype(np.int8) - (guess < -noise).astype(np.int8)
    for _ in range(_ROUNDS):
        acting = np.flatnonzero(sides)
        bound = np.where(sides[acting] > 0, form.upper[acting], form.lower[acting])
        y, multipliers = acting_optimum(form, acting, bound)
        following = _sides(form, sides, y, multipliers)
        if np.array_equal(following, sides):
            return Polished(y, multipliers)
        sides = following
    return None


def _sides(form: NormalForm, sides: Sides, y: Vector, multipliers: Vector) -> Sides:
    value = form.rows @ y
    slip = _TOLERANCE * max(1.0, float(np.abs(y).max()))
    keep = sides * multipliers >= -_TOLERANCE * max(1.0, float(np.abs(multipliers).max()))
    above, below = value > form.upper + slip, value < form.lower - slip
    joins = above.astype(np.int8) - below.astype(np.int8)
    following: Sides = np.where((sides != 0) & keep, sides, joins)
    return following


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
