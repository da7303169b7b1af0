# SPDX-License-Identifier: BSD-3-Clause
"""The object of a task as a rigid body: inertia, start pose, and which of its faces a hand presses."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impedance_modules.compiled import compiled
from impedance_modules.errors import BadInput
from impedance_modules.plant.plant_state import BODY, Row, Table
from impedance_modules.robot.model import RobotModel
from impedance_modules.robot.pose import carry
from impedance_modules.robot.rotation import (
    add_cross,
    add_rotation_rate,
    compose,
    dot,
    exp3,
    exponential,
    logarithm,
    turn,
    turn_back,
)
from impedance_modules.spec.task import ObjectSpec

Array = NDArray[np.float64]

SHAPES = {"box": 3, "cylinder": 2, "sphere": 1}
"""Shapes and how many sizes describe them."""


@dataclass(frozen=True)
class HeldObject:
    """A rigid object in the plant and the hand frames that hold it; none for an object on its own."""

    spec: ObjectSpec
    hands: tuple[str, ...]

    def __post_init__(self) -> None:
        if len(self.spec.size) != SHAPES.get(self.spec.shape):
            raise BadInput(
                f"an object of shape '{self.spec.shape}' with {len(self.spec.size)} sizes cannot be"
                " built (valid: box with 3, cylinder with diameter and length, sphere with diameter)"
            )
        if not self.hands and self.spec.position is None:
            raise BadInput("an object that no hand holds needs a position")

    @staticmethod
    def of_task(model: RobotModel, spec: ObjectSpec) -> HeldObject:
        """Finds the hands of the limbs that hold the object."""
        return HeldObject(spec, tuple(model.limbs[name].hand for name in spec.held_by))

    def position(self, hand_origins: Sequence[Array]) -> Array:
        """Gives the object's start in world [m]: as declared, or midway between the holding hands."""
        if self.spec.position is not None:
            return np.array(self.spec.position, dtype=float)
        return np.asarray(np.mean(np.asarray(hand_origins), axis=0))


def principal_inertia(shape: str, size: tuple[float, ...], mass: float) -> Array:
    """Computes the inertia (3,) of a homogeneous body about its centre, in its own axes [kg.m^2].

    Box: m (b^2 + c^2) / 12 and cyclic. Cylinder about z: m r^2 / 2, across: m (3 r^2 + l^2) / 12.
    Sphere: 2 m r^2 / 5.
    """
    if shape == "box":
        square = np.square(size)
        return np.asarray(mass * (square.sum() - square) / 12.0)
    radius = 0.5 * size[0]
    if shape == "sphere":
        return np.full(3, 0.4 * mass * radius**2)
    across = mass * (3.0 * radius**2 + size[1] ** 2) / 12.0
    return np.array([across, across, 0.5 * mass * radius**2])


def pressing_direction(shape: str, size: tuple[float, ...], point: Array) -> Array:
    """Gives the unit vector (3,) along which a hand at ``point`` presses into the object, its own axes.

    Into the box face, or cylinder cap or side, or sphere, that the point is nearest to.
    """
    if shape == "sphere":
        return -_unit(point)
    if shape == "box":
        return -_axis(point, int(np.argmax(np.abs(point) / np.asarray(size))))
    side = np.array([point[0], point[1], 0.0])
    if abs(point[2]) / size[1] > float(np.linalg.norm(side)) / size[0]:
        return -_axis(point, 2)
    return -_unit(side)


def _axis(point: Array, index: int) -> Array:
    direction = np.zeros(3)
    direction[index] = 1.0 if point[index] >= 0.0 else -1.0
    return direction


def _unit(vector: Array) -> Array:
    length = float(np.linalg.norm(vector))
    if length == 0.0:
        raise BadInput("a hand at the object's centre has no direction in which to press")
    return vector / length


GRASP_LINEAR_STIFFNESS = 3e5
"""Of the coupling between a hand and a held object [N/m]: a thousand times a task's 300 N/m."""

GRASP_ANGULAR_STIFFNESS = 5e3
"""Of the same coupling [N.m/rad]: several hundred times a task's 10 N.m/rad."""

GRASP_DAMPING_TIME = 1e-4
"""Damping of the coupling over its stiffness [s]: a tenth of critical at 2000 rad/s."""

PALM_RADIUS = 0.03
"""Of the patch through which a friction grasp passes torque, at most mu N PALM_RADIUS [m]."""


def body_table(held: HeldObject | None, gravity: Array) -> Table:
    """Tabulates the object, or its absence, at rest in world axes."""
    body = np.zeros(1, BODY)
    for name in ("rotation", "change", "turned"):
        body[name] = np.eye(3)
    if held is not None:
        spec = held.spec
        body["present"], body["mass"], body["gravity"] = True, spec.mass, gravity
        body["inertia"] = principal_inertia(spec.shape, spec.size, spec.mass)
    return body


def prepare_hands(hands: Table, frames: tuple[str, ...], held: HeldObject) -> None:
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


def take_hold(hands: Table, body: Table, held: HeldObject, position: Array) -> Array:
    """Sets the couplings' rest at the start pose; returns the wrench of the object on each hand (h, 6)."""
    holding = [i for i in range(hands.size) if hands[i]["holds"]]
    rotation = body[0]["rotation"]
    wrench = np.zeros((hands.size, 6))
    for i in holding:
        hand = hands[i]
        hand["point"] = rotation.T @ (hand["translation"] - position)
        hand["normal"] = pressing_direction(held.spec.shape, held.spec.size, hand["point"])
        wrench[i, :3] = -held.spec.squeeze * (rotation @ hand["normal"])
    if holding and held.spec.carry_weight:
        weight = np.concatenate([body[0]["mass"] * body[0]["gravity"], np.zeros(3)])
        offsets = [rotation @ hands[i]["point"] for i in holding]
        wrench[holding] += _share(weight, wrench[holding], offsets)
    for i in holding:
        _set_rest(hands[i], rotation, position, wrench[i])
    return wrench


def _share(load: Array, pressed: Array, offsets: list[Array]) -> Array:
    """Adds the smallest wrenches (h, 6) on the hands that bring object and hands into equilibrium."""
    maps = np.hstack([carry(offset).T for offset in offsets])
    missing = load - maps @ pressed.reshape(-1)
    added, *_ = np.linalg.lstsq(maps, missing, rcond=None)
    return np.asarray(added.reshape(-1, 6))


def _set_rest(hand: Row, rotation: Array, position: Array, wrench: Array) -> None:
    """Winds one coupling so that it puts ``wrench`` on the hand at the present pose."""
    stretch = wrench[:3] / hand["linear_stiffness"]
    twist = wrench[3:] / hand["angular_stiffness"]
    hand["point"] = rotation.T @ (hand["translation"] + stretch - position)
    hand["turn"] = rotation.T @ exp3(twist) @ hand["rotation"]
    hand["stretch"], hand["twist"] = stretch, twist
    hand["pressure"] = max(0.0, -float(wrench[:3] @ (rotation @ hand["normal"])))


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
