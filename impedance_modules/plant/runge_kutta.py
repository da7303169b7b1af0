# SPDX-License-Identifier: BSD-3-Clause
r"""Steps of the plant, compiled: the classical Runge-Kutta method on springs, links, contacts and object at once.

Over a step h, for the state x and its rate f:

    x_1 = x,  x_2 = x + h/2 f(x_1),  x_3 = x + h/2 f(x_2),  x_4 = x + h f(x_3)
    x(t + h) = x + h/6 (f(x_1) + 2 f(x_2) + 2 f(x_3) + f(x_4))
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from impedance_modules.compiled import compiled
from impedance_modules.plant.compiled_links import accelerate, place_hands, place_links
from impedance_modules.plant.equations_of_motion import evaluate, hand_motion, spring
from impedance_modules.plant.point_contact import find_near, place_contacts, settle_contacts
from impedance_modules.plant.contact.compiled_wood import roughen, settle_wood
from impedance_modules.plant.grasp.compiled_grasp import (
    object_motion,
    place_grasps,
    settle_grasps,
    settle_object,
)
from impedance_modules.plant.plant_state import (
    COUNTERS,
    ELASTIC,
    IDEAL,
    OBJECT_SIZE,
    RATE,
    RIGID,
    STAGE,
    START,
    SUM,
    Table,
)

Array = NDArray[np.float64]


@compiled
def live(
    done: int,
    steps: int,
    step: float,
    near: float,
    surfaces: Table,
    woods: Table,
    worn: Array,
    splinters: Table,
    joints: Table,
    links: Table,
    hands: Table,
    body: Table,
    contacts: Table,
    state: Array,
    jacobian: Array,
    motion: Array,
    wrench: Array,
    torque: Array,
    acceleration: Array,
) -> int:
    """Takes steps from the ``done``-th on, up to all ``steps`` or until coal has to be asked; returns how many."""
    n = joints.size
    while done < steps:
        if place(near, surfaces, links, hands, body, contacts, state, jacobian) > 0:
            return done
        open_step(state, hands, body, contacts, surfaces, woods, worn)
        for index in range(1, 5):
            if index > 1:
                place_links(links, state[STAGE, :n])
            evaluate(surfaces, joints, hands, body, contacts, state, jacobian, motion, wrench, torque)
            accelerate(links, state[STAGE, n : 2 * n], torque, acceleration)
            absorb(index, step, joints, state, acceleration)
        close_step(step, joints, hands, body, contacts, woods, worn, splinters, state, jacobian, motion)
        done += 1
    return done


@compiled
def place(
    near: float,
    surfaces: Table,
    links: Table,
    hands: Table,
    body: Table,
    contacts: Table,
    state: Array,
    jacobian: Array,
) -> int:
    """Brings links, hands and points to the step's start; returns how many points wait for coal.

    ``near`` is the clearance below which coal is asked [m].
    """
    first = state.shape[1] - OBJECT_SIZE - COUNTERS
    place_links(links, state[START, : links.size - 1])
    place_hands(hands, links, jacobian)
    if contacts.size == 0:
        return 0
    return int(find_near(contacts, surfaces, hands, body, state[START, first : first + 3], near))


@compiled
def rate(
    surfaces: Table,
    joints: Table,
    links: Table,
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
    """Writes the rate of the stage row and the links' acceleration, for whoever steps outside ``live``."""
    n = joints.size
    place_links(links, state[STAGE, :n])
    evaluate(surfaces, joints, hands, body, contacts, state, jacobian, motion, wrench, torque)
    accelerate(links, state[STAGE, n : 2 * n], torque, acceleration)


@compiled
def open_step(
    state: Array, hands: Table, body: Table, contacts: Table, surfaces: Table, woods: Table, worn: Array
) -> None:
    """Starts a step: stage one is the start, and couplings and contacts are placed exactly."""
    first = state.shape[1] - OBJECT_SIZE - COUNTERS
    state[STAGE] = state[START]
    position = state[START, first : first + 3]
    place_contacts(surfaces, contacts, hands, position)
    if woods.size > 0:
        roughen(contacts, surfaces, woods, worn)
    if body[0].present:
        place_grasps(hands, body, position)


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
    step: float,
    joints: Table,
    hands: Table,
    body: Table,
    contacts: Table,
    woods: Table,
    worn: Array,
    splinters: Table,
    state: Array,
    jacobian: Array,
    motion: Array,
) -> None:
    """Ends a step: friction springs, wood, slipping palms and the object's rotation are brought up to date."""
    n = joints.size
    if contacts.size > 0 or body[0].present:
        hand_motion(jacobian, state, motion)
        if body[0].present:
            final = state[STAGE, 4 * n : 4 * n + OBJECT_SIZE]
            object_motion(body[0], state[START, 4 * n : 4 * n + 3], final, motion[hands.size])
            settle_grasps(hands, body, motion)
            settle_object(body[0], final)
        settle_contacts(contacts, motion)
        if woods.size > 0:
            settle_wood(contacts, woods, worn, splinters, step)
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
            joint.load = spring(joint, wound, speed)
        elif joint.kind == RIGID:
            joint.load -= joint.reflected_inertia * state[RATE, n + i]
        elif joint.kind == IDEAL:
            joint.load = joint.motor
