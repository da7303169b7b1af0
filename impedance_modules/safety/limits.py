# SPDX-License-Identifier: BSD-3-Clause
"""What the filter must keep: a robot's limits and the times over which they are kept."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from impedance_modules.records import Record, Scalar, Vector
from impedance_modules.spec.robot_spec import JointSpec, TimingSpec

GENTLE_APPROACH = 0.2
"""A pair that closes at 1 m/s is then slowed from 0.2 m before its margin on, with 5 m/s^2 [s]."""


class FilterLimits(Record):
    """Constants of one run, joints in the order of the torque vector; nothing changes them.

    Attributes:
        effort_max: (n,) [N.m].
        effort_rate_max: (n,) [N.m/s].
        position_min: (n,) [rad].
        position_max: (n,) [rad].
        velocity_max: (n,) [rad/s].
        deceleration: (n,) braking each joint may count on, and the most a joint row ever demands [rad/s^2].
        return_speed: (n,) speed at most demanded from a joint outside its range [rad/s].
        margin: Distance that pairs keep [m].
        approach_time: A pair may close no faster than (distance - margin) / approach_time, at least four
            of its horizons [s].
        separation_speed: Speed at most demanded from a pair closer than the margin [m/s].
        separation_acceleration: Most that a distance row ever demands [m/s^2].
        period: Control period [s].
        delay: From a state sample to its torque acting, beyond the period [s].
        horizon: Time over which position and velocity rows look ahead, at least one period [s].
        pair_horizon: Time over which distance rows look ahead, at least one period [s].
        reflected_inertia: (n,) of the motors [kg.m^2].
        compliance: (n,) of the springs between motors and links [rad/(N.m)], 0 for a rigid joint.
    """

    effort_max: Vector
    effort_rate_max: Vector
    position_min: Vector
    position_max: Vector
    velocity_max: Vector
    deceleration: Vector
    return_speed: Vector
    margin: Scalar
    approach_time: Scalar
    separation_speed: Scalar
    separation_acceleration: Scalar
    period: Scalar
    delay: Scalar
    horizon: Scalar
    pair_horizon: Scalar
    reflected_inertia: Vector
    compliance: Vector


def limits_of(
    joints: Sequence[JointSpec],
    timing: TimingSpec,
    *,
    rate: float,
    reflected_inertia: Vector,
    deceleration: Vector,
    margin: float,
    look_ahead: int = 5,
) -> FilterLimits:
    """The limits of a robot file at a control rate.

    Look-ahead: look_ahead * period + delay, so that a torque which acts late still acts in time; of joints at least as
    long as the slowest drive needs from full torque one way to full torque the other, of pairs, which are slow when
    they are near, from none to full torque. Pairs close in four times that, or in `GENTLE_APPROACH` if that is longer.
    A joint outside its range is asked back at a tenth of its speed limit, a pair at 0.1 m/s with at most 5 m/s^2.

    Args:
        joints: In the order of the torque vector.
        timing: The robot's delays.
        rate: Control rate of this run [Hz].
        reflected_inertia: (n,) of the rotors as a torque meets them, the robot's own torque loop included [kg.m^2].
        deceleration: (n,) see `braking_deceleration` [rad/s^2].
        margin: Distance that pairs keep [m].
        look_ahead: Periods to look ahead, at least 1.

    Raises:
        ValueError: If a limit is not positive or the look-ahead is shorter than a period.
    """
    period = 1.0 / rate
    rise = max(joint.effort_max / joint.effort_rate_max for joint in joints)
    soon = look_ahead * period + timing.command_delay
    velocity_max = np.array([joint.velocity_max for joint in joints])
    limits = FilterLimits(
        effort_max=np.array([joint.effort_max for joint in joints]),
        effort_rate_max=np.array([joint.effort_rate_max for joint in joints]),
        position_min=np.array([joint.position_min for joint in joints]),
        position_max=np.array([joint.position_max for joint in joints]),
        velocity_max=velocity_max,
        deceleration=np.array(deceleration),
        return_speed=0.1 * velocity_max,
        margin=margin,
        approach_time=max(GENTLE_APPROACH, 4.0 * max(soon, rise)),
        separation_speed=0.1,
        separation_acceleration=5.0,
        period=period,
        delay=timing.command_delay,
        horizon=max(soon, 2.0 * rise),
        pair_horizon=max(soon, rise),
        reflected_inertia=np.array(reflected_inertia),
        compliance=np.array(
            [0.0 if j.spring_stiffness is None else 1.0 / j.spring_stiffness for j in joints]
        ),
    )
    _check(limits)
    return limits


def _check(limits: FilterLimits) -> None:
    """Refuses limits under which a row would be empty or a pair would swing."""
    positive = {
        "effort_max": limits.effort_max,
        "effort_rate_max": limits.effort_rate_max,
        "velocity_max": limits.velocity_max,
        "deceleration": limits.deceleration,
        "return_speed": limits.return_speed,
        "position_max - position_min": limits.position_max - limits.position_min,
        "separation_speed": limits.separation_speed,
        "separation_acceleration": limits.separation_acceleration,
        "period": limits.period,
    }
    bad = [name for name, value in positive.items() if not np.all(np.asarray(value) > 0.0)]
    if bad:
        raise ValueError(f"filter limits must be positive, these are not: {', '.join(bad)}")
    if not (limits.delay >= 0.0 and limits.margin >= 0.0):
        raise ValueError(f"delay and margin must not be negative: {limits.delay} s, {limits.margin} m")
    if not min(limits.horizon, limits.pair_horizon) >= limits.period:
        raise ValueError(
            f"horizons {limits.horizon} s and {limits.pair_horizon} s must be at least the period {limits.period} s"
        )
    if not limits.approach_time >= 4.0 * limits.pair_horizon:
        raise ValueError(
            f"approach_time {limits.approach_time} s must be at least four horizons of {limits.pair_horizon} s, "
            "or a pair swings through its margin"
        )


def braking_deceleration(effort_max: Vector, inertia: Vector, share: float = 0.5) -> Vector:
    """Braking that a share of each joint's torque gives against its own inertia.

    b_i = share effort_max_i / M_ii. M_ii, the inertia with the other joints held, is the largest that
    the joint ever accelerates; the rest of the torque is left for bias and coupling.

    Args:
        effort_max: (n,) [N.m].
        inertia: (n,) largest diagonal of M + I_r over the poses of interest [kg.m^2].
        share: In (0, 1].

    Returns:
        (n,) [rad/s^2].
    """
    return share * effort_max / inertia
