# SPDX-License-Identifier: BSD-3-Clause
"""Net stiffness equals what finite static displacements of the loaded arm show, and says when it folds."""

import numpy as np
import pytest

from impedance_modules.modules.spring import Spring
from impedance_modules.robot.kinematics import Kinematics
from impedance_modules.robot.model import Limb, RobotModel
from impedance_modules.robot.pose import Pose
from impedance_modules.superposition.net_stiffness import (
    as_joint_stiffness,
    carried_wrench,
    gamma,
    net_stiffness,
    spring_stiffness,
    through_arm,
)
from tests.support.arm_samples import (
    ROBOTS,
    TYPICAL_STIFFNESS,
    Array,
    baxter,
    derivative,
    hand_of,
    make_spring,
    measured_compliance,
    random_pose,
    random_position,
    random_psd,
    relative,
    six_joint_pair,
)


class LoadedArm:
    """Joint springs, a hand spring and a constant wrench on one arm; solves its statics by Newton steps."""

    def __init__(self, model: RobotModel, limb: Limb, joint_stiffness: Array, rest: Array) -> None:
        self.model, self.limb = model, limb
        self.joint_stiffness, self.rest = joint_stiffness, rest
        self.kinematics = Kinematics(model, (limb.hand,))

    def hand(self, q_limb: Array) -> tuple[Pose, Array]:
        q = np.zeros(self.model.n)
        q[self.limb.joints] = q_limb
        self.kinematics.update(q, np.zeros(self.model.n))
        return self.kinematics.pose(self.limb.hand), self.kinematics.jacobian[0][:, self.limb.joints].copy()

    def settle(self, q: Array, spring: Spring, target: Pose, wrench: Array) -> Array:
        """Solves K_j (q - q_0) = J^T (w_spring + wrench) near q, to rounding."""
        for _ in range(60):
            pose, J = self.hand(q)
            total = spring.wrench(pose, target) + wrench
            balance = self.joint_stiffness * (q - self.rest) - J.T @ total
            if np.max(np.abs(balance)) < 1e-12:
                break
            end = spring_stiffness(spring, pose, target)
            q = q - np.linalg.solve(np.diag(self.joint_stiffness) - gamma(J, total) + J.T @ end @ J, balance)
        return q


@ROBOTS
@pytest.mark.parametrize("seed", range(20))
def test_gamma_is_the_derivative_of_the_joint_torques(robot, seed: int) -> None:
    random = np.random.default_rng(seed)
    model = robot()
    limb = list(model.limbs.values())[seed % 2]
    q = random_position(random, model)
    wrench = np.array([30.0] * 3 + [5.0] * 3) * random.normal(size=6)
    motion = np.eye(model.n)[limb.joints]
    found = gamma(hand_of(model, limb, q)[1], wrench)
    expected = derivative(lambda h: hand_of(model, limb, q + h @ motion)[1].T @ wrench, len(motion))
    np.testing.assert_allclose(found, expected, atol=1e-8)
    force_only = gamma(hand_of(model, limb, q)[1], np.append(wrench[:3], np.zeros(3)))
    np.testing.assert_allclose(force_only, force_only.T, atol=1e-12)


@ROBOTS
@pytest.mark.parametrize("seed", range(12))
def test_net_stiffness_equals_finite_static_displacements(robot, seed: int) -> None:
    """With a preload that the joint springs carry: push the hand a little six ways and watch it move."""
    random = np.random.default_rng(100 + seed)
    model = robot()
    limb = list(model.limbs.values())[seed % 2]
    k = len(limb.joints)
    rest = random_position(random, model)[limb.joints]
    arm = LoadedArm(model, limb, 40.0 + 40.0 * random.random(k), rest)
    spring = make_spring(random_psd(random, TYPICAL_STIFFNESS))
    start, _ = arm.hand(rest)
    target = start @ random_pose(random, 0.02, 0.2)
    preload = np.array([8.0] * 3 + [0.5] * 3) * random.normal(size=6)
    q = arm.settle(rest, spring, target, preload)
    pose, J = arm.hand(q)
    carried = spring.wrench(pose, target) + preload
    found = net_stiffness(J, arm.joint_stiffness, spring_stiffness(spring, pose, target), carried)
    assert found.stiffness is not None and not found.folds
    assert relative(carried_wrench(J, arm.joint_stiffness * (q - rest)), carried) < 1e-8
    assert np.max(np.abs(found.gamma)) > 0.1

    moved = measured_compliance(lambda push: arm.hand(arm.settle(q, spring, target, preload + push))[0])
    assert relative(found.compliance, moved) < 1e-6
    assert relative(found.stiffness, np.linalg.inv(moved)) < 1e-5


@ROBOTS
def test_unloaded_arm_has_the_textbook_stiffness(robot) -> None:
    random = np.random.default_rng(5)
    model = robot()
    for limb in model.limbs.values():
        _, J, _ = hand_of(model, limb, random_position(random, model))
        springs, end = 5.0 + 20.0 * random.random(len(limb.joints)), random_psd(random, TYPICAL_STIFFNESS)
        found = net_stiffness(J, springs, end, np.zeros(6))
        assert relative(found.stiffness, np.linalg.inv(J @ np.diag(1 / springs) @ J.T) + end) < 1e-8
        assert relative(found.compliance, np.linalg.inv(found.stiffness)) < 1e-8
        assert not found.folds and not found.folds_held


