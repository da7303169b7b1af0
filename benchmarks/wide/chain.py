# SPDX-License-Identifier: BSD-3-Clause
"""The torque path of all joints over one step of the physics, with dry friction by one of four laws.

What is not friction is the blind benchmark's (`benchmarks.blind.compiled`), which knows no engine either.
"""

from __future__ import annotations

import math

from numba import njit

from benchmarks.blind.compiled import bristle, drag, held_command, link_torque, motor_torque
from benchmarks.wide.frozen import dahl

LAWS = ("lugre", "dahl", "regularised", "constraint")
SMOOTH = 0.004
"""Speed [rad/s] of the regularised law."""


@njit(cache=True)
def friction_level(record, v, load, position):
    """Torque [N.m] at which dry friction slips: fc + da sgn v + fs exp(-(v/vs)^2) + kl |load|, not below zero."""
    level = record.fc * (1.0 + record.pa * math.sin(record.pn * position))
    level += record.fs * math.exp(-((v / record.vs) ** 2)) + record.kl * abs(load)
    level += record.da if v > 0.0 else -record.da
    return max(level, 0.0)


@njit(cache=True)
def dry_friction(law, record, z, v, load, position, step):
    """Torque that opposes v by law number ``law`` of `LAWS`, and the law's new state; 3 leaves it to the engine."""
    if law == 0:
        return bristle(record, z, v, load, position, step)
    level = friction_level(record, v, load, position)
    if law == 1:
        return dahl(record, z, v, level, step)
    if law == 2:
        return level * math.tanh(v / SMOOTH), 0.0
    return 0.0, 0.0


@njit(cache=True)
def drive_torques(
    law, joints, friction, state, coupling, commands, support, q, v, theta, w, load, errors, time, age, delay, lost,
    step, out, levels,
):  # fmt: skip
    """Fills ``out`` (3, n) and ``levels`` (2, n), the engine's friction on links and motors [N.m].

    ``out``: torque on the links, on the motors, and of the motors before friction [N.m].

    Args are those of `benchmarks.blind.compiled.apply_drives`; ``load`` (n,) is the torque through the transmission.
    """
    n = q.size
    for i in range(n):
        begin = time - 0.5 * step - delay - joints[i].delay
        command = held_command(commands, i, begin + 1e-12, begin + step + 1e-12, 0.001)
        torque = motor_torque(
            joints[i], state[i], command, support[i], theta[i], errors[0, i], errors[1, i], age, lost, step
        )
        out[2, i] = torque
        rub, state[i].z_motor = dry_friction(
            law, friction[0, i], state[i].z_motor, w[i], load[i], theta[i], step
        )
        torque -= rub + drag(friction[0, i], w[i], age)
        for j in range(n):
            torque -= (coupling[i, j] + coupling[j, i]) * math.tanh((w[i] + w[j]) / 0.02)
        out[1, i] = torque
        rub, state[i].z_link = dry_friction(law, friction[1, i], state[i].z_link, v[i], load[i], q[i], step)
        out[0, i] = link_torque(joints[i], state[i], q[i]) - rub - drag(friction[1, i], v[i], age)
        levels[0, i] = friction_level(friction[1, i], v[i], load[i], q[i])
        levels[1, i] = friction_level(friction[0, i], w[i], load[i], theta[i])


@njit(cache=True)
def motor_reading(joints, torques, theta, time, out):
    """Fills ``out`` (n,) with what the drives believe that their motors give: current times the stated constant.

    ``torques`` (n,) are the motors' before friction; undone here are offset, ripple, tone, damaged tooth and gain.
    """
    for i in range(out.size):
        joint = joints[i]
        torque = torques[i] - joint.offset - joint.vibration * math.sin(joint.tone * time)
        torque -= joint.ripple * math.sin(joint.order * theta[i] + joint.phase)
        if joint.bump != 0.0:
            away = (theta[i] - joint.bump_at) / joint.bump_every
            away = (away - math.floor(away + 0.5)) * joint.bump_every
            torque += joint.bump * math.exp(-0.5 * (away / joint.bump_width) ** 2)
        out[i] = torque / (joint.gain * (1.0 + joint.kt_a * math.sin(2.0 * math.pi * time / joint.kt_T)))


def law_number(name: str) -> int:
    """Returns a law's number."""
    return LAWS.index(name)
