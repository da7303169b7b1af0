# SPDX-License-Identifier: BSD-3-Clause
"""Reads the triangles of a surface from an STL or OBJ file, and says what is wrong with them as a closed body.

STL (StereoLithography interface, 3D Systems 1989) repeats every corner; OBJ (Wavefront) numbers them. Corners of equal
coordinates are one vertex. A closed body has, for every edge a -> b of a triangle, one neighbour that has b -> a:
then each edge has two triangles, all turn the same way round, and the volume

    V = sum x_1 . (x_2 x x_3) / 6          over all triangles, against the clock as seen from outside

is above zero.
"""

from __future__ import annotations

import itertools
import struct
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from impedance_modules.errors import BadInput
from impedance_modules.input_files import read_input
from impedance_modules.spec.located_xml import LARGEST_NUMBER, read_number
from impedance_modules.spec.task import Matrix, MeshSpec

LARGEST_FILE = 30_000_000
"""Of a mesh [bytes]."""

MOST_TRIANGLES, MOST_BODIES = 100_000, 1000

FARTHEST, SMALLEST = 20.0, 1e-3
"""How far from its origin a mesh may reach, and how long it must at least be [m]."""

FLAT = 1e-10
"""A triangle whose area is below so much of its longest edge's square has none."""

HEADER, RECORD = 80, 50
"""Bytes before the count of a binary STL, and of each of its triangles."""

STL_WORDS = frozenset({"solid", "facet", "outer", "endloop", "endfacet", "endsolid"})
OBJ_WORDS = frozenset({"vn", "vt", "o", "g", "s", "usemtl", "mtllib", "l", "p"})
"""What says nothing about where the triangles are."""

Indices = NDArray[np.int64]


def mesh_path(task: Path, file: str) -> Path:
    """Gives the place of a mesh that a task names; a relative path begins at the task's folder."""
    return task.resolve().parent / file


def read_mesh(path: Path, file: str, scale: float) -> MeshSpec:
    """Reads a mesh.

    Args:
        path: Of the file.
        file: Its name in the task.
        scale: Metres per unit of its numbers.

    Raises:
        BadInput: It is missing, too large, not of its format, has numbers that are not finite, no triangle or too many.
    """
    raw = read_input(path, LARGEST_FILE, near=_meshes_beside(path))
    corners = _obj_corners(path, raw) if path.suffix.lower() == ".obj" else _stl_corners(path, raw)
    if not len(corners):
        raise BadInput(f"{path}: has no triangle (valid: a closed body of triangles)")
    sound = (np.abs(corners) <= LARGEST_NUMBER).all(axis=(1, 2))
    if not sound.all():
        first = int(np.flatnonzero(~sound)[0]) + 1
        raise BadInput(
            f"{path}: triangle {first} has a coordinate that is not finite (valid: at most {LARGEST_NUMBER:g} in size)"
        )
    # Adding zero makes -0.0 the same number as 0.0.
    places, index = np.unique(corners.reshape(-1, 3) + 0.0, axis=0, return_inverse=True)
    return MeshSpec(file, scale * places, index.reshape(-1, 3).astype(np.int64))


def _meshes_beside(path: Path) -> str:
    """Names the meshes in a folder, for a message that one is not there."""
    try:
        found = sorted(file.name for file in path.parent.iterdir() if file.suffix.lower() in {".stl", ".obj"})
    except (OSError, ValueError):
        return ""
    return f"; meshes there: {', '.join(found[:5])}" if found else ""


def mesh_faults(mesh: MeshSpec) -> Iterator[str]:
    """Says everything that keeps a mesh from being a closed body of a sensible size, one sentence each."""
    found = [*_size_faults(mesh), *_flat_triangles(mesh), *_edge_faults(mesh)]
    # Where an edge has no neighbour on its other side there is no volume to speak of.
    yield from found or _volume_faults(mesh)


def _size_faults(mesh: MeshSpec) -> Iterator[str]:
    farthest = float(np.abs(mesh.vertices).max())
    longest = float(np.ptp(mesh.vertices, axis=0).max())
    if farthest > FARTHEST:
        yield (
            f"reaches {farthest:.4g} m from its origin (valid: at most {FARTHEST:g} m; of a file in millimetres: "
            "`scale: 0.001`)"
        )
    elif longest < SMALLEST:
        yield f"is only {longest:.3g} m long (valid: at least {SMALLEST:g} m; `scale` is metres per unit)"


