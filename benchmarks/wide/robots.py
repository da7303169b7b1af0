# SPDX-License-Identifier: BSD-3-Clause
"""The arms: read from their makers' URDFs, or made up here; as plain links, with drives whose numbers are invented.

An arm is what a stranger has: links in any orientation of the base, limits, and either a bare URDF with ideal drives
or a robot file that states rotors, damping, springs and sensors.
"""

from __future__ import annotations

import sysconfig
import xml.etree.ElementTree as ET
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.blind.arm_model import REPOSITORY, Inertial, Link, turned
from benchmarks.wide.frozen import PANDA

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Machine:
    """Links and limits of an arm.

    Attributes:
        name: Of the robot.
        links: Parents first; the first hangs on ``world``.
        hand: Last link that has a mass.
        position_min, position_max, velocity_max, effort_max: (n,) [rad, rad/s, N.m].
        payload: Mass that it may carry [kg].
    """

    name: str
    links: tuple[Link, ...]
    hand: str
    position_min: Array
    position_max: Array
    velocity_max: Array
    effort_max: Array
    payload: float

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the moving joints, from the base outwards."""
        return tuple(link.joint for link in self.links if link.joint is not None)


MOUNTS: dict[str, tuple[float, float, float]] = {
    "table": (0.0, 0.0, 0.0),
    "ceiling": (float(np.pi), 0.0, 0.4),
    "wall": (0.0, float(np.pi / 2), 0.0),
    "tilted": (0.35, -0.25, 0.8),
}
"""Roll, pitch, yaw of the base in the world [rad]."""


def mounted(machine: Machine, mount: str) -> Machine:
    """Returns the arm on a base of some orientation."""
    base = Link("mount", "world", None, np.zeros(3), np.array(MOUNTS[mount]), np.array([0.0, 0.0, 1.0]), None)
    first = replace(machine.links[0], parent="mount")
    return replace(machine, links=(base, first, *machine.links[1:]))


def example_folder() -> Path:
    """Returns the folder of the example-robot-data package."""
    return Path(sysconfig.get_path("purelib")) / "cmeel.prefix/share/example-robot-data/robots"


def read_machine(
    name: str, urdf: Path, first: str, last: str, payload: float, torque: float | None = None
) -> Machine:
    """Reads the chain of joints from link ``first`` to link ``last`` and everything that is fixed to it.

    Joints off the chain (fingers, another arm) are taken as fixed at zero.

    Args:
        name: Of the robot.
        urdf: The file.
        first: Link on which the chain begins.
        last: Link at its end.
        payload: Mass that it may carry [kg].
        torque: Largest torque of all joints [N.m], where the file's is not the machine's.
    """
    root = ET.parse(urdf).getroot()
    inertials = {one.attrib["name"]: _inertial(one) for one in root.iter("link")}
    tags = [one for one in root.findall("joint") if one.find("parent") is not None]
    by_child = {_named(one, "child"): one for one in tags}
    chain, at = set(), last
    while at != first:
        chain.add(at)
        at = _named(by_child[at], "parent")
    links, limits, waiting = [], [], [first]
    links.append(
        Link(first, "world", None, np.zeros(3), np.zeros(3), np.array([0.0, 0.0, 1.0]), inertials[first])
    )
    while waiting:
        parent = waiting.pop(0)
        for tag in (one for one in tags if _named(one, "parent") == parent):
            child = _named(tag, "child")
            moves = child in chain and tag.attrib["type"] != "fixed"
            links.append(_link(tag, child, parent, inertials[child], moves))
            waiting.append(child)
            if moves:
                limits.append(_limits(tag))
    low, high, speed, effort = np.array(limits).T
    hand = [link for link in links if link.name in chain and link.inertial is not None][-1].name
    most = effort if torque is None else np.full(effort.size, torque)
    return Machine(
        name, tuple(links), hand, np.maximum(low, -3.0), np.minimum(high, 3.0), speed, most, payload
    )


def _named(tag: ET.Element, part: str) -> str:
    found = tag.find(part)
    if found is None:
        raise ValueError(f"joint {tag.attrib.get('name')}: no <{part}>")
    return found.attrib["link"]


def _numbers(tag: ET.Element | None, key: str, absent: tuple[float, float, float]) -> Array:
    if tag is None or key not in tag.attrib:
        return np.array(absent)
    return np.array([float(word) for word in tag.attrib[key].split()])


def _link(tag: ET.Element, child: str, parent: str, inertial: Inertial | None, moves: bool) -> Link:
    origin = tag.find("origin")
    place, rpy = _numbers(origin, "xyz", (0, 0, 0)), _numbers(origin, "rpy", (0, 0, 0))
    axis = _numbers(tag.find("axis"), "xyz", (1, 0, 0))
    return Link(child, parent, tag.attrib["name"] if moves else None, place, rpy, axis, inertial)


def _limits(tag: ET.Element) -> tuple[float, float, float, float]:
    limit = tag.find("limit")
    if limit is None:
        raise ValueError(f"joint {tag.attrib['name']}: no <limit>")
    keys = ("lower", "upper", "velocity", "effort")
    low, high, speed, effort = (float(limit.attrib.get(key, 0.0)) for key in keys)
    return (low, high, speed, effort) if high > low else (-3.0, 3.0, speed, effort)


def _inertial(tag: ET.Element) -> Inertial | None:
    part = tag.find("inertial")
    if part is None:
        return None
    tensor, mass, origin = part.find("inertia"), part.find("mass"), part.find("origin")
    if tensor is None or mass is None or float(mass.attrib["value"]) <= 0.0:
        return None
    xx, yy, zz, xy, xz, yz = (float(tensor.attrib[key]) for key in ("ixx", "iyy", "izz", "ixy", "ixz", "iyz"))
    turn = turned(_numbers(origin, "rpy", (0, 0, 0)))
    inertia = turn @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ turn.T
    return Inertial(float(mass.attrib["value"]), _numbers(origin, "xyz", (0, 0, 0)), inertia)


def rod(mass: float, length: float, radius: float, along: int) -> Inertial:
    """Returns a solid cylinder along an axis (0 x, 1 y, 2 z) that begins at the joint."""
    across, about = mass * (3 * radius**2 + length**2) / 12, 0.5 * mass * radius**2
    moments, com = np.full(3, across), np.zeros(3)
    moments[along], com[along] = about, 0.5 * length
    return Inertial(mass, com, np.diag(moments))


def planar(n: int) -> Machine:
    """Makes an arm of n equal links that swings in a vertical plane."""
    mass, length = 2.0, 0.4
    up, links = np.array([0.0, 1.0, 0.0]), []
    links.append(Link("base", "world", None, np.zeros(3), np.zeros(3), up, None))
    for i in range(n):
        place = np.array([0.0, 0.0, 0.3 if i == 0 else length])
        lean = np.array([0.0, 0.5 * np.pi if i == 0 else 0.0, 0.0])
        links.append(
            Link(
                f"bar_{i + 1}", links[-1].name, f"hinge_{i + 1}", place, lean, up, rod(mass, length, 0.03, 2)
            )
        )
    most = np.array([60.0, 40.0, 20.0])[:n]
    ones = np.ones(n)
    return Machine(
        f"planar_{n}", tuple(links), links[-1].name, -2.0 * ones, 2.0 * ones, 3.0 * ones, most, 1.5
    )


HEAVY = (
    ("waist", (0.0, 0.0, 0.3), (0, 0, 1), 420.0, 0.6, 0.35, 2, 1.8, 9900.0),
    ("shoulder", (0.35, 0.0, 0.4), (0, 1, 0), 170.0, 1.1, 0.15, 2, 1.6, 9900.0),
    ("elbow", (0.0, 0.0, 1.1), (0, 1, 0), 140.0, 0.9, 0.14, 0, 1.7, 7000.0),
    ("forearm", (0.9, 0.0, -0.05), (1, 0, 0), 55.0, 0.3, 0.12, 0, 2.0, 1800.0),
    ("wrist", (0.3, 0.0, 0.0), (0, 1, 0), 40.0, 0.2, 0.1, 0, 2.0, 1800.0),
    ("flange", (0.2, 0.0, 0.0), (1, 0, 0), 20.0, 0.1, 0.1, 0, 3.0, 900.0),
)
"""An arm of the size of those that carry cars: joint, place, axis, mass, length, radius, along, speed, torque."""


def heavy() -> Machine:
    """Makes the arm of `HEAVY`; its numbers are invented, its size is that of arms for 300 kg."""
    links = [Link("base", "world", None, np.zeros(3), np.zeros(3), np.array([0.0, 0.0, 1.0]), None)]
    for name, place, axis, mass, length, radius, along, _, _ in HEAVY:
        body = rod(mass, length, radius, along)
        links.append(
            Link(
                f"{name}_link",
                links[-1].name,
                name,
                np.array(place),
                np.zeros(3),
                np.array(axis, float),
                body,
            )
        )
    speed, effort = np.array([row[7] for row in HEAVY]), np.array([row[8] for row in HEAVY])
    reach = np.array([2.5, 1.0, 1.2, 2.8, 2.0, 2.8])
    return Machine("heavy_arm", tuple(links), links[-1].name, -reach, reach, speed, effort, 100.0)


def _baxter() -> Machine:
    urdf = REPOSITORY / "robots/baxter/baxter.urdf"
    return read_machine("baxter_arm", urdf, "left_arm_mount", "left_hand", 2.2)


def _universal(size: int) -> Machine:
    urdf = example_folder() / f"ur_description/urdf/ur{size}_robot.urdf"
    return read_machine(f"ur{size}", urdf, "base_link", "ee_link", float(size))


def _small() -> Machine:
    urdf = example_folder() / "so_arm_description/urdf/so100.urdf"
    return replace(_slow_joints_freed(read_machine("so100", urdf, "base", "gripper", 0.2, 3.0)), payload=0.2)


def _slow_joints_freed(machine: Machine) -> Machine:
    return replace(machine, velocity_max=np.full(len(machine.joints), 4.0))


def _panda() -> Machine:
    return read_machine("panda", example_folder() / PANDA, "panda_link0", "panda_hand", 3.0)


ROBOTS: dict[str, Callable[[], Machine]] = {
    "baxter": _baxter,
    "ur5": lambda: _universal(5),
    "ur10": lambda: _universal(10),
    "so100": _small,
    "heavy_arm": heavy,
    "planar_1": lambda: planar(1),
    "planar_2": lambda: planar(2),
    "planar_3": lambda: planar(3),
    "panda": _panda,
}
