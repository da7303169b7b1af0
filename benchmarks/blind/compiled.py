# SPDX-License-Identifier: BSD-3-Clause
"""The inner loops of the generator, compiled: friction, the torque path to the motors, the sensors.

Written from the equations alone; shares nothing with the package under test.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit


@njit(cache=True)
def bristle(record, z, v, load, position, step):
    """LuGre friction over one step at constant speed: returns the torque that opposes v, and the new z.

    z' = v - s0 |v| / g z,   torque = s0 z + s1 z',   g = fc + da sgn v + (fs) exp(-(v/vs)^2) + kl |load|
    """
    level = record.fc * (1.0 + record.pa * math.sin(record.pn * position))
    level += record.fs * math.exp(-((v / record.vs) ** 2)) + record.kl * abs(load)
    level += record.da if v > 0.0 else -record.da
    if level <= 0.0 or record.s0 <= 0.0:
        return 0.0, 0.0
    end = math.copysign(level / record.s0, v)
    after = end + (z - end) * math.exp(-record.s0 * abs(v) * step / level)
    if v == 0.0:
        after = z
    return record.s0 * after + record.s1 * (after - z) / step, after


@njit(cache=True)
def drag(record, v, time):
    """Viscous (fading with warmth, direction dependent) and quadratic drag that opposes v."""
    fade = 1.0 - record.k * (1.0 - math.exp(-time / record.T))
    return record.fv * fade * v + record.dv * abs(v) + record.c * v * abs(v)


@njit(cache=True)
def held_command(commands, joint, begin, end, period):
    """Mean over [begin, end] of the command that is held for one period each; zero before the first."""
    first = math.floor(begin / period)
    last = math.floor(end / period)
    if last < 0:
        return 0.0
    if first == last or first < 0:
        return commands[last, joint]
    share = (end - last * period) / (end - begin)
    return share * commands[last, joint] + (1.0 - share) * commands[first, joint]


@njit(cache=True)
def motor_torque(joint, state, command, support, theta, error, error_rate, time, lost, step):
    """What one motor really gives: command, robot's own support, and all that goes wrong on the way."""
    asked = command * (1.0 - joint.drop * lost) + joint.dkp * error + joint.dkd * error_rate
    if joint.dead > 0.0:
        asked = math.copysign(max(abs(asked) - joint.dead, 0.0), asked)
    asked += support
    asked = min(max(asked, -joint.limit), joint.limit)
    if joint.lag > 0.0:
        if state.started == 0.0:
            state.lagged = asked
        state.lagged += (1.0 - math.exp(-step / joint.lag)) * (asked - state.lagged)
        asked = state.lagged
    state.started = 1.0
    asked *= joint.gain * (1.0 + joint.kt_a * math.sin(2.0 * math.pi * time / joint.kt_T))
    asked += joint.offset + joint.vibration * math.sin(joint.tone * time)
    asked += joint.ripple * math.sin(joint.order * theta + joint.phase)
    away = (theta - joint.bump_at) / joint.bump_every
    away = (away - math.floor(away + 0.5)) * joint.bump_every
    if joint.bump != 0.0:
        asked -= joint.bump * math.exp(-0.5 * (away / joint.bump_width) ** 2)
    return asked


@njit(cache=True)
def link_torque(joint, state, q):
    """Torque of springs, stops and cables that act on one link."""
    torque = joint.preload - joint.spring * q
    if joint.stop > 0.0 and q > joint.stop_at:
        torque -= joint.stop * (q - joint.stop_at)
    if joint.snag > 0.0:
        if state.caught == 0.0 and abs(q - joint.snag_at) < 0.02:
            state.caught = 1.0
        pull = joint.snag * (q - joint.snag_at)
        if state.caught == 1.0:
            if pull > joint.snag_force:
                state.caught = 2.0
            else:
                torque -= max(pull, 0.0)
        if state.caught == 2.0 and q < joint.snag_at - 0.1:
            state.caught = 0.0
    return torque


