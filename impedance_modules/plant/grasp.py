# SPDX-License-Identifier: BSD-3-Clause
"""The object of a task as a rigid body: inertia, start pose, and which of its faces a hand presses."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impedance_modules.errors import BadInput
from impedance_modules.robot.model import RobotModel
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
