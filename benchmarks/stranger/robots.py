# SPDX-License-Identifier: BSD-3-Clause
"""Arms of several makers, as their URDFs describe them, and as one copy came out of the factory.

The descriptions are those of the package example-robot-data. Meshes and `<dynamics>` tags are
left out, fingers are fixed: the clean robots of this benchmark rub nowhere, and a description that says
otherwise would be wrong. Masses of a real copy differ by 3 % (one sigma), as docs/diagnosis.md states.
"""

from __future__ import annotations

import copy
import importlib.util
import xml.etree.ElementTree as ET
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

TOLERANCE = 0.03
"""One sigma of a link's mass, and, as shares of their size, of its inertia and its centre."""

DROPPED = ("gazebo", "transmission", "material", "ros2_control")


@dataclass(frozen=True)
class Maker:
    """One arm: its file, the posture about which it works [rad], reach about it, and speeds."""

    name: str
    file: str
    middle: tuple[float, ...]
    reach: tuple[float, ...]  # rad to either side
    speed: tuple[float, ...]  # rad/s that a sensible user stays below
    rated: tuple[float, ...]  # N.m, from the description
    tip: str  # link behind the last joint


MAKERS = (
    Maker(
        "panda",
        "panda_description/urdf/panda.urdf",
        (0.0, -0.3, 0.0, -1.9, 0.0, 1.7, 0.5),
        (1.2, 0.7, 1.0, 0.8, 1.2, 0.9, 1.2),
        (1.5, 1.2, 1.5, 1.5, 1.8, 1.8, 2.0),
        (87, 87, 87, 87, 12, 12, 12),
        "panda_link7",
    ),
    Maker(
        "ur5",
        "ur_description/urdf/ur5_robot.urdf",
        (0.3, -1.3, 1.4, -1.2, -1.5, 0.2),
        (1.3, 0.7, 0.9, 1.0, 1.0, 1.4),
        (1.5, 1.2, 1.5, 2.0, 2.0, 2.0),
        (150, 150, 150, 28, 28, 28),
        "wrist_3_link",
    ),
    Maker(
        "ur10",
        "ur_description/urdf/ur10_robot.urdf",
        (-0.2, -1.2, 1.3, -1.0, -1.4, 0.0),
        (1.2, 0.6, 0.8, 1.0, 1.0, 1.4),
        (1.2, 1.0, 1.3, 1.8, 1.8, 2.0),
        (330, 330, 150, 54, 54, 54),
        "wrist_3_link",
    ),
    Maker(
        "ur3",
        "ur_description/urdf/ur3_robot.urdf",
        (0.1, -1.4, 1.5, -1.3, -1.4, 0.3),
        (1.3, 0.7, 0.9, 1.1, 1.1, 1.5),
        (1.6, 1.4, 1.6, 2.2, 2.2, 2.2),
        (56, 56, 28, 12, 12, 12),
        "wrist_3_link",
    ),
    Maker(
        "kinova",
        "kinova_description/robots/kinova.urdf",
        (0.4, 2.6, 1.5, 0.8, 1.6, 0.5),
        (1.0, 0.6, 0.6, 1.0, 1.0, 1.2),
        (0.6, 0.6, 0.6, 0.8, 0.8, 0.8),
        (40, 80, 40, 20, 20, 20),
        "j2s6s200_link_6",
    ),
    Maker(
        "xarm7",
        "xarm_description/urdf/xarm7.urdf",
        (0.0, -0.2, 0.1, 1.2, 0.0, 0.9, 0.0),
        (1.2, 0.8, 1.0, 0.8, 1.2, 0.8, 1.4),
        (1.6, 1.4, 1.6, 1.6, 2.0, 2.0, 2.0),
        (50, 50, 30, 30, 30, 20, 20),
        "link7",
    ),
    Maker(
        "z1",
        "z1_description/urdf/z1.urdf",
        (0.0, 1.3, -1.3, 0.0, 0.0, 0.0),
        (1.2, 0.7, 0.7, 0.9, 0.9, 1.3),
        (1.6, 1.4, 1.4, 1.8, 1.8, 2.0),
        (30, 60, 30, 30, 30, 30),
        "link06",
    ),
)


def robots_folder() -> Path:
    """Where example-robot-data has put its descriptions, in the environment that generates."""
    found = importlib.util.find_spec("example_robot_data")
    if found is None:
        found = importlib.util.find_spec("numpy")
    if found is None or found.origin is None:
        raise FileNotFoundError("example-robot-data is not installed")
    site = next(p for p in Path(found.origin).parents if p.name == "site-packages")
    return site / "cmeel.prefix" / "share" / "example-robot-data" / "robots"


