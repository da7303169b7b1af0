# SPDX-License-Identifier: BSD-3-Clause
"""Compares the robot description that a Baxter serves with ours, and takes over its calibrated mounts.

Each Baxter is calibrated at its shoulders: the fixed joint that carries an arm's first joint is up to a centimetre
from its nominal place. The served description has the calibrated place. Within ``MOUNT_SHIFT`` and ``MOUNT_TURN`` our
model is built with it (``RobotSpec.joint_origins``); beyond them, or where anything else differs, it is another robot
and refused. Poses between links come from ``UrdfJoints``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from xml.etree import ElementTree

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.errors import BadInput
from impedance_modules.robot.pose import Pose
from impedance_modules.robot.rotation import log3
from impedance_modules.spec.robot_spec import JointOrigin, LimbSpec, RobotSpec

MOUNT_SHIFT, MOUNT_TURN = 0.03, 0.03
"""Largest calibration offset of a mount that is accepted [m], [rad]; 0.0096 m and 0.004 rad are known."""

SAME_PLACE, SAME_TURN = 1e-3, 2e-3
"""All other joints must agree this well [m], [rad]."""

NOTICED = 1e-6
"""A smaller offset of a mount is not taken over [m], [rad]."""

SAME_ANGLE = 1e-3
"""Position limits must agree this well [rad]."""


@dataclass(frozen=True)
class DescriptionComparison:
    """How the served description differs from our model.

    Attributes:
        origins: Mount's joint in our URDF -> where this robot has it; empty where ours fits.
        problems: Why it cannot be the robot that we mean.
        notes: Differences that do not matter.
    """

    origins: Mapping[str, JointOrigin]
    problems: tuple[str, ...]
    notes: tuple[str, ...]


@dataclass(frozen=True)
class _Found:
    """Collects a comparison."""

    origins: dict[str, JointOrigin]
    problems: list[str]
    notes: list[str]


def compare_description(text: str, spec: RobotSpec) -> DescriptionComparison:
    """Compares a served description with a robot folder.

    Args:
        text: The URDF that the robot serves.
        spec: Of the robot folder; its own ``joint_origins`` are not looked at.
    """
    try:
        served = UrdfJoints(text)
    except (ElementTree.ParseError, ValueError) as error:
        return DescriptionComparison({}, (f"the served description cannot be read: {error}",), ())
    ours = UrdfJoints(spec.urdf.read_text())
    found = _Found({}, [], [])
    for limb in spec.limbs.values():
        missing = [name for name in limb.joints.values() if name not in served.joints]
        if missing:
            found.problems.append(f"the served description has no joint {', '.join(missing)}")
            continue
        try:
            _compare_mount(ours, served, limb, found)
            _compare_chain(ours, served, limb, found.problems)
        except ValueError as error:
            found.problems.append(f"the served description of the {limb.name} arm cannot be read: {error}")
        found.problems.extend(_limit_problems(served, limb, spec))
    return DescriptionComparison(found.origins, tuple(found.problems), tuple(found.notes))


def _compare_mount(ours: UrdfJoints, served: UrdfJoints, limb: LimbSpec, found: _Found) -> None:
    """Finds the mount that puts our first joint where the served description has it."""
    first = next(iter(limb.joints.values()))
    mount = ours.carrier(link_of(ours.joints[first], "parent"))
    if mount is None or mount.get("type") != "fixed":
        raise BadInput(f"joint '{first}' has no fixed mount in our URDF")
    root = _root_of(ours, first)
    here = ours.between(link_of(ours.joints[first], "child"), root)
    there = served.between(link_of(served.joints[first], "child"), root)
    parent = ours.between(link_of(mount, "parent"), root)
    if here is None or there is None or parent is None:
        found.problems.append(f"the served description does not carry '{first}' on the link '{root}'")
        return
    shift, turn = _difference(here, there)
    if max(shift, turn) <= NOTICED:
        return
    what = f"{limb.name} mount {1e3 * shift:.1f} mm and {1e3 * turn:.1f} mrad from its nominal place"
    if shift > MOUNT_SHIFT or turn > MOUNT_TURN:
        found.problems.append(
            f"{what} (believed up to {1e3 * MOUNT_SHIFT:.0f} mm and {1e3 * MOUNT_TURN:.0f} mrad)"
        )
        return
    calibrated = parent.inverse() @ there @ origin_of(ours.joints[first]).inverse()
    found.origins[str(mount.get("name"))] = JointOrigin(
        (
            float(calibrated.translation[0]),
            float(calibrated.translation[1]),
            float(calibrated.translation[2]),
        ),
        roll_pitch_yaw(calibrated.rotation),
    )
    found.notes.append(what)


def _compare_chain(ours: UrdfJoints, served: UrdfJoints, limb: LimbSpec, problems: list[str]) -> None:
    """Compares each joint with the one before it, and the directions of their axes."""
    names = list(limb.joints.values())
    for before, name in pairwise(names):
        here = ours.between(link_of(ours.joints[name], "child"), link_of(ours.joints[before], "child"))
        there = served.between(link_of(served.joints[name], "child"), link_of(served.joints[before], "child"))
        if here is None or there is None:
            problems.append(f"the served description does not carry '{name}' on '{before}'")
            continue
        shift, turn = _difference(here, there)
        if shift > SAME_PLACE or turn > SAME_TURN:
            problems.append(
                f"'{name}' is served {1e3 * shift:.1f} mm and {1e3 * turn:.1f} mrad from where our model has it"
            )
    for name in names:
        if float(np.linalg.norm(axis_of(ours.joints[name]) - axis_of(served.joints[name]))) > SAME_TURN:
            problems.append(f"'{name}' is served with another axis than our model has")


def _limit_problems(served: UrdfJoints, limb: LimbSpec, spec: RobotSpec) -> list[str]:
    """Lists ranges that differ, and speeds or torques that our file allows and the robot does not."""
    found = []
    for name in limb.joints.values():
        element, own = served.joints[name].find("limit"), spec.joints[name]
        if element is None:
            found.append(f"'{name}' is served without limits")
            continue
        for key, value in (("lower", own.position_min), ("upper", own.position_max)):
            said = number_of(element, key)
            if not abs(said - value) <= SAME_ANGLE:
                found.append(f"'{name}' is served with {key} limit {said:g} rad, robot.yaml says {value:g}")
        for key, value, unit in (("velocity", own.velocity_max, "rad/s"), ("effort", own.effort_max, "N.m")):
            said = number_of(element, key)
            if not said >= value * (1.0 - 1e-6):
                found.append(
                    f"'{name}' is served with {key} limit {said:g} {unit}, robot.yaml allows {value:g}"
                )
    return found


def _root_of(tree: UrdfJoints, joint: str) -> str:
    link = link_of(tree.joints[joint], "parent")
    while (carrier := tree.carrier(link)) is not None:
        link = link_of(carrier, "parent")
    return link


def _difference(one: Pose, other: Pose) -> tuple[float, float]:
    turn = log3(one.rotation.T @ other.rotation)
    return float(np.linalg.norm(one.translation - other.translation)), float(np.linalg.norm(turn))


class UrdfJoints:
    """Joints of a URDF by the link they carry."""

    def __init__(self, text: str) -> None:
        root = ElementTree.fromstring(text)
        self.joints = {str(joint.get("name")): joint for joint in root.findall("joint")}
        self._above = {link_of(joint, "child"): joint for joint in self.joints.values()}

    def between(self, link: str, ancestor: str) -> Pose | None:
        """Pose of a link in an ancestor at zero angles; None when the ancestor does not carry it."""
        pose = Pose.identity()
        for _ in range(len(self.joints) + 1):
            if link == ancestor:
                return pose
            if link not in self._above:
                return None
            joint = self._above[link]
            pose, link = origin_of(joint) @ pose, link_of(joint, "parent")
        return None

    def carrier(self, link: str) -> ElementTree.Element | None:
        """The joint that carries a link."""
        return self._above.get(link)


def link_of(joint: ElementTree.Element, role: str) -> str:
    """Returns the link that is a joint's ``parent`` or ``child``."""
    element = joint.find(role)
    return "" if element is None else str(element.get("link"))


