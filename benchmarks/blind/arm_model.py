# SPDX-License-Identifier: BSD-3-Clause
"""One arm, read from a URDF as a plain list of links, and written as a MuJoCo model.

Own reader, on purpose: the benchmark shares no physical code with the package that it tests. In the MJCF links hang on
hinges, rotors stand beside them, and a spring tendon joins each pair:

    M(q) v' + C + g = tau_s,    I_r w' + D w = tau_m - tau_s,    tau_s = K (theta - q) + B (w - v)

The rotors are fixed to the world, so that they only store energy about their own axis; `springlength` of a tendon
may be an interval, which is a backlash.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import yaml
from numpy.typing import NDArray

Array = NDArray[np.float64]

REPOSITORY = Path(__file__).resolve().parents[2]
ROBOT_FOLDER = REPOSITORY / "robots" / "baxter"
GRAVITY = 9.81
STEP = 0.0005


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


@dataclass(frozen=True)
class Joints:
    """What lies between motors and links: (n,) rotor inertia, motor damping, spring K and B, backlash gap."""

    rotor_inertia: Array
    motor_damping: Array
    stiffness: Array
    damping: Array
    gap: Array

    @classmethod
    def nominal(cls, drive: Drive) -> Joints:
        """Returns the joints of robot.yaml."""
        gap = np.zeros(len(drive.joints))
        return cls(
            drive.rotor_inertia, drive.motor_damping, drive.spring_stiffness, drive.spring_damping, gap
        )


def write_mjcf(
    links: Sequence[Link],
    joints: Joints | None,
    gravity: Array,
    hand: str,
) -> str:
    """Returns the model as XML; without ``joints`` the arm is rigid: its links alone.

    Args:
        links: Parents first, the first one's parent being the base.
        joints: Drive numbers, or None.
        gravity: (3,) [m/s^2].
        hand: Link that carries the site ``hand``.
    """
    root = ET.Element("mujoco", model="arm")
    ET.SubElement(root, "compiler", angle="radian", autolimits="true", inertiafromgeom="false")
    option = {"timestep": str(STEP), "integrator": "implicitfast", "gravity": _text(gravity)}
    if joints is not None:
        option |= {"iterations": "1"}
    ET.SubElement(root, "option", option)
    world = ET.SubElement(root, "worldbody")
    bodies = {links[0].parent: world}
    for link in links:
        bodies[link.name] = _body(bodies[link.parent], link)
    ET.SubElement(bodies[hand], "site", name="hand", pos="0 0 0")
    names = [link.joint for link in links if link.joint is not None]
    if joints is not None:
        _add_drives(root, world, names, joints)
    return ET.tostring(root, encoding="unicode")


def _body(parent: ET.Element, link: Link) -> ET.Element:
    body = ET.SubElement(
        parent, "body", name=link.name, pos=_text(link.position), quat=_text(_quaternion(link.rpy))
    )
    if link.inertial is not None:
        tensor = link.inertial.inertia
        full = [tensor[0, 0], tensor[1, 1], tensor[2, 2], tensor[0, 1], tensor[0, 2], tensor[1, 2]]
        place = {"pos": _text(link.inertial.com), "mass": repr(float(link.inertial.mass))}
        ET.SubElement(body, "inertial", place | {"fullinertia": _text(np.array(full))})
    if link.joint is not None:
        ET.SubElement(body, "joint", name=link.joint, type="hinge", axis=_text(link.axis))
    return body


def _add_drives(root: ET.Element, world: ET.Element, names: Sequence[str], joints: Joints) -> None:
    tendons = ET.SubElement(root, "tendon")
    for i, name in enumerate(names):
        rotor = ET.SubElement(world, "body", name=f"rotor_{i}", pos="0 0 0")
        inertia = repr(float(joints.rotor_inertia[i]))
        ET.SubElement(rotor, "inertial", pos="0 0 0", mass="0.001", diaginertia=" ".join([inertia] * 3))
        damping = repr(float(joints.motor_damping[i]))
        ET.SubElement(rotor, "joint", name=f"motor_{i}", type="hinge", axis="0 0 1", damping=damping)
        half = 0.5 * float(joints.gap[i])
        numbers = {"stiffness": joints.stiffness[i], "damping": joints.damping[i]}
        shape = {key: repr(float(value)) for key, value in numbers.items()}
        tendon = ET.SubElement(tendons, "fixed", shape | {"springlength": f"{-half!r} {half!r}"})
        ET.SubElement(tendon, "joint", joint=name, coef="-1")
        ET.SubElement(tendon, "joint", joint=f"motor_{i}", coef="1")


def _quaternion(rpy: Array) -> Array:
    """Returns w, x, y, z of Rz(yaw) Ry(pitch) Rx(roll)."""
    (sr, sp, sy), (cr, cp, cy) = np.sin(rpy / 2), np.cos(rpy / 2)
    return np.array(
        [
            cr * cp * cy + sr * sp * sy,
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
        ]
    )


def _text(numbers: Array) -> str:
    return " ".join(repr(float(number)) for number in numbers)
