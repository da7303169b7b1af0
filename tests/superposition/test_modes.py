# SPDX-License-Identifier: BSD-3-Clause
"""Joint-space modes, two arms on one object, and the sampled loop around elastic joints."""

import math

import numpy as np
import pytest
from scipy.linalg import block_diag, eigh, expm

from impedance_modules.modules.damping import endpoint_damping, joint_damping
from impedance_modules.modules.mobility import mobility
from impedance_modules.modules.motor_velocity import begin_at, estimate_motor_velocity, motor_velocity
from impedance_modules.superposition.elastic_joints import (
    Drives,
    SampledArm,
    Sampling,
    drives_of,
    sampled_arm,
    sampling_of,
)
from impedance_modules.superposition.modes import (
    JointSpace,
    hold_together,
    joint_space_stiffness,
    least_damped,
    natural_modes,
)
from impedance_modules.superposition.net_stiffness import gamma, net_stiffness
from impedance_modules.superposition.object_impedance import lever_arm_stiffness, superpose_inertia
from impedance_modules.superposition.operational_inertia import (
    angular_ellipsoid,
    carry_inertia,
    ellipsoid,
    linear_ellipsoid,
    operational_inertia,
)
from impedance_modules.superposition.sampled_loop import (
    Gains,
    highest_stable_stiffness,
    loop_matrix,
    sampled_modes,
    spectral_radius,
)
from tests.support.arm_samples import (
    ROBOTS,
    TYPICAL_STIFFNESS,
    Array,
    baxter,
    hand_of,
    random_position,
    random_psd,
    relative,
    six_joint_pair,
)


@ROBOTS
def test_an_arm_has_a_mode_per_joint_and_the_textbook_frequencies(robot) -> None:
    random = np.random.default_rng(0)
    model = robot()
    limb = next(iter(model.limbs.values()))
    _, J, inverse = hand_of(model, limb, random_position(random, model))
    inertia, k = np.linalg.inv(inverse), len(limb.joints)
    joint_springs, end = 5.0 + 20.0 * random.random(k), random_psd(random, TYPICAL_STIFFNESS)
    springs = joint_space_stiffness(J, joint_springs, end, np.zeros((k, k)))
    modes = natural_modes(JointSpace(inertia, springs, np.zeros((k, k))))
    assert len(modes) == k
    expected = np.sqrt(eigh(springs, inertia, eigvals_only=True))
    np.testing.assert_allclose([mode.frequency for mode in modes], expected, rtol=1e-9)
    np.testing.assert_allclose([mode.damping_ratio for mode in modes], 0.0, atol=1e-9)


def test_free_growing_and_settling_motions_are_told_apart() -> None:
    inertia, nothing = np.eye(2), np.zeros((2, 2))
    free = natural_modes(JointSpace(inertia, np.diag([0.0, 100.0]), nothing))
    assert [mode.damping_ratio is None for mode in free] == [True, True, False]
    assert least_damped(free).frequency == pytest.approx(10.0)
    folding = natural_modes(JointSpace(inertia, np.diag([-25.0, 100.0]), 0.2 * inertia))
    assert least_damped(folding).damping_ratio == pytest.approx(-1.0)
    slow = natural_modes(JointSpace(inertia, 100.0 * inertia, 50.0 * inertia))
    assert all(mode.damping_ratio == pytest.approx(1.0) for mode in slow)


