# SPDX-License-Identifier: BSD-3-Clause
r"""The robot of a folder as MuJoCo's bodies, joints and actuators, made of the model that the controller has too.

    elastic   M(q) a + h(q, v) = tau_s + J^T f        I_r w' + D w = drive - tau_s
    rigid     (M(q) + I_r) a + h(q, v) + D v = drive + J^T f

Each joint of the URDF is one body with its placement, inertia and axis; what is fixed to a link is part of it. A joint
with a series spring has its rotor as a body of its own, which turns about nothing but its axis; a tendon between the
two is the spring, tau_s = K (theta - q) + B (w - v), with a dead band for play. Where the robot has an inner torque
loop, I_r and D are as the commanded torque meets them. Three actuators make up a joint's drive: the command, within
the joint's effort; what the robot adds for its arms' weight; and its own position hold.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from impedance_modules.arrays import Array, Indices
from impedance_modules.errors import BadInput
from impedance_modules.plant.joints import ELASTIC, IDEAL, joint_kind
from impedance_modules.plant.links import link_model, link_table
from impedance_modules.records import Row
from impedance_modules.robot.model import RobotModel
from impedance_modules.robot.rotation import write_quaternion

OWN = "impedance/"
"""Begins every name that is added to a model, so that none meets one of a user's file."""

COMMAND, ASSIST, HOLD = "command", "assist", "hold"
"""Actuators of each joint."""

LEAST_MASS, LEAST_INERTIA = 1e-6, 1e-9
"""Of a link or rotor without mass [kg], [kg.m^2]: MuJoCo moves nothing lighter."""

STOP_TIME = 0.01
"""Time constant of a joint's stop, critically damped [s]."""


@dataclass(frozen=True)
class RobotIndices:
    """Where the robot's n joints are in MuJoCo's vectors, in the model's order, each (n,).

    Attributes:
        position: Of the links, in ``qpos``.
        velocity: Of the links, in ``qvel`` and all that belongs to a degree of freedom.
        motor_position, motor_velocity: Of the rotors; those of the links where a joint has no spring.
        elastic: Whether it has one.
        command, assist, hold: In ``ctrl``.
    """

    position: Indices
    velocity: Indices
    motor_position: Indices
    motor_velocity: Indices
    elastic: NDArray[np.bool_]
    command: Indices
    assist: Indices
    hold: Indices


def quaternion(rotation: Array) -> Array:
    """Gives a rotation (3, 3) as MuJoCo writes it: (w, x, y, z)."""
    out = np.zeros(4)
    write_quaternion(np.ascontiguousarray(rotation), out)
    return np.roll(out, 1)


def rotor_name(joint: str) -> str:
    """Names a joint's rotor, its joint and its spring."""
    return f"{OWN}rotor/{joint}"


def add_robot(spec: mujoco.MjSpec, model: RobotModel, gravity: Array, gap: Array) -> None:
    """Adds the robot's bodies, joints and springs to an empty model.

    Args:
        spec: Of the scene; its gravity is set too.
        model: The robot.
        gravity: (3,) in world axes [m/s^2].
        gap: (n,) play of the joints with springs [rad].
    """
    spec.option.gravity = gravity
    table = link_table(link_model(model, gravity))
    bodies = [spec.worldbody]
    for i, joint in enumerate(model.joints):
        row, kind = table[i + 1], joint_kind(joint)
        body = bodies[int(row["parent"])].add_body(
            name=f"{OWN}{joint.name}", pos=row["rest_translation"], quat=quaternion(row["rest_rotation"])
        )
        _set_inertia(body, row)
        added = _add_joint(body, joint.name, row)
        added.limited = mujoco.mjtLimited.mjLIMITED_TRUE
        added.range, added.solref_limit = [joint.position_min, joint.position_max], [STOP_TIME, 1.0]
        turning = added
        if kind == ELASTIC:
            turning = _add_rotor(spec, added)
            _add_spring(spec, model, i, float(gap[i]))
        turning.armature = float(model.reflected_inertia[i])
        turning.damping[0] = 0.0 if kind == IDEAL else float(model.motor_damping[i])
        bodies.append(body)


def _add_joint(body: mujoco.MjsBody, name: str, row: Row) -> mujoco.MjsJoint:
    """Lets a body turn about or slide along a link's axis."""
    turns = bool(row["screw"][3:].any())
    return body.add_joint(
        name=name,
        type=mujoco.mjtJoint.mjJNT_HINGE if turns else mujoco.mjtJoint.mjJNT_SLIDE,
        axis=row["screw"][3:] if turns else row["screw"][:3],
    )


def _add_rotor(spec: mujoco.MjSpec, joint: mujoco.MjsJoint) -> mujoco.MjsJoint:
    """Adds a joint's rotor: weightless, and of no inertia but that about its axis."""
    name = rotor_name(joint.name)
    body = spec.worldbody.add_body(name=name, mass=LEAST_MASS, gravcomp=1.0, explicitinertial=True)
    body.ipos, body.inertia = np.zeros(3), np.full(3, LEAST_INERTIA)
    return body.add_joint(name=name, type=joint.type, axis=joint.axis)


