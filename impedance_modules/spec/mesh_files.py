# SPDX-License-Identifier: BSD-3-Clause
"""Where the meshes of a robot description are; many come without theirs."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

from impedance_modules.input_files import is_file

PACKAGE, FILE = "package://", "file://"


def find_mesh(urdf: Path, name: str) -> Path | None:
    """Finds the file of a mesh; None where it is not there.

    ``package://NAME/REST`` is NAME/REST below a folder that holds the description, however far up, or REST in such a
    folder that is itself called NAME; any other name is a path, from the description's folder.

    Args:
        urdf: The description.
        name: As its ``<mesh filename>`` says.
    """
    if not name.startswith(PACKAGE):
        path = mesh_path(urdf, name)
        return path if is_file(path) else None
    package, _, rest = name.removeprefix(PACKAGE).partition("/")
    above = urdf.resolve().parents
    tried = [folder / package / rest for folder in above]
    tried += [folder / rest for folder in above if folder.name == package]
    return next((path for path in tried if is_file(path)), None)


def mesh_path(urdf: Path, name: str) -> Path:
    """Gives the place that a name without a package means."""
    return urdf.resolve().parent / name.removeprefix(FILE)


def missing_mesh(urdf: Path, link: ET.Element) -> str | None:
    """Gives the name of a link's first collision mesh that is not there; None where all are."""
    names = [mesh.get("filename", "") for mesh in link.iterfind("collision/geometry/mesh")]
    return next((name for name in names if find_mesh(urdf, name) is None), None)
