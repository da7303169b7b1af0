# SPDX-License-Identifier: BSD-3-Clause
r"""Coupling of a hand and the object, and the object's own motion, compiled.

A weld is an isotropic spring-damper on position and rotation, its force at the hand's origin:

    f = k e + d e',  e = p + R s - p_H        t = k_r e_r + d_r (w_O - w_H),  e_r = log(R R_OH R_H^T)

and the opposite force and moment, at the same point, on the object. A friction grasp keeps the part of
f that presses (N >= 0), and limits the rest to mu N and t to mu N times the palm's radius.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from impedance_modules.compiled import compiled
from impedance_modules.plant.plant_state import Row, Table
from impedance_modules.robot.rotation import (
    add_cross,
    add_rotation_rate,
    compose,
    dot,
    exponential,
    logarithm,
    turn,
    turn_back,
)

Array = NDArray[np.float64]


@compiled
def place_grasps(hands: Table, body: Table, object_position: Array) -> None:
    """Writes each coupling's stretch [m] and twist [rad] at the step's start, exactly."""
    partly, relative = np.empty((3, 3)), np.empty((3, 3))
    for i in range(hands.size):
        hand = hands[i]
        if not hand.holds:
            continue
        turn(body[0].rotation, hand.point, hand.arm)
        for k in range(3):
            hand.stretch[k] = object_position[k] + hand.arm[k] - hand.translation[k]
        compose(body[0].rotation, hand.turn, partly)
        for r in range(3):
            for c in range(3):
                relative[r, c] = dot(partly[r], hand.rotation[c])
        logarithm(relative, hand.twist)


@compiled
def grasp_forces(hands: Table, body: Table, motion: Array, wrench: Array) -> float:
    """Adds each coupling's wrench to its hand and the object; returns the power they receive [W]."""
    power, held = 0.0, hands.size
    lever, stretch = np.empty(3), np.empty(3)
    for i in range(hands.size):
        hand = hands[i]
        if not hand.holds:
            continue
        turn(body[0].change, hand.arm, lever)
        for k in range(3):
            moved = motion[held, 0, k] + lever[k] - hand.arm[k] - motion[i, 0, k]
            stretch[k] = hand.stretch[k] + moved
        _coupling(hand, body[0], lever, stretch, motion[i], motion[held], wrench[i, 1])
        force, reaction = wrench[i, 1], wrench[held, 1]
        for k in range(3):
            lever[k] -= stretch[k]
            reaction[k] -= force[k]
            reaction[3 + k] -= force[3 + k]
            power += force[k] * motion[i, 1, k] + force[3 + k] * (
                motion[i, 1, 3 + k] - motion[held, 1, 3 + k]
            )
            power -= force[k] * motion[held, 1, k]
        moment = np.zeros(3)
        add_cross(force[:3], lever, moment)
        for k in range(3):
            reaction[3 + k] += moment[k]
            power += moment[k] * motion[held, 1, 3 + k]
    return power


@compiled
def _coupling(
    hand: Row, body: Row, lever: Array, stretch: Array, own: Array, other: Array, wrench: Array
) -> None:
    """Writes the wrench on the hand; ``lever`` from the object's origin to its grasped point."""
    rate = np.empty(3)
    for k in range(3):
        rate[k] = other[1, k] - own[1, k]
    add_cross(other[1, 3:], lever, rate)
    for k in range(3):
        wrench[k] = hand.linear_stiffness * stretch[k] + hand.linear_damping * rate[k]
        twist = hand.twist[k] + other[0, 3 + k] - own[0, 3 + k]
        spin = other[1, 3 + k] - own[1, 3 + k]
        wrench[3 + k] = hand.angular_stiffness * twist + hand.angular_damping * spin
    if hand.slips:
        _limit(hand, body, wrench)


@compiled
def _limit(hand: Row, body: Row, wrench: Array) -> None:
    """Brings a wrench on a hand into the friction cone of its pressure; ``normal`` points into the object."""
    normal = np.empty(3)
    turn(body.turned, hand.normal, normal)
    hand.pressure = max(0.0, -dot(wrench[:3], normal))
    along = dot(wrench[:3], normal)
    for k in range(3):
        wrench[k] -= along * normal[k]
    bound = hand.friction * hand.pressure
    for half, limit in ((0, bound), (3, bound * hand.palm_radius)):
        size = math.sqrt(dot(wrench[half : half + 3], wrench[half : half + 3]))
        if size > limit:
            for k in range(3):
                wrench[half + k] *= limit / size
    for k in range(3):
        wrench[k] -= hand.pressure * normal[k]


