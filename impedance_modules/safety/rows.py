# SPDX-License-Identifier: BSD-3-Clause
r"""First of the filter's three steps: the limits of one cycle become rows on the torque.

Accelerations are torques seen through the inertia, vdot_i = Minv_i . (tau - bias), so a limit
a_min <= vdot_i <= a_max is the row Minv_i . tau in [a_min, a_max] + Minv_i . bias. A row keeps a state from leaving
its range by bounding the acceleration of the next ``horizon``: position rows by what braking can still stop, velocity
rows by what reaches the speed limit in one horizon, distance rows by a damper whose allowed closing speed shrinks
with the distance left. None demands more than the declared deceleration, so every interval is finite work for the
arm, and all are non-empty from any state.

The penalty of a soft row is commensurate with the metric: moving a row a . tau by one unit costs at least
1 / (a W^-1 a^T), and a W^-1 a^T lies between g / (1 + eps) and g / eps with g = a M a^T (``metric.py``). So
w = kappa / g makes a row resist between kappa / (1 + eps) and kappa / eps times harder than the desired torque pulls,
whatever its units. g is Minv_ii for an acceleration row Minv_i, 1 / Minv_ii (a lower bound of M_ii) for a single
torque, c Minv c^T for the acceleration along c.
"""

from __future__ import annotations

import math

import numpy as np

from impedance_modules.compiled import compiled
from impedance_modules.records import Vector
from impedance_modules.safety.filter_problem import POWER_ROW, FilterProblem, FilterState
from impedance_modules.safety.limits import FilterLimits


@compiled
def write_rows(problem: FilterProblem, limits: FilterLimits, state: FilterState) -> None:
    """Writes power, rate, distance, position and velocity rows with bounds and penalties.

    Args:
        problem: ``matrix``, ``lower``, ``upper`` and ``penalty`` are overwritten.
        limits: Constants of the run.
        state: This cycle.
    """
    write_power_row(problem, state.motor_velocity, state.available, limits.period + limits.delay)
    for i in range(state.q.size):
        _write_rate_row(problem, limits, state, i)
        _write_joint_rows(problem, limits, state, i)
    for pair in range(state.distance.size):
        _write_distance_row(problem, limits, state, pair)


@compiled
def write_power_row(problem: FilterProblem, motor_velocity: Vector, available: float, horizon: float) -> None:
    """The energy a torque may take from the tank before the next torque replaces it.

    thetadot . tau horizon <= available, divided by |thetadot| horizon so that the row has unit length;
    at rest the row is absent. tau = 0 always satisfies it.

    Args:
        problem: Its first row is overwritten.
        motor_velocity: (n,) thetadot, the port's speed [rad/s].
        available: Tank level above its floor, >= 0 [J].
        horizon: Period + delay [s].
    """
    square = 0.0
    for i in range(motor_velocity.size):
        square += motor_velocity[i] * motor_velocity[i]
    speed = math.sqrt(square)
    if speed == 0.0:
        problem.matrix[POWER_ROW, :] = 0.0
        problem.upper[POWER_ROW] = np.inf
        return
    for i in range(motor_velocity.size):
        problem.matrix[POWER_ROW, i] = motor_velocity[i] / speed
    problem.upper[POWER_ROW] = available / speed / horizon


@compiled
def _write_rate_row(problem: FilterProblem, limits: FilterLimits, state: FilterState, i: int) -> None:
    """Bounds one joint's torque by what its drive can reach in one period."""
    row = 1 + i
    problem.lower[row], problem.upper[row] = rate_interval(limits, i, state.previous[i])
    problem.penalty[row] = problem.kappa[row] * state.inverse_inertia[i, i]


@compiled
def rate_interval(limits: FilterLimits, i: int, previous: float) -> tuple[float, float]:
    """Torques that a drive can reach in one period.

    |tau - previous| <= rate_max period, around the previous torque clipped to the torque limits.

    Args:
        limits: effort_max, effort_rate_max and period.
        i: Joint.
        previous: Torque of the last cycle [N.m].

    Returns:
        (lower, upper) [N.m].
    """
    centre = min(max(previous, -limits.effort_max[i]), limits.effort_max[i])
    step = limits.effort_rate_max[i] * limits.period
    return centre - step, centre + step


@compiled
def _write_joint_rows(problem: FilterProblem, limits: FilterLimits, state: FilterState, i: int) -> None:
    """Bounds one joint's acceleration, Minv_i . (tau - bias), by its range and by its speed limit."""
    position = 1 + state.q.size + state.distance.size + i
    velocity = position + state.q.size
    mobility, free = state.inverse_inertia[i, i], 0.0
    problem.penalty[position] = problem.kappa[position] / mobility
    problem.penalty[velocity] = problem.kappa[velocity] / mobility
    for j in range(problem.coupled[0, i], problem.coupled[1, i]):
        free += state.inverse_inertia[i, j] * state.bias[j]
        problem.matrix[position, j] = state.inverse_inertia[i, j]
        problem.matrix[velocity, j] = state.inverse_inertia[i, j]
    low, high = position_interval(limits, i, state.q[i], state.v[i])
    problem.lower[position], problem.upper[position] = low + free, high + free
    low, high = velocity_interval(limits, i, state.v[i])
    problem.lower[velocity], problem.upper[velocity] = low + free, high + free


