# SPDX-License-Identifier: BSD-3-Clause
"""The URDF of a robot folder: one description, or several copies of it on one base.

What a controller needs is kept: links with inertia and collision shapes, joints with their limits. Pictures,
transmissions and what simulators add are left out. Numbers stay as the file writes them.
"""

from __future__ import annotations

import math
import shutil
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from impedance_modules.errors import BadInput
from impedance_modules.export.body_inertia import rotation_of_rpy, rpy_of_rotation
from impedance_modules.export.edited_xml import number, numbers
from impedance_modules.export.mujoco_shapes import list_as_capsule
from impedance_modules.new_robot.copy_names import CopyNames
from impedance_modules.new_robot.source_description import SourceDescription
from impedance_modules.robot.capsule_fit import Capsule, capsule_of_mesh
from impedance_modules.spec.located_xml import read_number
from impedance_modules.spec.mesh_files import find_mesh

SHAPES = ("meshes", "capsules", "none")
"""What becomes of collision meshes: copied beside the robot file, a capsule around each, or no shapes at all."""

MESHES = "meshes"
"""Folder of copied meshes."""

KEPT_OF_JOINT = ("origin", "parent", "child", "axis", "limit", "mimic")

Base = tuple[float, float, float, float, float, float]
"""Where a copy stands: x, y, z [m], roll, pitch, yaw [rad]."""


@dataclass(frozen=True)
class JointLimits:
    """Limits that a joint of an arm gets: [rad], [rad/s], [N.m]."""

    lower: float
    upper: float
    velocity: float
    effort: float


class Copies:
    """Writes copies of a description into one tree.

    Attributes:
        root: The <robot> that is written.
        missing: Links whose collision mesh is not there.
        shaped: Links that have a collision shape.
    """

    def __init__(
        self,
        description: SourceDescription,
        name: str,
        shapes: str,
        folder: Path,
        names_of_copies: Sequence[CopyNames],
    ) -> None:
        """Begins an empty tree.

        Args:
            description: What is copied.
            name: The robot's.
            shapes: One of ``SHAPES``.
            folder: Where meshes are copied to.
            names_of_copies: Of all copies.
        """
        self._namings = tuple(names_of_copies)
        self.root = ET.Element("robot", name=name)
        self.missing: dict[str, str] = {}
        self.shaped: list[str] = []
        self._description, self._shapes, self._folder = description, shapes, folder
        self._meshes: dict[Path, str] = {}

    def add_base(self, bases: Sequence[tuple[CopyNames, Base]]) -> None:
        """Adds the link that copies stand on, and a fixed joint to each."""
        ET.SubElement(self.root, "link", name=self.base)
        children = {joint.child for joint in self._description.facts.joints.values()}
        (top,) = (link for link in self._description.facts.links if link not in children)
        for naming, (x, y, z, *angles) in bases:
            joint = ET.SubElement(self.root, "joint", name=naming("mount"), type="fixed")
            ET.SubElement(joint, "parent", link=self.base)
            ET.SubElement(joint, "child", link=naming(top))
            ET.SubElement(joint, "origin", xyz=numbers([x, y, z]), rpy=numbers(angles))

    @property
    def base(self) -> str:
        """Name of the link that copies stand on."""
        taken = {naming(link) for naming in self._namings for link in self._description.facts.links}
        return next(name for name in ("base", "mounting_plate") if name not in taken)

    def add_copy(self, naming: CopyNames, limits: Mapping[str, JointLimits], fixed: Sequence[str]) -> None:
        """Adds one copy.

        Args:
            naming: Of its links and joints.
            limits: Joint of an arm, as the description names it -> limits.
            fixed: Joints that become fixed ones.
        """
        for link in self._description.root.findall("link"):
            self._add_link(link, naming)
        for joint in self._description.root.findall("joint"):
            self._add_joint(joint, naming, limits.get(str(joint.get("name"))), fixed)

    def _add_link(self, link: ET.Element, naming: CopyNames) -> None:
        name = str(link.get("name"))
        added = ET.SubElement(self.root, "link", name=naming(name))
        mass = link.find("inertial/mass")
        if mass is not None and (read_number(mass.get("value", "")) or 0.0) > 0.0:
            added.extend(_copied(part) for part in link.findall("inertial"))
        if self._shapes == "none":
            return
        for index, shape in enumerate(link.findall("collision")):
            kept = self._shape(shape, f"{naming(name)} {index + 1}", added)
            if not kept:
                self.missing[name] = str(_mesh_name(shape))
        for capsule in link.findall("collision_checking/capsule"):
            list_as_capsule(added, str(capsule.get("name")))
        if added.find("collision") is not None:
            self.shaped.append(naming(name))

    def _shape(self, shape: ET.Element, name: str, link: ET.Element) -> bool:
        """Adds a collision shape; False where its mesh is not there."""
        mesh_name = _mesh_name(shape)
        if mesh_name is None:
            link.append(_copied(shape))
            return True
        path = find_mesh(self._description.path, mesh_name)
        if path is None:
            return False
        if self._shapes == "capsules":
            _add_capsule(link, name, shape, capsule_of_mesh(path, _scale(shape)))
            return True
        added = _copied(shape)
        mesh = added.find("geometry/mesh")
        if mesh is not None:
            mesh.set("filename", self._copied_mesh(path))
        link.append(added)
        return True

    def _copied_mesh(self, path: Path) -> str:
        """Copies a mesh once; returns its name from the robot's folder."""
        if path not in self._meshes:
            folder = self._folder / MESHES
            folder.mkdir(exist_ok=True)
            taken = set(self._meshes.values())
            names = [f"{MESHES}/{path.name}", *(f"{MESHES}/{i}-{path.name}" for i in range(len(taken) + 1))]
            name = next(name for name in names if name not in taken)
            shutil.copyfile(path, self._folder / name)
            self._meshes[path] = name
        return self._meshes[path]

    def _add_joint(
        self, joint: ET.Element, naming: CopyNames, limits: JointLimits | None, fixed: Sequence[str]
    ) -> None:
        name = str(joint.get("name"))
        added = ET.SubElement(self.root, "joint", name=naming(name), type=str(joint.get("type")))
        added.extend(_copied(part) for part in joint if part.tag in KEPT_OF_JOINT)
        for part in (*added.findall("parent"), *added.findall("child")):
            part.set("link", naming(str(part.get("link"))))
        for part in added.findall("mimic"):
            part.set("joint", naming(str(part.get("joint"))))
        if name in fixed:
            added.set("type", "fixed")
            for tag in ("axis", "limit", "mimic"):
                for part in added.findall(tag):
                    added.remove(part)
        if limits is not None:
            added.set("type", "revolute")
            for part in added.findall("limit"):
                added.remove(part)
            values = {key: number(getattr(limits, key)) for key in ("lower", "upper", "velocity", "effort")}
            ET.SubElement(added, "limit", values)

    def text(self, heading: str) -> str:
        """Writes the tree, with a comment on top."""
        ET.indent(self.root)
        return f'<?xml version="1.0"?>\n<!--\n{heading}\n-->\n{ET.tostring(self.root, encoding="unicode")}\n'


