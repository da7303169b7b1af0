# SPDX-License-Identifier: BSD-3-Clause
"""The rate of the plant's state, compiled: springs, rotors, stops, contact, grasp, object.

``compiled_step.py`` integrates it; ``reference.py`` says the same plainly.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from impedance_modules.compiled import compiled
from impedance_modules.plant.grasp import (
    grasp_forces,
    object_motion,
    object_rate,
)
from impedance_modules.plant.plant_state import (
    COMMAND,
    CONTACT,
    COUNTERS,
    EFFECT,
    ELASTIC,
    GRASP,
    MOTOR_LOSS,
    OBJECT_SIZE,
    PUSH,
    PUSH_ROW,
    RATE,
    RIGID,
    ROBOT,
    SPRING_LOSS,
    STAGE,
    START,
    STOP,
    Row,
    Table,
)
from impedance_modules.plant.point_contact import contact_forces

Array = NDArray[np.float64]


@compiled
def evaluate(
    surfaces: Table,
    joints: Table,
    hands: Table,
    body: Table,
    contacts: Table,
    state: Array,
    jacobian: Array,
    motion: Array,
    wrench: Array,
    torque: Array,
) -> None:
    """Writes the rate of everything but the links' acceleration, and the torque on the links."""
    n, stage, rate = joints.size, state[STAGE], state[RATE]
    first = 4 * n
    work = rate[first + OBJECT_SIZE :]
    work[:] = 0.0
    for i in range(n):
        torque[i] = _joint(joints[i], i, stage, rate, work)
    pushed = bool(np.any(wrench[:, PUSH_ROW] != 0.0))
    if contacts.size == 0 and body[0].present == 0 and not pushed:
        return
    hand_motion(jacobian, state, motion)
    wrench[:, :PUSH_ROW] = 0.0
    if body[0].present:
        now, held = stage[first : first + OBJECT_SIZE], hands.size
        object_motion(body[0], state[START, first : first + 3], now, motion[held])
        work[GRASP] = grasp_forces(hands, body, motion, wrench)
    work[CONTACT] = contact_forces(surfaces, contacts, motion, wrench)
    if pushed:
        work[PUSH] = push_power(hands.size + body[0].present, motion, wrench)
    if body[0].present:
        object_rate(body[0], wrench[held], now, motion[held, 1, 3:], rate[first : first + OBJECT_SIZE])
    _to_joints(jacobian, wrench, torque)


@compiled
def _joint(joint: Row, i: int, stage: Array, rate: Array, work: Array) -> float:
    """Writes one joint's rates and powers; returns the torque of drive, stop and effects on its link."""
    n = (stage.size - OBJECT_SIZE - COUNTERS) // 4
    q, v, theta, w = stage[i], stage[n + i], stage[2 * n + i], stage[3 * n + i]
    hold = joint.hold_stiffness * (joint.hold_position - theta) - joint.hold_damping * w
    hold = min(max(hold, -joint.effort_max), joint.effort_max)
    motor = joint.command + joint.assist + hold + joint.extra_motor
    loss = joint.motor_damping * w
    rate[i], rate[2 * n + i] = v, w
    if joint.kind == ELASTIC:
        load = spring(joint, theta - q, w - v)
        rate[3 * n + i] = (motor - load - loss) / joint.reflected_inertia
        work[SPRING_LOSS] += (load - joint.stiffness * _wound(joint, theta - q)) * (w - v)
    elif joint.kind == RIGID:
        load = motor - loss
    else:
        load, loss = motor, 0.0
    stop = _stop(joint, q, v)
    work[COMMAND] += joint.command * w
    work[ROBOT] += (joint.assist + hold) * w
    work[EFFECT] += joint.extra_motor * w + joint.extra_link * v
    work[MOTOR_LOSS] += loss * w
    work[STOP] += stop * v
    joint.motor, joint.load = motor, load
    return float(load + stop + joint.extra_link)


@compiled
def _wound(joint: Row, ahead: float) -> float:
    """Gives how far the spring is wound when the motor is ahead of its link: what the play leaves of it."""
    if ahead > joint.half_gap:
        return float(ahead - joint.half_gap)
    if ahead < -joint.half_gap:
        return float(ahead + joint.half_gap)
    return 0.0


@compiled
def spring(joint: Row, ahead: float, speed: float) -> float:
    """Gives the torque through the gear; where there is play, teeth push and never pull."""
    wound = _wound(joint, ahead)
    load = joint.stiffness * wound + joint.spring_damping * speed
    if joint.half_gap > 0.0:
        return float(max(load, 0.0) if wound > 0.0 else min(load, 0.0) if wound < 0.0 else 0.0)
    return float(load)


@compiled
def spring_loads(joints: Table, state: Array, out: Array) -> None:
    """Writes what a perfect effort sensor says at the step's start (n,) [N.m]: K (theta - q), or the gear's load."""
    n = joints.size
    for i in range(n):
        joint, ahead = joints[i], state[START, 2 * n + i] - state[START, i]
        out[i] = joint.stiffness * _wound(joint, ahead) if joint.kind == ELASTIC else joint.load


@compiled
def _stop(joint: Row, q: float, v: float) -> float:
    """Gives the torque of a joint stop: a spring-damper beyond the limit that never pulls back."""
    if q > joint.upper:
        return float(min(0.0, joint.stop_stiffness * (joint.upper - q) - joint.stop_damping * v))
    if q < joint.lower:
        return float(max(0.0, joint.stop_stiffness * (joint.lower - q) - joint.stop_damping * v))
    return 0.0


@compiled
def hand_motion(jacobian: Array, state: Array, motion: Array) -> None:
    """Writes each hand's displacement J (q - q_start) and twist J v."""
    n = jacobian.shape[2]
    for h in range(jacobian.shape[0]):
        for r in range(6):
            moved, speed = 0.0, 0.0
            for i in range(n):
                moved += jacobian[h, r, i] * (state[STAGE, i] - state[START, i])
                speed += jacobian[h, r, i] * state[STAGE, n + i]
            motion[h, 0, r], motion[h, 1, r] = moved, speed


@compiled
def push_power(bodies: int, motion: Array, wrench: Array) -> float:
    """Gives what pushes do on the first ``bodies`` bodies [W]: wrench times twist."""
    power = 0.0
    for b in range(bodies):
        for r in range(6):
            power += wrench[b, PUSH_ROW, r] * motion[b, 1, r]
    return power


@compiled
def _to_joints(jacobian: Array, wrench: Array, torque: Array) -> None:
    """Adds J^T (contact + grasp + push wrench) of every hand to the torque on the links."""
    for h in range(jacobian.shape[0]):
        for r in range(6):
            total = wrench[h, 0, r] + wrench[h, 1, r] + wrench[h, 2, r]
            if total != 0.0:
                for i in range(torque.size):
                    torque[i] += jacobian[h, r, i] * total
