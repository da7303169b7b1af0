# SPDX-License-Identifier: BSD-3-Clause
"""The compiled modules say what the clear ones say: springs, joint bias, moving equilibria, squeeze and weight."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from impedance_modules.modules import compiled_motion, compiled_object, compiled_springs
from impedance_modules.modules.arms import ArmModule, TaskModules
from impedance_modules.modules.damping import Damping
from impedance_modules.modules.equilibrium import Equilibrium, phase_motion
from impedance_modules.modules.held_object import OBJECT, HeldObject, carry_weight, squeeze_forces
from impedance_modules.modules.joint_bias import JointBias
from impedance_modules.modules.spring import Spring
from impedance_modules.modules.total import desired_effort
from impedance_modules.robot.kinematics import Kinematics
from impedance_modules.robot.model import RobotModel
from impedance_modules.robot.pose import Pose
from impedance_modules.robot.rotation import exp3, log3
from impedance_modules.spec.task import AXES, HybridAxis, ObjectSpec, PhaseSpec, Sine
from tests.support.arm_samples import (
    TYPICAL_STIFFNESS,
    Array,
    Random,
    baxter,
    make_spring,
    random_pose,
    random_position,
    random_psd,
    random_rotation,
    six_joint_pair,
)

MODELS = [baxter, six_joint_pair]


def random_spring(random: Random, model: RobotModel, limb: str, frame: str, q: Array, name: str) -> Spring:
    axes = {
        axis: HybridAxis(float(random.normal() * 10), float(random.uniform(0.05, 1.0)))
        for axis in random.choice(AXES, 2, replace=False)
    }
    spring = make_spring(
        random_psd(random, TYPICAL_STIFFNESS),
        frame,
        limb,
        name,
        random_pose(random),
        model.pose(q, frame),
        axes=axes,
    )
    return spring


def random_task(random: Random, model: RobotModel, *, held: bool) -> TaskModules:
    """Every limb with two springs on its hand and one halfway, joint bias on all joints, maybe an object."""
    q = random_position(random, model)
    arms = []
    for limb in model.limbs.values():
        middle = next(
            frame.name
            for frame in model.pin_model.frames
            if frame.parentJoint == model.pin_model.getJointId(limb.joint_names[3])
            and frame.name in model.frames
        )
        frames = (limb.hand, limb.hand, middle)
        springs = tuple(
            random_spring(random, model, limb.name, frame, q, f"{limb.name}.s{k}")
            for k, frame in enumerate(frames)
        )
        k = len(limb.joints)
        bias = JointBias(limb.name, limb.joints, random.uniform(0, 30, k), q[limb.joints], np.zeros(k), None)
        arms.append(ArmModule(limb, springs, bias))
    return TaskModules(tuple(arms), _held(random, model, arms, q) if held else None, q)


def _held(random: Random, model: RobotModel, arms: list[ArmModule], q: Array) -> HeldObject:
    hands = tuple(arm.limb.hand for arm in arms)
    poses = [model.pose(q, hand) for hand in hands]
    start = Pose(np.eye(3), np.mean([pose.translation for pose in poses], axis=0))
    limbs = tuple(arm.limb.name for arm in arms)
    spec = ObjectSpec(
        limbs,
        "sphere",
        float(random.uniform(0.5, 3)),
        (0.3,),
        None,
        "weld",
        None,
        float(random.uniform(0, 30)),
        True,
    )
    springs = tuple(spring.name for arm in arms for spring in arm.springs[:2])
    return HeldObject(spec, start, limbs, hands, tuple(start.inverse() @ pose for pose in poses), springs)


def springs_of(modules: TaskModules) -> list[Spring]:
    return [spring for arm in modules.arms for spring in arm.springs]


def random_equilibrium(random: Random, modules: TaskModules, model: RobotModel, angle: float) -> Equilibrium:
    def near(spring: Spring) -> Pose:
        pose = model.pose(modules.posture, spring.frame)
        return Pose(
            random_rotation(random, angle) @ pose.rotation, pose.translation + 0.1 * random.normal(size=3)
        )

    targets = {spring.name: near(spring) for spring in springs_of(modules)}
    rests = {
        arm.limb.name: arm.bias.rest + 0.3 * random.normal(size=len(arm.limb.joints)) for arm in modules.arms
    }
    return Equilibrium(targets, None if modules.held is None else modules.held.start, rests)


def random_damping(random: Random, modules: TaskModules) -> Damping:
    def joints(k: int) -> Array:
        half = random.normal(size=(k, k))
        return half @ half.T

    springs = {spring.name: random_psd(random, 0.1 * TYPICAL_STIFFNESS) for spring in springs_of(modules)}
    nothing = {name: np.zeros((6, 6)) for name in springs}
    modal = {arm.limb.name: joints(len(arm.limb.joints)) for arm in modules.arms}
    return Damping(springs, nothing, modal, {name: np.zeros_like(value) for name, value in modal.items()})


def stacked(values: list[Array]) -> Array:
    return np.ascontiguousarray(np.array(values))


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("angle", [1e-6, 1.0, np.pi])
def test_springs_and_joint_bias_agree(model, angle: float) -> None:
    """Torque of every module, wrench and energy; turns from nearly none to just before half a turn."""
    robot = model()
    random = np.random.default_rng(1)
    for _ in range(15):
        modules = random_task(random, robot, held=False)
        kinematics = Kinematics(robot, modules.frames)
        q, v = modules.posture + 0.05 * random.normal(size=robot.n), random.normal(size=robot.n)
        kinematics.update(q, v)
        targets, damping = random_equilibrium(random, modules, robot, angle), random_damping(random, modules)
        scale = float(random.uniform(0.0, 1.0))
        clear = desired_effort(modules, kinematics, targets, q, v, damping)
        expected: dict[str, Array] = {}
        for part in clear.parts:
            share = scale if part.kind == "spring" else 1.0
            expected[part.name] = expected.get(part.name, 0.0) + share * part.effort
        springs = springs_of(modules)
        slots = np.array([kinematics.frames.index(spring.frame) for spring in springs])
        poses = [targets.springs[spring.name] for spring in springs]
        places = stacked([pose.rotation for pose in poses]), stacked([pose.translation for pose in poses])
        stiffness = stacked([spring.in_world(spring.stiffness) for spring in springs])
        here = slots, kinematics.rotation, kinematics.translation
        efforts, wrenches = np.zeros((len(springs), robot.n)), np.zeros((len(springs), 6))
        energy = compiled_springs.spring_efforts(
            stiffness,
            stacked([damping.of_spring(spring) for spring in springs]),
            stacked([spring.axis_force() for spring in springs]),
            *here,
            kinematics.jacobian,
            kinematics.moved_by,
            *places,
            scale,
            v,
            wrenches,
            efforts,
        )
        for row, spring in enumerate(springs):
            np.testing.assert_allclose(efforts[row], expected[spring.name], rtol=1e-10, atol=1e-9)
        stored = sum(part.energy for part in clear.parts if part.wrench is not None)
        assert energy == pytest.approx(scale * stored, rel=1e-10)
        assert compiled_springs.spring_energies(stiffness, *here, *places) == pytest.approx(stored, rel=1e-10)
        check_bias(modules, targets, damping, kinematics, q, v, scale, expected)


def check_bias(
    modules: TaskModules,
    targets: Equilibrium,
    damping: Damping,
    kinematics: Kinematics,
    q: Array,
    v: Array,
    scale: float,
    expected: dict[str, Array],
) -> None:
    n = q.size
    stiffness, rest, viscous = np.zeros(n), np.zeros(n), np.zeros((n, n))
    limb_of_joint, stored = np.zeros(n, dtype=np.int64), 0.0
    for number, arm in enumerate(modules.arms):
        joints, name = arm.limb.joints, arm.limb.name
        stiffness[joints], rest[joints] = arm.bias.stiffness, targets.rests[name]
        viscous[np.ix_(joints, joints)] = damping.of_joints(name)
        limb_of_joint[joints] = number
        stored += arm.bias.energy(q, targets.rests[name])
    efforts = np.zeros((len(modules.arms), n))
    energy = compiled_springs.bias_efforts(
        stiffness, viscous, rest, limb_of_joint, kinematics.coupled, scale, q, v, efforts
    )
    for number, arm in enumerate(modules.arms):
        np.testing.assert_allclose(efforts[number], expected[arm.bias.name], rtol=1e-10, atol=1e-10)
    assert energy == pytest.approx(scale * stored, rel=1e-10)
    assert compiled_springs.bias_energy(stiffness, rest, q) == pytest.approx(stored, rel=1e-10)


def random_phase(random: Random, modules: TaskModules) -> PhaseSpec:
    """Moves most targets; values and sines on random axes; the object, if any, instead of what holds it."""

    def coordinates() -> dict[str, float | Sine]:
        found: dict[str, float | Sine] = {}
        for axis in random.choice(AXES, int(random.integers(1, 7)), replace=False):
            value = float(random.uniform(-1.0, 1.0))
            center = None if random.random() < 0.5 else value
            sine = Sine(0.2 * float(random.random()), float(random.uniform(0.1, 2.0)), center)
            found[str(axis)] = sine if random.random() < 0.3 else value
        return found

    held = () if modules.held is None else modules.held.springs
    names = [spring.name for spring in springs_of(modules) if spring.name not in held]
    moved = {name: coordinates() for name in names if random.random() < 0.7}
    if modules.held is not None:
        moved[OBJECT] = coordinates()
    arm = modules.arms[0]
    posture = {arm.limb.name: {arm.limb.short_names[1]: 0.4, arm.limb.short_names[4]: -0.2}}
    return PhaseSpec("p", float(random.uniform(0.2, 3.0)), moved, posture, {}, {}, None, "next")


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("held", [False, True])
def test_moving_equilibria_agree_through_two_phases(model, held: bool) -> None:
    robot = model()
    random = np.random.default_rng(2)
    for _ in range(12):
        modules = random_task(random, robot, held=held)
        start = random_equilibrium(random, modules, robot, 1.0)
        for _ in range(2):
            motion = phase_motion(modules, random_phase(random, modules), start)
            table = compiled_motion.motion_table(modules, motion, robot.n)
            clocks = np.append(random.uniform(0.0, 1.3 * motion.duration, 6), [0.0, motion.duration])
            for clock in clocks:
                check_targets(modules, motion.at(float(clock)), table, float(clock))
            start = motion.at(float(clocks[0]))


def check_targets(
    modules: TaskModules, expected: Equilibrium, table: compiled_motion.MotionTable, clock: float
) -> None:
    springs, n = springs_of(modules), table.rest_start.size
    rotation, translation = np.zeros((len(springs), 3, 3)), np.zeros((len(springs), 3))
    rest = np.full(n, np.nan)
    compiled_motion.targets(
        table.movers,
        table.rides,
        table.offsets,
        table.rest_start,
        table.rest_goal,
        table.duration,
        clock,
        rotation,
        translation,
        rest,
    )
    for row, spring in enumerate(springs):
        pose = expected.springs[spring.name]
        np.testing.assert_allclose(rotation[row], pose.rotation, atol=1e-12)
        np.testing.assert_allclose(translation[row], pose.translation, atol=1e-12)
    for arm in modules.arms:
        np.testing.assert_allclose(rest[arm.bias.joints], expected.rests[arm.limb.name], atol=1e-14)


@pytest.mark.parametrize("model", MODELS)
def test_squeeze_and_weight_agree_even_where_the_hands_drift_on_the_object(model) -> None:
    """Both take the grasps as rigid: the object's axes are the first hand's, the places on it those of the start."""
    robot = model()
    random = np.random.default_rng(3)
    for carried in (True, False):
        for _ in range(8):
            modules = random_task(random, robot, held=True)
            held = replace(modules.held, spec=replace(modules.held.spec, carry_weight=carried))
            modules = replace(modules, held=held)
            kinematics = Kinematics(robot, modules.frames)
            q, v = modules.posture + 0.2 * random.normal(size=robot.n), np.zeros(robot.n)
            kinematics.update(q, v)
            targets = random_equilibrium(random, modules, robot, 1.0)
            clear = desired_effort(modules, kinematics, targets, q, v, random_damping(random, modules))
            # What is kept in the object's axes is what the hands' places in world would give.
            R_WO = kinematics.pose(held.hands[0]).rotation @ held.grasps[0].rotation.T
            offsets = np.array([R_WO @ grasp.translation for grasp in held.grasps])
            pressed = squeeze_forces(offsets, held.spec.squeeze)
            np.testing.assert_allclose(held.squeeze[:, :3] @ R_WO.T, pressed, atol=1e-9)
            np.testing.assert_allclose(held.weight(R_WO), carry_weight(offsets, held.spec.mass), atol=1e-9)
            shares = compiled_object.object_shares(held, modules.frames)
            squeeze, weight = np.full(robot.n, np.nan), np.full(robot.n, np.nan)
            compiled_object.object_efforts(
                *shares, kinematics.rotation, kinematics.jacobian, kinematics.moved_by, squeeze, weight
            )
            for kind, found in (("squeeze", squeeze), ("weight", weight)):
                expected = sum((part.effort for part in clear.parts if part.kind == kind), np.zeros(robot.n))
                np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9, err_msg=kind)


def test_without_an_object_nothing_is_squeezed() -> None:
    robot = baxter()
    modules = random_task(np.random.default_rng(4), robot, held=False)
    kinematics = Kinematics(robot, modules.frames)
    squeeze, weight = np.ones(robot.n), np.ones(robot.n)
    compiled_object.object_efforts(
        *compiled_object.object_shares(None, modules.frames),
        kinematics.rotation,
        kinematics.jacobian,
        kinematics.moved_by,
        squeeze,
        weight,
    )
    assert not squeeze.any()
    assert not weight.any()


def test_rotation_error_agrees_up_to_half_a_turn() -> None:
    random = np.random.default_rng(5)
    error = np.zeros(6)
    for angle in (0.0, 1e-9, 1e-5, 1e-3, 1.0, 3.0, np.pi - 1e-3, np.pi - 1e-7):
        for _ in range(10):
            axis = random.normal(size=3)
            target = random_rotation(random)
            rotation = exp3(angle * axis / np.linalg.norm(axis)) @ target
            compiled_springs.rotation_error(rotation, target, error)
            np.testing.assert_allclose(error[3:], log3(rotation @ target.T), rtol=1e-7, atol=1e-9)