@ROBOTS
@pytest.mark.parametrize("seed", range(5))
def test_arms_held_together_have_the_sums_as_their_limits(robot, seed: int) -> None:
    """Fast pushes on the object meet the summed inertia, slow ones the summed net stiffness, with preload."""
    random = np.random.default_rng(seed)
    model = robot()
    q = random_position(random, model)
    hands = [hand_of(model, limb, q) for limb in model.limbs.values()]
    origin = np.mean([hand[0].translation for hand in hands], axis=0)
    offsets = [hand[0].translation - origin for hand in hands]
    jacobians = [hand[1] for hand in hands]
    own = np.diag([1.2, 1.2, 1.2, 0.01, 0.02, 0.03])
    arms, summed, turning, inertias = [], np.zeros((6, 6)), np.zeros((6, 6)), []
    for (_, J, inverse), offset in zip(hands, offsets, strict=True):
        springs, end = 40.0 + 20.0 * random.random(J.shape[1]), random_psd(random, TYPICAL_STIFFNESS)
        carried = np.append(5.0 * random.normal(size=3), 0.3 * random.normal(size=3))
        force = 10.0 * random.normal(size=3)
        found = net_stiffness(J, springs, end, carried)
        summed += carry_inertia(found.at_hand, offset) + lever_arm_stiffness(force, offset)
        turning += lever_arm_stiffness(force, offset)
        arms.append((np.linalg.inv(inverse), joint_space_stiffness(J, springs, end, gamma(J, carried))))
        inertias.append(operational_inertia(J, inverse).carried(offset))
    held = hold_together(jacobians, offsets)
    joints = sum(J.shape[1] for J in jacobians)
    assert held.motion.shape == (joints, joints - 6)
    inertia, springs = (block_diag(*parts) for parts in zip(*arms, strict=True))
    stacked = JointSpace(inertia, springs, np.zeros((joints, joints)))
    system = held.system(stacked, own, turning)
    fast = held.twist @ np.linalg.solve(system.inertia, held.twist.T)
    assert relative(fast, superpose_inertia(inertias, own).mobility) < 1e-9
    slow = held.twist @ np.linalg.solve(system.stiffness, held.twist.T)
    assert relative(slow, np.linalg.inv(summed)) < 1e-7


def rigid_joint(inertia: float) -> tuple[Array, Drives]:
    zero = np.zeros(1)
    return np.array([[inertia]]), Drives(np.array([np.inf]), np.array([0.1]), zero, zero)


def test_one_rigid_joint_is_the_textbook_sampled_mass() -> None:
    """A mass on a sampled spring and damper: the loop's poles are the roots of its known polynomial."""
    mass, stiffness, damping, period = 2.0, 300.0, 15.0, 0.01
    inertia, drives = rigid_joint(mass)
    arm = sampled_arm(inertia, drives, Sampling(1.0 / period, 0, 10, 0.0, False), None, None)
    # Ten loops of 1 ms per period; velocity differentiated over the last of them.
    loop = 1e-3
    gains = Gains(np.array([[stiffness]]), np.array([[damping]]))
    state = np.array([0.1, 0.0, 0.1])
    matrix = loop_matrix(arm, gains)
    full = np.array([0.1, 0.0, 0.1, 0.0])
    for _ in range(50):
        force = -stiffness * state[0] - damping * (state[0] - state[2]) / loop
        q, v = state[0], state[1]
        for _ in range(10):
            before, q, v = q, q + v * loop + 0.5 * force / mass * loop**2, v + force / mass * loop
        state = np.array([q, v, before])
        full = matrix @ full
        np.testing.assert_allclose(full[:2], state[:2], rtol=1e-9, atol=1e-12)


def test_delay_and_sampling_bound_the_damping_of_a_mass() -> None:
    """A pure sampled damper on a mass, read without lag: stable exactly while D T < 2 m (no delay)."""
    inertia, drives = rigid_joint(2.0)
    arm = sampled_arm(inertia, drives, Sampling(1000.0, 0, 1, 0.0, False), None, None)
    exact = SampledArm(arm.A, arm.B, arm.position, np.eye(1, len(arm.A), 1), arm.sampling)
    zero = np.zeros((1, 1))
    assert spectral_radius(exact, Gains(zero, np.array([[0.999 * 4000.0]]))) < 1.0 + 1e-7
    assert spectral_radius(exact, Gains(zero, np.array([[1.001 * 4000.0]]))) > 1.0 + 1e-7
    late = sampled_arm(inertia, drives, Sampling(1000.0, 2, 1, 0.0, False), None, None)
    damped = Gains(np.array([[100.0]]), np.array([[1500.0]]))
    assert spectral_radius(arm, damped) < 1.0 < spectral_radius(late, damped)


