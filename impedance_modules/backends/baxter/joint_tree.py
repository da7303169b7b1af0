# SPDX-License-Identifier: BSD-3-Clause
"""Joints of a URDF as poses between links, as far as comparing two descriptions needs it."""

from __future__ import annotations

import math
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from impedance_modules.robot.pose import Pose

Array = NDArray[np.float64]


class JointTree:
    """Joints of a URDF by the link they carry."""

    def __init__(self, text: str) -> None:
        root = ElementTree.fromstring(text)
        self.joints = {str(joint.get("name")): joint for joint in root.findall("joint")}
        self._above = {link_of(joint, "child"): joint for joint in self.joints.values()}

    def between(self, link: str, ancestor: str) -> Pose | None:
        """Pose of a link in an ancestor at zero angles; None when it does not hang on it."""
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
