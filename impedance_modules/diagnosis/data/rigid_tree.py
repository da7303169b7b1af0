# SPDX-License-Identifier: BSD-3-Clause
r"""The rigid bodies of a URDF as arrays: what moves, about which axis, with which inertia.

Only the joints that a recording names move; every other joint stays at zero, and whatever hangs on it is
fixed to the body that carries it. A body's inertia is ten numbers at its joint's origin,

    \pi = (m, m c_x, m c_y, m c_z, I_xx, I_xy, I_yy, I_xz, I_yz, I_zz),

in which the equations of motion are linear (Khalil and Dombre).
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from impedance_modules.arrays import Array
from impedance_modules.errors import BadInput, nearest
from impedance_modules.spec.located_xml import parse_xml
from impedance_modules.spec.urdf import UrdfLimits, read_urdf

TOLERANCE = 1e-6
"""Negative eigenvalue that round-off in a robot description explains, as a part of the largest one."""


@dataclass(frozen=True, eq=False)
class Body:
    """One moving body and the joint that carries it.

    Attributes:
        joint: Joint name.
        link: Link that the joint moves.
        parent: Index of the body that carries it; None for the base.
        rotation: (3, 3) joint frame in the parent's at angle zero.
        translation: (3,) its origin there [m].
        axis: (3,) unit axis in the joint frame.
        prismatic: Whether it slides [m] and is driven by a force [N].
        inertia: (10,) parameters at the joint's origin, of the link and of all that is fixed to it.
        own: (10,) likewise, of the link alone.
        limits: From the URDF; None where it gives none.
    """

    joint: str
    link: str
    parent: int | None
    rotation: Array
    translation: Array
    axis: Array
    prismatic: bool
    inertia: Array
    own: Array
    limits: UrdfLimits | None


@dataclass(frozen=True, eq=False)
class RigidTree:
    """All moving bodies, carriers first, in the order of every array of a diagnosis.

    Attributes:
        bodies: One per recorded joint.
        standing: Movable joints in the same chain as recorded ones that were not recorded, taken as fixed.
    """

    bodies: tuple[Body, ...]
    standing: tuple[str, ...] = ()

    @property
    def joints(self) -> tuple[str, ...]:
        """Joint names."""
        return tuple(body.joint for body in self.bodies)

    @property
    def inertia(self) -> Array:
        """All inertial parameters, (10 n,)."""
        return np.concatenate([body.inertia for body in self.bodies])

    def units(self) -> tuple[str, ...]:
        """Unit of each joint's torque or force."""
        return tuple("N" if body.prismatic else "N.m" for body in self.bodies)


def read_tree(urdf: Path, joints: Sequence[str]) -> RigidTree:
    """Reads the bodies that ``joints`` move.

    Raises:
        BadInput: The URDF cannot be read, or lacks one of the joints.
    """
    facts = read_urdf(urdf)
    movable = tuple(name for name, joint in facts.joints.items() if joint.moves)
    for joint in joints:
        if joint not in movable:
            raise BadInput(
                f"{urdf}: no moving joint '{joint}'{nearest(joint, movable)} (valid: {', '.join(movable)})"
            )
    root, _ = parse_xml(urdf)
    limits = {name: joint.limits for name, joint in facts.joints.items()}
    return _Walk(root, frozenset(joints), limits, movable).tree()


def pseudo_inertia(parameters: Array) -> Array:
    r"""Builds P (4, 4) [kg.m^2, kg.m, kg].

    Args:
        parameters: (10,) m, h, I_xx, I_xy, I_yy, I_xz, I_yz, I_zz at one origin.
    """
    m, h = parameters[0], parameters[1:4]
    xx, xy, yy, xz, yz, zz = parameters[4:]
    inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    out = np.empty((4, 4))
    out[:3, :3] = 0.5 * np.trace(inertia) * np.eye(3) - inertia
    out[:3, 3] = out[3, :3] = h
    out[3, 3] = m
    return out


def can_exist(nominal: Array, change: Array) -> bool:
    """Says whether a body whose parameters change by (10,) still can exist.

    A nominal description that is not physical itself (rounded, or careless) may not become less physical.
    """
    before = np.linalg.eigvalsh(pseudo_inertia(nominal))
    after = np.linalg.eigvalsh(pseudo_inertia(nominal + change))
    return bool(after[0] >= min(0.0, float(before[0])) - TOLERANCE * float(before[-1]))