def _flat_triangles(mesh: MeshSpec) -> Iterator[str]:
    a, b, c = (mesh.vertices[mesh.triangles[:, k]] for k in range(3))
    area = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
    longest = np.max([np.sum(side**2, axis=1) for side in (b - a, c - b, a - c)], axis=0)
    found = np.flatnonzero(area <= FLAT * longest)
    if found.size:
        yield (
            f"triangle {found[0] + 1} has no area{_and_more(found.size)}: its corners lie on one line, near "
            f"{_place(a[found[0]])}"
        )


def _edge_faults(mesh: MeshSpec) -> Iterator[str]:
    """Finds edges that do not belong to two triangles which turn the same way round."""
    count = len(mesh.vertices)
    ends = np.concatenate([mesh.triangles[:, [k, (k + 1) % 3]] for k in range(3)])
    low, high = ends.min(axis=1), ends.max(axis=1)
    edges, which, used = np.unique(low * count + high, return_inverse=True, return_counts=True)
    forwards = np.bincount(which, weights=ends[:, 0] < ends[:, 1], minlength=len(edges))
    told = (
        (used == 1, "is open: only one triangle has the edge from {} to {}{}"),
        (used > 2, "has an edge of more than two triangles, from {} to {}{}"),
        (
            (used == 2) & (forwards != 1),
            "has neighbours that turn opposite ways, at the edge from {} to {}{}",
        ),
    )
    for wrong, sentence in told:
        found = np.flatnonzero(wrong)
        if found.size:
            first, second = divmod(int(edges[found[0]]), count)
            places = (_place(mesh.vertices[first]), _place(mesh.vertices[second]))
            yield sentence.format(*places, _and_more(found.size)) + " (valid: a closed body of triangles)"


def _volume_faults(mesh: MeshSpec) -> Iterator[str]:
    """Finds bodies without volume, and those that are inside out; a cavity inside another body may be."""
    names, body = np.unique(_bodies(mesh), return_inverse=True)
    if len(names) > MOST_BODIES:
        yield f"consists of {len(names)} bodies (valid: at most {MOST_BODIES})"
        return
    corners = mesh.vertices[mesh.triangles]
    low, high = np.full((2, len(names), 3), np.inf) * np.array([1.0, -1.0])[:, None, None]
    np.minimum.at(low, body, corners.min(axis=1))
    np.maximum.at(high, body, corners.max(axis=1))
    middle, extent = 0.5 * (low + high), (high - low).max(axis=1)
    a, b, c = (corners[:, k] - middle[body] for k in range(3))
    volume = np.bincount(body, weights=np.sum(a * np.cross(b, c), axis=1) / 6.0)
    for i in range(len(names)):
        around = (volume > 0.0) & (low < low[i]).all(axis=1) & (high > high[i]).all(axis=1)
        if abs(volume[i]) <= FLAT * extent[i] ** 3:
            yield f"has no volume: the body around {_place(middle[i])} is flat (valid: a closed body)"
        elif volume[i] < 0.0 and not around.any():
            yield (
                f"is inside out around {_place(middle[i])}: its triangles turn with the clock as seen from outside"
                " (valid: against the clock)"
            )


def _bodies(mesh: MeshSpec) -> Indices:
    """Numbers the connected bodies; gives that of each triangle (t,)."""
    label = np.arange(len(mesh.vertices))
    while True:
        least = label[mesh.triangles].min(axis=1)
        after = label.copy()
        for k in range(3):
            np.minimum.at(after, mesh.triangles[:, k], least)
            np.minimum.at(after, label[mesh.triangles[:, k]], least)
        # A vertex takes the label of its label: distances double in every round.
        after = after[after]
        if np.array_equal(after, label):
            return np.asarray(label[mesh.triangles[:, 0]])
        label = after


def _stl_corners(path: Path, raw: bytes) -> Matrix:
    """Reads the corners (t, 3, 3) of a binary or written STL."""
    if len(raw) >= HEADER + 4:
        (count,) = struct.unpack_from("<I", raw, HEADER)
        if len(raw) == HEADER + 4 + RECORD * count:
            _refuse_too_many(path, count)
            kind = np.dtype([("normal", "<f4", (3,)), ("corners", "<f4", (3, 3)), ("more", "<u2")])
            return np.frombuffer(raw, kind, count, HEADER + 4)["corners"].astype(np.float64)
    if not raw.lstrip()[:5].lower() == b"solid":
        raise BadInput(
            f"{path}: is no STL file of {len(raw)} bytes (valid: one that begins with 'solid', or of {HEADER + 4} + "
            f"{RECORD} bytes per triangle)"
        )
    return _written_stl(path, raw.decode("latin-1"))


