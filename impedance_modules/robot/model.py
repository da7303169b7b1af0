# SPDX-License-Identifier: BSD-3-Clause
r"""Rigid-body model of a robot folder: joints in one order, limbs as index sets, frames by name.

The model carries the reflected inertia as armature, so its mass matrix is M + I_r and its inverse the
mobility that controller, damping and filter rows use (design 4, "Which inertia").
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from impedance_modules.arrays import Array
from impedance_modules.errors import BadInput, nearest
from impedance_modules.robot.description import name_apart, rigid_model
from impedance_modules.robot.link_geometry import read_geometry
from impedance_modules.robot.pose import Pose
from impedance_modules.spec.robot_spec import BodyChange, JointOrigin, JointSpec, RobotSpec


@dataclass(frozen=True)
class Limb:
    """One arm within the model.

    Attributes:
        name: As in the robot file.
        hand: Frame of its hand.
        short_names: Joint names as a task file writes them, from the base outwards.
        joint_names: The same joints as the model names them.
        joints: (k,) their indices in the model's vectors, from the base outwards.
    """

    name: str
    hand: str
    short_names: tuple[str, ...]
    joint_names: tuple[str, ...]
    joints: NDArray[np.intp]


class RobotModel:
    """Kinematics and dynamics of a robot, built once from its ``RobotSpec``.

    Attributes:
        spec: The robot file.
        joint_names: Names of all n joints, in the order of every vector.
        limbs: Limb name -> ``Limb``.
        frames: Names of all link frames.
        reflected_inertia: (n,) I_r as the commanded torque meets it, that is divided by 1 + k where the robot has an
            inner torque loop of gain k (``robot/inner_torque_loop.py``) [kg.m^2].
        rotor_inertia: (n,) I_r of the rotors themselves, whatever loop runs around them [kg.m^2].
        motor_damping: (n,) D, seen the same way [N.m.s/rad].
        pin_model: Pinocchio model with armature I_r; for robot/ and plant/ only.
    """

    def __init__(self, spec: RobotSpec) -> None:
        self.spec = spec
        full = _full_model(spec)
        locked = [full.getJointId(name) for name in spec.locked]
        reference = pin.neutral(full)
        for name, angle in spec.locked.items():
            reference[full.joints[full.getJointId(name)].idx_q] = angle
        name_apart(full, locked)
        self._full, self._locked, self._reference = full, locked, reference
        try:
            self.pin_model: pin.Model = pin.buildReducedModel(full, locked, reference)
        except (ValueError, RuntimeError) as error:  # two frames of one name, say
            raise BadInput(f"{spec.urdf}: its locked joints cannot be fixed: {error}") from None
        self.joint_names: tuple[str, ...] = tuple(self.pin_model.names)[1:]
        self.joints: tuple[JointSpec, ...] = tuple(spec.joints[name] for name in self.joint_names)
        self.rotor_inertia: Array = self.column("reflected_inertia")
        self.reflected_inertia: Array = self.rotor_inertia.copy()
        self.motor_damping: Array = self.column("motor_damping")
        if spec.inner_torque_loop is not None:
            self.reflected_inertia /= spec.inner_torque_loop.lighter
            self.motor_damping /= spec.inner_torque_loop.lighter
        self.pin_model.armature = self.reflected_inertia
        self.pin_model.gravity.linear = np.array(spec.gravity)
        for change in spec.body_changes:
            add_to_body(self.pin_model, change)
        springs = spec.parallel_springs
        self._spring_stiffness, self._spring_preload = np.zeros(self.n), np.zeros(self.n)
        for index, name in enumerate(self.joint_names):
            if name in springs:
                self._spring_stiffness[index] = springs[name].stiffness
                self._spring_preload[index] = springs[name].preload
        self.limbs: Mapping[str, Limb] = {name: self._limb(name) for name in spec.limbs}
        self.frames: tuple[str, ...] = tuple(
            frame.name for frame in self.pin_model.frames if frame.type == pin.FrameType.BODY
        )

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.joint_names)

    def column(self, attribute: str) -> Array:
        """Collects one number per joint, e.g. ``effort_max``, as (n,) in the model's order."""
        return np.array([float(getattr(joint, attribute)) for joint in self.joints])

    @cached_property
    def encoder_at_motor(self) -> NDArray[np.bool_]:
        """Which joints (n,) report the motor's position theta and not the link's q."""
        return np.array([joint.encoder == "motor" for joint in self.joints], dtype=bool)

    def spring_compliance(self) -> Array:
        """Gives 1 / K_sea per joint, (n,) [rad/(N.m)]; 0 for a rigid joint."""
        stiffness = (joint.spring_stiffness for joint in self.joints)
        return np.array([0.0 if value is None else 1.0 / value for value in stiffness])

    def _limb(self, name: str) -> Limb:
        limb = self.spec.limbs[name]
        names = tuple(limb.joints.values())
        indices = np.array([self.joint_names.index(joint) for joint in names], dtype=np.intp)
        return Limb(name, limb.hand, tuple(limb.joints), names, indices)

    def limb_of(self, frame: str) -> Limb:
        """Returns the limb whose joints move ``frame``.

        Raises:
            BadInput: No limb, or more than one, moves the frame.
        """
        joint = self.pin_model.frames[self.frame_id(frame)].parentJoint
        moving = {int(self.pin_model.idx_vs[i]) for i in self.pin_model.supports[joint] if i > 0}
        found = [limb for limb in self.limbs.values() if moving & set(limb.joints.tolist())]
        if len(found) != 1:
            raise BadInput(f"frame '{frame}' is moved by {len(found)} limbs, not by exactly one")
        return found[0]

    def frame_id(self, frame: str) -> int:
        """Returns pinocchio's index of a link frame.

        Raises:
            BadInput: The robot has no such link.
        """
        if frame not in self.frames:
            raise BadInput(
                f"robot '{self.spec.name}' has no frame '{frame}'{nearest(frame, self.frames)}"
                f" (valid: {', '.join(self.frames)})"
            )
        return int(self.pin_model.getFrameId(frame, pin.FrameType.BODY))

    def position(self, postures: Mapping[str, Mapping[str, float]]) -> Array:
        """Builds q (n,) [rad] from limb -> short joint name -> angle.

        Joints of other limbs are 0, or in the middle of their range where 0 is outside of it.
        """
        lower, upper = self.column("position_min"), self.column("position_max")
        q = np.where((lower <= 0.0) & (upper >= 0.0), 0.0, 0.5 * (lower + upper))
        for limb_name, posture in postures.items():
            limb = self.limbs[limb_name]
            for short, index in zip(limb.short_names, limb.joints, strict=True):
                q[index] = posture[short]
        return q

    def reach(self, limb: str) -> float:
        """Gives how far a limb's hand can be from its first joint at most [m]: the lengths between joints, summed."""
        found, links = self.limbs[limb], self.pin_model
        frame = links.frames[self.frame_id(found.hand)]
        joints = [links.getJointId(name) for name in found.joint_names[1:]]
        between = sum(float(np.linalg.norm(links.jointPlacements[joint].translation)) for joint in joints)
        return between + float(np.linalg.norm(frame.placement.translation))

    def joint_place(self, joint: str) -> Array:
        """Computes where a joint is in world (3,) [m], all joints where ``position`` puts those of other limbs."""
        data = self.pin_model.createData()
        pin.forwardKinematics(self.pin_model, data, self.position({}))
        return np.array(data.oMi[self.pin_model.getJointId(joint)].translation)

    def pose(self, q: Array, frame: str) -> Pose:
        """Computes X_WF at q, allocating; loops use ``Kinematics``."""
        data = self.pin_model.createData()
        pin.forwardKinematics(self.pin_model, data, q)
        placement = pin.updateFramePlacement(self.pin_model, data, self.frame_id(frame))
        return Pose(placement.rotation.copy(), placement.translation.copy())

    def gravity(self, q: Array) -> Array:
        """Computes the torque that holds the arms' weight, and winds their parallel springs, at q, (n,) [N.m]."""
        data = self.pin_model.createData()
        return np.array(pin.computeGeneralizedGravity(self.pin_model, data, q)) + self.parallel_spring_effort(
            q
        )

    def parallel_spring_effort(self, q: Array) -> Array:
        """Computes the torque that winds the parallel springs at q, (n,) [N.m]; zero where there are none."""
        return np.asarray(self._spring_stiffness * q - self._spring_preload)

    def mass_matrix(self, q: Array) -> Array:
        """Computes M + I_r at q, (n, n) [kg.m^2]."""
        matrix = pin.crba(self.pin_model, self.pin_model.createData(), q)
        return np.asarray(np.triu(matrix) + np.triu(matrix, 1).T)

    def geometry(self, links: Collection[str] | None = None) -> pin.GeometryModel:
        """Builds collision shapes, fresh and without pairs; for robot/ and plant/ only.

        Args:
            links: Whose; None for all, but for meshes that are not there.

        Raises:
            BadInput: A mesh of one of ``links`` is not there, or a shape cannot be read.
        """
        shapes = read_geometry(self._full, self.spec.urdf, links)
        _, reduced = pin.buildReducedModel(self._full, shapes, self._locked, self._reference)
        for shape in reduced.geometryObjects:
            shape.geometry.computeLocalAABB()
        return reduced


