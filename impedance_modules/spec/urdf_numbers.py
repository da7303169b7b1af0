# SPDX-License-Identifier: BSD-3-Clause
"""Every number of a URDF that somebody computes with later: there, finite, and of the right sign.

``rpy="inf"``, a position of one number or a word for an axis would otherwise come to light inside a library, without
a line, or as a number that spreads.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator

from impedance_modules.input_files import is_file
from impedance_modules.spec.located_xml import Faults
from impedance_modules.spec.mesh_files import mesh_path

_OF_ORIGIN = ("xyz", "rpy")
_INERTIA = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
_SIZES = {"sphere": ("radius",), "cylinder": ("radius", "length"), "capsule": ("radius", "length")}
_OF_JOINT = {
    "dynamics": ("damping", "friction"),
    "mimic": ("multiplier", "offset"),
    "calibration": ("rising", "falling", "reference_position"),
    "safety_controller": ("soft_lower_limit", "soft_upper_limit", "k_position", "k_velocity"),
}
"""Elements of a joint that the simulation may read; none of their numbers must be there."""


def check_numbers(root: ET.Element, faults: Faults) -> None:
    """Notes every number of links and joints that cannot be used; limits and masses are read elsewhere."""
    for joint in root.findall("joint"):
        _check_origins(joint, faults)
        for axis in joint.findall("axis"):
            values = faults.vector(axis, "xyz")
            if values and max(map(abs, values)) < 1e-9 and joint.get("type") != "fixed":
                faults.add(axis, "<axis> has no direction (valid: not all of its numbers 0)")
        for tag, keys in _OF_JOINT.items():
            _check_optional(joint.findall(tag), keys, faults)
    for link in root.findall("link"):
        for part in _parts(link):
            _check_origins(part, faults)
            _check_shapes(part, faults)
        _check_optional(link.findall("inertial/inertia"), _INERTIA, faults)


def _parts(link: ET.Element) -> Iterator[ET.Element]:
    for tag in ("inertial", "visual", "collision"):
        yield from link.findall(tag)


def _check_origins(element: ET.Element, faults: Faults) -> None:
    for origin in element.findall("origin"):
        for key in _OF_ORIGIN:
            if key in origin.attrib:
                faults.vector(origin, key)


def _check_optional(elements: list[ET.Element], keys: tuple[str, ...], faults: Faults) -> None:
    for element in elements:
        for key in keys:
            if key in element.attrib:
                faults.number(element, key)


def _check_shapes(part: ET.Element, faults: Faults) -> None:
    for shape in part.findall("geometry/*"):
        if shape.tag == "box" and any(size < 0.0 for size in faults.vector(shape, "size")):
            faults.add(shape, "<box> has a negative size (valid: at least 0)")
        for key in _SIZES.get(shape.tag, ()):
            faults.number(shape, key, least=0.0)
        if shape.tag == "mesh":
            _check_mesh(shape, faults)


def _check_mesh(mesh: ET.Element, faults: Faults) -> None:
    """A mesh that is there is a file: a device would be read without end."""
    name = mesh.get("filename", "")
    path = mesh_path(faults.path, name)
    try:
        there = path.exists()
    except (OSError, ValueError):
        there = False
    if not name or (there and not is_file(path)):
        faults.add(mesh, f"<mesh> has the file {name[:60]!r} (valid: a regular file)")
    if "scale" in mesh.attrib:
        faults.vector(mesh, "scale")
