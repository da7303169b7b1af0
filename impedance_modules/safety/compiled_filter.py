# SPDX-License-Identifier: BSD-3-Clause
"""The filter's quadratic program filled in by compiled code; formulas and reasons are in ``build.py``.

``fill`` writes what ``build.build`` writes, into the arrays of the same ``FilterWorkspace``.
``tests/laws/test_compiled_filter.py`` holds them together.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from impedance_modules.compiled import compiled

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

POWER_HORIZON, HORIZON, PERIOD, MARGIN, APPROACH_TIME, SEPARATION_SPEED, SEPARATION_ACCELERATION = range(7)
"""Places of the scalar limits, names as in ``limits.FilterLimits``."""

EFFORT, RATE, LOW, HIGH, SPEED, BRAKING, RETURN = range(7)
"""Places of the per-joint limits: effort_max, effort_rate_max, position_min, position_max, velocity_max,
deceleration, return_speed."""


@compiled
def metric(
    inverse_inertia: Array,
    jacobian: Array,
    moved_by: Indices,
    eps: float,
    floor_linear: float,
    floor_angular: float,
    out: Array,
) -> None:
    r"""Writes W = sum_hands Minv J^T Lambda J Minv + eps Minv (see ``metric.metric``).

    Args:
        inverse_inertia: (n, n).
        jacobian: (hands, 6, n).
        moved_by: (2, hands or more) first and one past the last joint that can move each hand: what a hand feels
            of a torque stays within its own arm, so all sums run over those alone.
        eps: Weight of the posture.
        floor_linear: Mobility of the heaviest hand the filter believes in [1/kg].
        floor_angular: Likewise [1/(kg.m^2)].
        out: (n, n), overwritten.
    """
    n = inverse_inertia.shape[0]
    for i in range(n):
        for j in range(n):
            out[i, j] = eps * inverse_inertia[i, j]
    acceleration = np.empty((6, n))
    factor = np.empty((6, 6))
    for hand in range(jacobian.shape[0]):
        first, last = moved_by[0, hand], moved_by[1, hand]
        for r in range(6):
            for j in range(first, last):
                acceleration[r, j] = 0.0
            for k in range(first, last):
                motion = jacobian[hand, r, k]
                for j in range(first, last):
                    acceleration[r, j] += motion * inverse_inertia[k, j]
        _cholesky_of_mobility(acceleration, jacobian[hand], first, last, floor_linear, floor_angular, factor)
        _divide(factor, acceleration, first, last)
        for r in range(6):
            for i in range(first, last):
                share = acceleration[r, i]
                for j in range(first, last):
                    out[i, j] += share * acceleration[r, j]


@compiled
def _cholesky_of_mobility(
    acceleration: Array,
    jacobian: Array,
    first: int,
    last: int,
    floor_linear: float,
    floor_angular: float,
    factor: Array,
) -> None:
    """Factors J Minv J^T + C = L L^T, 6 x 6."""
    for r in range(6):
        for c in range(r + 1):
            total = 0.0
            for j in range(first, last):
                total += acceleration[r, j] * jacobian[c, j]
            if r == c:
                total += floor_linear if r < 3 else floor_angular
            for k in range(c):
                total -= factor[r, k] * factor[c, k]
            factor[r, c] = math.sqrt(total) if r == c else total / factor[c, c]


@compiled
def _divide(factor: Array, rows: Array, first: int, last: int) -> None:
    """Replaces rows by L^-1 rows, in the columns from ``first`` to ``last``."""
    for r in range(6):
        for k in range(r):
            share = factor[r, k]
            for j in range(first, last):
                rows[r, j] -= share * rows[k, j]
        inverse = 1.0 / factor[r, r]
        for j in range(first, last):
            rows[r, j] *= inverse


@compiled
def _braking(room: float, speed: float, deceleration: float, return_speed: float, horizon: float) -> float:
    """Largest acceleration towards a limit, ``rows.braking_acceleration``."""
    if room > 0.0:
        spare = 2.0 * room - speed * horizon
        if spare >= 0.0:
            half = 0.5 * deceleration * horizon
            bound = (math.sqrt(half * half + deceleration * spare) - half - speed) / horizon
        else:
            bound = -speed * speed / (2.0 * room)
    else:
        bound = -(min(return_speed, -room / horizon) + speed) / horizon
    return max(bound, -deceleration)


@compiled
def fill(
    matrix: Array,
    lower: Array,
    upper: Array,
    penalty: Array,
    joints: Array,
    scalars: Array,
    kappa: Array,
    coupled: Indices,
    q: Array,
    v: Array,
    motor_velocity: Array,
    inverse_inertia: Array,
    bias: Array,
    previous: Array,
    available: float,
    distance: Array,
    gradient: Array,
) -> None:
    """Writes power, rate, distance, position and velocity rows, in that order.

    Args:
        matrix: (m, n), the workspace's like the next three.
        lower: (m,).
        upper: (m,).
        penalty: (m,).
        joints: (7, n) per-joint limits; see the places above.
        scalars: (7,) limits; likewise.
        kappa: (4,) relative penalties of rate, distance, position and velocity rows.
        coupled: (2, n) first and one past the last joint that each joint's inertia couples it with; the matrix
            must be zero elsewhere, and stays so.
        q: (n,) [rad].
        v: (n,) [rad/s].
        motor_velocity: (n,) [rad/s].
        inverse_inertia: (n, n).
        bias: (n,) as in ``build.FilterState`` [N.m].
        previous: (n,) torque of the last cycle [N.m].
        available: Tank level above its floor [J].
        distance: (pairs,) [m].
        gradient: (pairs, n) of each pair, zero where far.
    """
    n, pairs = q.size, distance.size
    _power(matrix, upper, motor_velocity, available, scalars[POWER_HORIZON])
    horizon = scalars[HORIZON]
    position, velocity = 1 + n + pairs, 1 + 2 * n + pairs
    for i in range(n):
        centre = min(max(previous[i], -joints[EFFORT, i]), joints[EFFORT, i])
        step = joints[RATE, i] * scalars[PERIOD]
        lower[1 + i], upper[1 + i] = centre - step, centre + step
        mobility = inverse_inertia[i, i]
        penalty[1 + i] = kappa[0] * mobility
        penalty[position + i] = kappa[2] / mobility
        penalty[velocity + i] = kappa[3] / mobility
        free = 0.0
        for j in range(coupled[0, i], coupled[1, i]):
            free += inverse_inertia[i, j] * bias[j]
            matrix[position + i, j] = inverse_inertia[i, j]
            matrix[velocity + i, j] = inverse_inertia[i, j]
        brake, back = joints[BRAKING, i], joints[RETURN, i]
        high = _braking(joints[HIGH, i] - q[i], v[i], brake, back, horizon)
        low = -_braking(q[i] - joints[LOW, i], -v[i], brake, back, horizon)
        middle = 0.5 * (low + high)
        lower[position + i] = min(low, middle) + free
        upper[position + i] = max(high, middle) + free
        lower[velocity + i] = min((-joints[SPEED, i] - v[i]) / horizon, brake) + free
        upper[velocity + i] = max((joints[SPEED, i] - v[i]) / horizon, -brake) + free
    for p in range(pairs):
        row = 1 + n + p
        _distance(
            matrix, lower, penalty, row, distance[p], gradient[p], scalars, kappa[1], v, inverse_inertia, bias
        )


@compiled
def _power(matrix: Array, upper: Array, motor_velocity: Array, available: float, horizon: float) -> None:
    speed = 0.0
    for i in range(motor_velocity.size):
        speed += motor_velocity[i] * motor_velocity[i]
    speed = math.sqrt(speed)
    if speed == 0.0:
        matrix[0, :] = 0.0
        upper[0] = np.inf
        return
    for i in range(motor_velocity.size):
        matrix[0, i] = motor_velocity[i] / speed
    upper[0] = available / speed / horizon


@compiled
def _distance(
    matrix: Array,
    lower: Array,
    penalty: Array,
    row: int,
    distance: float,
    gradient: Array,
    scalars: Array,
    kappa: float,
    v: Array,
    inverse_inertia: Array,
    bias: Array,
) -> None:
    n = v.size
    far = True
    for j in range(n):
        far = far and gradient[j] == 0.0
        matrix[row, j] = 0.0
    if far:
        lower[row], penalty[row] = -np.inf, 1.0
        return
    for i in range(n):
        for j in range(n):
            matrix[row, j] += gradient[i] * inverse_inertia[i, j]
    rate, mobility, free = 0.0, 0.0, 0.0
    for j in range(n):
        mobility += matrix[row, j] * gradient[j]
        free += matrix[row, j] * bias[j]
        rate += gradient[j] * v[j]
    allowed = min((scalars[MARGIN] - distance) / scalars[APPROACH_TIME], scalars[SEPARATION_SPEED])
    wanted = min((allowed - rate) / scalars[HORIZON], scalars[SEPARATION_ACCELERATION])
    lower[row] = wanted + free
    penalty[row] = kappa / mobility