@compiled
def object_rate(body: Row, wrench: Array, stage: Array, velocity: Array, rate: Array) -> None:
    """Writes the rate of the object's twelve numbers (p, phi, u, L) under contact, grasp and push."""
    for k in range(3):
        rate[k] = stage[6 + k]
        rate[3 + k] = 0.0
        rate[6 + k] = body.gravity[k] + (wrench[0, k] + wrench[1, k] + wrench[2, k]) / body.mass
        rate[9 + k] = wrench[0, 3 + k] + wrench[1, 3 + k] + wrench[2, 3 + k]
    add_rotation_rate(stage[3:6], velocity, rate[3:6])


@compiled
def object_motion(body: Row, start: Array, stage: Array, motion: Array) -> None:
    """Writes the object's displacement and twist at a stage, w = R I^-1 R^T L."""
    local, spin = np.empty(3), np.empty(3)
    exponential(stage[3:6], body.change)
    compose(body.change, body.rotation, body.turned)
    turn_back(body.turned, stage[9:12], local)
    for k in range(3):
        local[k] /= body.inertia[k]
    turn(body.turned, local, spin)
    for k in range(3):
        motion[0, k] = stage[k] - start[k]
        motion[0, 3 + k] = stage[3 + k]
        motion[1, k] = stage[6 + k]
        motion[1, 3 + k] = spin[k]


@compiled
def settle_object(body: Row, state: Array) -> None:
    """Moves the rotation since the step's start into the rotation, and starts it anew."""
    exponential(state[3:6], body.change)
    compose(body.change, body.rotation, body.turned)
    for r in range(3):
        state[3 + r] = 0.0
        for c in range(3):
            body.rotation[r, c] = body.turned[r, c]


@compiled
def settle_grasps(hands: Table, body: Table, motion: Array) -> None:
    """Draws slipping palms along: what stretches beyond friction's reach becomes the new rest.

    Runs before ``settle_object``, with the motion of the whole step.
    """
    held, lever = hands.size, np.empty(3)
    for i in range(hands.size):
        hand = hands[i]
        if not (hand.holds and hand.slips):
            continue
        turn(body[0].change, hand.arm, lever)
        for k in range(3):
            hand.stretch[k] += motion[held, 0, k] + lever[k] - hand.arm[k] - motion[i, 0, k]
            hand.twist[k] += motion[held, 0, 3 + k] - motion[i, 0, 3 + k]
        _slip_point(hand, body[0])
        _slip_turn(hand, body[0])


@compiled
def _slip_point(hand: Row, body: Row) -> None:
    """Shifts the rest point along the object's face."""
    normal, back, shift = np.empty(3), np.empty(3), np.empty(3)
    turn(body.turned, hand.normal, normal)
    along = dot(hand.stretch, normal)
    for k in range(3):
        shift[k] = hand.stretch[k] - along * normal[k]
    length = math.sqrt(dot(shift, shift))
    reach = hand.friction * hand.pressure / hand.linear_stiffness
    if length > reach:
        turn_back(body.turned, shift, back)
        for k in range(3):
            hand.point[k] -= (1.0 - reach / length) * back[k]


@compiled
def _slip_turn(hand: Row, body: Row) -> None:
    """Turns the rest rotation, R_OH becoming R^T exp(-excess) R R_OH."""
    angle = math.sqrt(dot(hand.twist, hand.twist))
    reach = hand.friction * hand.pressure * hand.palm_radius / hand.angular_stiffness
    if angle <= reach:
        return
    excess, back = np.empty(3), np.empty(3)
    change, rest = np.empty((3, 3)), np.empty((3, 3))
    for k in range(3):
        excess[k] = -(1.0 - reach / angle) * hand.twist[k]
    turn_back(body.turned, excess, back)
    exponential(back, change)
    compose(change, hand.turn, rest)
    for r in range(3):
        for c in range(3):
            hand.turn[r, c] = rest[r, c]
