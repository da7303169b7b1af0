# SPDX-License-Identifier: BSD-3-Clause
"""The sum of all modules: a gradient, passive dampers, an internal squeeze; the same as Python and as machine code."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from impedance_modules.compiled import use_machine_code
from impedance_modules.modules.equilibrium import phase_motion
from impedance_modules.modules.held_object import carry_weight, squeeze_forces
from impedance_modules.modules.spring import displacement, displacement_of
from impedance_modules.modules.sum import module_names, potential_energy, sum_modules
from impedance_modules.robot.kinematics import Kinematics
from impedance_modules.robot.pose import Pose
from impedance_modules.robot.rotation import exp3
from tests.support.arm_samples import ROBOTS, Array, baxter, derivative, random_rotation
from tests.support.module_samples import (
    module_sum,
    modules_in_force,
    random_damping,
    random_equilibrium,
    random_phase,
    random_task,
    springs_of,
)


def sampled(model, seed: int, *, held: bool = False, angle: float = 1.0):
    """A random task at a random state: modules, kinematics, targets, q, v, damping."""
    robot, random = model(), np.random.default_rng(seed)
    modules = random_task(random, robot, held=held)
    kinematics = Kinematics(robot, modules.frames)
    q, v = modules.posture + 0.05 * random.normal(size=robot.n), random.normal(size=robot.n)
    kinematics.update(q, v)
    targets = random_equilibrium(random, modules, robot, angle)
    return modules, kinematics, targets, q, v, random_damping(random, modules)


@ROBOTS
@pytest.mark.parametrize("held", [False, True])
@pytest.mark.parametrize("angle", [1e-6, 1.0, np.pi])
def test_python_and_machine_code_agree_to_the_last_bit(robot, held: bool, angle: float) -> None:
    found = {}
    for way in (False, True):
        use_machine_code(way)
        sums = [module_sum(*sampled(robot, seed, held=held, angle=angle), 0.7) for seed in range(4)]
        found[way] = [
            (modules.efforts.copy(), modules.springs.wrench.copy(), energy) for modules, energy in sums
        ]
    for here, there in zip(found[False], found[True], strict=True):
        for one, other in zip(here, there, strict=True):
            np.testing.assert_allclose(one, other, rtol=1e-13, atol=1e-12)


@ROBOTS
@pytest.mark.parametrize("angle", [1e-6, 1.0, 3.1])
def test_each_spring_pulls_with_the_wrench_that_matrices_give(ways, robot, angle: float) -> None:
    """J^T (s w + F - D J v) by numpy's matrices, w from pinocchio's logarithm, which shares no code with ours."""
    for seed in range(4):
        modules, kinematics, targets, q, v, damping = sampled(robot, seed, angle=angle)
        found, energy = module_sum(modules, kinematics, targets, q, v, damping, 0.6)
        stored = 0.0
        for row, spring in enumerate(springs_of(modules)):
            pose, target = kinematics.pose(spring.frame), targets.springs[spring.name]
            turned = pose.rotation @ target.rotation.T
            error = np.concatenate([pose.translation - target.translation, pin.log3(turned)])
            # Pinocchio's Jlog3 is the right one: d log(R exp(a)) / da; a world rotation d is a = R^T d.
            L = pin.Jlog3(turned) @ turned.T
            g = spring.world_stiffness @ error
            stored += 0.5 * error @ g
            J = kinematics.jacobian_of(spring.frame)
            wrench = -0.6 * np.concatenate([g[:3], L.T @ g[3:]])
            wrench += spring.axis_force() - damping.of_spring(spring) @ (J @ v)
            tolerance = 1e-6 * max(1.0, np.abs(wrench).max())
            np.testing.assert_allclose(found.springs.wrench[row], wrench, atol=tolerance)
            np.testing.assert_allclose(found.efforts[row], J.T @ wrench, atol=tolerance)
        for row, arm in enumerate(modules.arms, start=len(springs_of(modules))):
            joints, rest = arm.limb.joints, targets.rests[arm.limb.name]
            bias = np.zeros(q.size)
            bias[joints] = -0.6 * arm.bias.stiffness * (q[joints] - rest)
            bias[joints] -= damping.of_joints(arm.limb.name) @ v[joints]
            stored += 0.5 * float(arm.bias.stiffness @ (q[joints] - rest) ** 2)
            np.testing.assert_allclose(found.efforts[row], bias, rtol=1e-10, atol=1e-10)
        assert energy == pytest.approx(0.6 * stored, rel=1e-9)
        assert potential_energy(found, kinematics.arms, q) == pytest.approx(stored, rel=1e-9)
        np.testing.assert_allclose(found.desired, found.efforts.sum(axis=0), rtol=1e-12, atol=1e-12)
        assert len(module_names(modules)) == len(found.efforts)


@ROBOTS
def test_torque_is_minus_the_gradient_of_the_energy_by_the_joints(ways, robot) -> None:
    """tau = -dU/dq of everything together, springs on any frame, in any axes, with joint bias."""
    for seed in range(3):
        modules, kinematics, targets, q, _, damping = sampled(robot, seed)
        found, still = modules_in_force(modules, targets, damping, q.size), np.zeros(q.size)
        found.springs.force[:] = 0.0

        def energy(step: Array) -> float:
            kinematics.update(q + step, still)  # noqa: B023 - called within the loop
            return potential_energy(found, kinematics.arms, q + step)  # noqa: B023

        slope = derivative(energy, q.size, 1e-3)
        kinematics.update(q, still)
        effort = module_sum(modules, kinematics, targets, q, still, damping)[0]
        forces = [
            kinematics.jacobian_of(spring.frame).T @ spring.axis_force() for spring in springs_of(modules)
        ]
        torque = effort.desired - sum(forces)
        np.testing.assert_allclose(torque, -slope, atol=2e-8 * np.abs(torque).max())


@ROBOTS
def test_dampers_only_ever_take_energy(ways, robot) -> None:
    for seed in range(4):
        modules, kinematics, targets, q, v, damping = sampled(robot, seed)
        moving = module_sum(modules, kinematics, targets, q, v, damping)[0].desired
        still = module_sum(modules, kinematics, targets, q, np.zeros(q.size), damping)[0].desired
        assert float(v @ (moving - still)) <= 1e-9


@ROBOTS
@pytest.mark.parametrize("carried", [True, False])
def test_squeeze_and_weight_turn_with_the_first_hand(ways, robot, carried: bool) -> None:
    """Both take the grasps as rigid: the object's axes are the first hand's, the places on it those of the start."""
    for seed in range(4):
        modules, kinematics, targets, q, v, damping = sampled(robot, seed, held=True)
        held = replace(modules.held, spec=replace(modules.held.spec, carry_weight=carried))
        modules = replace(modules, held=held)
        found, _ = module_sum(modules, kinematics, targets, q, v, damping)
        R_WO = kinematics.pose(held.hands[0]).rotation @ held.grasps[0].rotation.T
        offsets = np.array([R_WO @ grasp.translation for grasp in held.grasps])
        pressed = squeeze_forces(offsets, held.spec.squeeze)
        lifted = carry_weight(offsets, held.spec.mass) if carried else np.zeros((len(offsets), 6))
        np.testing.assert_allclose(pressed.sum(axis=0), 0.0, atol=1e-9)
        for effort, wrenches in (
            (found.loads.squeeze_effort, np.hstack([pressed, np.zeros_like(pressed)])),
            (found.loads.weight_effort, lifted),
        ):
            pairs = zip(held.hands, wrenches, strict=True)
            expected = sum(kinematics.jacobian_of(hand).T @ wrench for hand, wrench in pairs)
            np.testing.assert_allclose(effort, expected, rtol=1e-9, atol=1e-9)


def test_half_a_grip_is_half_of_squeeze_and_weight(ways) -> None:
    modules, kinematics, targets, q, v, damping = sampled(baxter, 5, held=True)
    whole = module_sum(modules, kinematics, targets, q, v, damping)[0].efforts[-2:].copy()
    found = modules_in_force(modules, targets, damping, q.size)
    found.loads.grip = 0.5
    sum_modules(found, kinematics.arms, q, v, 1.0)
    np.testing.assert_allclose(found.efforts[-2:], 0.5 * whole, rtol=1e-14)


def test_hands_press_towards_each_other_with_the_force_asked_for_on_average() -> None:
    """Beside the object's centre they press less along the line between them: the scale makes up for it."""
    forces = squeeze_forces(np.array([[0.1, 0.05, 0.0], [-0.1, 0.05, 0.0]]), 15.0)
    np.testing.assert_allclose(forces, [[-15.0, 0.0, 0.0], [15.0, 0.0, 0.0]], atol=1e-9)


