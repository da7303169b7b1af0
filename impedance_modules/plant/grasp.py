# SPDX-License-Identifier: BSD-3-Clause
r"""A rigid object, and the stiff couplings by which hands hold it.

A weld is an isotropic spring-damper on position and rotation, its force at the hand's origin [N], [N.m]:

    f = k e + d e',  e = p + R s - p_H        t = k_r e_r + d_r (w_O - w_H),  e_r = log(R R_OH R_H^T)

p, R, w_O the object's position, rotation and angular velocity, p_H, R_H, w_H the hand's, s and R_OH the coupling's
rest in the object's axes. On the object act the opposite force and moment, at the same point. A friction grasp keeps
the part of f that presses (N >= 0), and limits the rest to mu N and t to mu N times the palm's radius. The object moves
by

    m u' = m g + f,  L' = t,  w_O = R I^-1 R^T L

The start is a static equilibrium: the hands' wrenches on the object sum to minus its weight (where the arms carry it),
and each presses with the declared squeeze; the couplings' rest is set so that they carry exactly these wrenches.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from impedance_modules.compiled import compiled
from impedance_modules.errors import BadInput
from impedance_modules.records import Flag, Matrix, Record, Row, Scalar, Table, Vector
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

if TYPE_CHECKING:
    from impedance_modules.plant.plant_state import PlantState

SHAPES = {"box": 3, "cylinder": 2, "sphere": 1}
"""Shapes and how many sizes describe them."""

GRASP_LINEAR_STIFFNESS = 3e5
"""Of the coupling between a hand and a held object [N/m]: a thousand times a task's 300 N/m."""

GRASP_ANGULAR_STIFFNESS = 5e3
"""Of the same coupling [N.m/rad]: several hundred times a task's 10 N.m/rad."""

GRASP_DAMPING_TIME = 1e-4
"""Damping of the coupling over its stiffness [s]: a tenth of critical at 2000 rad/s."""

PALM_RADIUS = 0.03
"""Of the patch through which a friction grasp passes torque, at most mu N PALM_RADIUS [m]."""

HAND = np.dtype(
    [
        ("link", np.int64),
        ("mount_translation", np.float64, (3,)),
        ("mount_rotation", np.float64, (3, 3)),
        ("holds", np.int64),
        ("slips", np.int64),
        ("translation", np.float64, (3,)),
        ("rotation", np.float64, (3, 3)),
        ("linear_stiffness", np.float64),
        ("angular_stiffness", np.float64),
        ("linear_damping", np.float64),
        ("angular_damping", np.float64),
        ("friction", np.float64),
        ("palm_radius", np.float64),
        ("rest_point", np.float64, (3,)),
        ("rest_rotation", np.float64, (3, 3)),
        ("normal", np.float64, (3,)),
        ("lever", np.float64, (3,)),
        ("deflection", np.float64, (3,)),
        ("angular_deflection", np.float64, (3,)),
        ("normal_force", np.float64),
    ],
    align=True,
)
"""One hand: where it sits on its link, its pose at the step's start, and its coupling.

``rest_point`` is s and ``rest_rotation`` R_OH, ``normal`` points into the object, all in the object's axes; ``lever``
is R s, ``deflection`` e [m] and ``angular_deflection`` e_r [rad], at the step's start, world axes.
"""


class ObjectState(Record):
    """The object that the hands hold, or that lies about.

    Attributes:
        present: Whether there is one.
        mass: [kg].
        inertia: (3,) principal, in its own axes [kg.m^2].
        gravity: (3,) acceleration, world axes [m/s^2].
        rotation: (3, 3) at the step's start.
        step_rotation: (3, 3) since then.
        rotation_now: (3, 3) both together.
    """

    present: Flag
    mass: Scalar
    inertia: Vector
    gravity: Vector
    rotation: Matrix
    step_rotation: Matrix
    rotation_now: Matrix


@compiled
def place_couplings(plant: PlantState) -> None:
    """Writes each coupling's deflection at the step's start [m], [rad], exactly."""
    hands, body, position = plant.hands, plant.body, plant.start.object_position
    partly, relative = np.empty((3, 3)), np.empty((3, 3))
    for i in range(hands.size):
        hand = hands[i]
        if not hand.holds:
            continue
        turn(body.rotation, hand.rest_point, hand.lever)
        for k in range(3):
            hand.deflection[k] = position[k] + hand.lever[k] - hand.translation[k]
        compose(body.rotation, hand.rest_rotation, partly)
        for r in range(3):
            for c in range(3):
                relative[r, c] = dot(partly[r], hand.rotation[c])
        logarithm(relative, hand.angular_deflection)


