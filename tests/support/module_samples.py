# SPDX-License-Identifier: BSD-3-Clause
"""Random tasks of two arms, with or without an object, and the sum of their modules. Seeded."""

from dataclasses import replace

import numpy as np

from impedance_modules.modules.arms import ArmModule, TaskModules
from impedance_modules.modules.damping import Damping
from impedance_modules.modules.equilibrium import Equilibrium
from impedance_modules.modules.held_object import OBJECT, HeldObject
from impedance_modules.modules.joint_bias import JointBias
from impedance_modules.modules.spring import Spring
from impedance_modules.modules.sum import Modules, lay_out, sum_modules, write_equilibrium, write_gains
from impedance_modules.robot.kinematics import Kinematics
from impedance_modules.robot.model import Limb, RobotModel
from impedance_modules.robot.pose import Pose
from impedance_modules.spec.task import AXES, HybridAxis, ObjectSpec, PhaseSpec, Sine
from tests.support.arm_samples import (
    TYPICAL_STIFFNESS,
    Array,
    Random,
    make_spring,
    random_pose,
    random_position,
    random_psd,
    random_rotation,
)


def random_spring(random: Random, model: RobotModel, limb: str, frame: str, q: Array, name: str) -> Spring:
    axes = {
        axis: HybridAxis(float(random.normal() * 10), float(random.uniform(0.05, 1.0)))
        for axis in random.choice(AXES, 2, replace=False)
    }
    stiffness, reference = random_psd(random, TYPICAL_STIFFNESS), random_pose(random)
    return make_spring(stiffness, frame, limb, name, reference, model.pose(q, frame), axes=axes)


def arm_module(
    limb: Limb, springs: list[Spring], q: Array, stiffness: Array, damping: float = 0.0, ratio=None
) -> ArmModule:
    """An arm with springs, and with joint springs that are at rest in a posture."""
    dampers = np.full(len(limb.joints), damping)
    bias = JointBias(limb.name, limb.joints, stiffness, q[limb.joints], dampers, ratio)
    return ArmModule(limb, tuple(springs), bias)


def hold(
    modules: TaskModules,
    model: RobotModel,
    *,
    mass: float = 1.2,
    squeeze: float = 0.0,
    carry_weight: bool = False,
    beside: Array | float = 0.0,
) -> TaskModules:
    """The same modules with a box welded between the hands; it moves with the springs on the hands."""
    hands = tuple(arm.limb.hand for arm in modules.arms)
    poses = [model.pose(modules.posture, hand) for hand in hands]
    start = Pose(np.eye(3), np.mean([pose.translation for pose in poses], axis=0) + beside)
    limbs = tuple(arm.limb.name for arm in modules.arms)
    spec = ObjectSpec(limbs, "box", mass, (0.3, 0.2, 0.2), None, "weld", None, squeeze, carry_weight)
    grasps = tuple(start.inverse() @ pose for pose in poses)
    springs = tuple(spring.name for spring in springs_of(modules) if spring.frame in hands)
    return replace(modules, held=HeldObject(spec, start, limbs, hands, grasps, springs))


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
        springs = [
            random_spring(random, model, limb.name, frame, q, f"{limb.name}.s{k}")
            for k, frame in enumerate(frames)
        ]
        arms.append(arm_module(limb, springs, q, random.uniform(0, 30, len(limb.joints))))
    modules = TaskModules(tuple(arms), None, q)
    if not held:
        return modules
    mass, squeeze = (float(random.uniform(*ends)) for ends in ((0.5, 3), (0, 30)))
    return hold(modules, model, mass=mass, squeeze=squeeze, carry_weight=True)


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


def modules_in_force(modules: TaskModules, targets: Equilibrium, damping: Damping, n: int) -> Modules:
    """The record of a task's modules with gains and equilibria in force; ``lay_out`` and the writers of a phase."""
    found = lay_out(modules, n)
    write_gains(found, modules, damping)
    write_equilibrium(found, modules, targets)
    return found


def module_sum(
    modules: TaskModules,
    kinematics: Kinematics,
    targets: Equilibrium,
    q: Array,
    v: Array,
    damping: Damping,
    scale: float = 1.0,
) -> tuple[Modules, float]:
    """The modules at a state, their torques and their energy."""
    found = modules_in_force(modules, targets, damping, q.size)
    return found, float(sum_modules(found, kinematics.arms, q, v, scale))