def _written_stl(path: Path, text: str) -> Matrix:
    corners: list[list[float]] = []
    for line, words in _lines(text):
        if words[0] == "vertex":
            corners.append(_numbers(path, line, words, 3))
        elif words[0] not in STL_WORDS:
            raise BadInput(
                f"{path}:{line}: '{words[0][:40]}' cannot stand in an STL file (valid: vertex,"
                f" {', '.join(sorted(STL_WORDS))})"
            )
        elif words[0] == "endloop" and len(corners) % 3:
            raise BadInput(f"{path}:{line}: a facet has {len(corners) % 3} corners more or less than three")
    _refuse_too_many(path, len(corners) // 3)
    if len(corners) % 3:
        raise BadInput(f"{path}: ends within a facet (valid: three corners in each facet)")
    return np.array(corners, dtype=np.float64).reshape(-1, 3, 3)


def _obj_corners(path: Path, raw: bytes) -> Matrix:
    """Reads the corners (t, 3, 3) of an OBJ file; a face of more corners becomes a fan of triangles."""
    places: list[list[float]] = []
    faces: list[tuple[int, int, int]] = []
    for line, words in _lines(raw.decode("latin-1")):
        if words[0] == "v":
            places.append(_numbers(path, line, words, 3))
        elif words[0] == "f":
            corners = [_corner(path, line, word, len(places)) for word in words[1:]]
            if len(corners) < 3:
                raise BadInput(f"{path}:{line}: a face of {len(corners)} corners (valid: at least three)")
            faces += [(corners[0], *pair) for pair in itertools.pairwise(corners[1:])]
            _refuse_too_many(path, len(faces))
        elif words[0] not in OBJ_WORDS and not words[0].startswith("#"):
            raise BadInput(
                f"{path}:{line}: '{words[0][:40]}' is not read (valid: v, f, {', '.join(sorted(OBJ_WORDS))})"
            )
    table = np.array(places, dtype=np.float64).reshape(-1, 3)
    return np.asarray(table[np.array(faces, dtype=np.int64).reshape(-1, 3)])


def _lines(text: str) -> Iterator[tuple[int, list[str]]]:
    """Yields the number and the words of every line that is not empty."""
    for number, line in enumerate(text.splitlines(), start=1):
        words = line.split()
        if words:
            yield number, words


def _numbers(path: Path, line: int, words: Sequence[str], count: int) -> list[float]:
    found = [read_number(word) for word in words[1 : count + 1]]
    numbers = [value for value in found if value is not None and abs(value) <= LARGEST_NUMBER]
    if len(numbers) < count:
        raise BadInput(
            f"{path}:{line}: '{' '.join(words)[:60]}' needs {count} finite numbers of at most {LARGEST_NUMBER:g}, as in"
            f" '{words[0]} 0.1 0 -0.2'"
        )
    return numbers


def _corner(path: Path, line: int, word: str, known: int) -> int:
    """Reads the vertex of ``7/2/5``, from 1, or from the last one backwards, ``-1``."""
    text = word.partition("/")[0]
    digits = text.removeprefix("-")
    number = int(digits) if digits.isascii() and digits.isdecimal() and len(digits) < 10 else 0
    if not 1 <= number <= known:
        raise BadInput(
            f"{path}:{line}: the corner '{word[:40]}' names no vertex (valid: 1 to {known}, the vertices before it)"
        )
    return known - number if text.startswith("-") else number - 1


def _refuse_too_many(path: Path, count: int) -> None:
    if count > MOST_TRIANGLES:
        raise BadInput(
            f"{path}: {count} triangles; at most {MOST_TRIANGLES} are read (valid: a coarser mesh)"
        )


def _and_more(count: int) -> str:
    return f" (and {count - 1} more)" if count > 1 else ""


def _place(point: Matrix) -> str:
    x, y, z = (float(value) for value in point)
    return f"({x:.4g}, {y:.4g}, {z:.4g}) m"