def _numbers(text: str) -> Array:
    numbers = np.array([float(word) for word in text.split()])
    if numbers.shape != (3,) or not np.isfinite(numbers).all():
        raise ValueError(f"'{text}' is not three numbers")
    return numbers


def number_of(element: ElementTree.Element, key: str) -> float:
    """Reads a number; not a number where there is none."""
    try:
        return float(element.get(key, "nan"))
    except ValueError:
        return math.nan


def axis_of(joint: ElementTree.Element) -> Array:
    """Returns the unit vector (3,) about which a joint turns."""
    element = joint.find("axis")
    axis = _numbers("1 0 0" if element is None else element.get("xyz", "1 0 0"))
    return np.asarray(axis / np.linalg.norm(axis))


def origin_of(joint: ElementTree.Element) -> Pose:
    """Returns where a joint sits in its parent link, at zero angle."""
    element = joint.find("origin")
    if element is None:
        return Pose.identity()
    roll, pitch, yaw = _numbers(element.get("rpy", "0 0 0"))
    return Pose(_rotation(roll, pitch, yaw), _numbers(element.get("xyz", "0 0 0")))


def _rotation(roll: float, pitch: float, yaw: float) -> Array:
    """R = Rz(yaw) Ry(pitch) Rx(roll), the URDF's convention."""
    (sr, cr), (sp, cp), (sy, cy) = ((math.sin(a), math.cos(a)) for a in (roll, pitch, yaw))
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def roll_pitch_yaw(rotation: Array) -> tuple[float, float, float]:
    """Inverse of ``_rotation``; mounts are far from pitch = 90 degrees."""
    return (
        math.atan2(rotation[2, 1], rotation[2, 2]),
        math.asin(-rotation[2, 0]),
        math.atan2(rotation[1, 0], rotation[0, 0]),
    )