@njit(cache=True)
def apply_drives(
    joints,
    friction,
    state,
    coupling,
    commands,
    support,
    q,
    v,
    theta,
    w,
    spring,
    errors,
    time,
    age,
    delay,
    lost,
    step,
    out,
):
    """Fills ``out`` (2n,): torque on the links, then on the motors, for one step of the physics.

    ``time`` counts from the first command, ``age`` from the first sample [s].
    """
    n = q.size
    for i in range(n):
        begin = time - 0.5 * step - delay - joints[i].delay
        command = held_command(commands, i, begin + 1e-12, begin + step + 1e-12, 0.001)
        torque = motor_torque(
            joints[i], state[i], command, support[i], theta[i], errors[0, i], errors[1, i], age, lost, step
        )
        rub, state[i].z_motor = bristle(friction[0, i], state[i].z_motor, w[i], spring[i], theta[i], step)
        torque -= rub + drag(friction[0, i], w[i], age)
        for j in range(n):
            torque -= (coupling[i, j] + coupling[j, i]) * math.tanh((w[i] + w[j]) / 0.02)
        out[n + i] = torque
        rub, state[i].z_link = bristle(friction[1, i], state[i].z_link, v[i], spring[i], q[i], step)
        out[i] = link_torque(joints[i], state[i], q[i]) - rub - drag(friction[1, i], v[i], age)


@njit(cache=True)
def read_sensors(joints, state, crosstalk, q, spring, noise, scale, period, frozen, out):
    """Fills ``out`` (3, n): measured position, reported velocity, measured torque, once per millisecond.

    ``scale``: position grid, effort grid, velocity time constant. ``noise`` (2, n): position, effort.
    """
    n = q.size
    share = 1.0 - math.exp(-period / scale[2])
    for i in range(n):
        joint = joints[i]
        if frozen and joint.freeze > 0.0:
            continue
        seen = q[i] + joint.dq0 + joint.eccentric * math.sin(q[i] + joint.eccentric_phase) + noise[0, i]
        seen = round(seen / scale[0]) * scale[0]
        if math.isnan(state[i].last):
            state[i].last = seen
        state[i].slow += share * ((seen - state[i].last) / period - state[i].slow)
        state[i].last = seen
        slower = 1.0 if joint.velocity_lag <= 0.0 else 1.0 - math.exp(-period / joint.velocity_lag)
        state[i].slower += slower * (state[i].slow - state[i].slower)
        felt = joint.effort_gain * spring[i] + joint.effort_offset + noise[1, i]
        for j in range(n):
            felt += crosstalk[i, j] * spring[j]
        out[0, i] = seen
        out[1, i] = state[i].slower
        out[2, i] = round(felt / scale[1]) * scale[1]


@njit(cache=True)
def impedance_law(stiffness, damping, spring, reference, seen, estimate, limits, out):
    """Joint impedance with feed-forward: tau = ff + K (q_d - q) + D (v_d - w), clipped to the limits.

    w is the motors' speed, from q + tau/K_s behind a filter of 8 ms: damping the links' speed through the
    springs would drive them unstable. ``estimate`` (2, n) keeps the last motor position and w.
    """
    for i in range(out.size):
        theta = seen[0, i] + seen[2, i] / spring[i]
        if math.isnan(estimate[0, i]):
            estimate[0, i] = theta
        estimate[1, i] += 0.117 * ((theta - estimate[0, i]) / 0.001 - estimate[1, i])
        estimate[0, i] = theta
        torque = reference[2, i] + stiffness[i] * (reference[0, i] - seen[0, i])
        torque += damping[i] * (reference[1, i] - estimate[1, i])
        out[i] = min(max(torque, -limits[i]), limits[i])


def nominal_records(n: int, dtype: np.dtype) -> np.ndarray:
    """Returns the sensors' and frictions' state before the first sample."""
    state = np.zeros(n, dtype)
    state["last"] = np.nan
    return state
