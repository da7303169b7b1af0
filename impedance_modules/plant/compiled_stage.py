# SPDX-License-Identifier: BSD-3-Clause
r"""One Runge-Kutta stage of the plant, compiled: springs, rotors, stops, contact, grasp, object.

The classical fourth-order method over a step h, for the state x and its rate f:

    x_1 = x,  x_2 = x + h/2 f(x_1),  x_3 = x + h/2 f(x_2),  x_4 = x + h f(x_3)
    x(t + h) = x + h/6 (f(x_1) + 2 f(x_2) + 2 f(x_3) + f(x_4))

The links' acceleration is pinocchio's, called between two stages; ``reference.py`` says the same plainly.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from impedance_modules.compiled import compiled
from impedance_modules.plant.contact.compiled_contact import contact_forces, place_contacts, settle_contacts
from impedance_modules.plant.grasp.compiled_grasp import (
    grasp_forces,
    object_motion,
    object_rate,
    place_grasps,
    settle_grasps,
    settle_object,
)
from impedance_modules.plant.records import (
    COMMAND,
    CONTACT,
    COUNTERS,
    EFFECT,
    ELASTIC,
    GRASP,
    IDEAL,
    MOTOR_LOSS,
    OBJECT_SIZE,
    RATE,
    RIGID,
    ROBOT,
    SPRING_LOSS,
    STAGE,
    START,
    STOP,
    SUM,
    Row,
    Table,
)

Array = NDArray[np.float64]


@compiled
def open_step(state: Array, hands: Table, body: Table, contacts: Table) -> None:
    """Starts a step: stage one is the start, and couplings and contacts are placed exactly."""
    first = state.shape[1] - OBJECT_SIZE - COUNTERS
    state[STAGE] = state[START]
    position = state[START, first : first + 3]
    place_contacts(contacts, hands, position)
    if body[0].present:
        place_grasps(hands, body, position)


@compiled
def evaluate(
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
    if contacts.size == 0 and body[0].present == 0:
        return
    _hand_motion(jacobian, state, motion)
    wrench[:] = 0.0
    if body[0].present:
        now, held = stage[first : first + OBJECT_SIZE], hands.size
        object_motion(body[0], state[START, first : first + 3], now, motion[held])
        work[GRASP] = grasp_forces(hands, body, motion, wrench)
    work[CONTACT] = contact_forces(contacts, motion, wrench)
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
        load = _spring(joint, theta - q, w - v)
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
def _spring(joint: Row, ahead: float, speed: float) -> float:
    """Gives the torque through the gear; where there is play, teeth push and never pull."""
    wound = _wound(joint, ahead)
    load = joint.stiffness * wound + joint.spring_damping * speed
    if joint.half_gap > 0.0:
        return float(max(load, 0.0) if wound > 0.0 else min(load, 0.0) if wound < 0.0 else 0.0)
    return float(load)


@compiled
def _stop(joint: Row, q: float, v: float) -> float:
    """Gives the torque of a joint stop: a spring-damper beyond the limit that never pulls back."""
    if q > joint.upper:
        return float(min(0.0, joint.stop_stiffness * (joint.upper - q) - joint.stop_damping * v))
    if q < joint.lower:
        return float(max(0.0, joint.stop_stiffness * (joint.lower - q) - joint.stop_damping * v))
    return 0.0


@compiled
def _hand_motion(jacobian: Array, state: Array, motion: Array) -> None:
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
def _to_joints(jacobian: Array, wrench: Array, torque: Array) -> None:
    """Adds J^T (contact + grasp wrench) of every hand to the torque on the links."""
    for h in range(jacobian.shape[0]):
        for r in range(6):
            total = wrench[h, 0, r] + wrench[h, 1, r]
            if total != 0.0:
                for i in range(torque.size):
                    torque[i] += jacobian[h, r, i] * total


@compiled
def absorb(index: int, step: float, joints: Table, state: Array, acceleration: Array) -> None:
    """Takes the links' acceleration of stage ``index`` (1 to 4) and moves on to the next stage."""
    n = joints.size
    start, stage, rate, total = state[START], state[STAGE], state[RATE], state[SUM]
    for i in range(n):
        rate[n + i] = acceleration[i]
        if joints[i].kind != ELASTIC:
            rate[3 * n + i] = acceleration[i]
    weight = 1.0 if index in {1, 4} else 2.0
    reach = step if index == 3 else 0.5 * step
    for k in range(state.shape[1]):
        total[k] = (total[k] if index > 1 else 0.0) + weight * rate[k]
        stage[k] = start[k] + (reach * rate[k] if index < 4 else step / 6.0 * total[k])


@compiled
def close_step(
    joints: Table,
    hands: Table,
    body: Table,
    contacts: Table,
    state: Array,
    jacobian: Array,
    motion: Array,
) -> None:
    """Ends a step: friction springs, slipping palms and the object's rotation are brought up to date."""
    n = joints.size
    if contacts.size > 0 or body[0].present:
        _hand_motion(jacobian, state, motion)
        if body[0].present:
            final = state[STAGE, 4 * n : 4 * n + OBJECT_SIZE]
            object_motion(body[0], state[START, 4 * n : 4 * n + 3], final, motion[hands.size])
            settle_grasps(hands, body, motion)
            settle_object(body[0], final)
        settle_contacts(contacts, motion)
    state[START] = state[STAGE]
    _read_loads(joints, state)


@compiled
def _read_loads(joints: Table, state: Array) -> None:
    """Writes the torque between each joint's gear and link at the step's end [N.m]."""
    n = joints.size
    for i in range(n):
        joint = joints[i]
        if joint.kind == ELASTIC:
            wound = state[START, 2 * n + i] - state[START, i]
            speed = state[START, 3 * n + i] - state[START, n + i]
            joint.load = _spring(joint, wound, speed)
        elif joint.kind == RIGID:
            joint.load -= joint.reflected_inertia * state[RATE, n + i]
        elif joint.kind == IDEAL:
            joint.load = joint.motor


@compiled
def stage(
    index: int,
    step: float,
    joints: Table,
    hands: Table,
    body: Table,
    contacts: Table,
    state: Array,
    jacobian: Array,
    motion: Array,
    wrench: Array,
    torque: Array,
    acceleration: Array,
) -> None:
    """Does all that lies between two calls of the articulated-body algorithm; 0 opens, 4 closes a step."""
    if index == 0:
        open_step(state, hands, body, contacts)
    else:
        absorb(index, step, joints, state, acceleration)
    if index < 4:
        evaluate(joints, hands, body, contacts, state, jacobian, motion, wrench, torque)
    else:
        close_step(joints, hands, body, contacts, state, jacobian, motion)