def test_fast_sampling_of_stiff_joints_shows_the_continuous_modes() -> None:
    random = np.random.default_rng(2)
    model = six_joint_pair()
    limb = next(iter(model.limbs.values()))
    _, _, inverse = hand_of(model, limb, random_position(random, model))
    inertia, zero = np.linalg.inv(inverse), np.zeros(6)
    drives = Drives(np.full(6, np.inf), model.reflected_inertia[limb.joints], zero, zero)
    springs = np.diag(10.0 + 10.0 * random.random(6))
    damping = joint_damping(np.diag(springs), inertia, 0.3)
    arm = sampled_arm(inertia, drives, Sampling(20000.0, 0, 1, 0.0, False), None, None)
    slow = [mode for mode in sampled_modes(arm, Gains(springs, damping)) if mode.frequency < 1000.0]
    for found, expected in zip(slow, natural_modes(JointSpace(inertia, springs, damping)), strict=True):
        assert found.frequency == pytest.approx(expected.frequency, rel=0.01)
        assert found.damping_ratio == pytest.approx(0.3, abs=0.01)


@pytest.mark.parametrize("motor_side", [False, True])
def test_a_period_is_integrated_exactly(motor_side: bool) -> None:
    """Free joints and held ones: one period of links and rotors is the matrix exponential of their equations."""
    model = baxter()
    limb = next(iter(model.limbs.values()))
    _, J, inverse = hand_of(model, limb, random_position(np.random.default_rng(4), model))
    inertia, drives = np.linalg.inv(inverse), drives_of(model, limb.joints)
    k, period = 7, 1.0 / 1000.0
    own = np.diag([1.2, 1.2, 1.2, 0.01, 0.02, 0.03])
    arm = sampled_arm(inertia, drives, Sampling(1000.0, 0, 1, 0.01, motor_side), None, J.T @ own @ J)
    stiffness, rotors = np.diag(drives.spring_stiffness), np.diag(drives.reflected_inertia)
    mass = block_diag(inertia - rotors + J.T @ own @ J, rotors)
    between = np.array([[1.0, -1.0], [-1.0, 1.0]])
    springs, dampers = np.kron(between, stiffness), np.kron(between, np.diag(drives.spring_damping))
    dampers[k:, k:] += np.diag(drives.motor_damping)
    own_motion = [-np.linalg.solve(mass, springs), -np.linalg.solve(mass, dampers)]
    system = np.block([[np.zeros((2 * k, 2 * k)), np.eye(2 * k)], own_motion])
    assert np.all(drives.elastic)
    np.testing.assert_allclose(arm.A[: 4 * k, : 4 * k], expm(system * period), atol=1e-11)


def test_whole_delays_are_not_rounded_up_further() -> None:
    robot = baxter().spec
    delay = robot.timing.command_delay
    assert sampling_of(robot, 1000.0, True).delay_periods == math.ceil(delay * 1000.0 - 1e-9)
    assert sampling_of(robot, 3.0 / delay, True).delay_periods == 3
    assert sampling_of(robot, 1.4 / delay, True).delay_periods == 2
    assert sampling_of(robot, 100.0, True).robot_loops == 10


def baxter_loop(seed: int, ratio: float, motor_side: bool) -> tuple[SampledArm, Gains, Gains]:
    model, random = baxter(), np.random.default_rng(seed)
    limb = next(iter(model.limbs.values()))
    _, J, inverse = hand_of(model, limb, random_position(random, model))
    inertia = np.linalg.inv(inverse)
    springs = np.array([10.0, 30, 5, 5, 5, 20, 10])
    K = np.diag([300.0, 300, 300, 10, 10, 10])
    (D,) = endpoint_damping([K], [ratio], mobility(J, inverse))
    sampling = sampling_of(model.spec, 1000.0, motor_side)
    arm = sampled_arm(0.5 * (inertia + inertia.T), drives_of(model, limb.joints), sampling, None, None)
    fixed = Gains(np.diag(springs), joint_damping(springs, inertia, ratio))
    return arm, fixed, Gains(J.T @ K @ J, J.T @ D @ J)


