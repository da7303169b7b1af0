# SPDX-License-Identifier: BSD-3-Clause
r"""How joints and motors move when the torque that is being computed begins to act.

A limit is kept by the torque that acts, and that torque acts late: on a state measured before, through a velocity
estimate that lags, after d commands that are in flight. So the filter's rows bound the motion expected at that moment.

**Motor.** Its acceleration is known from what acts on it, whatever pushes the arm: the torque tau that acts, the spring
torque s, its own damping D,

    I_r theta'' = tau - s - D theta',      s = s_measured - weight - b

The robot carries the weight itself, and so it does b, what the model lacks of that: springs beside a joint, a link that
is heavier. b changes slowly, and so it is told from a load that pushes the motor now: over `SLOW` seconds it follows
what the model's acceleration has and the reported velocity has not.

The robot reports velocities through a first-order filter, y' = (v - y) / T_f; what such a filter keeps back of a
velocity obeys e' = v' - e / T_f. So theta' = y + e: slow motion comes from the sensors, quick motion from the torques,
and no position is differentiated twice. The link moves at q' = theta' - r, r the rate of the spring's deflection.

**Joint as a whole.** Springs between motors and links do not change the momentum of both, with M = M_link + I_r:

    u = q' + M^{-1} I_r r,      u' = M^{-1} (tau - bias - D theta') + p

p is what pushes the arm from outside: what e of u has and the model's e, driven without p, lacks, over T_f.

**Until the torque acts**, u goes on at u' under the commands in flight, and each motor swings against its link:

    r' = (tau - s) / I_r - u',      s' = r / c,      c = 1 / K_sea
"""

from __future__ import annotations

import math

import numpy as np

from impedance_modules.compiled import compiled
from impedance_modules.records import Integer, Matrix, Record, Scalar, Vector

QUICK = 0.1
"""Time constant with which the rate of a spring's deflection is filtered, over that of the robot's velocity: the
measured torque is fine enough (1 % of a Baxter joint's top speed at 1 kHz)."""

SLOW = 0.05
"""Time constant of b [s]: some times that of the robot's velocity, and slower than a motor swings against its link."""


class ExpectedMotion(Record):
    """The estimate and its memory.

    Attributes:
        period: Control period, T [s].
        lag: Time constant of the robot's velocity estimate, T_f [s]; 0 for none.
        delay: Commands in flight, d.
        age: Of the deflection's rate [s].
        share: Of a new difference in that rate.
        compliance: (n,) c [rad/(N.m)], 0 for a rigid joint.
        reflected_inertia: (n,) I_r [kg.m^2]; 0 for a torque source.
        motor_damping: (n,) D [N.m.s/rad].
        inverse_inertia: (n, n) (M + I_r)^-1; this and the next two are the arms' own, up to date.
        bias: (n,) Coriolis torque [N.m].
        weight: (n,) torque that carries the arms and winds their parallel springs, the robot's own [N.m].
        measured: (3, n) position [rad], velocity as reported [rad/s], torque between gearbox and link [N.m].
        slow: (n,) rate of the springs' deflection as late as the reported velocity [rad/s].
        reported: (n,) velocity of the motors as late as that, at the last sample [rad/s].
        carried: (n,) b, what the robot carries beside the weight [N.m].
        deflection: (n,) of the joints' springs at the last sample [rad].
        rate: (n,) its rate, filtered [rad/s].
        turned: (n,) e / T_f, acceleration of the motors by what acts on them, as late as reported [rad/s^2].
        explained: (n,) e of u without pushes from outside [rad/s].
        acceleration: (n,) u' in the last interval, without pushes from outside [rad/s^2].
        motor_velocity: (n,) of the motors now [rad/s].
        push: (n,) p [rad/s^2].
        position: (n,) expected [rad].
        velocity: (n,) u expected [rad/s].
        link_velocity: (n,) q' expected [rad/s].
        swing: (n,) r expected [rad/s].
        load: (n,) s expected [N.m].
    """

    period: Scalar
    lag: Scalar
    delay: Integer
    age: Scalar
    share: Scalar
    compliance: Vector
    reflected_inertia: Vector
    motor_damping: Vector
    inverse_inertia: Matrix
    bias: Vector
    weight: Vector
    measured: Matrix
    slow: Vector
    reported: Vector
    carried: Vector
    deflection: Vector
    rate: Vector
    turned: Vector
    explained: Vector
    acceleration: Vector
    motor_velocity: Vector
    push: Vector
    position: Vector
    velocity: Vector
    link_velocity: Vector
    swing: Vector
    load: Vector


