# SPDX-License-Identifier: BSD-3-Clause
"""Damping from the inertia: positive, textbook in one dimension, the declared ratio in every mode."""

from dataclasses import replace

import numpy as np
import pytest

from impedance_modules.modules.arms import TaskModules
from impedance_modules.modules.damping import endpoint_damping, joint_damping, phase_damping
from impedance_modules.modules.mobility import mobility
from impedance_modules.robot.kinematics import Kinematics
from impedance_modules.robot.model import RobotModel
from impedance_modules.robot.pose import carry
from impedance_modules.spec.task import HybridAxis
from impedance_modules.superposition.modes import JointSpace, natural_modes
from tests.support.arm_samples import (
    ROBOTS,
    TYPICAL_STIFFNESS,
    Array,
    baxter,
    make_spring,
    random_position,
    random_psd,
    relative,
    split_spring,
)
from tests.support.module_samples import arm_module, hold


def random_inertia(random: np.random.Generator, k: int) -> Array:
    half = random.normal(size=(k, k))
    return half @ half.T / k + 0.1 * np.eye(k)


def ratios(inertia: Array, stiffness: Array, damping: Array) -> list[float | None]:
    return [mode.damping_ratio for mode in natural_modes(JointSpace(inertia, stiffness, damping))]


def test_one_dimension_is_two_zeta_root_k_m() -> None:
    for mass, stiffness, ratio in [(2.0, 300.0, 0.7), (0.1, 5.0, 1.0), (10.0, 1e4, 0.05)]:
        expected = 2.0 * ratio * np.sqrt(stiffness * mass)
        found = joint_damping(np.array([stiffness]), np.array([[mass]]), ratio)
        assert found[0, 0] == pytest.approx(expected, rel=1e-12)
        unit = np.zeros((6, 6))
        unit[0, 0] = 1.0
        (endpoint,) = endpoint_damping([stiffness * unit], [ratio], unit / mass)
        assert endpoint[0, 0] == pytest.approx(expected, rel=1e-12)
        assert np.count_nonzero(endpoint) == 1


@pytest.mark.parametrize("seed", range(20))
def test_every_mode_has_the_declared_ratio(seed: int) -> None:
    random = np.random.default_rng(seed)
    ratio = 0.1 + 0.85 * random.random()
    inertia, springs = random_inertia(random, 7), 1.0 + 50.0 * random.random(7)
    damping = joint_damping(springs, inertia, ratio)
    np.testing.assert_allclose(ratios(inertia, np.diag(springs), damping), ratio, rtol=1e-7)

    inertia = random_inertia(random, 6)
    springs = [random_psd(random, TYPICAL_STIFFNESS) for _ in range(3)]
    damping = sum(endpoint_damping(springs, [ratio] * 3, np.linalg.inv(inertia)))
    np.testing.assert_allclose(ratios(inertia, sum(springs), damping), ratio, rtol=1e-6)


@pytest.mark.parametrize("seed", range(20))
def test_damping_is_positive_and_agrees_with_the_textbook_form(seed: int) -> None:
    """Each spring's part is positive semidefinite; together M Phi diag(2 zeta omega) Phi^T M."""
    from scipy.linalg import eigh

    random = np.random.default_rng(seed)
    inertia = random_inertia(random, 6)
    springs = [random_psd(random, TYPICAL_STIFFNESS, rank) for rank in (2, 3, 6)]
    zetas = [0.3, 0.0, 1.2]
    parts = endpoint_damping(springs, zetas, np.linalg.inv(inertia))
    for part in parts:
        assert np.linalg.eigvalsh(part)[0] >= -1e-9 * np.linalg.norm(part)
    assert np.all(parts[1] == 0.0)
    squared, shapes = eigh(sum(springs), inertia)
    shares = [np.sum(shapes * (K @ shapes), axis=0) / squared for K in springs]
    weights = sum(2.0 * zeta * share for zeta, share in zip(zetas, shares, strict=True)) * np.sqrt(squared)
    textbook = inertia @ (shapes * weights) @ shapes.T @ inertia
    assert relative(sum(parts), textbook) < 1e-8


@pytest.mark.parametrize("seed", range(20))
def test_splitting_a_spring_changes_no_damping(seed: int) -> None:
    random = np.random.default_rng(seed)
    Y = np.linalg.inv(random_inertia(random, 6))
    whole, other = random_psd(random, TYPICAL_STIFFNESS), random_psd(random, TYPICAL_STIFFNESS, 3)
    share = random.random()
    before = endpoint_damping([whole, other], [0.7, 0.2], Y)
    after = endpoint_damping([share * whole, (1 - share) * whole, other], [0.7, 0.7, 0.2], Y)
    assert relative(after[0] + after[1], before[0]) < 1e-9
    assert relative(after[2], before[1]) < 1e-9


def test_free_and_immobile_directions_get_no_damping() -> None:
    random = np.random.default_rng(1)
    Y = np.linalg.inv(random_inertia(random, 6))
    position_only = np.diag([300.0, 300, 50, 0, 0, 0])
    (found,) = endpoint_damping([position_only], [0.7], Y)
    np.testing.assert_array_equal(found[3:], 0.0)
    (found,) = endpoint_damping([np.zeros((6, 6))], [0.7], Y)
    np.testing.assert_array_equal(found, 0.0)
    # A mechanism that cannot move along x: stiffness there is damped only through what it couples to.
    stuck = np.diag([0.0, 1, 1, 1, 1, 1])
    (found,) = endpoint_damping([np.diag(TYPICAL_STIFFNESS)], [0.7], stuck)
    np.testing.assert_allclose(np.diag(found)[1:], 1.4 * np.sqrt(TYPICAL_STIFFNESS[1:]), rtol=1e-12)
    assert found[0, 0] == 0.0


