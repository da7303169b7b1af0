# SPDX-License-Identifier: BSD-3-Clause
"""Limits as intervals of acceleration, each a pure formula over arrays.

A row keeps a state from leaving its range by bounding the acceleration of the next `horizon`:
position rows by what braking can still stop, velocity rows by what reaches the speed limit in one
horizon, distance rows by a damper whose allowed closing speed shrinks with the distance left. None
demands more than the declared deceleration, so every interval is finite work for the arm, and all
are non-empty from any state. All formulas broadcast over joints or pairs.
"""

from __future__ import annotations

import numpy as np

from impedance_modules.safety.problem import Vector


def braking_acceleration(
    room: Vector, speed: Vector, deceleration: Vector, return_speed: Vector, horizon: float
) -> Vector:
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
    half = 0.5 * deceleration * horizon
    spare = 2.0 * room - speed * horizon
    next_speed = np.sqrt(half * half + deceleration * np.maximum(spare, 0.0)) - half
    coast = (next_speed - speed) / horizon
    stop = -speed * speed / (2.0 * np.where(room > 0.0, room, 1.0))
    back = -(np.minimum(return_speed, np.maximum(-room, 0.0) / horizon) + speed) / horizon
    inside = np.where(spare >= 0.0, coast, stop)
    return np.maximum(np.where(room > 0.0, inside, back), -deceleration)


def position_interval(
    position: Vector,
    velocity: Vector,
    position_min: Vector,
    position_max: Vector,
    *,
    deceleration: Vector,
    return_speed: Vector,
    horizon: float,
) -> tuple[Vector, Vector]:
    """Accelerations from which each joint can stop before both ends of its range.

    The interval of `braking_acceleration` at both ends. Where a range is too short to stop in, the two
    ends contradict each other; both become their middle.

    Args:
        position: q [rad].
        velocity: v [rad/s].
        position_min: [rad].
        position_max: [rad].
        deceleration: [rad/s^2].
        return_speed: [rad/s].
        horizon: [s].

    Returns:
        (a_min, a_max) [rad/s^2], a_min <= a_max.
    """
    upper = braking_acceleration(position_max - position, velocity, deceleration, return_speed, horizon)
    lower = -braking_acceleration(position - position_min, -velocity, deceleration, return_speed, horizon)
    middle = 0.5 * (lower + upper)
    return np.minimum(lower, middle), np.maximum(upper, middle)


def velocity_interval(
    velocity: Vector, velocity_max: Vector, deceleration: Vector, horizon: float
) -> tuple[Vector, Vector]:
    """Accelerations that keep each joint's speed within its limit, or bring it back.

    a <= max(-b, (v_max - v) / h),   a >= min(b, (-v_max - v) / h).

    Args:
        velocity: v [rad/s].
        velocity_max: [rad/s].
        deceleration: b, the most that is demanded of a joint too fast [rad/s^2].
        horizon: h, at least the control period [s].

    Returns:
        (a_min, a_max) [rad/s^2], a_min <= a_max.
    """
    upper = np.maximum((velocity_max - velocity) / horizon, -deceleration)
    lower = np.minimum((-velocity_max - velocity) / horizon, deceleration)
    return lower, upper


def separation_acceleration(
    distance: Vector,
    rate: Vector,
    *,
    margin: float,
    approach_time: float,
    separation_speed: float,
    limit: float,
    horizon: float,
) -> Vector:
    """Smallest acceleration of a distance that a damper towards the margin asks for.

    The distance may shrink no faster than (d - margin) / T; closer than the margin it must grow at that
    rate, at most separation_speed. The allowed rate is reached in one horizon:

        a >= min(limit, (max(-(d - margin) / T, .) - d_rate) / h),   . = bounded by separation_speed

    The room r = d - margin then follows r'' + r' / h + r / (h T) = 0 at worst, which does not swing if
    T >= 4 h: a pair that starts outside the margin, not faster than the damper, never enters it.

    Args:
        distance: d [m].
        rate: Its time derivative [m/s].
        margin: [m].
        approach_time: T, at least 4 h [s].
        separation_speed: Bound of the speed demanded inside the margin [m/s].
        limit: Most acceleration ever demanded [m/s^2].
        horizon: h [s].

    Returns:
        Lower bound of the distance's acceleration [m/s^2].
    """
    allowed = np.minimum((margin - distance) / approach_time, separation_speed)
    return np.minimum((allowed - rate) / horizon, limit)


def rate_interval(
    previous: Vector, effort_rate_max: Vector, effort_max: Vector, period: float
) -> tuple[Vector, Vector]:
    """Torques that the drives can reach in one period.

    |tau - previous| <= rate_max period, around the previous torque clipped to the box.

    Args:
        previous: Torque of the last cycle [N.m].
        effort_rate_max: [N.m/s].
        effort_max: [N.m].
        period: [s].

    Returns:
        (lower, upper) [N.m].
    """
    centre = np.clip(previous, -effort_max, effort_max)
    step = effort_rate_max * period
    return centre - step, centre + step


def power_row(motor_velocity: Vector, available: float, horizon: float) -> tuple[Vector, float]:
    """The energy a torque may take from the tank before the next torque replaces it.

    thetadot . tau horizon <= available, divided by |thetadot| horizon so that the row has unit length;
    at rest the row is absent. tau = 0 always satisfies it.

    Args:
        motor_velocity: thetadot (n,), the port's speed [rad/s].
        available: Tank level above its floor [J].
        horizon: Period + delay [s].

    Returns:
        (row (n,), upper bound [N.m]).

    Raises:
        ValueError: If ``available`` is negative or not a number: a tank below its floor grants nothing.
    """
    if not available >= 0.0:
        raise ValueError(f"available energy must be >= 0 J, got {available}")
    speed = float(np.linalg.norm(motor_velocity))
    if speed == 0.0:
        return np.zeros_like(motor_velocity), np.inf
    return motor_velocity / speed, available / speed / horizon
