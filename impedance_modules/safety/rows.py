# SPDX-License-Identifier: BSD-3-Clause
r"""First of the filter's three steps: the limits of one cycle become rows on the torque.

A state is kept in its range by bounding the acceleration of the next ``horizon``: velocity rows by what reaches the
speed limit in one horizon, position rows by what braking can still stop, motor rows by how far a motor swings against
its link, distance rows by a damper whose allowed closing speed shrinks with the distance left. All look at the motion
that is expected when the torque begins to act (``expected_motion``). None demands more than the declared deceleration,
so every interval is finite work for the arm, and all are non-empty from any state.

A joint keeps its own limits with its own torque. vdot_i = Minv_i . (tau - bias), and a_min <= vdot_i <= a_max could as
well be kept by a shoulder that swings a wrist; but a torque reaches another joint only through two springs, and by then
the shoulder is the joint that is too fast. So each joint mends what the last torques of all did to it:

    tau_i in previous_i + ([a_min, a_max] - Minv_i . (previous - bias)) / g_i
    g_i = max(Minv_ii, sum_j |Minv_ij| / 2)

Joints that mend at once do not shake each other: the eigenvalues of diag(1/g) Minv lie between 0 and 2 (Gershgorin).

Limits of one joint are bounds of one torque: each keeps within what those before it have left, in the order torque
limit, rate, speed, swing, range. Speeds come before places, because the guarantee of the energy tank rests on them.

The penalty of a soft row is commensurate with the metric: moving a row a . tau by one unit costs at least
1 / (a W^-1 a^T), and a W^-1 a^T lies between g / (1 + eps) and g / eps with g = a M a^T (``metric.py``). So
w = kappa / g makes a row resist between kappa / (1 + eps) and kappa / eps times harder than the desired torque pulls,
whatever its units. g is 1 / Minv_ii (a lower bound of M_ii) for a single torque, c Minv c^T for the acceleration of
a distance along c.
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
    """Writes power, rate, motor, velocity, distance and position rows with bounds and penalties.

    Args:
        problem: ``matrix``, ``lower``, ``upper`` and ``penalty`` are overwritten.
        limits: Constants of the run.
        state: This cycle.
    """
    write_power_row(problem, state.motor_velocity, state.available, limits.period + limits.delay)
    for i in range(state.q.size):
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
def _write_joint_rows(problem: FilterProblem, limits: FilterLimits, state: FilterState, i: int) -> None:
    """Bounds one joint's torque by its drive's rate, its speed limit, its motor's swing and its range."""
    n, mobility, previous = state.q.size, state.inverse_inertia[i, i], state.previous[i]
    rate, motor, velocity = 1 + i, 1 + n + i, 1 + 2 * n + i
    position = 1 + 3 * n + state.distance.size + i
    before, all_at_once = 0.0, 0.0
    for j in range(problem.coupled[0, i], problem.coupled[1, i]):
        before += state.inverse_inertia[i, j] * (state.previous[j] - state.bias[j])
        all_at_once += abs(state.inverse_inertia[i, j])
    gain = max(mobility, 0.5 * all_at_once)
    for row in (rate, motor, velocity, position):
        problem.penalty[row] = problem.kappa[row] * mobility
    low, high = rate_interval(limits, i, previous)
    problem.lower[rate], problem.upper[rate] = low, high
    low, high = max(low, -limits.effort_max[i]), min(high, limits.effort_max[i])
    least, most = velocity_interval(limits, i, state.v[i], state.link_velocity[i], state.push[i])
    least, most = previous + (least - before) / gain, previous + (most - before) / gain
    low, high = narrow(problem, velocity, low, high, least, most)
    least, most = motor_interval(limits, i, state.link_velocity[i], state.swing[i], state.load[i])
    low, high = narrow(problem, motor, low, high, least, most)
    least, most = position_interval(limits, i, state.q[i], state.v[i])
    least, most = previous + (least - before) / gain, previous + (most - before) / gain
    narrow(problem, position, low, high, least, most)


@compiled
def narrow(
    problem: FilterProblem, row: int, low: float, high: float, least: float, most: float
) -> tuple[float, float]:
    """Writes what one limit asks of a joint's torque within what the limits before it have left.

    Where it contradicts them it gets as near to its own as they allow; where it asks for nothing new it is absent.

    Args:
        problem: One row's bounds are overwritten.
        row: Which.
        low: Least that the limits before it have left [N.m].
        high: Most that they have left [N.m], at least ``low``.
        least: Least that this limit asks for [N.m].
        most: Most that it asks for [N.m], at least ``least``.

    Returns:
        What is left now [N.m].
    """
    least, most = min(max(least, low), high), min(max(most, low), high)
    problem.lower[row] = least if least > low else -np.inf
    problem.upper[row] = most if most < high else np.inf
    return least, most


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
def motor_interval(limits: FilterLimits, i: int, v: float, swing: float, load: float) -> tuple[float, float]:
    r"""Torques under which the motor of an elastic joint does not swing beyond the speed limit.

    Against a link that goes on at its speed v, a motor under a constant torque tau moves on the circle

        r^2 + ((tau - s) / (I omega))^2,     theta' = v + r,     omega^2 = 1 / (I c)

    so that theta' stays below v_max as long as tau <= s + I omega sqrt(R^2 - r^2), R = v_max - v; likewise below.
    A swing beyond R is asked back with the rate omega.

    Args:
        limits: velocity_max, reflected_inertia I, compliance c.
        i: Joint.
        v: Of the link [rad/s].
        swing: r [rad/s].
        load: s, the torque of the spring without the weight [N.m].

    Returns:
        (lower, upper) [N.m], lower <= upper; infinite where no motor swings against a link.
    """
    own, top = limits.reflected_inertia[i], limits.velocity_max[i]
    if not (own > 0.0 and limits.compliance[i] > 0.0):
        return -np.inf, np.inf
    push = math.sqrt(own / limits.compliance[i])
    above, below = max(0.0, top - v), max(0.0, top + v)
    lower = load - push * max(swing_left(below, -swing), -above)
    upper = load + push * max(swing_left(above, swing), -below)
    # A swing beyond one side is asked back, whatever is left on the other.
    return (min(lower, upper), upper) if swing > 0.0 else (lower, max(lower, upper))


