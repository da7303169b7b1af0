# SPDX-License-Identifier: BSD-3-Clause
"""Whole modules under load: what the analysis prints equals what the summed torque does when pushed."""

from dataclasses import replace

import numpy as np
import pytest

from impedance_modules.modules.arms import TaskModules
from impedance_modules.modules.damping import Damping, phase_damping
from impedance_modules.modules.equilibrium import Equilibrium
from impedance_modules.modules.spring import displacement_of
from impedance_modules.modules.sum import sum_modules
from impedance_modules.robot.kinematics import Kinematics
from impedance_modules.robot.model import RobotModel
from impedance_modules.robot.pose import Pose, carry
from impedance_modules.robot.rotation import exp3
from impedance_modules.spec.task import HybridAxis
from impedance_modules.superposition.arm_impedance import ArmImpedance, arm_impedance
from impedance_modules.superposition.modes import hold_together
from impedance_modules.superposition.object_impedance import HeldImpedance, held_impedance, squeeze_force
from impedance_modules.superposition.object_sum import carried_preload, sum_at_object
from tests.support.arm_samples import (
    ROBOTS,
    TYPICAL_STIFFNESS,
    Array,
    make_spring,
    measured_compliance,
    random_pose,
    random_position,
    random_psd,
    relative,
)
from tests.support.module_samples import arm_module, hold, modules_in_force


class LoadedTask:
    """Arms with springs on hand and forearm, hybrid force and bias, their targets moved away: loaded."""

    def __init__(self, model: RobotModel, random: np.random.Generator) -> None:
        self.model = model
        q = random_position(random, model)

        def arm(limb):
            inner, springs = self._inner_frame(limb.name, limb.hand), []
            for name, frame, share in (("hand", limb.hand, 1.0), ("inner", inner, 0.2)):
                typical = share * TYPICAL_STIFFNESS
                stiffness, reference = (
                    random_psd(random, typical) + 0.3 * np.diag(typical),
                    random_pose(random),
                )
                more = {
                    "damping": 0.02 * np.diag(typical),
                    "damping_ratio": 0.7,
                    "axes": {"z": HybridAxis(4.0, None)},
                }
                springs.append(
                    make_spring(stiffness, frame, limb.name, name, reference, model.pose(q, frame), **more)
                )
            return arm_module(limb, springs, q, 30.0 + 20.0 * random.random(len(limb.joints)), 1.0, 0.7)

        arms = [arm(limb) for limb in model.limbs.values()]
        self.modules = TaskModules(tuple(arms), None, q)
        self.kinematics = Kinematics(model, self.modules.frames)
        self.targets = Equilibrium(
            {s.name: s.start @ random_pose(random, 0.01, 0.1) for arm in arms for s in arm.springs},
            None,
            {arm.limb.name: arm.bias.rest for arm in arms},
        )
        self.place(q)
        self.damping: Damping = phase_damping(self.modules, self.kinematics)

    def _inner_frame(self, limb: str, hand: str) -> str:
        """A frame two joints before the hand."""
        frames = [f for f in self.model.frames if f.split("_")[0] == hand.split("_", maxsplit=1)[0]]
        joints = self.model.limbs[limb].joints
        self.kinematics = Kinematics(self.model, frames)
        self.place(np.zeros(self.model.n))
        jacobians = [self.kinematics.jacobian_of(frame)[:, joints] for frame in frames]
        moved = [int(np.count_nonzero(np.any(J, axis=0))) for J in jacobians]
        return frames[moved.index(len(joints) - 2)]

    def place(self, q: Array) -> None:
        self.kinematics.update(q, np.zeros(self.model.n))

    def effort(self, q: Array, v: Array | None = None) -> Array:
        self.place(q)
        found = modules_in_force(self.modules, self.targets, self.damping, self.model.n)
        sum_modules(found, self.kinematics.arms, q, np.zeros(self.model.n) if v is None else v, 1.0)
        return found.desired

    def arms(self, q: Array) -> dict[str, ArmImpedance]:
        self.place(q)
        return {
            arm.limb.name: arm_impedance(arm, self.kinematics, self.targets, q, self.damping)
            for arm in self.modules.arms
        }

    def settle(self, q: Array, pushes: dict[str, Array]) -> Array:
        """Finds rest under constant wrenches on the hands, by the analysis's own joint-space stiffness."""
        for _ in range(80):
            balance = self.effort(q)
            for limb, push in pushes.items():
                balance = balance + self.kinematics.jacobian_of(self.model.limbs[limb].hand).T @ push
            if np.max(np.abs(balance)) < 1e-11:
                break
            for name, arm in self.arms(q).items():
                joints = self.model.limbs[name].joints
                q = q.copy()
                q[joints] += np.linalg.solve(arm.system.stiffness, balance[joints])
        return q