@compiled
def grasp_forces(plant: PlantState) -> float:
    """Adds each coupling's wrench to its hand and the object; returns the power they receive [W]."""
    hands, displacement, twist = plant.hands, plant.displacement, plant.twist
    power, held = 0.0, hands.size
    lever, deflection = np.empty(3), np.empty(3)
    for i in range(hands.size):
        hand = hands[i]
        if not hand.holds:
            continue
        turn(plant.body.step_rotation, hand.lever, lever)
        for k in range(3):
            moved = displacement[held, k] + lever[k] - hand.lever[k] - displacement[i, k]
            deflection[k] = hand.deflection[k] + moved
        _coupling_wrench(plant, i, lever, deflection)
        force, reaction = plant.grasp_wrench[i], plant.grasp_wrench[held]
        for k in range(3):
            lever[k] -= deflection[k]
            reaction[k] -= force[k]
            reaction[3 + k] -= force[3 + k]
            power += force[k] * twist[i, k] + force[3 + k] * (twist[i, 3 + k] - twist[held, 3 + k])
            power -= force[k] * twist[held, k]
        moment = np.zeros(3)
        add_cross(force[:3], lever, moment)
        for k in range(3):
            reaction[3 + k] += moment[k]
            power += moment[k] * twist[held, 3 + k]
    return power


@compiled
def _coupling_wrench(plant: PlantState, i: int, lever: Vector, deflection: Vector) -> None:
    """Writes the wrench on hand i; ``lever`` from the object's origin to its grasped point [m]."""
    hand, held, displacement, twist = plant.hands[i], plant.hands.size, plant.displacement, plant.twist
    wrench, rate = plant.grasp_wrench[i], np.empty(3)
    for k in range(3):
        rate[k] = twist[held, k] - twist[i, k]
    add_cross(twist[held, 3:], lever, rate)
    for k in range(3):
        wrench[k] = hand.linear_stiffness * deflection[k] + hand.linear_damping * rate[k]
        angle = hand.angular_deflection[k] + displacement[held, 3 + k] - displacement[i, 3 + k]
        spin = twist[held, 3 + k] - twist[i, 3 + k]
        wrench[3 + k] = hand.angular_stiffness * angle + hand.angular_damping * spin
    if hand.slips:
        _limit_to_friction(hand, plant.body.rotation_now, wrench)


@compiled
def _limit_to_friction(hand: Row, rotation: Matrix, wrench: Vector) -> None:
    """Brings a wrench on a hand into the friction cone of its normal force."""
    normal = np.empty(3)
    turn(rotation, hand.normal, normal)
    hand.normal_force = max(0.0, -dot(wrench[:3], normal))
    along = dot(wrench[:3], normal)
    for k in range(3):
        wrench[k] -= along * normal[k]
    bound = hand.friction * hand.normal_force
    for half, limit in ((0, bound), (3, bound * hand.palm_radius)):
        size = math.sqrt(dot(wrench[half : half + 3], wrench[half : half + 3]))
        if size > limit:
            for k in range(3):
                wrench[half + k] *= limit / size
    for k in range(3):
        wrench[k] -= hand.normal_force * normal[k]


@compiled
def object_rate(plant: PlantState) -> None:
    """Writes the rate of the object's position, rotation, velocity and momentum under contact, grasp and push."""
    stage, rate, body, held = plant.stage, plant.rate, plant.body, plant.hands.size
    contact, grasp, push = plant.contact_wrench[held], plant.grasp_wrench[held], plant.push_wrench[held]
    for k in range(3):
        rate.object_position[k] = stage.object_velocity[k]
        rate.object_rotation[k] = 0.0
        rate.object_velocity[k] = body.gravity[k] + (contact[k] + grasp[k] + push[k]) / body.mass
        rate.object_momentum[k] = contact[3 + k] + grasp[3 + k] + push[3 + k]
    add_rotation_rate(stage.object_rotation, plant.twist[held, 3:], rate.object_rotation)


@compiled
def object_motion(plant: PlantState) -> None:
    """Writes the object's displacement and twist at the stage, w = R I^-1 R^T L."""
    body, stage, held = plant.body, plant.stage, plant.hands.size
    local, spin = np.empty(3), np.empty(3)
    exponential(stage.object_rotation, body.step_rotation)
    compose(body.step_rotation, body.rotation, body.rotation_now)
    turn_back(body.rotation_now, stage.object_momentum, local)
    for k in range(3):
        local[k] /= body.inertia[k]
    turn(body.rotation_now, local, spin)
    for k in range(3):
        plant.displacement[held, k] = stage.object_position[k] - plant.start.object_position[k]
        plant.displacement[held, 3 + k] = stage.object_rotation[k]
        plant.twist[held, k] = stage.object_velocity[k]
        plant.twist[held, 3 + k] = spin[k]


@compiled
def update_object_rotation(plant: PlantState) -> None:
    """Moves the rotation since the step's start into the rotation, and starts it anew."""
    body, turned = plant.body, plant.stage.object_rotation
    exponential(turned, body.step_rotation)
    compose(body.step_rotation, body.rotation, body.rotation_now)
    for r in range(3):
        turned[r] = 0.0
        for c in range(3):
            body.rotation[r, c] = body.rotation_now[r, c]


