# SPDX-License-Identifier: BSD-3-Clause
r"""A MuJoCo model of one's own (MJCF) in place of the robot folder's links: of the whole robot, or of one of its arms.

The robot's joints are found by their names: as they are, or, in a model of one arm, as the end of each limb's own names
(``left_joint1``: ``joint1``). A model of one arm is attached once for every limb. Where it stands follows from the
robot's URDF: the rotation R and translation t that bring the axes of its joints onto the URDF's,

    R b_i = a_i,        (1 - a_i a_i^T) (R c_i + t - p_i) = 0

a_i and p_i direction and anchor of axis i in the URDF, b_i and c_i in the file, both at the start posture. Axes that do
not meet, there or when the joints have moved, are another arm, and refused. Masses, rotors, damping, dry friction and
stops are those of the file; the joints' series springs are the robot folder's.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.backends.mujoco.robot_bodies import (
    OWN,
    add_robot,
    add_series_spring,
    compile_model,
    quaternion,
)
from impedance_modules.backends.mujoco.surroundings import HandMount
from impedance_modules.errors import BadInput
from impedance_modules.plant.joints import ELASTIC, joint_kind
from impedance_modules.robot.model import RobotModel

SAME_PLACE, SAME_DIRECTION = 2e-3, 5e-3
"""By how much a joint's axis may be elsewhere than in the URDF [m], and point elsewhere [rad]."""

MOVED = 0.3
"""By how much the joints are moved to compare their zeros, senses and order [rad]."""


@dataclass(frozen=True)
class ModelPart:
    """One copy of the user's model.

    Attributes:
        prefix: Of all its names.
        joints: Joint of the robot -> joint of the file.
    """

    prefix: str
    joints: Mapping[str, str]


@dataclass(frozen=True)
class JointAxes:
    """Axes of joints in world: unit directions (k, 3) and anchors (k, 3) [m]."""

    direction: Array
    anchor: Array


def read_users_model(
    path: Path, model: RobotModel, posture: Array, gravity: Array, gap: Array
) -> tuple[mujoco.MjSpec, tuple[HandMount, ...]]:
    """Builds the robot of a user's model, without drives.

    Args:
        path: The MJCF.
        model: The robot, as its folder has it.
        posture: (n,) at the start [rad].
        gravity: (3,) in world axes [m/s^2].
        gap: (n,) play of the joints with springs [rad].

    Raises:
        BadInput: The file cannot be read, lacks joints of the robot, or is another arm.
    """
    spec = mujoco.MjSpec()
    spec.compiler.degree = False
    spec.option.gravity = gravity
    for part in _parts(path, model):
        _attach(spec, path, model, posture, part)
    for i, joint in enumerate(model.joints):
        if joint_kind(joint) == ELASTIC:
            add_series_spring(spec, model, i, float(gap[i]))
    return spec, tuple(_mounts(spec, model, posture))


def _read(path: Path) -> mujoco.MjSpec:
    """Reads the file's bodies, joints and shapes; its drives, sensors and couplings are left out."""
    try:
        spec = mujoco.MjSpec.from_file(str(path))
    except (ValueError, OSError) as error:
        raise BadInput(f"--mjcf {path}: not a MuJoCo model that can be read: {error}") from None
    for kind in (spec.keys, spec.sensors, spec.actuators, spec.equalities, spec.tendons):
        for element in list(kind):
            spec.delete(element)
    return spec


def _parts(path: Path, model: RobotModel) -> list[ModelPart]:
    """Decides which joint of the file is which of the robot."""
    names = tuple(joint.name for joint in _read(path).joints if joint.name)
    whole = {joint: joint for joint in model.joint_names if joint in names}
    if len(whole) == model.n:
        return [ModelPart(f"{OWN}model/", whole)]
    return [ModelPart(f"{OWN}{limb}/", _arm_joints(path, limb, model, names)) for limb in model.limbs]


def _arm_joints(path: Path, limb: str, model: RobotModel, names: tuple[str, ...]) -> dict[str, str]:
    """Finds a limb's joints in the model of one arm.

    Raises:
        BadInput: One has none, or more than one could be it.
    """
    found: dict[str, str] = {}
    for joint in model.limbs[limb].joint_names:
        fitting = [name for name in names if joint == name] or [
            name for name in names if joint.endswith(name)
        ]
        if len(fitting) != 1:
            said = f"could be any of {', '.join(fitting)}" if fitting else "is not among them"
            raise BadInput(
                f"--mjcf {path}: it has the joints {', '.join(names)}; '{joint}' of robot '{model.spec.name}' {said}"
                " (valid: the robot's names, or for one arm, the ends of each limb's)"
            )
        found[joint] = fitting[0]
    return found


def _attach(spec: mujoco.MjSpec, path: Path, model: RobotModel, posture: Array, part: ModelPart) -> None:
    """Adds one copy where the URDF has it; joints that the robot does not have are fixed."""
    child = _read(path)
    for joint in list(child.joints):
        if joint.name not in part.joints.values():
            child.delete(joint)
    rotation, translation = _placement(child, path, model, posture, part)
    _take_options(child, spec)
    frame = spec.worldbody.add_frame(pos=translation, quat=quaternion(rotation))
    spec.attach(child, prefix=part.prefix, frame=frame)
    for ours, theirs in part.joints.items():
        joint = spec.joint(f"{part.prefix}{theirs}")
        joint.name = ours
        joint.parent.name = joint.parent.name or f"{part.prefix}{ours}"


