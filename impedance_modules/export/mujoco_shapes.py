# SPDX-License-Identifier: BSD-3-Clause
r"""The geoms of a MuJoCo model with which something collides, as collision shapes of a URDF.

A geom collides where contype or conaffinity is not 0; groups are for pictures only. A geom at X_BG in a body that
stands at X_LB in its link becomes

    sphere, box, cylinder    themselves, at X_LB X_BG
    capsule                  a <cylinder> of its straight part that <collision_checking> lists as a capsule
    ellipsoid a >= b >= c    the capsule of radius b around it, 2 (a - b) long, along the axis of a
    mesh                     its file; MuJoCo collides with the convex hull, and so does ``robot.link_geometry``

The ellipsoid is inside: at a cos t along the axis its half width is at most b sin t, and (a cos t - a + b)^2 +
b^2 sin^2 t <= b^2 wherever a cos t > a - b. A mesh is moved before MuJoCo places it: a corner x of the file becomes
S R^T (x - c), with R, c of refquat and refpos and S = diag(scale).
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.export.body_inertia import rpy_of_rotation
from impedance_modules.export.edited_xml import number, numbers
from impedance_modules.export.geom_inertia import SIZES, placed_geom
from impedance_modules.export.mujoco_bodies import ORIENTATIONS, orientation, orientation_of, sized
from impedance_modules.export.mujoco_model import MujocoDescription

READABLE = (".stl", ".obj")
"""Mesh files that other programs than MuJoCo read."""

TURNED = 1e-12
"""Entries of a rotation that differ from those of none by less are none."""

Placement = tuple[Array, Array]
"""Rotation (3, 3) and place (3,) [m] of something in the link that it is fixed to."""


class MujocoShapes:
    """Writes geoms into links, and remembers what it left out."""

    def __init__(self, model: MujocoDescription) -> None:
        """Takes the model that the geoms are of."""
        self._model = model
        self._meshes = {
            _mesh_name(mesh): mesh for part in model.root.iter("asset") for mesh in part.iter("mesh")
        }
        self._pictures = 0
        self._rounded: list[str] = []
        self._left_out: dict[str, list[str]] = {}

    def add(self, link: ET.Element, geom: ET.Element, placed: Placement) -> None:
        """Adds a geom to a link as a collision shape, where it collides and a URDF has such a shape.

        Args:
            link: Of the URDF.
            geom: Of the model.
            placed: What the geom stands in, in the link.
        """
        model = self._model
        if not any(model.numbers(geom, key, (1.0,))[0] for key in ("contype", "conaffinity")):
            self._pictures += 1
            return
        kind = model.value(geom, "type") or "sphere"
        name = geom.get("name") or f"geom {len(link.findall('collision')) + 1} of {link.get('name')}"
        if len([key for key in ORIENTATIONS if model.holder(geom, key) is not None]) > 1:
            self._leave_out("turned in two ways, one by a default class", name)
        elif kind == "mesh":
            self._add_mesh(link, geom, name, placed)
        elif kind not in SIZES:
            self._leave_out(f"a {kind}, which a URDF does not have", name)
        elif model.value(geom, "mesh") is not None:
            self._leave_out(f"a {kind} that MuJoCo fits to a mesh", name)
        else:
            self._add_solid(link, geom, name, placed)

    def notes(self) -> Iterator[str]:
        """Says what became of geoms that are no shapes now."""
        if self._pictures:
            yield f"{self._pictures} geoms collide with nothing (contype and conaffinity are 0) and are left out"
        yield from self._rounded
        for reason, names in self._left_out.items():
            yield f"no collision shape, since it is {reason}: {', '.join(names)}"

    def _leave_out(self, reason: str, name: str) -> None:
        self._left_out.setdefault(reason, []).append(name)

    def _add_solid(self, link: ET.Element, geom: ET.Element, name: str, placed: Placement) -> None:
        kind = self._model.value(geom, "type") or "sphere"
        R, p, size = placed_geom(self._model, geom, kind)
        if np.any(size[: SIZES[kind]] <= 0.0):
            self._leave_out("of no size", name)
            return
        if kind == "ellipsoid":
            a, b, c = np.sort(size[:3])[::-1]
            order = np.argsort(size[:3], kind="stable")
            R = R @ _cyclic(int(order[2]))
            kind, size = "capsule", np.array([b, a - b])
            self._rounded.append(
                f"the ellipsoid {name} becomes the capsule around it, up to {1e3 * (b - c):.3g} mm wider across its"
                " shortest axis"
            )
        geometry = self._collision(link, _in_link(placed, R, p), capsule=kind == "capsule")
        if kind == "sphere":
            ET.SubElement(geometry, "sphere", radius=number(float(size[0])))
        elif kind == "box":
            ET.SubElement(geometry, "box", size=numbers(2.0 * size[:3]))
        else:
            radius, length = number(float(size[0])), number(2.0 * float(size[1]))
            ET.SubElement(geometry, "cylinder", radius=radius, length=length)

    def _collision(self, link: ET.Element, placed: Placement, *, capsule: bool) -> ET.Element:
        """Adds a <collision>; returns its <geometry>."""
        R, p = placed
        name = f"{link.get('name')} {len(link.findall('collision')) + 1}"
        shape = ET.SubElement(link, "collision", name=name)
        ET.SubElement(shape, "origin", xyz=numbers(p), rpy=numbers(rpy_of_rotation(R)))
        if capsule:
            list_as_capsule(link, name)
        return ET.SubElement(shape, "geometry")

    def _add_mesh(self, link: ET.Element, geom: ET.Element, name: str, placed: Placement) -> None:
        model = self._model
        mesh = self._meshes.get(model.value(geom, "mesh") or "")
        file = None if mesh is None else mesh.get("file")
        if mesh is None or file is None:
            self._leave_out("a mesh without a file", name)
            return
        if not file.lower().endswith(READABLE):
            self._leave_out(f"a mesh in a file that is none of {', '.join(READABLE)}", name)
            return
        scale = sized(model, mesh, "scale", (1.0, 1.0, 1.0))
        centre = sized(model, mesh, "refpos", (0.0, 0.0, 0.0))
        turn = _reference_rotation(model, mesh)
        if np.ptp(scale) > 0.0 and np.max(np.abs(turn - np.eye(3))) > TURNED:
            self._leave_out("a mesh that is turned (refquat) before it is scaled unevenly", name)
            return
        R, p = orientation_of(model, geom), sized(model, geom, "pos", (0.0, 0.0, 0.0))
        corner = -scale * (turn.T @ centre)
        geometry = self._collision(link, _in_link(placed, R @ turn.T, p + R @ corner), capsule=False)
        found = ET.SubElement(geometry, "mesh", filename=str(self._file(file)))
        if np.any(scale != 1.0):
            found.set("scale", numbers(scale))

    def _file(self, name: str) -> Path:
        """The file of a mesh: in meshdir, else in assetdir, from the model's folder."""
        model = self._model
        if model.setting("compiler", "strippath") == "true":
            name = Path(name).name
        folder = model.setting("compiler", "meshdir") or model.setting("compiler", "assetdir") or ""
        return model.faults.path.resolve().parent / folder / name


def list_as_capsule(link: ET.Element, name: str) -> None:
    """Lists a <cylinder> of a link as one with a half-sphere on each end; pinocchio reads the first list only."""
    listed = link.find("collision_checking")
    if listed is None:
        listed = ET.SubElement(link, "collision_checking")
    ET.SubElement(listed, "capsule", name=name)


def _in_link(placed: Placement, R: Array, p: Array) -> Placement:
    turn, place = placed
    return turn @ R, place + turn @ p


def _cyclic(axis: int) -> Array:
    """The rotation (3, 3) whose third column is a coordinate axis."""
    return np.roll(np.eye(3), axis - 2, axis=0)


def _mesh_name(mesh: ET.Element) -> str:
    return mesh.get("name") or Path(mesh.get("file", "")).stem


def _reference_rotation(model: MujocoDescription, mesh: ET.Element) -> Array:
    """The rotation of refquat (3, 3)."""
    quat = numbers(sized(model, mesh, "refquat", (1.0, 0.0, 0.0, 0.0)))
    return orientation(model, ET.Element("mesh", quat=quat))
