# SPDX-License-Identifier: BSD-3-Clause
"""The filter's quadratic program filled in by compiled code; formulas and reasons are in ``build.py``.

``fill`` writes what ``build.build`` writes, into the arrays of the same ``FilterWorkspace``.
``tests/laws/test_compiled_filter.py`` holds them together.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]

POWER_HORIZON, HORIZON, PERIOD, MARGIN, APPROACH_TIME, SEPARATION_SPEED, SEPARATION_ACCELERATION = range(7)
"""Places of the scalar limits, names as in ``limits.FilterLimits``."""

EFFORT, RATE, LOW, HIGH, SPEED, BRAKING, RETURN = range(7)
"""Places of the per-joint limits: effort_max, effort_rate_max, position_min, position_max, velocity_max,
deceleration, return_speed."""


@njit(cache=True)
def metric(
    inverse_inertia: Array, jacobian: Array, eps: float, floor_linear: float, floor_angular: float, out: Array
) -> None:
    r"""Writes W = sum_hands Minv J^T Lambda J Minv + eps Minv (see ``metric.metric``)."""
    n = inverse_inertia.shape[0]
    for i in range(n):
        for j in range(n):
            out[i, j] = eps * inverse_inertia[i, j]
    acceleration = np.empty((6, n))
    factor = np.empty((6, 6))
    for hand in range(jacobian.shape[0]):
        first, last = _columns(jacobian[hand])
        for r in range(6):
            for j in range(n):
                total = 0.0
                for k in range(first, last):
                    total += jacobian[hand, r, k] * inverse_inertia[k, j]
                acceleration[r, j] = total
        _cholesky_of_mobility(acceleration, jacobian[hand], first, last, floor_linear, floor_angular, factor)
        _divide(factor, acceleration)
        low, high = _columns(acceleration)
        for i in range(low, high):
            for j in range(low, i + 1):
                total = 0.0
                for r in range(6):
                    total += acceleration[r, i] * acceleration[r, j]
                out[i, j] += total
                if i != j:
                    out[j, i] += total


@njit(cache=True)
def _columns(matrix: Array) -> tuple[int, int]:
    """Finds the first and one past the last column that is not all zero: a limb's part of the robot."""
    n = matrix.shape[1]
    first, last = n, 0
    for j in range(n):
        for r in range(matrix.shape[0]):
            if matrix[r, j] != 0.0:
                first = min(first, j)
                last = j + 1
    return first, last


@njit(cache=True)
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


@njit(cache=True)
def _divide(factor: Array, rows: Array) -> None:
    """Replaces rows by L^-1 rows."""
    for j in range(rows.shape[1]):
        for r in range(6):
            total = rows[r, j]
            for k in range(r):
                total -= factor[r, k] * rows[k, j]
            rows[r, j] = total / factor[r, r]


@njit(cache=True)
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


@njit(cache=True)
def fill(
    matrix: Array,
    lower: Array,
    upper: Array,
    penalty: Array,
    joints: Array,
    scalars: Array,
    kappa: Array,
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
        matrix, lower, upper, penalty: (m, n), (m,): the workspace's arrays.
        joints: (7, n) per-joint limits, scalars: (7,) limits; see the places above.
        kappa: (4,) relative penalties of rate, distance, position and velocity rows.
        q, v, motor_velocity, bias, previous: (n,) as in ``build.FilterState``.
        inverse_inertia: (n, n).
        available: Tank level above its floor [J].
        distance: (pairs,), gradient: (pairs, n) of each pair, zero gradient where far.
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
        for j in range(n):
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
        _distance(
            matrix,
            lower,
            penalty,
            1 + n + p,
            distance[p],
            gradient[p],
            scalars,
            kappa[1],
            v,
            inverse_inertia,
            bias,
        )


@njit(cache=True)
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


@njit(cache=True)
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
    rate, mobility, free = 0.0, 0.0, 0.0
    for j in range(n):
        total = 0.0
        for i in range(n):
            total += gradient[i] * inverse_inertia[i, j]
        matrix[row, j] = total
        mobility += total * gradient[j]
        free += total * bias[j]
        rate += gradient[j] * v[j]
    if mobility == 0.0:
        lower[row], penalty[row] = -np.inf, 1.0
        return
    allowed = min((scalars[MARGIN] - distance) / scalars[APPROACH_TIME], scalars[SEPARATION_SPEED])
    wanted = min((allowed - rate) / scalars[HORIZON], scalars[SEPARATION_ACCELERATION])
    lower[row] = wanted + free
    penalty[row] = kappa / mobility