class _Walk:
    """Walks a URDF from its root outwards."""

    def __init__(
        self,
        root: ET.Element,
        kept: frozenset[str],
        limits: Mapping[str, UrdfLimits | None],
        movable: Sequence[str],
    ) -> None:
        self._links = {link.attrib["name"]: link for link in root.findall("link")}
        self._children: dict[str, list[ET.Element]] = {name: [] for name in self._links}
        for joint in root.findall("joint"):
            self._children[_link(joint, "parent")].append(joint)
        below = {_link(joint, "child") for joint in root.findall("joint")}
        self._root = next(name for name in self._links if name not in below)
        self._kept, self._limits = kept, limits
        self._movable = frozenset(movable)
        self._standing: list[str] = []
        self._bodies: list[Body] = []
        self._inertia: list[Array] = []

    def tree(self) -> RigidTree:
        self._visit(self._root, None, np.eye(3), np.zeros(3))
        return RigidTree(
            tuple(
                Body(**{**vars(body), "inertia": inertia})
                for body, inertia in zip(self._bodies, self._inertia, strict=True)
            ),
            tuple(self._standing),
        )

    def _visit(self, link: str, body: int | None, rotation: Array, translation: Array) -> None:
        if body is not None:
            self._inertia[body] = self._inertia[body] + _inertia(self._links[link], rotation, translation)
        for joint in self._children[link]:
            turn, shift = _origin(joint.find("origin"))
            R, p = rotation @ turn, translation + rotation @ shift
            child = _link(joint, "child")
            name = joint.attrib["name"]
            if name not in self._kept:
                carried = len(self._bodies)
                self._visit(child, body, R, p)
                if name in self._movable and (body is not None or len(self._bodies) > carried):
                    self._standing.append(name)
                continue
            self._add(joint, child, body, R, p)
            self._visit(child, len(self._bodies) - 1, np.eye(3), np.zeros(3))

    def _add(self, joint: ET.Element, child: str, body: int | None, R: Array, p: Array) -> None:
        name = joint.attrib["name"]
        element = joint.find("axis")
        axis = _numbers(element.attrib["xyz"]) if element is not None else np.array([1.0, 0.0, 0.0])
        self._bodies.append(
            Body(
                joint=name,
                link=child,
                parent=body,
                rotation=R,
                translation=p,
                axis=axis / np.linalg.norm(axis),
                prismatic=joint.attrib["type"] == "prismatic",
                inertia=np.zeros(10),
                own=_inertia(self._links[child], np.eye(3), np.zeros(3)),
                limits=self._limits[name],
            )
        )
        self._inertia.append(np.zeros(10))


def _link(joint: ET.Element, end: str) -> str:
    element = joint.find(end)
    return "" if element is None else element.attrib["link"]


def _numbers(text: str) -> Array:
    return np.array([float(word) for word in text.split()])


def _origin(element: ET.Element | None) -> tuple[Array, Array]:
    if element is None:
        return np.eye(3), np.zeros(3)
    turn = Rotation.from_euler("xyz", _numbers(element.get("rpy", "0 0 0"))).as_matrix()
    return np.asarray(turn), _numbers(element.get("xyz", "0 0 0"))


def _inertia(link: ET.Element, rotation: Array, translation: Array) -> Array:
    """Ten parameters of one link, at the origin of the body that carries it."""
    element = link.find("inertial")
    if element is None:
        return np.zeros(10)
    mass_element, tensor = element.find("mass"), element.find("inertia")
    mass = 0.0 if mass_element is None else float(mass_element.attrib["value"])
    turn, shift = _origin(element.find("origin"))
    R, c = rotation @ turn, translation + rotation @ shift
    keys = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
    xx, xy, xz, yy, yz, zz = (0.0 if tensor is None else float(tensor.get(key, "0")) for key in keys)
    about = R @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ R.T
    about = about + mass * (c @ c * np.eye(3) - np.outer(c, c))
    second = about[[0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]]
    return np.concatenate([[mass], mass * c, second])
