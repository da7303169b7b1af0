# SPDX-License-Identifier: BSD-3-Clause
"""One arm is one impedance module: its springs and its joint bias. A task is a few of them and an object.

``build_modules`` makes them from a task file and a robot model at the start posture. Every check that needs the arm's
geometry is made there, and all of its findings are raised together.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.errors import BadFile, Problem
from impedance_modules.modules.between_spring import BetweenSpring, build_between_spring
from impedance_modules.modules.held_object import OBJECT, HeldObject, distance_to_surface
from impedance_modules.modules.hinge import LEAST_LEVER, Hinge
from impedance_modules.modules.joint_bias import JointBias
from impedance_modules.modules.obstacle import Obstacle
from impedance_modules.modules.spring import Spring
from impedance_modules.robot.model import Limb, RobotModel
from impedance_modules.robot.pose import Pose
from impedance_modules.spec.hinge_spec import HINGE
from impedance_modules.spec.task import ArmSpec, JointBiasSpec, ObjectSpec, PhaseSpec, TaskSpec

WORLD = "world"
GRASP_REACH = 0.01
"""A hand holds the object if its frame is at most this far from the object's surface [m]."""


@dataclass(frozen=True)
class ArmModule:
    """An impedance module: how one arm should react to contact.

    Attributes:
        limb: The arm.
        springs: Springs on its frames.
        bias: Joint springs; None for none.
    """

    limb: Limb
    springs: tuple[Spring, ...]
    bias: JointBias | None


@dataclass(frozen=True)
class TaskModules:
    """All impedance modules of a task, and the object between them.

    Attributes:
        arms: In the order of the task file.
        held: The object that arms hold; None for none.
        posture: (n,) q at the start [rad]; joints of limbs without a module are 0.
        between: Springs between frames of two arms.
        obstacles: That push frames of the arms away.
    """

    arms: tuple[ArmModule, ...]
    held: HeldObject | None
    posture: Array
    between: tuple[BetweenSpring, ...] = ()
    obstacles: tuple[Obstacle, ...] = ()

    @property
    def frames(self) -> tuple[str, ...]:
        """Frames whose pose and Jacobian a cycle needs: hands first, then other springs' frames."""
        hands = [arm.limb.hand for arm in self.arms]
        others = [spring.frame for arm in self.arms for spring in arm.springs]
        joined = [frame for spring in self.between for frame in spring.frames]
        guarded = [frame for obstacle in self.obstacles for frame in obstacle.frames]
        return tuple(dict.fromkeys(hands + others + joined + guarded))

    def arm(self, limb: str) -> ArmModule:
        """Finds the module of a limb by name."""
        return next(arm for arm in self.arms if arm.limb.name == limb)


def with_phase_gains(modules: TaskModules, phase: PhaseSpec) -> TaskModules:
    """Returns the modules with the hybrid axes and stiffnesses that hold from a phase on."""
    arms = tuple(
        replace(arm, springs=tuple(_with_gains(spring, phase) for spring in arm.springs))
        for arm in modules.arms
    )
    return replace(modules, arms=arms)


def _with_gains(spring: Spring, phase: PhaseSpec) -> Spring:
    axes = phase.axes.get(spring.name, {})
    stiffness = phase.stiffness.get(spring.name)
    return spring if not axes and stiffness is None else spring.with_gains(axes, stiffness)


def build_modules(task: TaskSpec, model: RobotModel) -> TaskModules:
    """Builds every arm's module, and the object with its grasps, at the start posture.

    Args:
        task: A task whose names have been checked against the robot.
        model: The robot.

    Raises:
        BadFile: A hand is too far from the object or inside it, or holds the very axis of its hinge, or a phase
            moves both the object and a spring that holds it; all at once.
    """
    posture = model.position({name: arm.posture for name, arm in task.arms.items()})
    arms = tuple(_arm(arm, model, posture) for arm in task.arms.values())
    held = None if task.object is None else _held(task.object, arms, model, posture)
    between = tuple(build_between_spring(spec, model, posture) for spec in task.between)
    obstacles = tuple(Obstacle(spec) for spec in task.obstacles)
    modules = TaskModules(arms, held, posture, between, obstacles)
    if held is not None:
        problems = (
            _hand_problems(task, held) + _target_problems(task, held) + _axis_problems(task, held, model)
        )
        if problems:
            raise BadFile(problems)
    return modules


def _arm(spec: ArmSpec, model: RobotModel, posture: Array) -> ArmModule:
    limb = model.limbs[spec.limb]
    springs = tuple(
        Spring(
            spec=spring,
            limb=spec.limb,
            reference=_frame_pose(spring.expressed_in, model, posture),
            start=model.pose(posture, spring.frame),
        )
        for spring in spec.springs
    )
    bias = None if spec.joint_bias is None else _bias(spec.joint_bias, limb, posture)
    return ArmModule(limb, springs, bias)