@compiled
def update_slipping_palms(plant: PlantState) -> None:
    """Moves the rest of slipping palms: what deflects beyond friction's bound becomes the new rest.

    Runs before ``update_object_rotation``, with the motion of the whole step.
    """
    hands, body, displacement = plant.hands, plant.body, plant.displacement
    held, lever = hands.size, np.empty(3)
    for i in range(hands.size):
        hand = hands[i]
        if not (hand.holds and hand.slips):
            continue
        turn(body.step_rotation, hand.lever, lever)
        for k in range(3):
            hand.deflection[k] += displacement[held, k] + lever[k] - hand.lever[k] - displacement[i, k]
            hand.angular_deflection[k] += displacement[held, 3 + k] - displacement[i, 3 + k]
        _slip_along(hand, body.rotation_now)
        _slip_about(hand, body.rotation_now)


@compiled
def _slip_along(hand: Row, rotation: Matrix) -> None:
    """Shifts the rest point along the object's face."""
    normal, back, shift = np.empty(3), np.empty(3), np.empty(3)
    turn(rotation, hand.normal, normal)
    along = dot(hand.deflection, normal)
    for k in range(3):
        shift[k] = hand.deflection[k] - along * normal[k]
    length = math.sqrt(dot(shift, shift))
    bound = hand.friction * hand.normal_force / hand.linear_stiffness
    if length > bound:
        turn_back(rotation, shift, back)
        for k in range(3):
            hand.rest_point[k] -= (1.0 - bound / length) * back[k]


@compiled
def _slip_about(hand: Row, rotation: Matrix) -> None:
    """Turns the rest rotation, R_OH becoming R^T exp(-excess) R R_OH."""
    angle = math.sqrt(dot(hand.angular_deflection, hand.angular_deflection))
    bound = hand.friction * hand.normal_force * hand.palm_radius / hand.angular_stiffness
    if angle <= bound:
        return
    excess, back = np.empty(3), np.empty(3)
    change, rest = np.empty((3, 3)), np.empty((3, 3))
    for k in range(3):
        excess[k] = -(1.0 - bound / angle) * hand.angular_deflection[k]
    turn_back(rotation, excess, back)
    exponential(back, change)
    compose(change, hand.rest_rotation, rest)
    for r in range(3):
        for c in range(3):
            hand.rest_rotation[r, c] = rest[r, c]


@dataclass(frozen=True)
class ObjectBody:
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
    def of_task(model: RobotModel, spec: ObjectSpec) -> ObjectBody:
        """Finds the hands of the limbs that hold the object."""
        return ObjectBody(spec, tuple(model.limbs[name].hand for name in spec.held_by))

    def position(self, hand_origins: Sequence[Vector]) -> Vector:
        """Gives the object's start in world [m]: as declared, or midway between the holding hands."""
        if self.spec.position is not None:
            return np.array(self.spec.position, dtype=float)
        return np.asarray(np.mean(np.asarray(hand_origins), axis=0))


def principal_inertia(shape: str, size: tuple[float, ...], mass: float) -> Vector:
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


def pressing_direction(shape: str, size: tuple[float, ...], point: Vector) -> Vector:
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


def _axis(point: Vector, index: int) -> Vector:
    direction = np.zeros(3)
    direction[index] = 1.0 if point[index] >= 0.0 else -1.0
    return direction


def _unit(vector: Vector) -> Vector:
    length = float(np.linalg.norm(vector))
    if length == 0.0:
        raise BadInput("a hand at the object's centre has no direction in which to press")
    return vector / length


def object_state(held: ObjectBody | None, gravity: Vector) -> ObjectState:
    """Makes the object, or its absence, at rest in world axes; gravity (3,) [m/s^2]."""
    body = ObjectState(
        present=held is not None,
        mass=0.0 if held is None else held.spec.mass,
        inertia=np.zeros(3),
        gravity=np.zeros(3),
        rotation=np.eye(3),
        step_rotation=np.eye(3),
        rotation_now=np.eye(3),
    )
    if held is not None:
        body.gravity[:] = gravity
        body.inertia[:] = principal_inertia(held.spec.shape, held.spec.size, held.spec.mass)
    return body


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
    """Sets the couplings' rest at the start pose; returns the wrench of the object on each hand (h, 6)."""
    holding = [i for i in range(hands.size) if hands[i]["holds"]]
    rotation = body.rotation
    wrench = np.zeros((hands.size, 6))
    for i in holding:
        hand = hands[i]
        hand["rest_point"] = rotation.T @ (hand["translation"] - position)
        hand["normal"] = pressing_direction(held.spec.shape, held.spec.size, hand["rest_point"])
        wrench[i, :3] = -held.spec.squeeze * (rotation @ hand["normal"])
    if holding and held.spec.carry_weight:
        weight = np.concatenate([body.mass * body.gravity, np.zeros(3)])
        offsets = [rotation @ hands[i]["rest_point"] for i in holding]
        wrench[holding] += _share(weight, wrench[holding], offsets)
    for i in holding:
        _set_rest(hands[i], rotation, position, wrench[i])
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
    hand["deflection"], hand["angular_deflection"] = deflection, angle
    hand["normal_force"] = max(0.0, -float(wrench[:3] @ (rotation @ hand["normal"])))
