# SPDX-License-Identifier: BSD-3-Clause
r"""A rigid object: its shape, its inertia and its motion under gravity, contact, hands and pushes.

    m u' = m g + f,  L' = t,  w_O = R I^-1 R^T L

u is the velocity of its centre, L its angular momentum, R its rotation, f and t everything that acts on it [N], [N.m].
A convex shape also says how deep a point lies beneath its nearest face: what presses on it presses there.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from impedance_modules.compiled import compiled
from impedance_modules.errors import BadInput
from impedance_modules.records import Flag, Integer, Matrix, Record, Scalar, Vector
from impedance_modules.robot.model import RobotModel
from impedance_modules.robot.rotation import add_rotation_rate, compose, exponential, turn, turn_back
from impedance_modules.spec.task import ObjectSpec

if TYPE_CHECKING:
    from impedance_modules.plant.plant_state import PlantState

SHAPES = {"box": 3, "cylinder": 2, "sphere": 1}
"""Shapes and how many sizes describe them."""

BOX, CYLINDER, SPHERE = range(3)
"""``ObjectState.shape``, in the order of ``SHAPES``."""


class ObjectState(Record):
    """The object that the hands hold, or that lies about.

    Attributes:
        present: Whether there is one.
        shape: ``BOX``, ``CYLINDER`` or ``SPHERE``.
        half: (3,) half of its extent along its own axes [m].
        mass: [kg].
        inertia: (3,) principal, in its own axes [kg.m^2].
        gravity: (3,) acceleration, world axes [m/s^2].
        rotation: (3, 3) at the step's start.
        step_rotation: (3, 3) since then.
        rotation_now: (3, 3) both together.
    """

    present: Flag
    shape: Integer
    half: Vector
    mass: Scalar
    inertia: Vector
    gravity: Vector
    rotation: Matrix
    step_rotation: Matrix
    rotation_now: Matrix


@compiled
def depth_beneath_face(body: ObjectState, margin: float, point: Vector, inward: Vector) -> float:
    """Gives how deep a point (3,) in the object's axes lies beneath the nearest face [m]; below 0 outside.

    Writes the face's direction into the object (3,), own axes. Every face counts as ``margin`` [m] further out.
    """
    half, nearest = body.half, 0
    if body.shape == BOX:
        depth = half[0] + margin - abs(point[0])
        for k in (1, 2):
            gap = half[k] + margin - abs(point[k])
            if gap < depth:
                depth, nearest = gap, k
        _along_axis(point, nearest, inward)
        return float(depth)
    if body.shape == CYLINDER:
        cap = half[2] + margin - abs(point[2])
        side = half[0] + margin - math.hypot(point[0], point[1])
        if cap < side:
            _along_axis(point, 2, inward)
            return float(cap)
        inward[2] = 0.0
        _radially(point, inward, 2)
        return float(side)
    return float(half[0] + margin - _radially(point, inward, 3))


@compiled
def _along_axis(point: Vector, axis: int, inward: Vector) -> None:
    """Writes the unit vector against a point's coordinate."""
    for k in range(3):
        inward[k] = 0.0
    inward[axis] = -1.0 if point[axis] >= 0.0 else 1.0


@compiled
def _radially(point: Vector, inward: Vector, axes: int) -> float:
    """Writes the unit vector from a point to the centre in its first ``axes`` coordinates; returns the distance [m].

    At the centre all directions are as near; the first axis is taken.
    """
    square = 0.0
    for k in range(axes):
        square += point[k] ** 2
    distance = math.sqrt(square)
    if distance == 0.0:
        _along_axis(point, 0, inward)
        return 0.0
    for k in range(axes):
        inward[k] = -point[k] / distance
    return distance


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


@dataclass(frozen=True)
class ObjectBody:
    """A rigid object in the plant and the hand frames that hold it; none for an object on its own.

    The plant's state is that of its centre of mass: ``ObjectState`` and all couplings count from there.
    """

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
        if self.centre.any() and (self.spec.grasp == "friction" or self.spec.hinge is not None):
            raise BadInput(
                f"an object with its centre of mass at {self.spec.centre} m cannot be built with a friction grasp or a"
                " hinge (valid: a weld without a hinge, or a centre of 0, 0, 0)"
            )

    @staticmethod
    def of_task(model: RobotModel, spec: ObjectSpec) -> ObjectBody:
        """Finds the hands of the limbs that hold the object."""
        return ObjectBody(spec, tuple(model.limbs[name].hand for name in spec.held_by))

    @property
    def centre(self) -> Vector:
        """Its centre of mass (3,) from its origin, along its own axes [m]."""
        return np.array(self.spec.centre, dtype=float)

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


def half_extent(shape: str, size: tuple[float, ...]) -> Vector:
    """Gives half of a body's extent (3,) along its own axes [m]; a cylinder's axis is z."""
    if shape == "box":
        return 0.5 * np.array(size)
    return 0.5 * np.array([size[0], size[0], size[-1]])


def object_state(held: ObjectBody | None, gravity: Vector) -> ObjectState:
    """Makes the object, or its absence, at rest in world axes; gravity (3,) [m/s^2]."""
    body = ObjectState(
        present=held is not None,
        shape=BOX if held is None else list(SHAPES).index(held.spec.shape),
        half=np.zeros(3),
        mass=0.0 if held is None else held.spec.mass,
        inertia=np.zeros(3),
        gravity=np.zeros(3),
        rotation=np.eye(3),
        step_rotation=np.eye(3),
        rotation_now=np.eye(3),
    )
    if held is not None:
        body.gravity[:] = gravity
        body.half[:] = half_extent(held.spec.shape, held.spec.size)
        body.inertia[:] = principal_inertia(held.spec.shape, held.spec.size, held.spec.mass)
    return body