def test_singular_joint_springs_give_a_compliance_and_no_stiffness() -> None:
    random = np.random.default_rng(6)
    model = baxter()
    limb = next(iter(model.limbs.values()))
    _, J, _ = hand_of(model, limb, random_position(random, model))
    end = random_psd(random, TYPICAL_STIFFNESS) + np.diag(0.1 * TYPICAL_STIFFNESS)
    found = net_stiffness(J, np.zeros(7), end, np.zeros(6))
    assert found.stiffness is None and not found.folds
    assert relative(found.compliance, np.linalg.inv(end)) < 1e-9
    assert relative(found.at_hand, end) < 1e-9

    one_free = np.array([20.0, 20, 20, 0, 20, 20, 20])
    found = net_stiffness(J, one_free, end, np.zeros(6))
    nearly = net_stiffness(J, one_free + 1e-9, end, np.zeros(6))
    assert found.stiffness is None
    assert relative(found.compliance, nearly.compliance) < 1e-6
    assert relative(found.at_hand, nearly.at_hand) < 1e-6

    position_only = np.diag([300.0, 300, 50, 0, 0, 0])
    found = net_stiffness(J, np.zeros(7), position_only, np.zeros(6))
    assert found.stiffness is None and found.compliance is None
    assert relative(found.at_hand, position_only) < 1e-9


def test_singular_posture_has_a_compliance_and_no_stiffness() -> None:
    random = np.random.default_rng(7)
    model = six_joint_pair()
    limb = next(iter(model.limbs.values()))
    q = random_position(random, model)
    q[limb.joints[limb.short_names.index("tilt")]] = 0.0
    _, J, _ = hand_of(model, limb, q)
    found = net_stiffness(J, np.full(6, 20.0), np.zeros((6, 6)), np.zeros(6))
    assert found.stiffness is None and found.at_hand is None
    np.testing.assert_allclose(found.compliance, J @ J.T / 20.0, atol=1e-12)


def test_a_pushed_strut_folds_and_a_pulled_one_does_not() -> None:
    """Two links in line on soft joints: Euler's column. It folds at the load where K_j - Gamma turns."""
    lengths = np.array([0.4, 0.3])
    axis, tip = np.array([0.0, 0.0, 1.0]), np.array([lengths.sum(), 0.0, 0.0])
    joints = [np.zeros(3), np.array([lengths[0], 0.0, 0.0])]
    J = np.vstack([np.array([np.cross(axis, tip - at) for at in joints]).T, np.tile(axis[:, None], 2)])
    springs = np.array([10.0, 10.0])
    push = np.array([-1.0, 0, 0, 0, 0, 0])
    # In line, a pushing force f gives Gamma = f [[l1 + l2, l2], [l2, l2]].
    shape = np.array([[lengths.sum(), lengths[1]], [lengths[1], lengths[1]]])
    np.testing.assert_allclose(gamma(J, push), shape, atol=1e-12)
    critical = 10.0 / np.linalg.eigvalsh(shape)[-1]
    nothing = np.zeros((6, 6))
    assert not net_stiffness(J, springs, nothing, 0.999 * critical * push).folds
    folded = net_stiffness(J, springs, nothing, 1.001 * critical * push)
    assert folded.folds and folded.stiffness is None and folded.compliance is None
    assert not net_stiffness(J, springs, nothing, -10.0 * critical * push).folds


def test_a_self_motion_can_fold_behind_a_stiff_hand() -> None:
    """A stiff hand spring hides nothing: the elbow of a loaded seven-joint arm still folds, held or not."""
    random = np.random.default_rng(8)
    model = baxter()
    limb = next(iter(model.limbs.values()))
    folded = 0
    for _ in range(20):
        _, J, _ = hand_of(model, limb, random_position(random, model))
        wrench = np.append(200.0 * random.normal(size=3), np.zeros(3))
        found = net_stiffness(J, np.full(7, 1.0), np.diag(1e4 * np.ones(6)), wrench)
        if found.folds_held:
            folded += 1
            assert found.folds and found.stiffness is None
    assert folded > 0


@ROBOTS
def test_a_spring_on_another_frame_counts_as_joint_stiffness(robot) -> None:
    """J^T K J - Gamma of a deflected spring on any frame is minus the derivative of its torque."""
    random = np.random.default_rng(9)
    model = robot()
    limb = next(iter(model.limbs.values()))
    frame = model.frames[model.frames.index(limb.hand) - 2]
    spring = make_spring(random_psd(random, TYPICAL_STIFFNESS))
    q = random_position(random, model)
    kinematics = Kinematics(model, (frame,))

    def effort(at: Array) -> Array:
        kinematics.update(at, np.zeros(model.n))
        return (kinematics.jacobian[0].T @ spring.wrench(kinematics.pose(frame), target))[limb.joints]

    target = model.pose(q, frame) @ random_pose(random, 0.05, 0.4)
    motion = np.eye(model.n)[limb.joints]
    slope = -derivative(lambda h: effort(q + h @ motion), len(motion))
    effort(q)
    J, pose = kinematics.jacobian[0][:, limb.joints], kinematics.pose(frame)
    found = as_joint_stiffness(J, spring_stiffness(spring, pose, target), spring.wrench(pose, target))
    assert relative(found, slope) < 1e-7


def test_through_arm_is_the_inverse_of_what_the_joints_give() -> None:
    random = np.random.default_rng(10)
    for _ in range(50):
        J = random.normal(size=(6, 7))
        A = random.normal(size=(7, 7)) + 4.0 * np.eye(7)
        assert relative(through_arm(J, A), np.linalg.inv(J @ np.linalg.inv(A) @ J.T)) < 1e-8
    np.testing.assert_array_equal(through_arm(J, np.zeros((7, 7))), np.zeros((6, 6)))