def add_series_spring(spec: mujoco.MjSpec, model: RobotModel, i: int, gap: float) -> None:
    """Puts a joint's spring between a link of a user's model and a rotor, which takes over inertia and friction.

    A joint without rotor inertia gets the robot's.
    """
    joint = spec.joint(model.joint_names[i])
    rotor = _add_rotor(spec, joint)
    rotor.armature = joint.armature or float(model.reflected_inertia[i])
    rotor.damping, rotor.frictionloss = joint.damping, joint.frictionloss
    joint.armature, joint.damping, joint.frictionloss = 0.0, np.zeros(3), 0.0
    _add_spring(spec, model, i, gap)


def _add_spring(spec: mujoco.MjSpec, model: RobotModel, i: int, gap: float) -> None:
    """Adds the spring between rotor and link; with play, its damping is left out: teeth do not pull."""
    joint = model.joints[i]
    tendon = spec.add_tendon(name=rotor_name(joint.name))
    tendon.wrap_joint(rotor_name(joint.name), 1.0)
    tendon.wrap_joint(joint.name, -1.0)
    tendon.stiffness[0] = float(joint.spring_stiffness or 0.0)
    tendon.damping[0] = 0.0 if gap > 0.0 else joint.spring_damping
    tendon.springlength = [-0.5 * gap, 0.5 * gap]


def _set_inertia(body: mujoco.MjsBody, row: Row) -> None:
    """Writes a link's mass, centre and inertia; MuJoCo's order is xx, yy, zz, xy, xz, yz."""
    inertia = np.array(row["inertia"])
    body.mass = max(float(row["mass"]), LEAST_MASS)
    body.ipos = row["centre"]
    if not inertia.any():
        inertia = LEAST_INERTIA * np.eye(3)
    body.fullinertia = inertia[(0, 1, 2, 0, 0, 1), (0, 1, 2, 1, 2, 2)]
    body.explicitinertial = True


def add_actuators(spec: mujoco.MjSpec, model: RobotModel) -> None:
    """Gives each joint of the robot its three actuators; the hold's gains are zero until the robot holds."""
    for joint in model.joints:
        reach = [-joint.effort_max, joint.effort_max]
        command = _actuator(spec, joint.name, COMMAND)
        command.ctrllimited, command.ctrlrange = mujoco.mjtLimited.mjLIMITED_TRUE, reach
        _actuator(spec, joint.name, ASSIST)
        hold = _actuator(spec, joint.name, HOLD)
        hold.gainprm[0], hold.biastype = 0.0, mujoco.mjtBias.mjBIAS_AFFINE
        hold.forcelimited, hold.forcerange = mujoco.mjtLimited.mjLIMITED_TRUE, reach


def _actuator(spec: mujoco.MjSpec, joint: str, kind: str) -> mujoco.MjsActuator:
    driven = joint if spec.joint(rotor_name(joint)) is None else rotor_name(joint)
    made = spec.add_actuator(name=f"{OWN}{joint}/{kind}", target=driven)
    made.trntype = mujoco.mjtTrn.mjTRN_JOINT
    return made


def robot_indices(compiled: mujoco.MjModel, names: tuple[str, ...]) -> RobotIndices:
    """Finds the robot's joints, rotors and actuators in a compiled model."""
    joints = [compiled.joint(name) for name in names]
    rotors = {compiled.joint(i).name for i in range(compiled.njnt)} & {rotor_name(name) for name in names}
    elastic = [rotor_name(name) in rotors for name in names]
    motors = [
        compiled.joint(rotor_name(name) if own else name) for name, own in zip(names, elastic, strict=True)
    ]

    def drives(kind: str) -> Indices:
        return _indices(compiled.actuator(f"{OWN}{name}/{kind}").id for name in names)

    return RobotIndices(
        position=_indices(joint.qposadr[0] for joint in joints),
        velocity=_indices(joint.dofadr[0] for joint in joints),
        motor_position=_indices(joint.qposadr[0] for joint in motors),
        motor_velocity=_indices(joint.dofadr[0] for joint in motors),
        elastic=np.array(elastic),
        command=drives(COMMAND),
        assist=drives(ASSIST),
        hold=drives(HOLD),
    )


def _indices(numbers: Iterable[int]) -> Indices:
    return np.array(list(numbers), dtype=np.intp)


def compile_model(spec: mujoco.MjSpec, words: str) -> mujoco.MjModel:
    """Compiles a model.

    Args:
        spec: Of the scene.
        words: Where it comes from.

    Raises:
        BadInput: MuJoCo refuses it, in its words; e.g. an inertia that no body can have.
    """
    try:
        return spec.compile()
    except ValueError as error:
        raise BadInput(f"{words}: MuJoCo refuses the model: {error}") from None
