# SPDX-License-Identifier: BSD-3-Clause
r"""The plant's equations of motion in plain numpy with pinocchio's ``aba``: independent of the laws that run.

links    M(q) v' + C(q, v) + g(q) = tau_s + stops + effects + sum J_h^T (contact + grasp + push)
rotors   I_r w' + D w = tau_m - tau_s,  tau_s = K (theta - q) + B (w - v)
object   m u' = m g + f,  L' = t,  w_O = R I^-1 R^T L
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from impedance_modules.plant.joints import ELASTIC, IDEAL, RIGID
from impedance_modules.plant.plant_state import PlantState
from impedance_modules.plant.rigid_object import BOX, SPHERE, ObjectState
from impedance_modules.records import Matrix, Row, Table, Vector
from tests.reference.bent_sheet import bent_sheet_force

Motion = tuple[Vector, Vector]
"""Displacement since the step's start and twist of a body, (6,) each."""


def plain_rate(plant: PlantState, links: pin.Model) -> Vector:
    """Computes the rate of q, v, theta, w, p, u and L at the stage, in this order, (4 n + 9,).

    Geometry is that of the step's start (``Integrator.place``), moved linearly, as in the laws.

    Args:
        plant: Its state; not changed.
        links: Pinocchio model with the armature of rigid joints.
    """
    stage, joints, body = plant.stage, plant.joints, plant.body
    motor, drive = joint_torques(plant)
    moved = stage.position - plant.start.position
    bodies: list[Motion] = [(J @ moved, J @ stage.velocity) for J in plant.jacobian]
    _, turning = _object_motion(plant)
    bodies.append(turning)
    wrench = plant.push_wrench.copy()
    for contact in plant.contacts[plant.contacts["near"] == 1]:
        wrench[contact["body"]] += contact_wrench(
            plant.surfaces[contact["surface"]], contact, *bodies[contact["body"]]
        )
    for h, hand in enumerate(plant.hands):
        if hand["holds"]:
            wrench[h] += _pair(hand, bodies[h], turning, plant, wrench[-1])
    torque = drive + sum(J.T @ F for J, F in zip(plant.jacobian, wrench[:-1], strict=True))
    acceleration = pin.aba(links, links.createData(), stage.position, stage.velocity, torque)
    elastic, rotor = joints["kind"] == ELASTIC, joints["reflected_inertia"]
    speeding = np.where(elastic, motor / np.where(elastic, rotor, 1.0), acceleration)
    fall = body.gravity + wrench[-1, :3] / (body.mass if body.present else 1.0)
    return np.concatenate(
        [
            stage.velocity,
            acceleration,
            stage.motor_velocity,
            speeding,
            stage.object_velocity,
            fall,
            wrench[-1, 3:],
        ]
    )


def joint_torques(plant: PlantState) -> tuple[Vector, Vector]:
    """Computes the net torque on each rotor, and the torque of drive, stop and effects on each link."""
    joints, stage = plant.joints, plant.stage
    q, v, theta, w = stage.position, stage.velocity, stage.motor_position, stage.motor_velocity
    hold = joints["hold_stiffness"] * (joints["hold_position"] - theta) - joints["hold_damping"] * w
    hold = np.clip(hold, -joints["effort_max"], joints["effort_max"])
    motor = joints["command"] + joints["assist"] + hold + joints["effect_motor"]
    spring = plain_spring_torque(joints, theta - q, w - v)
    loss = joints["motor_damping"] * w
    kinds = [joints["kind"] == kind for kind in (ELASTIC, RIGID, IDEAL)]
    load = np.select(kinds, [spring, motor - loss, motor])
    high = np.minimum(0.0, joints["stop_stiffness"] * (joints["upper"] - q) - joints["stop_damping"] * v)
    low = np.maximum(0.0, joints["stop_stiffness"] * (joints["lower"] - q) - joints["stop_damping"] * v)
    stop = np.where(q > joints["upper"], high, np.where(q < joints["lower"], low, 0.0))
    return motor - load - loss, load + stop + joints["effect_link"]


def plain_spring_torque(joints: Table, lead: Vector, speed: Vector) -> Vector:
    """Gives the torque through each elastic gear (n,) [N.m]; where there is play, teeth push and never pull."""
    gap = joints["half_gap"]
    deflection = lead - np.clip(lead, -gap, gap)
    load = joints["stiffness"] * deflection + joints["spring_damping"] * speed
    toothed = np.where(deflection > 0.0, np.maximum(load, 0.0), np.minimum(load, 0.0))
    return np.where(gap > 0.0, np.where(deflection == 0.0, 0.0, toothed), load)


