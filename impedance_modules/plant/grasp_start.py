# SPDX-License-Identifier: BSD-3-Clause
"""How hands take hold: what every coupling is made of, and its rest, loaded with squeeze and weight.

The start is a static equilibrium: the hands' wrenches on the object sum to minus its weight (where the arms carry it),
and each presses with the declared squeeze; the couplings' rest is set so that they carry exactly these wrenches.
"""

from __future__ import annotations

import numpy as np

from impedance_modules.errors import BadInput
from impedance_modules.plant.grasp import (
    GRASP_ANGULAR_STIFFNESS,
    GRASP_DAMPING_TIME,
    GRASP_LINEAR_STIFFNESS,
    PALM_RADIUS,
)
from impedance_modules.plant.rigid_object import ObjectBody, ObjectState, depth_beneath_face
from impedance_modules.records import Matrix, Row, Table, Vector
from impedance_modules.robot.pose import carry
from impedance_modules.robot.rotation import exp3


def set_up_couplings(hands: Table, frames: tuple[str, ...], held: ObjectBody) -> None:
    """Writes the constants of every holding hand's coupling."""
    for hand, frame in zip(hands, frames, strict=True):
        hand["holds"] = frame in held.hands
        hand["slips"] = held.spec.friction is not None and held.spec.grasp == "friction"
        hand["friction"] = 0.0 if held.spec.friction is None else held.spec.friction
        hand["palm_radius"] = PALM_RADIUS
        hand["linear_stiffness"] = GRASP_LINEAR_STIFFNESS
        hand["angular_stiffness"] = GRASP_ANGULAR_STIFFNESS
        hand["linear_damping"] = GRASP_LINEAR_STIFFNESS * GRASP_DAMPING_TIME
        hand["angular_damping"] = GRASP_ANGULAR_STIFFNESS * GRASP_DAMPING_TIME


def load_couplings(hands: Table, body: ObjectState, held: ObjectBody, position: Vector) -> Matrix:
    """Sets the couplings' rest at the start pose; returns the wrench of the object on each hand (h, 6).

    Args:
        hands: Placed.
        body: The object.
        held: What it is, and who holds it.
        position: (3,) of its centre of mass in world [m].
    """
    holding = [i for i in range(hands.size) if hands[i]["holds"]]
    rotation = body.rotation
    wrench = np.zeros((hands.size, 6))
    for i in holding:
        hand = hands[i]
        hand["rest_point"] = rotation.T @ (hand["translation"] - position)
        if not hand["rest_point"].any():
            raise BadInput("a hand at the object's centre has no direction in which to press")
        depth_beneath_face(body, 0.0, hand["rest_point"] + held.centre, hand["normal"])
        wrench[i, :3] = -held.spec.squeeze * (rotation @ hand["normal"])
    if holding and held.spec.carry_weight:
        weight = np.concatenate([body.mass * body.gravity, np.zeros(3)])
        offsets = [rotation @ hands[i]["rest_point"] for i in holding]
        wrench[holding] += _share(weight, wrench[holding], offsets)
    for i in holding:
        _set_rest(hands[i], rotation, position, wrench[i])
        if hands[i]["slips"]:
            _set_palm(hands[i], body, position, wrench[i])
    return wrench


def _share(load: Vector, pressed: Matrix, offsets: list[Vector]) -> Matrix:
    """Adds the smallest wrenches (h, 6) on the hands that bring object and hands into equilibrium."""
    maps = np.hstack([carry(offset).T for offset in offsets])
    missing = load - maps @ pressed.reshape(-1)
    added, *_ = np.linalg.lstsq(maps, missing, rcond=None)
    return np.asarray(added.reshape(-1, 6))


def _set_rest(hand: Row, rotation: Matrix, position: Vector, wrench: Vector) -> None:
    """Deflects one coupling so that it puts ``wrench`` on the hand at the present pose."""
    deflection = wrench[:3] / hand["linear_stiffness"]
    angle = wrench[3:] / hand["angular_stiffness"]
    hand["rest_point"] = rotation.T @ (hand["translation"] + deflection - position)
    hand["rest_rotation"] = rotation.T @ exp3(angle) @ hand["rotation"]


def _set_palm(hand: Row, body: ObjectState, position: Vector, wrench: Vector) -> None:
    """Puts one palm's surface where it presses with the normal part of ``wrench`` at the present pose.

    A hand that is pulled has its palm as far before the face instead.
    """
    point = body.rotation.T @ (hand["translation"] - position)
    pressed = -float(wrench[:3] @ (body.rotation @ hand["normal"])) / hand["linear_stiffness"]
    hand["palm_offset"] = pressed - depth_beneath_face(body, 0.0, point, hand["normal"])
