# SPDX-License-Identifier: BSD-3-Clause
"""The robot description that the double serves and obeys: ours, with the arms' mounts where calibration found them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from xml.etree import ElementTree

from impedance_modules.errors import BadInput, nearest
from impedance_modules.spec.robot_spec import RobotSpec


def served_description(spec: RobotSpec, mount_offset: Mapping[str, tuple[float, float, float]]) -> str:
    """Writes the URDF of a robot whose mounts are moved.

    Args:
        spec: Of the robot.
        mount_offset: Limb -> (3,) by how much its mount lies beside the nominal place, in its parent's axes [m].

    Raises:
        BadInput: An offset is for a limb that the robot does not have, or the limb has no mount to move.
    """
    root = ElementTree.parse(spec.urdf).getroot()
    joints = {str(joint.get("name")): joint for joint in root.iter("joint")}
    for limb, offset in mount_offset.items():
        if limb not in spec.limbs:
            known = tuple(spec.limbs)
            raise BadInput(f"no limb '{limb}' to mount{nearest(limb, known)} (valid: {', '.join(known)})")
        first = next(iter(spec.limbs[limb].joints.values()))
        _move(_mount(joints, first), offset)
    return ElementTree.tostring(root, encoding="unicode")


def _mount(joints: Mapping[str, ElementTree.Element], first: str) -> ElementTree.Element:
    """Finds the fixed joint that carries a limb's first joint."""
    carrier = _link(joints[first], "parent")
    for joint in joints.values():
        if joint.get("type") == "fixed" and _link(joint, "child") == carrier:
            return joint
    raise BadInput(f"joint '{first}' has no fixed mount in the URDF, so no calibration can move it")


def _link(joint: ElementTree.Element, role: str) -> str | None:
    element = joint.find(role)
    return None if element is None else element.get("link")


def _move(mount: ElementTree.Element, offset: tuple[float, float, float]) -> None:
    origin = mount.find("origin")
    if origin is None:
        origin = ElementTree.SubElement(mount, "origin")
    nominal = [float(number) for number in origin.get("xyz", "0 0 0").split()]
    origin.set("xyz", " ".join(repr(a + b) for a, b in zip(nominal, offset, strict=True)))


def write_description(text: str, folder: Path) -> Path:
    """Puts a description where a model can be built from it."""
    path = folder / "served.urdf"
    path.write_text(text)
    return path
