# SPDX-License-Identifier: BSD-3-Clause
"""Random arms, postures, springs and grasps for the law tests. Seeded: a failure comes back."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

from impedance_modules.modules.spring import Spring, displacement_of
from impedance_modules.robot.kinematics import Kinematics
from impedance_modules.robot.model import Limb, RobotModel
from impedance_modules.robot.pose import Pose
from impedance_modules.robot.rotation import exp3
from impedance_modules.spec.robot_reader import read_robot
from impedance_modules.spec.task import HybridAxis, SpringSpec
from tests.support.paths import TESTS

Array = NDArray[np.float64]
Random = np.random.Generator


@cache
def baxter() -> RobotModel:
    return RobotModel(read_robot("baxter"))


@cache
def six_joint_pair() -> RobotModel:
    return RobotModel(read_robot(TESTS / "robots" / "six_joint_pair"))


ROBOTS = pytest.mark.parametrize("robot", [baxter, six_joint_pair])
"""Runs a test on both robots; ``robot()`` gives the model."""


def random_position(random: Random, model: RobotModel) -> Array:
    """A posture in the middle 80 % of every joint's range."""
    low, high = model.column("position_min"), model.column("position_max")
    return low + (0.1 + 0.8 * random.random(model.n)) * (high - low)


def random_psd(random: Random, scale: Array, rank: int = 6) -> Array:
    """A full positive semidefinite matrix with about ``scale`` on its diagonal."""
    half = np.sqrt(scale)[:, None] * random.normal(size=(6, rank)) / np.sqrt(6)
    return half @ half.T


TYPICAL_STIFFNESS = np.array([300.0, 300.0, 300.0, 10.0, 10.0, 10.0])


def random_rotation(random: Random, largest: float = np.pi) -> Array:
    axis = random.normal(size=3)
    return exp3(axis / np.linalg.norm(axis) * largest * random.random())


def random_pose(random: Random, size: float = 0.5, angle: float = np.pi) -> Pose:
    return Pose(random_rotation(random, angle), size * random.normal(size=3))


def make_spring(
    stiffness: Array,
    frame: str = "hand",
    limb: str = "arm",
    name: str = "spring",
    reference: Pose | None = None,
    start: Pose | None = None,
    damping: Array | None = None,
    damping_ratio: float | None = None,
    axes: dict[str, HybridAxis] | None = None,
) -> Spring:
    spec = SpringSpec(name, frame, "world", stiffness, damping, damping_ratio, axes or {})
    return Spring(spec, limb, reference or Pose.identity(), start or Pose.identity())


def split_spring(spring: Spring, share: float) -> tuple[Spring, Spring]:
    """Two springs that should do together what the one does."""

    def part(name: str, factor: float) -> Spring:
        return replace(spring, spec=replace(spring.spec, name=name, stiffness=factor * spring.stiffness))

    return part("first", share), part("second", 1.0 - share)


def hand_of(model: RobotModel, limb: Limb, q: Array) -> tuple[Pose, Array, Array]:
    """Pose of a limb's hand, its (6, k) Jacobian and the limb's (k, k) inverse inertia."""
    kinematics = Kinematics(model, (limb.hand,))
    kinematics.update(q, np.zeros(model.n))
    block = kinematics.inverse_inertia[np.ix_(limb.joints, limb.joints)]
    return kinematics.pose(limb.hand), kinematics.jacobian_of(limb.hand)[:, limb.joints].copy(), block


def displaced(pose: Pose, step: Array) -> Pose:
    """The pose after a small world-axes displacement and rotation, step (6,)."""
    return Pose(exp3(step[3:]) @ pose.rotation, pose.translation + step[:3])


def relative(actual: Array, expected: Array) -> float:
    """Largest difference, relative to the largest entry."""
    return float(np.max(np.abs(actual - expected)) / np.max(np.abs(expected)))


def derivative(function: Callable[[Array], Array], size: int = 6, step: float = 1e-5) -> Array:
    """Fourth-order central differences of a function at 0, one column per unit motion (..., size)."""

    def slope(h: Array) -> Array:
        near, far = function(h) - function(-h), function(2.0 * h) - function(-2.0 * h)
        return (8.0 * near - far) / (12.0 * step)

    return np.array([slope(h) for h in step * np.eye(size)]).T


def measured_compliance(pose_under: Callable[[Array], Pose], push: float = 1e-3) -> Array:
    """Displacement and rotation of a frame per unit wrench (6, 6), by small pushes both ways, world axes."""
    pushes = push * np.eye(6)
    return np.array([displacement_of(pose_under(w), pose_under(-w)) for w in pushes]).T / (2.0 * push)