def arms_of(model: RobotModel, random: np.random.Generator, ratio: float | None) -> TaskModules:
    q = random_position(random, model)

    def arm(limb):
        stiffness, start = random_psd(random, TYPICAL_STIFFNESS), model.pose(q, limb.hand)
        spring = make_spring(stiffness, limb.hand, limb.name, start=start, damping_ratio=ratio)
        return arm_module(limb, [spring], q, 20.0 * random.random(len(limb.joints)), 0.1, ratio)

    return TaskModules(tuple(arm(limb) for limb in model.limbs.values()), None, q)


def at_posture(model: RobotModel, modules: TaskModules) -> Kinematics:
    kinematics = Kinematics(model, modules.frames)
    kinematics.update(modules.posture, np.zeros(model.n))
    return kinematics


@ROBOTS
@pytest.mark.parametrize("seed", range(5))
def test_a_limbs_modes_have_the_ratio_of_its_springs(robot, seed: int) -> None:
    random = np.random.default_rng(seed)
    model = robot()
    modules = arms_of(model, random, 0.6)
    kinematics = at_posture(model, modules)
    found = phase_damping(modules, kinematics)
    for arm in modules.arms:
        joints, spring = arm.limb.joints, arm.springs[0]
        block = kinematics.inverse_inertia[np.ix_(joints, joints)]
        J = kinematics.jacobian_of(arm.limb.hand)[:, joints]
        inertia = np.linalg.inv(mobility(J, block))
        values = ratios(inertia, spring.in_world(spring.stiffness), found.spring_modal[spring.name])
        np.testing.assert_allclose(values, 0.6, rtol=1e-5)
        modal = found.joint_modal[arm.limb.name]
        values = ratios(np.linalg.inv(block), np.diag(arm.bias.stiffness), modal)
        np.testing.assert_allclose(values, 0.6, rtol=1e-5)
        declared = found.of_joints(arm.limb.name) - modal
        np.testing.assert_allclose(declared, 0.1 * np.eye(len(joints)), atol=1e-12)


def test_a_bias_without_a_ratio_damps_no_mode_and_an_arm_without_a_bias_has_none() -> None:
    model = baxter()
    modules = arms_of(model, np.random.default_rng(2), 0.6)
    first, second = modules.arms
    bare = replace(first, bias=replace(first.bias, damping_ratio=None)), replace(second, bias=None)
    found = phase_damping(replace(modules, arms=bare), at_posture(model, modules))
    assert list(found.joint_modal) == [first.limb.name]
    assert found.joint_modal[first.limb.name].shape == (first.limb.joints.size,) * 2
    assert not found.joint_modal[first.limb.name].any()


@ROBOTS
@pytest.mark.parametrize("seed", range(5))
def test_a_held_object_has_the_ratio_of_its_hands_springs(robot, seed: int) -> None:
    """The object's sums are damped; carried back to the hands, each damper stays positive."""
    random = np.random.default_rng(seed)
    model = robot()
    modules = hold(arms_of(model, random, 0.8), model)
    kinematics = at_posture(model, modules)
    found = phase_damping(modules, kinematics)
    origin = modules.held.start.translation
    inertia, stiffness, damping = modules.held.inertia(np.eye(3)), np.zeros((6, 6)), np.zeros((6, 6))
    for arm in modules.arms:
        joints, spring = arm.limb.joints, arm.springs[0]
        X = carry(kinematics.pose(arm.limb.hand).translation - origin)
        J = kinematics.jacobian_of(arm.limb.hand)[:, joints]
        block = kinematics.inverse_inertia[np.ix_(joints, joints)]
        inertia = inertia + X.T @ np.linalg.inv(mobility(J, block)) @ X
        stiffness += X.T @ spring.in_world(spring.stiffness) @ X
        own = found.of_spring(spring)
        assert np.linalg.eigvalsh(0.5 * (own + own.T))[0] > -1e-8 * np.linalg.norm(own)
        damping += X.T @ own @ X
    np.testing.assert_allclose(ratios(inertia, stiffness, damping), 0.8, rtol=1e-5)


def test_splitting_a_spring_of_a_task_changes_neither_its_damping_nor_its_hands() -> None:
    random = np.random.default_rng(4)
    model = baxter()
    for build in (lambda modules: modules, lambda modules: hold(modules, model)):
        whole = build(arms_of(model, random, 0.5))
        arm = whole.arms[0]
        parts = split_spring(arm.springs[0], 0.3)
        halved = build(replace(whole, arms=(replace(arm, springs=parts), *whole.arms[1:])))
        kinematics = at_posture(model, whole)
        before, after = phase_damping(whole, kinematics), phase_damping(halved, kinematics)
        summed = after.of_spring(parts[0]) + after.of_spring(parts[1])
        assert relative(summed, before.of_spring(arm.springs[0])) < 1e-8


def test_explicit_damping_simply_adds() -> None:
    random = np.random.default_rng(5)
    model = baxter()
    modules = arms_of(model, random, 0.5)
    arm = modules.arms[0]
    declared = random_psd(random, np.full(6, 20.0))
    spec = replace(arm.springs[0].spec, damping=declared, axes={"z": HybridAxis(-12.0, 0.1)})
    spring = replace(arm.springs[0], spec=spec)
    loaded = replace(modules, arms=(replace(arm, springs=(spring,)), *modules.arms[1:]))
    kinematics = at_posture(model, modules)
    with_it, without = (phase_damping(task, kinematics).of_spring(spring) for task in (loaded, modules))
    np.testing.assert_allclose(with_it - without, declared + np.diag([0, 0, 120.0, 0, 0, 0]), atol=1e-9)