@ROBOTS
@pytest.mark.parametrize("seed", range(6))
def test_a_loaded_arm_moves_as_its_printed_compliance_says(robot, seed: int) -> None:
    random = np.random.default_rng(seed)
    task = LoadedTask(robot(), random)
    sizes = np.array([5.0] * 3 + [0.3] * 3)
    load = {limb: sizes * random.normal(size=6) for limb in task.model.limbs}
    q = task.settle(task.modules.posture, load)
    found = task.arms(q)
    for limb, arm in found.items():
        assert not arm.stiffness.folds
        assert np.max(np.abs(arm.preload)) > 1.0
        np.testing.assert_allclose(arm.preload, arm.wrench + load[limb], atol=1e-7)

        def pushed(wrench: Array, limb=limb) -> Pose:
            task.place(task.settle(q, {**load, limb: load[limb] + wrench}))
            return task.kinematics.pose(task.model.limbs[limb].hand)

        compliance = measured_compliance(pushed)
        assert relative(arm.stiffness.compliance, compliance) < 1e-5
        assert relative(arm.stiffness.stiffness, np.linalg.inv(compliance)) < 1e-4
        assert relative(arm.stiffness_without_preload.stiffness, arm.stiffness.stiffness) > 1e-4


@ROBOTS
def test_scaled_and_fixed_gains_make_up_the_arm(robot) -> None:
    random = np.random.default_rng(0)
    task = LoadedTask(robot(), random)
    for arm in task.arms(task.modules.posture).values():
        for part in ("stiffness", "damping"):
            fixed, scaled, whole = (getattr(gains, part) for gains in (arm.fixed, arm.scaled, arm.system))
            np.testing.assert_allclose(fixed + scaled, whole, atol=1e-10)
        assert np.linalg.eigvalsh(arm.system.damping)[0] > 0.0
        difference = arm.inertia.inertia - arm.inertia_without_reflected.inertia
        assert np.linalg.eigvalsh(0.5 * (difference + difference.T))[0] > 0.0


@ROBOTS
def test_joint_space_damping_is_minus_the_derivative_of_the_torque_by_velocity(robot) -> None:
    task = LoadedTask(robot(), np.random.default_rng(1))
    q = task.modules.posture
    for limb, arm in task.arms(q).items():
        joints = task.model.limbs[limb].joints
        still, units = task.effort(q), np.eye(task.model.n)
        columns = [still - task.effort(q, units[joint]) for joint in joints]
        assert relative(arm.system.damping, np.array(columns).T[joints]) < 1e-9


class HeldTask(LoadedTask):
    """The same arms with a box welded between the hands; rest of the closed chain by Newton steps."""

    def __init__(self, model: RobotModel, random: np.random.Generator) -> None:
        super().__init__(model, random)
        beside = 0.05 * random.normal(size=3)
        self.modules = hold(self.modules, model, squeeze=12.0, carry_weight=True, beside=beside)
        self.place(self.modules.posture)
        self.damping = phase_damping(self.modules, self.kinematics)

    def held(self, q: Array) -> HeldImpedance:
        return held_impedance(self.modules.held, self.arms(q))

    def settle_held(self, q: Array, push: Array) -> tuple[Array, Pose]:
        """Finds rest of arms and object under a wrench on the object, grasps kept to rounding."""
        held = self.modules.held
        for _ in range(200):
            effort = self.effort(q)
            poses = [self.kinematics.pose(hand) for hand in held.hands]
            where = [pose @ grasp.inverse() for pose, grasp in zip(poses, held.grasps, strict=True)]
            gap = displacement_of(*where)
            origin = 0.5 * (where[0].translation + where[1].translation)
            joints = [self.model.limbs[limb].joints for limb in held.limbs]
            pairs = zip(held.hands, joints, strict=True)
            jacobians = [self.kinematics.jacobian_of(hand)[:, j] for hand, j in pairs]
            offsets = [pose.translation - origin for pose in poses]
            chain = hold_together(jacobians, offsets)
            pull = chain.motion.T @ np.concatenate([effort[j] for j in joints]) + chain.twist.T @ push
            if np.max(np.abs(gap)) < 1e-13 and np.max(np.abs(pull)) < 1e-10:
                break
            closing = np.hstack([carry(-offsets[0]) @ jacobians[0], -carry(-offsets[1]) @ jacobians[1]])
            step = chain.motion @ np.linalg.solve(self.held(q).system.stiffness, pull)
            step = step - np.linalg.pinv(closing) @ gap
            q = q.copy()
            for j, part in zip(joints, np.split(step, [len(joints[0])]), strict=True):
                q[j] += part
        return q, where[0]