def test_without_an_object_nothing_is_squeezed(ways) -> None:
    found, _ = module_sum(*sampled(baxter, 4))
    assert not found.efforts[-2:].any()


def test_displacement_is_the_logarithm_up_to_half_a_turn(ways) -> None:
    random, error = np.random.default_rng(5), np.zeros(6)
    for angle in (0.0, 1e-9, 1e-5, 1e-3, 1.0, 3.0, np.pi - 1e-3, np.pi - 1e-7):
        for _ in range(5):
            axis = random.normal(size=3)
            axis /= np.linalg.norm(axis)
            target = Pose(random_rotation(random), random.normal(size=3))
            pose = Pose(exp3(angle * axis) @ target.rotation, target.translation + 0.1 * axis)
            displacement(pose.rotation, pose.translation, target.rotation, target.translation, error)
            expected = np.concatenate([0.1 * axis, angle * axis])
            np.testing.assert_allclose(error, expected, rtol=1e-7, atol=2e-9)
            np.testing.assert_array_equal(displacement_of(pose, target), error)


@ROBOTS
@pytest.mark.parametrize("held", [False, True])
def test_a_phase_starts_where_the_last_one_stopped_and_carries_the_object_s_springs(
    ways, robot, held
) -> None:
    model, random = robot(), np.random.default_rng(2)
    for _ in range(6):
        modules = random_task(random, model, held=held)
        start = random_equilibrium(random, modules, model, 1.0)
        for _ in range(2):
            motion = phase_motion(modules, random_phase(random, modules), start)
            begin = motion.at(0.0)
            for name, pose in start.springs.items():
                np.testing.assert_allclose(begin.springs[name].rotation, pose.rotation, atol=1e-12)
                np.testing.assert_allclose(begin.springs[name].translation, pose.translation, atol=1e-12)
            clock = float(random.uniform(0.0, 1.3 * motion.duration))
            now = motion.at(clock)
            for name in motion.carried:
                before = start.object.inverse() @ start.springs[name]
                after = now.object.inverse() @ now.springs[name]
                np.testing.assert_allclose(after.rotation, before.rotation, atol=1e-12)
                np.testing.assert_allclose(after.translation, before.translation, atol=1e-12)
            for limb, rest in now.rests.items():
                ends = [start.rests[limb], motion.goals.get(limb, start.rests[limb])]
                low, high = np.min(ends, axis=0), np.max(ends, axis=0)
                assert ((low - 1e-12 <= rest) & (rest <= high + 1e-12)).all()
            start = now