@compiled
def swing_left(most: float, swing: float) -> float:
    """How much of a circle of radius ``most`` is left at a swing, sqrt(most^2 - swing^2) [rad/s].

    Beyond the circle on its own side it is asked back: negative. Beyond it on the other side nothing is left.
    """
    if abs(swing) < most:
        return math.sqrt(most * most - swing * swing)
    return min(0.0, most - swing)


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
def velocity_interval(
    limits: FilterLimits, i: int, v: float, link: float, push: float
) -> tuple[float, float]:
    """Accelerations by the robot's own torque that keep a joint's speed within its limit, or bring it back.

        a + p <= max(-b, (v_max - v) / h),   a + p >= min(b, (-v_max - v) / h)

    v is the faster of the joint and its link alone, p what pushes the arm from outside, b at most. What holds a joint
    back may let go at once: it is counted on up to as much again as is allowed without it.

    Args:
        limits: velocity_max; deceleration, b, the most that is demanded of a joint too fast; horizon, h.
        i: Joint.
        v: Of motor and link together [rad/s].
        link: Of the link alone [rad/s].
        push: p [rad/s^2].

    Returns:
        (a_min, a_max) [rad/s^2], a_min <= a_max.
    """
    top, brake = limits.velocity_max[i], limits.deceleration[i]
    low = min((-top - min(v, link)) / limits.horizon, brake)
    high = max((top - max(v, link)) / limits.horizon, -brake)
    low -= max(min(push, brake, max(0.0, -low)), -brake)
    high -= min(max(push, -brake, min(0.0, -high)), brake)
    middle = 0.5 * (low + high)
    return min(low, middle), max(high, middle)


@compiled
def _write_distance_row(problem: FilterProblem, limits: FilterLimits, state: FilterState, pair: int) -> None:
    """Bounds the acceleration of one pair's distance; the row of a far pair, without a gradient, is absent."""
    n, far = state.v.size, True
    row = 1 + 3 * n + pair
    for j in range(n):
        far = far and state.gradient[pair, j] == 0.0
        problem.matrix[row, j] = 0.0
    if far:
        problem.lower[row], problem.penalty[row] = -np.inf, 1.0
        return
    for i in range(n):
        for j in range(n):
            problem.matrix[row, j] += state.gradient[pair, i] * state.inverse_inertia[i, j]
    rate, mobility, free, push = 0.0, 0.0, 0.0, 0.0
    for j in range(n):
        mobility += problem.matrix[row, j] * state.gradient[pair, j]
        free += problem.matrix[row, j] * state.bias[j]
        rate += state.gradient[pair, j] * state.v[j]
        push += state.gradient[pair, j] * state.push[j]
    least = separation_acceleration(limits, state.distance[pair], rate, state.drift[pair])
    problem.lower[row] = least_with_push(least, push) + free
    problem.penalty[row] = problem.kappa[row] / mobility


@compiled
def separation_acceleration(limits: FilterLimits, distance: float, rate: float, drift: float) -> float:
    """Smallest acceleration that joints must give a distance so that a damper towards the margin is obeyed.

    The distance may shrink no faster than (d - margin) / T, T the approach time; closer than the margin it must grow
    at that rate, at most separation_speed. The allowed rate is reached in one horizon h:

        a + drift >= (min(-(d - margin) / T, separation_speed) - d_rate) / h,   a at most ``limit``

    drift is what the distance does at constant joint velocities.

    The room r = d - margin then follows r'' + r' / h + r / (h T) = 0 at worst, which does not swing if
    T >= 4 h: a pair that starts outside the margin, not faster than the damper, never enters it.

    Args:
        limits: margin, approach_time, separation_speed, separation_acceleration (the limit) and pair_horizon.
        distance: d [m].
        rate: Its time derivative [m/s].
        drift: Its second derivative at constant joint velocities [m/s^2].

    Returns:
        Lower bound of what the joints' accelerations add to the distance's [m/s^2].
    """
    allowed = min((limits.margin - distance) / limits.approach_time, limits.separation_speed)
    return min((allowed - rate) / limits.pair_horizon - drift, limits.separation_acceleration)


@compiled
def least_with_push(least: float, push: float) -> float:
    r"""Smallest acceleration that joints must give a distance while something pushes the two links apart.

    Hands that squeeze a box close no faster for it: the box pushes back, and its push is measured. It may let go at
    once, slip or break, so it is counted on up to as much again as is allowed without it, and only while closing is
    allowed at all:

        a >= l - min(max(p, 0), max(-l, 0)),      l the bound without it

    At worst, p counted in full and not there, r'' + 2 r' / h + 2 r / (h T) = 0: with T >= 4 h this does not swing
    either, and the pair still never enters the margin. In samples this asks for h of two periods; ``limits_of`` looks
    five ahead.

    Args:
        least: l [m/s^2].
        push: p, what forces that are not the robot's own add to the distance's acceleration [m/s^2].

    Returns:
        Lower bound of what the joints' accelerations add to the distance's [m/s^2].
    """
    return least - min(max(push, 0.0), max(-least, 0.0))