def _copied(element: ET.Element) -> ET.Element:
    """Copies an element without the spaces around it."""
    added = ET.Element(element.tag, dict(element.attrib))
    added.extend(_copied(part) for part in element)
    return added


def _mesh_name(shape: ET.Element) -> str | None:
    mesh = shape.find("geometry/mesh")
    return None if mesh is None else mesh.get("filename", "")


def _scale(shape: ET.Element) -> np.ndarray:
    mesh = shape.find("geometry/mesh")
    words = ("1 1 1" if mesh is None else mesh.get("scale", "1 1 1")).split()
    values = [read_number(word) for word in words]
    if len(values) != 3 or any(value is None or value == 0.0 for value in values):
        raise BadInput(
            f"a collision mesh has the scale {' '.join(words)[:60]!r} (valid: three numbers, none 0)"
        )
    return np.array(values, dtype=np.float64)


def _add_capsule(link: ET.Element, name: str, shape: ET.Element, capsule: Capsule) -> None:
    """Adds a capsule in place of a mesh: a cylinder along z that is listed as one with half-spheres."""
    X = _origin(shape)
    centre = X[:3, :3] @ capsule.centre + X[:3, 3]
    R = X[:3, :3] @ _turned_to(capsule.axis)
    added = ET.SubElement(link, "collision", name=name)
    rounded = [[round(value, 4) for value in triple] for triple in (centre, rpy_of_rotation(R))]
    ET.SubElement(added, "origin", xyz=numbers(rounded[0]), rpy=numbers(rounded[1]))
    geometry = ET.SubElement(added, "geometry")
    # Rounded up, to whole millimetres: a capsule may be larger than its mesh, and not smaller.
    sizes = {"radius": capsule.radius, "length": capsule.length}
    up = {key: number(math.ceil(1e3 * size + 0.3) / 1e3) for key, size in sizes.items()}
    ET.SubElement(geometry, "cylinder", up)
    list_as_capsule(link, name)


def _origin(shape: ET.Element) -> np.ndarray:
    X = np.eye(4)
    origin = shape.find("origin")
    if origin is not None:
        X[:3, 3] = [float(word) for word in origin.get("xyz", "0 0 0").split()]
        X[:3, :3] = rotation_of_rpy([float(word) for word in origin.get("rpy", "0 0 0").split()])
    return X


def _turned_to(axis: np.ndarray) -> np.ndarray:
    """A rotation whose third column is an axis."""
    other = np.eye(3)[int(np.argmin(np.abs(axis)))]
    x = np.cross(other, axis)
    x = x / np.linalg.norm(x)
    return np.column_stack([x, np.cross(axis, x), axis])