def _full_model(spec: RobotSpec) -> pin.Model:
    origins = spec.joint_origins
    return rigid_model(spec.urdf, calibrated_description(spec.urdf, origins) if origins else None)


def add_to_body(model: pin.Model, change: BodyChange) -> None:
    """Adds to a link's inertia, in place.

    Raises:
        BadInput: No joint moves the link, or what results is no physical body.
    """
    links = [f.name for f in model.frames if f.type == pin.FrameType.BODY and f.parentJoint > 0]
    if change.link not in links:
        raise BadInput(
            f"no joint moves a link '{change.link}'{nearest(change.link, links)} (valid: {', '.join(links)})"
        )
    frame = model.frames[model.getFrameId(change.link, pin.FrameType.BODY)]
    before = pin.PseudoInertia.FromDynamicParameters(model.inertias[frame.parentJoint].toDynamicParameters())
    added = pin.PseudoInertia.FromDynamicParameters(np.array(change.parameters))
    T = frame.placement.homogeneous
    total = before.toMatrix() + T @ added.toMatrix() @ T.T
    if np.linalg.eigvalsh(total)[0] <= 0.0:
        raise BadInput(
            f"link '{change.link}': with {change.parameters[0]:+g} kg and its moments it is no physical body"
            " (valid: mass above 0, a positive definite pseudo-inertia)"
        )
    model.inertias[frame.parentJoint] = pin.PseudoInertia.FromMatrix(total).toInertia()