@compiled
def position_interval(limits: FilterLimits, i: int, q: float, v: float) -> tuple[float, float]:
    """Accelerations from which a joint can stop before both ends of its range.

    The interval of ``braking_acceleration`` at both ends. Where a range is too short to stop in, the two
    ends contradict each other; both become their middle.

    Args:
        limits: position_min, position_max, deceleration, return_speed and horizon.
        i: Joint.
        q: [rad].
        v: [rad/s].

    Returns:
        (a_min, a_max) [rad/s^2], a_min <= a_max.
    """
    brake, back, horizon = limits.deceleration[i], limits.return_speed[i], limits.horizon
    high = braking_acceleration(limits.position_max[i] - q, v, brake, back, horizon)
    low = -braking_acceleration(q - limits.position_min[i], -v, brake, back, horizon)
    middle = 0.5 * (low + high)
    return min(low, middle), max(high, middle)


@compiled
def braking_acceleration(
    room: float, speed: float, deceleration: float, return_speed: float, horizon: float
) -> float:
    r"""Largest acceleration towards a limit from which the joint can still stop before it.

    With room d to the limit, speed v towards it, braking b and horizon h, the acceleration a is held for
    h and braking follows: d >= (v + v') h / 2 + v'^2 / (2 b), v' = v + a h. So

        d >= v h / 2 :  a = (v' - v) / h,  v' = -b h / 2 + sqrt((b h / 2)^2 + b (2 d - v h))
        0 < d < v h / 2 :  a = -v^2 / (2 d)           stops inside the horizon, at the limit
        d <= 0 :  a = (-min(return_speed, -d / h) - v) / h      back, at a bounded speed

    and never less than -b. From d >= v^2 / (2 b), or v <= 0, the result is at least -b without that
    clip, and obeying it for any time up to h keeps the state there: the limit is never crossed. A joint
    that has to stop inside one period leaves it at b times the period or slower, backwards.

    Args:
        room: Distance to the limit, negative outside [rad].
        speed: Towards the limit [rad/s].
        deceleration: b > 0 [rad/s^2].
        return_speed: Bound of the speed demanded outside, > 0 [rad/s].
        horizon: h, at least the control period [s].

    Returns:
        Upper bound of the acceleration towards the limit [rad/s^2].
    """
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
def velocity_interval(limits: FilterLimits, i: int, v: float) -> tuple[float, float]:
    """Accelerations that keep a joint's speed within its limit, or bring it back.

    a <= max(-b, (v_max - v) / h),   a >= min(b, (-v_max - v) / h).

    Args:
        limits: velocity_max; deceleration, b, the most that is demanded of a joint too fast; horizon, h.
        i: Joint.
        v: [rad/s].

    Returns:
        (a_min, a_max) [rad/s^2], a_min <= a_max.
    """
    low = min((-limits.velocity_max[i] - v) / limits.horizon, limits.deceleration[i])
    high = max((limits.velocity_max[i] - v) / limits.horizon, -limits.deceleration[i])
    return low, high


@compiled
def _write_distance_row(problem: FilterProblem, limits: FilterLimits, state: FilterState, pair: int) -> None:
    """Bounds the acceleration of one pair's distance; the row of a far pair, without a gradient, is absent.

    How the distance would accelerate by itself, without vdot, is left out: 5 m/s^2 at most, at full speed.
    """
    n, far = state.v.size, True
    row = 1 + n + pair
    for j in range(n):
        far = far and state.gradient[pair, j] == 0.0
        problem.matrix[row, j] = 0.0
    if far:
        problem.lower[row], problem.penalty[row] = -np.inf, 1.0
        return
    for i in range(n):
        for j in range(n):
            problem.matrix[row, j] += state.gradient[pair, i] * state.inverse_inertia[i, j]
    rate, mobility, free = 0.0, 0.0, 0.0
    for j in range(n):
        mobility += problem.matrix[row, j] * state.gradient[pair, j]
        free += problem.matrix[row, j] * state.bias[j]
        rate += state.gradient[pair, j] * state.v[j]
    problem.lower[row] = separation_acceleration(limits, state.distance[pair], rate) + free
    problem.penalty[row] = problem.kappa[row] / mobility


@compiled
def separation_acceleration(limits: FilterLimits, distance: float, rate: float) -> float:
    """Smallest acceleration of a distance that a damper towards the margin asks for.

    The distance may shrink no faster than (d - margin) / T, T the approach time; closer than the margin it must grow
    at that rate, at most separation_speed. The allowed rate is reached in one horizon h:

        a >= min(limit, (max(-(d - margin) / T, .) - d_rate) / h),   . = bounded by separation_speed

    The room r = d - margin then follows r'' + r' / h + r / (h T) = 0 at worst, which does not swing if
    T >= 4 h: a pair that starts outside the margin, not faster than the damper, never enters it.

    Args:
        limits: margin, approach_time, separation_speed, separation_acceleration (the limit) and horizon.
        distance: d [m].
        rate: Its time derivative [m/s].

    Returns:
        Lower bound of the distance's acceleration [m/s^2].
    """
    allowed = min((limits.margin - distance) / limits.approach_time, limits.separation_speed)
    return min((allowed - rate) / limits.horizon, limits.separation_acceleration)
