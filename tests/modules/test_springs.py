# SPDX-License-Identifier: BSD-3-Clause
"""Springs are exact gradients of their energy, for random stiffness, axes, frames and deflections."""

import numpy as np
import pytest

from impedance_modules.modules.spring import Spring, add_energy, displacement_of
from impedance_modules.robot.pose import Pose
from impedance_modules.robot.rotation import exp3
from impedance_modules.spec.task import HybridAxis
from impedance_modules.superposition.net_stiffness import (
    spring_stiffness,
    spring_stiffness_without_preload,
)
from tests.support.arm_samples import (
    TYPICAL_STIFFNESS,
    derivative,
    displaced,
    make_spring,
    random_pose,
    random_psd,
    split_spring,
)


def energy_of(spring: Spring, pose: Pose, target: Pose) -> float:
    """The law's energy of one spring [J]."""
    return float(add_energy(spring.world_stiffness, displacement_of(pose, target), 0.0))


@pytest.mark.parametrize("seed", range(200))
def test_wrench_is_minus_the_gradient_of_the_energy(seed: int) -> None:
    random = np.random.default_rng(seed)
    spring = make_spring(random_psd(random, TYPICAL_STIFFNESS), reference=random_pose(random))
    pose, target = random_pose(random, angle=1.5), random_pose(random, angle=1.5)
    slope = derivative(lambda step: energy_of(spring, displaced(pose, step), target), step=1e-3)
    wrench = spring.wrench(pose, target)
    np.testing.assert_allclose(wrench, -slope, atol=1e-8 * max(1.0, np.abs(wrench).max()))


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-5, 1e-4, 0.1, 0.29, 0.31, 1.0, 3.0, 3.1415])
def test_stiffness_is_minus_the_derivative_of_the_wrench(angle: float) -> None:
    random = np.random.default_rng(7)
    for _ in range(20):
        spring = make_spring(random_psd(random, TYPICAL_STIFFNESS), reference=random_pose(random))
        target = random_pose(random)
        axis = random.normal(size=3)
        turned = exp3(angle * axis / np.linalg.norm(axis)) @ target.rotation
        pose = Pose(turned, target.translation + 0.3 * random.normal(size=3))
        step = 2e-4 if angle < 3.0 else 1e-6
        slope = -derivative(lambda h, at=pose, to=target, k=spring: k.wrench(displaced(at, h), to), step=step)
        K = spring_stiffness(spring, pose, target)
        np.testing.assert_allclose(K, slope, atol=(1e-8 if angle < 3.0 else 1e-5) * np.abs(K).max())


def test_relaxed_spring_shows_its_declared_stiffness() -> None:
    random = np.random.default_rng(3)
    spring = make_spring(random_psd(random, TYPICAL_STIFFNESS), reference=random_pose(random))
    pose = random_pose(random)
    declared = spring.in_world(spring.stiffness)
    for law in (spring_stiffness, spring_stiffness_without_preload):
        np.testing.assert_allclose(law(spring, pose, pose), declared, rtol=1e-12, atol=1e-10)


def test_wrench_is_continuous_up_to_the_cut() -> None:
    """A turn of almost half a revolution gives nearly the wrench of half a revolution, and no blow-up."""
    random = np.random.default_rng(5)
    for _ in range(50):
        spring = make_spring(random_psd(random, TYPICAL_STIFFNESS))
        axis = random.normal(size=3)
        axis /= np.linalg.norm(axis)
        gap, previous = 1e-2, spring.wrench(Pose(exp3((np.pi - 1e-2) * axis), np.zeros(3)), Pose.identity())
        for short in (1e-3, 1e-4, 1e-6, 1e-9):
            wrench = spring.wrench(Pose(exp3((np.pi - short) * axis), np.zeros(3)), Pose.identity())
            assert np.linalg.norm(wrench - previous) < 5e3 * gap
            gap, previous = short, wrench


def test_splitting_a_spring_changes_neither_energy_nor_wrench_nor_stiffness() -> None:
    random = np.random.default_rng(11)
    for _ in range(50):
        spring = make_spring(random_psd(random, TYPICAL_STIFFNESS), reference=random_pose(random))
        pose, target = random_pose(random, angle=1.5), random_pose(random, angle=1.5)
        first, second = split_spring(spring, random.random())
        whole, both = spring.wrench(pose, target), first.wrench(pose, target) + second.wrench(pose, target)
        np.testing.assert_allclose(both, whole, rtol=1e-12, atol=1e-11)
        energy = energy_of(first, pose, target) + energy_of(second, pose, target)
        assert energy == pytest.approx(energy_of(spring, pose, target), rel=1e-12)
        K = spring_stiffness(first, pose, target) + spring_stiffness(second, pose, target)
        np.testing.assert_allclose(K, spring_stiffness(spring, pose, target), rtol=1e-11, atol=1e-9)


def test_hybrid_axis_pushes_along_its_own_axis_and_limits_the_speed() -> None:
    random = np.random.default_rng(2)
    reference = random_pose(random)
    axes = {"z": HybridAxis(force=-12.0, speed_limit=0.1), "rx": HybridAxis(force=0.5, speed_limit=None)}
    spring = make_spring(np.zeros((6, 6)), reference=reference, axes=axes)
    wrench = spring.axis_force()
    np.testing.assert_allclose(wrench[:3], -12.0 * reference.rotation[:, 2], atol=1e-12)
    np.testing.assert_allclose(wrench[3:], 0.5 * reference.rotation[:, 0], atol=1e-12)
    np.testing.assert_allclose(np.diag(spring.damping), [0, 0, 120.0, 0, 0, 0])


def test_a_spring_pulls_along_its_own_axes() -> None:
    random = np.random.default_rng(8)
    reference = random_pose(random)
    spring = make_spring(np.diag([300.0, 0.0, 0.0, 0.0, 0.0, 0.0]), reference=reference)
    x, y = reference.rotation[:, 0], reference.rotation[:, 1]
    for offset, force in ((0.1 * x, -30.0 * x), (0.1 * y, 0.0 * y)):
        wrench = spring.wrench(Pose(np.eye(3), offset), Pose.identity())
        np.testing.assert_allclose(wrench, [*force, 0.0, 0.0, 0.0], atol=1e-12)