def expected_motion(
    *,
    compliance: Vector,
    reflected_inertia: Vector,
    motor_damping: Vector,
    arms: tuple[Matrix, Vector, Vector],
    slow: Vector,
    period: float,
    lag: float,
    delay: int,
) -> ExpectedMotion:
    """Prepares the estimate; arguments as in ``ExpectedMotion``, ``arms``: inverse inertia, bias and weight."""
    n, quick = compliance.size, QUICK * lag
    memory = ("reported", "carried", "deflection", "rate", "turned", "explained", "acceleration")
    found = ("motor_velocity", "push", "position", "velocity", "link_velocity", "swing", "load")
    return ExpectedMotion(
        period=period,
        lag=lag,
        delay=delay,
        age=quick + 0.5 * period,
        share=1.0 - math.exp(-period / quick) if quick > 0.0 else 1.0,
        compliance=compliance.copy(),
        reflected_inertia=reflected_inertia.copy(),
        motor_damping=motor_damping.copy(),
        inverse_inertia=arms[0],
        bias=arms[1],
        weight=arms[2],
        measured=np.zeros((3, n)),
        slow=slow,
        **{name: np.zeros(n) for name in memory + found},
    )


def begin_steady(motion: ExpectedMotion, velocity: Vector, effort: Vector, acting: Vector) -> None:
    """Starts from a state (n,), (n,) under torques (n,) that all are taken as steady."""
    motion.deflection[:] = effort * motion.compliance
    motion.rate[:], motion.turned[:], motion.explained[:] = 0.0, 0.0, 0.0
    motion.motor_velocity[:] = motion.reported[:] = velocity
    motion.carried[:] = effort - motion.weight - acting


@compiled
def expect_motion(motion: ExpectedMotion, intervals: int, applied: Vector, pending: Matrix) -> None:
    """Takes one sample and writes what is expected when the next torque begins to act.

    Args:
        motion: ``measured``, ``slow`` and what is the arms' own are of this sample; the rest is overwritten.
        intervals: Periods since the last sample, 1 unless states were missed.
        applied: (n,) torque that acted in the last interval [N.m].
        pending: (d + 1, n) commands in flight, oldest first, and a row for the next one [N.m].
    """
    seconds = motion.period * intervals
    decay = math.exp(-seconds / motion.lag) if motion.lag > 0.0 else 0.0
    for i in range(applied.size):
        motion.acceleration[i] = _free_acceleration(motion, applied, i)
    for i in range(applied.size):
        deflection = motion.measured[2, i] * motion.compliance[i]
        motion.rate[i] += motion.share * ((deflection - motion.deflection[i]) / seconds - motion.rate[i])
        motion.deflection[i] = deflection
        _estimate_motor(motion, applied[i], seconds, decay, i)
        motion.swing[i] = motion.rate[i]
        if _swings(motion, i):
            _swing_on(motion, i, applied[i], motion.acceleration[i] + motion.push[i], motion.age)
    for i in range(applied.size):
        motion.velocity[i] = motion.motor_velocity[i] - motion.swing[i]
        motion.velocity[i] += _shared(motion, motion.swing, i)
    for i in range(applied.size):
        _look_ahead(motion, pending, decay, i)
    for i in range(applied.size):
        motion.link_velocity[i] = motion.velocity[i] - _shared(motion, motion.swing, i)


