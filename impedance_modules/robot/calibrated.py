# SPDX-License-Identifier: BSD-3-Clause
"""A robot description with some joints where one particular robot has them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from xml.etree import ElementTree

from impedance_modules.errors import BadInput, nearest
from impedance_modules.spec.robot_spec import JointOrigin


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