def with_reflected_inertia(spec: RobotSpec, values: Mapping[str, float]) -> RobotSpec:
    """Returns the robot with the reflected inertia [kg.m^2] of some joints replaced.

    Raises:
        BadInput: A joint is unknown, or a value is negative.
    """
    names = tuple(spec.joints)
    for name, value in values.items():
        if name not in spec.joints:
            raise BadInput(
                f"robot '{spec.name}' has no joint '{name}'{nearest(name, names)} (valid: {', '.join(names)})"
            )
        if not value >= 0.0:
            raise BadInput(
                f"joint '{name}': a reflected inertia of {value} kg.m^2 is not physical (valid: >= 0)"
            )
    joints = {
        name: replace(joint, reflected_inertia=values[name]) if name in values else joint
        for name, joint in spec.joints.items()
    }
    return replace(spec, joints=joints)


def calibrated_description(urdf: Path, origins: Mapping[str, JointOrigin]) -> str:
    """Returns a URDF's text with the origins of some joints replaced.

    Raises:
        BadInput: The URDF has no such joint.
    """
    root = ElementTree.parse(urdf).getroot()
    joints = {str(joint.get("name")): joint for joint in root.iter("joint")}
    for name, origin in origins.items():
        if name not in joints:
            known = tuple(joints)
            raise BadInput(f"{urdf}: no joint '{name}' to calibrate{nearest(name, known)}")
        element = joints[name].find("origin")
        if element is None:
            element = ElementTree.SubElement(joints[name], "origin")
        element.set("xyz", " ".join(repr(number) for number in origin.translation))
        element.set("rpy", " ".join(repr(number) for number in origin.roll_pitch_yaw))
    return ElementTree.tostring(root, encoding="unicode")