@compiled
def _estimate_motor(motion: ExpectedMotion, applied: float, seconds: float, decay: float, i: int) -> None:
    """Velocity and load of one motor now; ``decay``: of what the velocity filter keeps back."""
    own, reported = motion.reflected_inertia[i], motion.measured[1, i] + motion.slow[i]
    motion.load[i] = motion.measured[2, i] - motion.weight[i] - motion.carried[i]
    turn = motion.acceleration[i]
    if own > 0.0:
        turn = (applied - motion.load[i] - motion.motor_damping[i] * motion.motor_velocity[i]) / own
    motion.turned[i] = decay * motion.turned[i] + (1.0 - decay) * turn
    seen = (reported - motion.reported[i]) / seconds
    motion.carried[i] += (1.0 - math.exp(-seconds / SLOW)) * own * (seen - motion.turned[i])
    motion.reported[i] = reported
    motion.motor_velocity[i] = reported + motion.lag * motion.turned[i]


@compiled
def _look_ahead(motion: ExpectedMotion, pending: Matrix, decay: float, i: int) -> None:
    """Lets one joint go on until the next torque acts; ``decay``: of what the velocity filter keeps back."""
    past, now = motion.acceleration[i], motion.velocity[i]
    motion.explained[i] = decay * motion.explained[i] + motion.lag * (1.0 - decay) * past
    kept_back = now - motion.measured[1, i] - _shared(motion, motion.slow, i)
    motion.push[i] = (kept_back - motion.explained[i]) / motion.lag if motion.lag > 0.0 else 0.0
    for k in range(motion.delay):
        turn = _free_acceleration(motion, pending[k], i) + motion.push[i]
        motion.velocity[i] += motion.period * turn
        if _swings(motion, i):
            _swing_on(motion, i, pending[k, i], turn, motion.period)
    ahead = motion.delay * motion.period
    motion.position[i] = motion.measured[0, i] + 0.5 * ahead * (now + motion.velocity[i])


@compiled
def _swings(motion: ExpectedMotion, i: int) -> bool:
    """Tells whether a joint has a motor that swings against its link."""
    return bool(motion.compliance[i] > 0.0 and motion.reflected_inertia[i] > 0.0)


@compiled
def _free_acceleration(motion: ExpectedMotion, effort: Vector, i: int) -> float:
    """What torques (n,) do to joint i as a whole, without pushes from outside [rad/s^2]."""
    total = 0.0
    for j in range(effort.size):
        if motion.inverse_inertia[i, j] != 0.0:
            lost = motion.bias[j] + motion.motor_damping[j] * motion.motor_velocity[j]
            total += motion.inverse_inertia[i, j] * (effort[j] - lost)
    return total


@compiled
def _shared(motion: ExpectedMotion, rate: Vector, i: int) -> float:
    """M^-1 I_r r of joint i: what the motors' own motion r (n,) adds to the joint's as a whole [rad/s]."""
    total = 0.0
    for j in range(rate.size):
        if motion.inverse_inertia[i, j] != 0.0:
            total += motion.inverse_inertia[i, j] * motion.reflected_inertia[j] * rate[j]
    return total


@compiled
def _swing_on(motion: ExpectedMotion, i: int, effort: float, acceleration: float, seconds: float) -> None:
    """Lets a motor swing against a link that accelerates steadily; its own friction is left out."""
    own, compliance = motion.reflected_inertia[i], motion.compliance[i]
    frequency = 1.0 / math.sqrt(own * compliance)
    centre = effort - own * acceleration
    cosine, sine = math.cos(frequency * seconds), math.sin(frequency * seconds)
    away, impedance = motion.load[i] - centre, compliance * frequency
    motion.load[i] = centre + away * cosine + motion.swing[i] / impedance * sine
    motion.swing[i] = motion.swing[i] * cosine - away * impedance * sine
