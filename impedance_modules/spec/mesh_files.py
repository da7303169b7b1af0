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
    return next((path for path in places_of_mesh(urdf, name) if is_file(path)), None)


def places_of_mesh(urdf: Path, name: str) -> tuple[Path, ...]:
    """Lists where the file of a mesh is looked for, in this order; arguments as in ``find_mesh``."""
    if not name.startswith(PACKAGE):
        return (mesh_path(urdf, name),)
    package, _, rest = name.removeprefix(PACKAGE).partition("/")
    above = urdf.resolve().parents
    tried = [folder / package / rest for folder in above]
    return (*tried, *(folder / rest for folder in above if folder.name == package))


def folders_looked_in(urdf: Path, name: str) -> tuple[str, ...]:
    """Lists the folders in which a mesh was looked for; a package's folders by the name that they would have."""
    if not name.startswith(PACKAGE):
        return (str(mesh_path(urdf, name).parent),)
    package = name.removeprefix(PACKAGE).partition("/")[0]
    return tuple(str(folder / package) for folder in urdf.resolve().parents)


def mesh_path(urdf: Path, name: str) -> Path:
    """Gives the place that a name without a package means."""
    return urdf.resolve().parent / name.removeprefix(FILE)


def missing_mesh(urdf: Path, link: ET.Element) -> str | None:
    """Gives the name of a link's first collision mesh that is not there; None where all are."""
    names = [mesh.get("filename", "") for mesh in link.iterfind("collision/geometry/mesh")]
    return next((name for name in names if find_mesh(urdf, name) is None), None)
