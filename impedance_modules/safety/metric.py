# SPDX-License-Identifier: BSD-3-Clause
r"""What a change of torque costs: the metric W of the filter.

Gauss's principle of least constraint: the natural size of a torque change dtau is the size of the
acceleration it causes, weighed by inertia. Seen by the whole arm that is
(Minv dtau)^T M (Minv dtau) = dtau^T Minv dtau; seen by the hands it is the same with the hands'
acceleration and their operational inertia.
"""

from __future__ import annotations

import math

import numpy as np

from impedance_modules.compiled import compiled
from impedance_modules.records import Matrix
from impedance_modules.safety.filter_problem import FilterProblem, FilterState

POSTURE_WEIGHT = 0.1
"""eps: a torque change that moves no hand costs eps / (1 + eps) of one that moves a hand."""

HEAVIEST_HAND = (100.0, 10.0)
"""Bounds of a hand's operational inertia, (mass [kg], rotational inertia [kg.m^2]), near singularities."""


@compiled
def write_metric(problem: FilterProblem, state: FilterState) -> None:
    """Writes the metric of a cycle's problem, with the weights above."""
    weigh_changes(problem, state, POSTURE_WEIGHT, HEAVIEST_HAND[0], HEAVIEST_HAND[1])


@compiled
def weigh_changes(
    problem: FilterProblem, state: FilterState, eps: float, heaviest: float, bulkiest: float
) -> None:
    r"""How much a torque change matters: first the hands' acceleration, then the posture's.

    W = sum_hands Minv J^T Lambda J Minv + eps Minv,   Lambda = (J Minv J^T + C)^-1,
    C = diag(1/mass x 3, 1/inertia x 3) of the heaviest hand the filter believes in.

    C bounds Lambda where an arm is singular and its true operational inertia infinite; elsewhere it
    changes Lambda by about Lambda / heaviest. Since Lambda never exceeds the true one, the sum is a
    weighted projection: eps Minv <= W <= (1 + eps) Minv, so W is as well conditioned as the inertia
    up to the factor (1 + eps) / eps, in every posture. Source: design section 4, "QP".

    Args:
        problem: ``metric`` is overwritten; a torque moves the hand of its own arm alone, so all sums run over
            the joints of ``moved_by`` alone. Hands must not share joints.
        state: ``inverse_inertia`` and ``jacobian``.
        eps: Weight of the posture, > 0.
        heaviest: Largest mass of a hand [kg].
        bulkiest: Largest rotational inertia of a hand [kg.m^2].
    """
    n = state.inverse_inertia.shape[0]
    for i in range(n):
        for j in range(n):
            problem.metric[i, j] = eps * state.inverse_inertia[i, j]
    acceleration, factor = np.empty((6, n)), np.empty((6, 6))
    least = (1.0 / heaviest, 1.0 / bulkiest)
    for hand in range(state.jacobian.shape[0]):
        first, last = problem.moved_by[0, hand], problem.moved_by[1, hand]
        jacobian = state.jacobian[hand]
        _write_acceleration(jacobian, state.inverse_inertia, first, last, acceleration)
        _factor_mobility(acceleration, jacobian, (first, last), least, factor)
        _divide(factor, acceleration, first, last)
        for r in range(6):
            for i in range(first, last):
                share = acceleration[r, i]
                for j in range(first, last):
                    problem.metric[i, j] += share * acceleration[r, j]


@compiled
def _write_acceleration(
    jacobian: Matrix, inverse_inertia: Matrix, first: int, last: int, acceleration: Matrix
) -> None:
    """Writes J Minv (6, n), in the columns from ``first`` to ``last``."""
    for r in range(6):
        for j in range(first, last):
            acceleration[r, j] = 0.0
        for k in range(first, last):
            motion = jacobian[r, k]
            for j in range(first, last):
                acceleration[r, j] += motion * inverse_inertia[k, j]


@compiled
def _factor_mobility(
    acceleration: Matrix,
    jacobian: Matrix,
    joints: tuple[int, int],
    least: tuple[float, float],
    factor: Matrix,
) -> None:
    """Factors J Minv J^T + C = L L^T, 6 x 6, by Cholesky; ``least``: linear and angular entries of C."""
    for r in range(6):
        for c in range(r + 1):
            total = 0.0
            for j in range(joints[0], joints[1]):
                total += acceleration[r, j] * jacobian[c, j]
            if r == c:
                total += least[0] if r < 3 else least[1]
            for k in range(c):
                total -= factor[r, k] * factor[c, k]
            factor[r, c] = math.sqrt(total) if r == c else total / factor[c, c]


@compiled
def _divide(factor: Matrix, rows: Matrix, first: int, last: int) -> None:
    """Replaces rows by L^-1 rows, in the columns from ``first`` to ``last``."""
    for r in range(6):
        for k in range(r):
            share = factor[r, k]
            for j in range(first, last):
                rows[r, j] -= share * rows[k, j]
        inverse = 1.0 / factor[r, r]
        for j in range(first, last):
            rows[r, j] *= inverse
