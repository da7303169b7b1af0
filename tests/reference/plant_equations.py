# SPDX-License-Identifier: BSD-3-Clause
r"""The plant's equations of motion in plain numpy, to read and to test the compiled stages against.

links    M(q) v' + C(q, v) + g(q) = tau_s + stops + effects + sum J_h^T (contact + grasp + push)
rotors   I_r w' + D w = tau_m - tau_s,  tau_s = K (theta - q) + B (w - v)
object   m u' = m g + f,  L' = t,  w_O = R I^-1 R^T L
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from impedance_modules.plant.sheet import Sheet
from impedance_modules.plant.joints import spring_torque
from impedance_modules.plant.plant_state import ELASTIC, IDEAL, PUSH_ROW, RIGID, STAGE, START, Memory, Row
from impedance_modules.robot.rotation import exp3

Array = NDArray[np.float64]


def plain_rate(memory: Memory, links: pin.Model) -> Array:
    """Computes the rate of q, v, theta, w, p, u and L at the stage row, in this order, (4 n + 9,).

    Geometry is that of the step's start (``Integrator.place``), moved linearly, as in the compiled loop.

    Args:
        memory: The plant's tables; not changed.
        links: Pinocchio model with the armature of rigid joints.
    """
    q, v = memory.part("position", STAGE), memory.part("velocity", STAGE)
    w = memory.part("motor_velocity", STAGE)
    motor, drive = joint_torques(memory)
    bodies = [_hand_motion(memory, h) for h in range(memory.hands.size)]
    rotation, turning = _object_motion(memory)
    bodies.append(turning)
    wrench = memory.wrench[:, PUSH_ROW].copy()
    for contact in memory.contacts[memory.contacts["near"] == 1]:
        move, twist = bodies[contact["body"]]
        wrench[contact["body"]] += contact_wrench(memory.surfaces[contact["surface"]], contact, move, twist)
    for h, hand in enumerate(memory.hands):
        if hand["holds"]:
            wrench[h] += _pair(hand, bodies[h], turning, rotation, wrench[-1])
    torque = drive + sum(J.T @ F for J, F in zip(memory.jacobian, wrench[:-1], strict=True))
    acceleration = pin.aba(links, links.createData(), q, v, torque)
    kind, rotor = memory.joints["kind"], memory.joints["reflected_inertia"]
    elastic = kind == ELASTIC
    speeding = np.where(elastic, motor / np.where(elastic, rotor, 1.0), acceleration)
    body = memory.body[0]
    fall = body["gravity"] + wrench[-1, :3] / (body["mass"] if body["present"] else 1.0)
    carried = memory.part("object_velocity", STAGE)
    return np.concatenate([v, acceleration, w, speeding, carried, fall, wrench[-1, 3:]])


def joint_torques(memory: Memory) -> tuple[Array, Array]:
    """Computes the net torque on each rotor, and the torque of drive, stop and effects on each link."""
    joints = memory.joints
    q, v = memory.part("position", STAGE), memory.part("velocity", STAGE)
    theta, w = memory.part("motor_position", STAGE), memory.part("motor_velocity", STAGE)
    hold = joints["hold_stiffness"] * (joints["hold_position"] - theta) - joints["hold_damping"] * w
    hold = np.clip(hold, -joints["effort_max"], joints["effort_max"])
    motor = joints["command"] + joints["assist"] + hold + joints["extra_motor"]
    spring = spring_torque(joints, theta - q, w - v)
    loss = joints["motor_damping"] * w
    kinds = [joints["kind"] == kind for kind in (ELASTIC, RIGID, IDEAL)]
    load = np.select(kinds, [spring, motor - loss, motor])
    high = np.minimum(0.0, joints["stop_stiffness"] * (joints["upper"] - q) - joints["stop_damping"] * v)
    low = np.maximum(0.0, joints["stop_stiffness"] * (joints["lower"] - q) - joints["stop_damping"] * v)
    stop = np.where(q > joints["upper"], high, np.where(q < joints["lower"], low, 0.0))
    return motor - load - loss, load + stop + joints["extra_link"]


def contact_wrench(surface: Row, contact: Row, move: Array, twist: Array) -> Array:
    """Computes the wrench (6,) of one surface on a body at its origin, through one point."""
    arm, normal = contact["arm"], contact["normal"]
    shift = move[:3] + np.cross(move[3:], arm)
    speed = twist[:3] + np.cross(twist[3:], arm)
    push = -contact["stiffness"] * (contact["distance"] + normal @ shift)
    if surface["span_count"] > 0:
        normal, push = sheet_push(surface, contact, shift)
    if push <= 0.0:
        return np.zeros(6)
    across = np.eye(3) - np.outer(normal, normal)
    pressure = max(0.0, push - contact["damping"] * (normal @ speed))
    rub = -contact["stiffness"] * (contact["slip"] + across @ shift) - contact["damping"] * (across @ speed)
    bound = np.inf if contact["caught"] >= 0 else contact["friction"] * pressure
    force = _limited(rub, float(bound)) + pressure * normal
    return np.concatenate([force, np.cross(arm, force)])


def sheet_push(surface: Row, contact: Row, shift: Array) -> tuple[Array, float]:
    """Gives the normal of a bent sheet under a point that has moved by ``shift`` (3,), and the force along it [N]."""
    sheet = Sheet.of_spans(
        surface["spans"][: surface["span_count"]], surface["half"][1], 1.0 / surface["softness"]
    )
    local = surface["rotation"].T @ (contact["position"] + shift - surface["translation"])
    force = sheet.force(local - np.array([0.0, 0.0, contact["radius"]]), float(contact["stiffness"]))
    if force is None:
        return contact["normal"], 0.0
    size = float(np.linalg.norm(force))
    return surface["rotation"] @ force / size, size


def _limited(vector: Array, bound: float) -> Array:
    """Shortens a vector to a length."""
    length = float(np.linalg.norm(vector))
    return vector * (bound / length) if length > bound else vector


def _hand_motion(memory: Memory, h: int) -> tuple[Array, Array]:
    n, J = memory.n, memory.jacobian[h]
    moved = memory.state[STAGE, :n] - memory.state[START, :n]
    return J @ moved, J @ memory.part("velocity", STAGE)


def _object_motion(memory: Memory) -> tuple[Array, tuple[Array, Array]]:
    """Gives the object's rotation, the part of it made in this step, its displacement and its twist."""
    body, turn = memory.body[0], memory.part("object_turn", STAGE)
    rotation = exp3(turn) @ body["rotation"]
    inertia = body["inertia"] if body["present"] else np.ones(3)
    spin = rotation @ (rotation.T @ memory.part("object_momentum", STAGE) / inertia)
    moved = memory.part("object_position", STAGE) - memory.part("object_position", START)
    velocity = memory.part("object_velocity", STAGE)
    return rotation, (np.concatenate([moved, turn]), np.concatenate([velocity, spin]))


def _pair(
    hand: Row,
    own: tuple[Array, Array],
    other: tuple[Array, Array],
    rotation: Array,
    reaction: Array,
) -> Array:
    """Computes the coupling's wrench on its hand and adds the opposite one to ``reaction``."""
    now = rotation @ hand["point"]
    stretch = hand["stretch"] + other[0][:3] + now - hand["arm"] - own[0][:3]
    twist = hand["twist"] + other[0][3:] - own[0][3:]
    rate = other[1][:3] + np.cross(other[1][3:], now) - own[1][:3]
    force = hand["linear_stiffness"] * stretch + hand["linear_damping"] * rate
    moment = hand["angular_stiffness"] * twist + hand["angular_damping"] * (other[1][3:] - own[1][3:])
    if hand["slips"]:
        normal = rotation @ hand["normal"]
        pressure = max(0.0, -float(force @ normal))
        bound = float(hand["friction"]) * pressure
        force = _limited(force - (force @ normal) * normal, bound) - pressure * normal
        moment = _limited(moment, bound * float(hand["palm_radius"]))
    reaction[:3] -= force
    reaction[3:] -= moment + np.cross(now - stretch, force)
    return np.concatenate([force, moment])