def _take_options(child: mujoco.MjSpec, spec: mujoco.MjSpec) -> None:
    """Gives a copy the scene's options: how it is integrated and solved is not the file's affair."""
    for name in vars(type(spec.option)):
        if not name.startswith("_"):
            setattr(child.option, name, getattr(spec.option, name))


def _placement(
    child: mujoco.MjSpec, path: Path, model: RobotModel, posture: Array, part: ModelPart
) -> tuple[Array, Array]:
    """Finds rotation (3, 3) and translation (3,) [m] of a copy, and refuses another arm.

    Raises:
        BadInput: Its axes are not the URDF's.
    """
    folder, file = _folder_model(model), compile_model(child.copy(), f"--mjcf {path}")
    rows = [model.joint_names.index(name) for name in part.joints]
    found: tuple[Array, Array] | None = None
    for q in (posture, posture + MOVED, posture - MOVED * np.arange(1, model.n + 1) / model.n):
        ours = _axes(folder, tuple(part.joints), q[rows])
        theirs = _axes(file, tuple(part.joints.values()), q[rows])
        found = found or _best_placement(ours, theirs)
        _refuse_other_arm(path, tuple(part.joints), ours, theirs, found)
    return found or (np.eye(3), np.zeros(3))


def _folder_model(model: RobotModel) -> mujoco.MjModel:
    """Compiles the robot folder's own links."""
    spec = mujoco.MjSpec()
    spec.compiler.degree = False
    add_robot(spec, model, np.zeros(3), np.zeros(model.n))
    return compile_model(spec, f"robot '{model.spec.name}'")


def _axes(compiled: mujoco.MjModel, names: tuple[str, ...], q: Array) -> JointAxes:
    """Computes the axes of some joints at their positions (k,) [rad]."""
    data, joints = mujoco.MjData(compiled), [compiled.joint(name) for name in names]
    data.qpos[[joint.qposadr[0] for joint in joints]] = q
    mujoco.mj_kinematics(compiled, data)
    at = [joint.id for joint in joints]
    return JointAxes(np.array(data.xaxis[at]), np.array(data.xanchor[at]))


def _best_placement(ours: JointAxes, theirs: JointAxes) -> tuple[Array, Array]:
    """Solves for R by the directions (Kabsch 1976), then for t by the axes' distances, both by least squares."""
    u, _, v = np.linalg.svd(ours.direction.T @ theirs.direction)
    rotation = u @ np.diag([1.0, 1.0, np.linalg.det(u @ v)]) @ v
    across = np.eye(3) - ours.direction[:, :, None] * ours.direction[:, None, :]
    away = ours.anchor - theirs.anchor @ rotation.T
    right = np.einsum("kij,kj->ki", across, away).reshape(-1)
    return rotation, np.linalg.lstsq(across.reshape(-1, 3), right, rcond=None)[0]


def _refuse_other_arm(
    path: Path, names: tuple[str, ...], ours: JointAxes, theirs: JointAxes, placed: tuple[Array, Array]
) -> None:
    rotation, translation = placed
    turned = theirs.direction @ rotation.T
    angle = np.linalg.norm(np.cross(turned, ours.direction), axis=1) + np.pi * (
        np.sum(turned * ours.direction, axis=1) < 0.0
    )
    away = ours.anchor - theirs.anchor @ rotation.T - translation
    away -= np.sum(away * ours.direction, axis=1)[:, None] * ours.direction
    distance = np.linalg.norm(away, axis=1)
    worst = int(np.argmax(np.maximum(distance / SAME_PLACE, angle / SAME_DIRECTION)))
    if distance[worst] > SAME_PLACE or angle[worst] > SAME_DIRECTION:
        raise BadInput(
            f"--mjcf {path}: the axis of '{names[worst]}' is {1e3 * distance[worst]:.1f} mm and {angle[worst]:.3f} rad"
            f" away from where the robot's URDF has it (valid: up to {1e3 * SAME_PLACE:g} mm, {SAME_DIRECTION:g} rad;"
            " a model of the same arm, its joints' zeros and senses as in the URDF)"
        )


def _mounts(spec: mujoco.MjSpec, model: RobotModel, posture: Array) -> Iterator[HandMount]:
    """Fixes each hand's frame to the body of its limb's last joint, where the URDF has it at the start."""
    compiled = compile_model(spec.copy(), f"robot '{model.spec.name}'")
    data = mujoco.MjData(compiled)
    data.qpos[[compiled.joint(name).qposadr[0] for name in model.joint_names]] = posture
    mujoco.mj_kinematics(compiled, data)
    for limb in model.limbs.values():
        body = str(spec.joint(limb.joint_names[-1]).parent.name)
        at, hand = data.body(body), model.pose(posture, limb.hand)
        rotation = np.array(at.xmat).reshape(3, 3)
        yield HandMount(
            limb.hand, body, rotation.T @ hand.rotation, rotation.T @ (hand.translation - at.xpos)
        )
