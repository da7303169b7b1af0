# SPDX-License-Identifier: BSD-3-Clause
"""The numbers of one arm, read from a URDF: a plain list of links, nothing else.

Own reader, on purpose: the benchmark shares no physical code with the package it judges.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import yaml
from numpy.typing import NDArray

Array = NDArray[np.float64]

REPOSITORY = Path(__file__).resolve().parents[2]
ROBOT_FOLDER = REPOSITORY / "robots" / "baxter"


@dataclass(frozen=True)
class Inertial:
    """Mass [kg], centre of mass (3,) [m] and inertia (3, 3) at it [kg.m^2], in the link's frame."""

    mass: float
    com: Array
    inertia: Array


@dataclass(frozen=True)
class Link:
    """One link and the joint that carries it.

    Attributes:
        name: Of the link.
        parent: Name of the parent link.
        joint: Name of the moving joint, or None where it is fixed.
        position: (3,) of the joint in the parent's frame [m].
        rpy: (3,) fixed-axis roll, pitch, yaw of the joint in the parent's frame [rad].
        axis: (3,) of rotation, in the link's frame.
        inertial: Or None for a frame without mass.
    """

    name: str
    parent: str
    joint: str | None
    position: Array
    rpy: Array
    axis: Array
    inertial: Inertial | None


@dataclass(frozen=True)
class Drive:
    """Numbers of robot.yaml per joint of one arm, (7,) each, in SI units, and the sensors' scalars."""

    joints: tuple[str, ...]
    position_min: Array
    position_max: Array
    velocity_max: Array
    effort_max: Array
    spring_stiffness: Array
    spring_damping: Array
    rotor_inertia: Array
    motor_damping: Array
    command_delay: float
    position_resolution: float
    position_noise: float
    effort_resolution: float
    effort_noise: float
    velocity_filter: float


def read_drive(side: str) -> Drive:
    """Reads what robot.yaml says of one limb's joints."""
    robot = yaml.safe_load((ROBOT_FOLDER / "robot.yaml").read_text())
    limb = robot["limbs"][side]["joints"]
    joints, sensors = robot["joints"], robot["sensors"]

    def column(key: str) -> Array:
        return np.array([joints[key].get(long, joints[key][short]) for short, long in limb.items()], float)

    return Drive(
        joints=tuple(limb.values()),
        position_min=column("position")[:, 0],
        position_max=column("position")[:, 1],
        velocity_max=column("velocity"),
        effort_max=column("effort"),
        spring_stiffness=column("spring_stiffness"),
        spring_damping=column("spring_damping"),
        rotor_inertia=column("reflected_inertia"),
        motor_damping=column("motor_damping"),
        command_delay=robot["timing"]["command_delay"],
        position_resolution=sensors["position_resolution"],
        position_noise=sensors["position_noise"],
        effort_resolution=sensors["effort_resolution"],
        effort_noise=sensors["effort_noise"],
        velocity_filter=sensors["velocity_filter"],
    )


def hand_of(side: str) -> str:
    """Returns the name of the limb's hand link."""
    robot = yaml.safe_load((ROBOT_FOLDER / "robot.yaml").read_text())
    return str(robot["limbs"][side]["hand"])


def read_arm(side: str) -> tuple[Link, ...]:
    """Returns the links from the base to the hand and everything that hangs on them, parents first."""
    root = ET.parse(ROBOT_FOLDER / "baxter.urdf").getroot()
    inertials = {link.attrib["name"]: _inertial(link) for link in root.iter("link")}
    first = read_drive(side).joints[0]
    children: dict[str, list[ET.Element]] = {}
    for joint in root.iter("joint"):
        children.setdefault(_attribute(joint, "parent", "link"), []).append(joint)
    mount = next(joint for joint in root.iter("joint") if joint.attrib["name"] == first)
    links = [*_ancestors(root, mount, inertials)]
    waiting = [mount]
    while waiting:
        joint = waiting.pop(0)
        links.append(_link(joint, inertials))
        waiting.extend(children.get(links[-1].name, []))
    return tuple(links)


def turned(rpy: Array) -> Array:
    """Returns the rotation (3, 3) of fixed-axis roll, pitch, yaw: Rz(yaw) Ry(pitch) Rx(roll)."""
    (sr, sp, sy), (cr, cp, cy) = np.sin(rpy), np.cos(rpy)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def _ancestors(root: ET.Element, joint: ET.Element, inertials: dict[str, Inertial | None]) -> list[Link]:
    carriers = {_attribute(one, "child", "link"): one for one in root.iter("joint")}
    found: list[Link] = []
    parent = _attribute(joint, "parent", "link")
    while parent in carriers:
        link = _link(carriers[parent], inertials)
        found.insert(0, Link(link.name, link.parent, link.joint, link.position, link.rpy, link.axis, None))
        parent = link.parent
    return found


def _link(joint: ET.Element, inertials: dict[str, Inertial | None]) -> Link:
    name = _attribute(joint, "child", "link")
    origin = joint.find("origin")
    axis = joint.find("axis")
    return Link(
        name=name,
        parent=_attribute(joint, "parent", "link"),
        joint=None if joint.attrib["type"] == "fixed" else joint.attrib["name"],
        position=_vector(origin, "xyz", (0.0, 0.0, 0.0)),
        rpy=_vector(origin, "rpy", (0.0, 0.0, 0.0)),
        axis=_vector(axis, "xyz", (1.0, 0.0, 0.0)),
        inertial=inertials[name],
    )


def _inertial(link: ET.Element) -> Inertial | None:
    part = link.find("inertial")
    if part is None:
        return None
    tensor, mass, origin = part.find("inertia"), part.find("mass"), part.find("origin")
    if tensor is None or mass is None:
        raise ValueError(f"link {link.attrib['name']}: inertial without mass or inertia")
    if np.any(_vector(origin, "rpy", (0.0, 0.0, 0.0))):
        raise ValueError(f"link {link.attrib['name']}: turned inertia axes are not read")
    xx, yy, zz, xy, xz, yz = (float(tensor.attrib[key]) for key in ("ixx", "iyy", "izz", "ixy", "ixz", "iyz"))
    inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    return Inertial(float(mass.attrib["value"]), _vector(origin, "xyz", (0.0, 0.0, 0.0)), inertia)


def _attribute(element: ET.Element, part: str, key: str) -> str:
    found = element.find(part)
    if found is None:
        raise ValueError(f"joint {element.attrib.get('name')}: no <{part}>")
    return found.attrib[key]


def _vector(element: ET.Element | None, key: str, absent: tuple[float, float, float]) -> Array:
    if element is None or key not in element.attrib:
        return np.array(absent)
    return np.array([float(number) for number in element.attrib[key].split()])