def contact_wrench(surface: Row, contact: Row, move: Vector, twist: Vector) -> Vector:
    """Computes the wrench (6,) of one surface on a body at its origin, through one point."""
    lever, normal = contact["lever"], contact["normal"]
    shift = move[:3] + np.cross(move[3:], lever)
    speed = twist[:3] + np.cross(twist[3:], lever)
    push = -contact["stiffness"] * (contact["distance"] + normal @ shift)
    if surface["sheet"]["span_count"] > 0:
        local = surface["rotation"].T @ (contact["position"] + shift - surface["translation"])
        local = local - np.array([0.0, 0.0, contact["radius"]])
        force = surface["rotation"] @ bent_sheet_force(surface["sheet"], local, float(contact["stiffness"]))
        push = float(np.linalg.norm(force))
        normal = force / push if push > 0.0 else normal
    if push <= 0.0:
        return np.zeros(6)
    across = np.eye(3) - np.outer(normal, normal)
    pressure = max(0.0, push - contact["damping"] * (normal @ speed))
    rub = -contact["stiffness"] * (contact["stretch"] + across @ shift)
    rub = rub - contact["damping"] * (across @ speed)
    bound = np.inf if contact["splinter"] >= 0 else contact["friction"] * pressure
    force = _limited(rub, float(bound)) + pressure * normal
    return np.concatenate([force, np.cross(lever, force)])


def _limited(vector: Vector, bound: float) -> Vector:
    """Shortens a vector to a length."""
    length = float(np.linalg.norm(vector))
    return vector * (bound / length) if length > bound else vector


def _object_motion(plant: PlantState) -> tuple[Matrix, Motion]:
    """Gives the object's rotation, and its displacement and twist."""
    body, stage = plant.body, plant.stage
    rotation = pin.exp3(stage.object_rotation) @ body.rotation
    inertia = body.inertia if body.present else np.ones(3)
    spin = rotation @ (rotation.T @ stage.object_momentum / inertia)
    moved = stage.object_position - plant.start.object_position
    displacement = np.concatenate([moved, stage.object_rotation])
    return rotation, (displacement, np.concatenate([stage.object_velocity, spin]))


def _pair(hand: Row, own: Motion, other: Motion, plant: PlantState, reaction: Vector) -> Vector:
    """Computes the coupling's wrench on its hand and adds the opposite one to ``reaction``."""
    rotation, _ = _object_motion(plant)
    twist = hand["angular_deflection"] + other[0][3:] - own[0][3:]
    if hand["slips"]:
        offset = hand["translation"] + own[0][:3] - plant.start.object_position - other[0][:3]
        force, moment = palm_wrench(hand, plant.body, rotation, offset, twist, own[1], other[1])
    else:
        now = rotation @ hand["rest_point"]
        stretch = hand["deflection"] + other[0][:3] + now - hand["lever"] - own[0][:3]
        rate = other[1][:3] + np.cross(other[1][3:], now) - own[1][:3]
        force = hand["linear_stiffness"] * stretch + hand["linear_damping"] * rate
        moment = hand["angular_stiffness"] * twist + hand["angular_damping"] * (other[1][3:] - own[1][3:])
        offset = now - stretch
    reaction[:3] -= force
    reaction[3:] -= moment + np.cross(offset, force)
    return np.concatenate([force, moment])


def depth_and_direction(body: ObjectState, margin: float, point: Vector) -> tuple[float, Vector]:
    """Gives how deep a point lies beneath the nearest face, and the direction into the object, its own axes."""
    if body.shape == BOX:
        gaps = body.half + margin - np.abs(point)
        axis = int(np.argmin(gaps))
        return float(gaps[axis]), -np.eye(3)[axis] * (1.0 if point[axis] >= 0.0 else -1.0)
    if body.shape == SPHERE:
        return float(body.half[0] + margin - np.linalg.norm(point)), -point / np.linalg.norm(point)
    across = np.array([point[0], point[1], 0.0])
    cap, side = body.half[2] + margin - abs(point[2]), body.half[0] + margin - np.linalg.norm(across)
    if cap < side:
        return float(cap), np.array([0.0, 0.0, -1.0 if point[2] >= 0.0 else 1.0])
    return float(side), -across / np.linalg.norm(across)


def palm_wrench(
    hand: Row, body: ObjectState, rotation: Matrix, offset: Vector, angle: Vector, own: Vector, other: Vector
) -> tuple[Vector, Vector]:
    """Computes force and moment on a palm that friction keeps; ``offset`` from the object's origin, twists (6,)."""
    point = rotation.T @ offset
    depth, inward = depth_and_direction(body, float(hand["palm_offset"]), point)
    if depth <= 0.0:
        return np.zeros(3), np.zeros(3)
    normal, k, c = rotation @ inward, hand["linear_stiffness"], hand["linear_damping"]
    along_face = np.eye(3) - np.outer(normal, normal)
    velocity = own[:3] - other[:3] - np.cross(other[3:], offset)
    pressed = k * depth + np.clip(c * (velocity @ normal), -k * depth, k * depth)
    bound = float(hand["friction"] * pressed)
    held = _limited(k * (along_face @ (rotation @ (hand["rest_point"] - point))), bound)
    rub = _limited(held - c * (along_face @ velocity), bound)
    bound *= float(hand["palm_radius"])
    moment = _limited(hand["angular_stiffness"] * angle, bound)
    moment = _limited(moment + hand["angular_damping"] * (other[3:] - own[3:]), bound)
    return rub - pressed * normal, moment
