# SPDX-License-Identifier: BSD-3-Clause
"""Collision shapes of a description as its maker ships it: meshes in packages, or not there at all.

Only what somebody asks for is read. A mesh becomes its convex hull (coal): distances of hulls are never larger than
those of what is inside, and a direction that separates them exists.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Collection
from pathlib import Path

import coal
import pinocchio as pin

from impedance_modules.errors import BadInput
from impedance_modules.spec.located_xml import parse_xml
from impedance_modules.spec.mesh_files import find_mesh


def read_geometry(model: pin.Model, urdf: Path, links: Collection[str] | None) -> pin.GeometryModel:
    """Builds the collision shapes of links, without pairs.

    Args:
        model: Of all joints of the description.
        urdf: The description, which its reader has checked.
        links: Names of those whose shapes are asked for; None for all, as far as their meshes are there.

    Raises:
        BadInput: A mesh of one of ``links`` is not there, or a shape cannot be read.
    """
    root, _ = parse_xml(urdf)
    for link in root.iter("link"):
        _keep_readable(link, urdf, links)
    text = ET.tostring(root, encoding="unicode")
    try:
        found = pin.buildGeomFromUrdfString(model, text, pin.GeometryType.COLLISION)
    except (ValueError, RuntimeError) as error:
        raise BadInput(f"{urdf}: a collision shape cannot be read: {error}") from None
    for shape in found.geometryObjects:
        if isinstance(shape.geometry, coal.BVHModelBase):
            shape.geometry = _hull(shape.geometry, f"{urdf}: shape '{shape.name}'")
    return found


def _hull(mesh: coal.BVHModelBase, where: str) -> coal.ConvexBase:
    """Computes the convex hull of a mesh's corners.

    Not ``buildConvexRepresentation``: it takes the mesh for convex as it is, and of one that is not, distances are
    too large by as much as the mesh is long.
    """
    try:
        mesh.buildConvexHull(True, "Qt")
    except (ValueError, RuntimeError) as error:  # all corners in one plane, say
        raise BadInput(f"{where}: its mesh has no convex hull: {error}") from None
    return mesh.convex


def _keep_readable(link: ET.Element, urdf: Path, links: Collection[str] | None) -> None:
    """Takes away what is not asked for, and where all is asked for what is not there; writes meshes' whole paths."""
    for shape in link.findall("collision"):
        mesh = shape.find("geometry/mesh")
        path = None if mesh is None else find_mesh(urdf, mesh.get("filename", ""))
        there = mesh is None or path is not None
        if not (there if links is None else link.get("name") in links):
            link.remove(shape)
        elif mesh is not None and path is not None:
            mesh.set("filename", str(path))