def _frame_pose(frame: str, model: RobotModel, posture: Array) -> Pose:
    return Pose.identity() if frame == WORLD else model.pose(posture, frame)


def _bias(spec: JointBiasSpec, limb: Limb, posture: Array) -> JointBias:
    """A joint that the file does not name has no spring and no damper of its own."""
    damping = {} if spec.damping is None else spec.damping
    return JointBias(
        limb=limb.name,
        joints=limb.joints,
        stiffness=np.array([spec.stiffness.get(name, 0.0) for name in limb.short_names]),
        rest=posture[limb.joints],
        damping=np.array([damping.get(name, 0.0) for name in limb.short_names]),
        damping_ratio=spec.damping_ratio,
        damping_against=spec.damping_against,
    )


def _held(spec: ObjectSpec, arms: tuple[ArmModule, ...], model: RobotModel, posture: Array) -> HeldObject:
    holding = {arm.limb.name: arm for arm in arms}
    hands = tuple(holding[name].limb.hand for name in spec.held_by)
    poses = [model.pose(posture, hand) for hand in hands]
    midway = np.mean([pose.translation for pose in poses], axis=0)
    start = Pose(np.eye(3), midway if spec.position is None else np.array(spec.position, dtype=float))
    springs = tuple(
        spring.name
        for name, hand in zip(spec.held_by, hands, strict=True)
        for spring in holding[name].springs
        if _same_body(model, posture, spring.frame, hand)
    )
    grasps = tuple(start.inverse() @ pose for pose in poses)
    hinge = None if spec.hinge is None else Hinge.of_object(spec.hinge, start)
    return HeldObject(spec, start, spec.held_by, hands, grasps, springs, hinge)


def _same_body(model: RobotModel, posture: Array, frame: str, hand: str) -> bool:
    """Tells whether two frames are rigidly attached: their relative pose survives moving every joint."""
    moved = posture + 0.1 + 0.01 * np.arange(model.n)
    here = model.pose(posture, hand).inverse() @ model.pose(posture, frame)
    there = model.pose(moved, hand).inverse() @ model.pose(moved, frame)
    return bool(
        np.allclose(here.rotation, there.rotation, atol=1e-9)
        and np.allclose(here.translation, there.translation, atol=1e-9)
    )


def _hand_problems(task: TaskSpec, held: HeldObject) -> list[Problem]:
    problems = []
    for limb, grasp in zip(held.limbs, held.grasps, strict=True):
        distance = distance_to_surface(held.spec.shape, held.spec.size, grasp.translation)
        if abs(distance) <= GRASP_REACH:
            continue
        where = ", ".join(f"{value:+.3f}" for value in grasp.translation)
        side = "away from" if distance > 0.0 else "inside"
        problems.append(
            task.document.problem(
                ("object", "held_by"),
                f"the hand of '{limb}' is {abs(distance) * 1000.0:.0f} mm {side} the object's surface at the"
                f" start posture (hand at ({where}) m from the object's centre); a grasp needs at most"
                f" {GRASP_REACH * 1000.0:.0f} mm: change the posture, object.size or object.position",
            )
        )
    return problems


def _axis_problems(task: TaskSpec, held: HeldObject, model: RobotModel) -> list[Problem]:
    """Finds hands that would hold the hinge's axis itself, or that are too short to reach around it."""
    hinge, problems = held.hinge, []
    if hinge is None:
        return []
    for limb, grasp in zip(held.limbs, held.grasps, strict=True):
        lever, reach = hinge.lever((held.start @ grasp).translation), model.reach(limb)
        if lever < LEAST_LEVER:
            message = (
                f"the hinge's axis runs through the hand of '{limb}', {1e3 * lever:.0f} mm from its frame: the hand"
                f" has no lever arm there (valid: at least {1e3 * LEAST_LEVER:.0f} mm between axis and hand)"
            )
            problems.append(task.document.problem(("object", HINGE, "point"), message))
        elif lever > reach:
            message = (
                f"the hinge's axis is {lever:.2f} m from the hand of '{limb}', farther than the whole arm is long,"
                f" {reach:.2f} m: it could not follow the arc (valid: a point nearer to the hand)"
            )
            problems.append(task.document.problem(("object", HINGE, "point"), message))
    return problems


def _target_problems(task: TaskSpec, held: HeldObject) -> list[Problem]:
    problems = []
    for index, phase in enumerate(task.phases):
        mover = next((name for name in (OBJECT, HINGE) if name in phase.equilibrium), None)
        if mover is None:
            continue
        for target in sorted(set(phase.equilibrium) & set(held.springs)):
            message = (
                f"'{target}' holds the object, and this phase moves '{mover}' too; both would place the"
                " same spring: move one of them"
            )
            problems.append(task.document.problem(("phases", index, "equilibrium", target), message))
    return problems