@pytest.mark.parametrize("seed", range(4))
def test_highest_stable_stiffness_is_where_stability_ends(seed: int) -> None:
    arm, fixed, scaled = baxter_loop(seed, 0.7, motor_side=True)
    limit = highest_stable_stiffness(arm, fixed, scaled, 1e3)
    assert limit is not None and 1.0 < limit < 100.0
    for scale, stable in ((0.99 * limit, True), (1.01 * limit, False)):
        damping = fixed.damping + np.sqrt(scale) * scaled.damping
        gains = Gains(fixed.stiffness + scale * scaled.stiffness, damping)
        assert (spectral_radius(arm, gains) < 1.0) == stable
        worst = least_damped(sampled_modes(arm, gains))
        assert (worst.damping_ratio > 0.0) == stable
    assert highest_stable_stiffness(arm, fixed, scaled, 0.9 * limit) is None


@pytest.mark.parametrize("seed", range(4))
def test_damping_the_links_through_their_springs_loses_stability_where_the_motors_do_not(seed: int) -> None:
    """Thesis 3.1.1: collocated damping is passive, non-collocated is not. Same gains, other velocity."""
    links, motors = (
        highest_stable_stiffness(*baxter_loop(seed, 0.7, motor_side), 1e3) for motor_side in (False, True)
    )
    assert links < 1e-3 and motors > 1.0


def test_motor_velocity_adds_the_rate_of_the_deflection() -> None:
    motor, velocity = motor_velocity(np.array([1 / 250.0, 0.0]), 1e-3, 0.01), np.array([0.1, 0.2])
    begin_at(motor, velocity, np.array([3.0, 3.0]))
    np.testing.assert_array_equal(motor.velocity, velocity)
    for k in range(1, 200):
        estimate_motor_velocity(motor, velocity, np.array([3.0, 3.0]) + 50.0 * k * 1e-3)
    # Effort grows by 50 N.m/s: the spring is deflected at 50/250 rad/s; the rigid joint's motor is its link.
    np.testing.assert_allclose(motor.velocity, [0.1 + 0.2, 0.2], rtol=1e-6)


def test_the_loop_model_and_the_estimator_are_the_same_filter() -> None:
    """One elastic joint, stepped in the model: its velocity reading is what the run's estimate gives."""
    drives = Drives(np.array([250.0]), np.array([0.05]), np.array([0.1]), np.array([0.0]))
    inertia = np.array([[0.3]])
    arm = sampled_arm(inertia, drives, Sampling(1000.0, 0, 1, 0.01, True), None, None)
    links = sampled_arm(inertia, drives, Sampling(1000.0, 0, 1, 0.01, False), None, None)
    motor = motor_velocity(np.array([1 / 250.0]), 1e-3, 0.01)
    x, y = np.zeros(len(arm.A)), np.zeros(len(links.A))
    for k in range(100):
        torque = np.array([math.sin(0.05 * k)])
        x, y = arm.A @ x + arm.B @ torque, links.A @ y + links.B @ torque
        effort = 250.0 * (y[1:2] - y[:1])
        estimate_motor_velocity(motor, links.velocity @ y, effort)
        np.testing.assert_allclose(arm.velocity @ x, motor.velocity, atol=1e-12)


def test_ellipsoids_give_back_their_matrix() -> None:
    random = np.random.default_rng(3)
    matrix = random_psd(random, TYPICAL_STIFFNESS)
    blocks = ((linear_ellipsoid(matrix), matrix[:3, :3]), (angular_ellipsoid(matrix), matrix[3:, 3:]))
    for found, block in blocks:
        rebuilt = (found.directions * found.half_axes) @ found.directions.T
        np.testing.assert_allclose(rebuilt, block, atol=1e-9)
        assert np.linalg.det(found.directions) == pytest.approx(1.0)
    assert ellipsoid(np.diag([1.0, -2.0, 3.0])).half_axes[0] == pytest.approx(-2.0)


def test_an_ellipsoid_is_of_the_symmetric_part() -> None:
    stack = np.random.default_rng(4).normal(size=(5, 3, 3))
    found = ellipsoid(stack)
    for k, block in enumerate(stack):
        one = ellipsoid(block)
        rebuilt = (one.directions * one.half_axes) @ one.directions.T
        np.testing.assert_allclose(rebuilt, 0.5 * (block + block.T), atol=1e-12)
        np.testing.assert_allclose(found.half_axes[k], one.half_axes, atol=1e-12)