@ROBOTS
@pytest.mark.parametrize("seed", range(4))
def test_a_held_loaded_object_moves_as_the_sum_says(robot, seed: int) -> None:
    """Both arms loaded and squeezing; the closed chain is only solved here, never in the sum."""
    random = np.random.default_rng(20 + seed)
    task = HeldTask(robot(), random)
    load = np.append(4.0 * random.normal(size=3), 0.2 * random.normal(size=3))
    q, _ = task.settle_held(task.modules.posture, load)
    found = task.held(q)
    assert not found.folds and not found.joints_singular
    np.testing.assert_allclose(found.impedance.wrench, -load, atol=1e-6)
    compliance = measured_compliance(lambda push: task.settle_held(q, load + push)[1])
    assert relative(np.linalg.inv(found.impedance.stiffness), compliance) < 1e-5
    slow = found.motion.twist @ np.linalg.solve(found.system.stiffness, found.motion.twist.T)
    assert relative(slow, compliance) < 1e-5
    held = task.modules.held
    loose = held_impedance(replace(held, spec=replace(held.spec, squeeze=0.0)), task.arms(q))
    pressed, unpressed = (squeeze_force(one.hands, one.impedance.internal) for one in (found, loose))
    # The hands press along the line between them, which passes near the object's origin.
    assert 0.8 * held.spec.squeeze < pressed - unpressed <= held.spec.squeeze + 1e-9
    pairs = zip(found.hands, found.impedance.internal, strict=True)
    summed = sum(carry(hand.offset).T @ wrench for hand, wrench in pairs)
    np.testing.assert_allclose(summed, 0.0, atol=1e-8)


@ROBOTS
@pytest.mark.parametrize("seed", range(6))
def test_what_is_listed_at_the_object_adds_up_under_load(robot, seed: int) -> None:
    """Random postures, springs and loads, at rest or not: every matrix is the sum of its parts, the load's too."""
    random = np.random.default_rng(40 + seed)
    task = HeldTask(robot(), random)
    arms = task.arms(task.modules.posture)
    found, limbs = held_impedance(task.modules.held, arms), task.modules.held.limbs
    own = task.modules.held.inertia(found.pose.rotation)
    listed = sum_at_object(limbs, arms, found, own, plane="xz", stiffness=found.impedance.stiffness)
    totals = {
        "inertia": found.impedance.inertia.inertia,
        "inertia_without_reflected": found.impedance_without_reflected.inertia.inertia,
        "damping": found.impedance.damping,
        "stiffness": found.impedance.stiffness,
    }
    assert set(listed.summands) == set(totals)
    for name, parts in listed.summands.items():
        assert relative(sum((*parts.arms.values(), *parts.more.values())), totals[name]) < 1e-9
    load = listed.summands["stiffness"].more["load"]
    assert np.max(np.abs(load)) > 1e-7 * np.max(np.abs(totals["stiffness"]))

    def moment(turn: Array) -> Array:
        """Of the hands' forces about the object's origin, which keep their directions while it turns."""
        arms = [exp3(turn) @ hand.offset for hand in found.hands]
        return sum(np.cross(r, hand.wrench[:3]) for r, hand in zip(arms, found.hands, strict=True))

    steps = 1e-6 * np.eye(3)
    measured = np.array([(moment(-step) - moment(step)) / 2e-6 for step in steps]).T
    np.testing.assert_allclose(load[3:, 3:], measured, atol=1e-6)
    np.testing.assert_array_equal(load[:3], 0.0)
    origin, held_by = found.pose.translation, [arms[limb] for limb in limbs]
    levers = [np.cross(arm.pose.translation - origin, arm.preload[:3]) for arm in held_by]
    expected = sum(arm.preload for arm in held_by) + np.append(np.zeros(3), sum(levers))
    np.testing.assert_allclose(carried_preload(held_by, origin), expected, rtol=1e-9, atol=1e-9)
    hidden = sum_at_object(limbs, arms, found, own, plane=None, stiffness=None)
    assert set(hidden.summands["stiffness"].arms.values()) == {None} and not hidden.coupling