def nominal(maker: Maker) -> ET.Element:
    """The maker's description without meshes, fingers' motion and `<dynamics>`."""
    root = ET.parse(robots_folder() / maker.file).getroot()
    for tag in DROPPED:
        for element in root.findall(tag):
            root.remove(element)
    for link in root.findall("link"):
        for tag in ("visual", "collision"):
            for element in link.findall(tag):
                link.remove(element)
    for joint in root.findall("joint"):
        if any(word in joint.get("name", "") for word in ("finger", "ripper")):
            joint.set("type", "fixed")
        for tag in ("dynamics", "mimic", "safety_controller", "calibration"):
            for element in joint.findall(tag):
                joint.remove(element)
    return root


def joints_of(root: ET.Element) -> list[str]:
    """Names of the joints that move, from the base to the tip."""
    moving = [j for j in root.findall("joint") if j.get("type") in ("revolute", "continuous")]
    return [j.get("name", "") for j in moving]


def as_built(root: ET.Element, rng: np.random.Generator) -> ET.Element:
    """A copy whose links differ from the drawing by the factory's tolerance (cut at two sigma)."""
    root = copy.deepcopy(root)
    for inertial in root.iter("inertial"):
        mass, centre, moments = read_inertial(inertial)
        draw = np.clip(rng.standard_normal(5), -2.0, 2.0)
        factor = 1.0 + TOLERANCE * draw[0]
        centre = centre + TOLERANCE * np.linalg.norm(centre) / np.sqrt(3.0) * draw[1:4]
        write_inertial(inertial, mass * factor, centre, moments * factor * (1.0 + TOLERANCE * draw[4]))
    return root


def read_inertial(inertial: ET.Element) -> tuple[float, Array, Array]:
    """Mass [kg], centre [m] in the link's axes, and the six moments about it [kg.m^2]."""
    mass = float(_child(inertial, "mass").get("value", "0"))
    origin = inertial.find("origin")
    centre = np.array(
        [float(x) for x in (origin.get("xyz", "0 0 0") if origin is not None else "0 0 0").split()]
    )
    inertia = _child(inertial, "inertia")
    return mass, centre, np.array([float(inertia.get(k, "0")) for k in MOMENTS])


MOMENTS = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")


def write_inertial(inertial: ET.Element, mass: float, centre: Array, moments: Array) -> None:
    """Puts the numbers of a link's body back; the axes of its moments stay as they are."""
    _child(inertial, "mass").set("value", repr(float(mass)))
    origin = inertial.find("origin")
    if origin is None:
        origin = ET.SubElement(inertial, "origin", {"rpy": "0 0 0"})
    origin.set("xyz", " ".join(repr(float(x)) for x in centre))
    for key, value in zip(MOMENTS, moments, strict=True):
        _child(inertial, "inertia").set(key, repr(float(value)))


def add_body(root: ET.Element, link: str, mass: float, point: Array) -> ET.Element:
    """A copy with a small dense thing (a cube of steel's density) fixed to a link: what a tool is."""
    root = copy.deepcopy(root)
    side = (abs(mass) / 7800.0) ** (1.0 / 3.0)
    moment = repr(mass * side**2 / 6.0)
    body = ET.SubElement(root, "link", {"name": "stranger_tool"})
    inertial = ET.SubElement(body, "inertial")
    ET.SubElement(inertial, "origin", {"xyz": "0 0 0", "rpy": "0 0 0"})
    ET.SubElement(inertial, "mass", {"value": repr(mass)})
    ET.SubElement(inertial, "inertia", {k: moment if k in ("ixx", "iyy", "izz") else "0" for k in MOMENTS})
    joint = ET.SubElement(root, "joint", {"name": "stranger_bolt", "type": "fixed"})
    ET.SubElement(joint, "parent", {"link": link})
    ET.SubElement(joint, "child", {"link": "stranger_tool"})
    ET.SubElement(joint, "origin", {"xyz": " ".join(repr(float(x)) for x in point), "rpy": "0 0 0"})
    return root


def child_link(root: ET.Element, joint: str) -> str:
    """The link that a joint moves."""
    for element in root.findall("joint"):
        if element.get("name") == joint:
            return _child(element, "child").get("link", "")
    raise KeyError(joint)


def _child(element: ET.Element, tag: str) -> ET.Element:
    found = element.find(tag)
    if found is None:
        raise ValueError(f"<{element.tag}> without <{tag}>")
    return found
