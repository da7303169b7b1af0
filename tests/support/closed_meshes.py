# SPDX-License-Identifier: BSD-3-Clause
"""Closed bodies of triangles whose exact shape is known, and files of them."""

import struct
from pathlib import Path

import numpy as np

from impedance_modules.spec.task import MeshSpec, SurfaceSpec


def mesh(vertices, triangles) -> MeshSpec:
    return MeshSpec("made.stl", np.array(vertices, dtype=float), np.array(triangles, dtype=np.int64))


def box_mesh(size) -> MeshSpec:
    """A box about the origin, two triangles a face."""
    corners = 0.5 * np.array(size) * [[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]
    faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return mesh(corners, [tri for a, b, c, d in faces for tri in ((a, b, c), (a, c, d))])


def block_under(heights, x, y, bottom: float) -> MeshSpec:
    """A block with flat sides whose top is a height field (m, n) over a grid x (m,), y (n,)."""
    m, n = heights.shape
    top = np.stack([*np.meshgrid(x, y, indexing="ij"), heights], axis=-1).reshape(-1, 3)
    low = top * [1.0, 1.0, 0.0] + [0.0, 0.0, bottom]
    number = np.arange(m * n).reshape(m, n)
    a, b, c, d = number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]
    upper = np.concatenate([np.stack(t, -1).reshape(-1, 3) for t in ((a, b, c), (a, c, d))])
    rim = [*number[:, 0], *number[-1, 1:], *number[-2::-1, -1], *number[0, -2:0:-1]]
    sides = []
    for i, j in zip(rim, [*rim[1:], rim[0]], strict=True):
        sides += [(i, i + m * n, j + m * n), (i, j + m * n, j)]
    return mesh(np.concatenate([top, low]), np.concatenate([upper, upper[:, ::-1] + m * n, sides]))


def ball_mesh(radius: float, rings: int = 24) -> MeshSpec:
    """A sphere about the origin: all corners lie on it."""
    around = 2 * rings
    polar, way = np.pi * np.arange(1, rings) / rings, 2.0 * np.pi * np.arange(around) / around
    ring = np.stack([np.outer(np.sin(polar), f(way)) for f in (np.cos, np.sin)], axis=-1)
    wall = np.concatenate(
        [ring, np.broadcast_to(np.cos(polar)[:, None, None], (*ring.shape[:2], 1))], axis=-1
    )
    vertices = radius * np.concatenate([wall.reshape(-1, 3), [[0, 0, 1], [0, 0, -1]]])
    number = np.arange((rings - 1) * around).reshape(-1, around)
    after = np.roll(number, -1, axis=1)
    parts = [
        (number[:-1], number[1:], after[1:]), (number[:-1], after[1:], after[:-1]),
        (np.full(around, number.size), number[0], after[0]),
        (np.full(around, number.size + 1), after[-1], number[-1]),
    ]  # fmt: skip
    return mesh(vertices, np.concatenate([np.stack(part, -1).reshape(-1, 3) for part in parts]))


def saddle_block(radii, size, cells: int = 40) -> MeshSpec:
    """A block whose top is a saddle, cut into cells each way."""
    x, y = (np.linspace(-0.5 * edge, 0.5 * edge, cells + 1) for edge in size)
    heights = x[:, None] ** 2 / (2.0 * radii[0]) - y**2 / (2.0 * radii[1])
    return block_under(heights, x, y, heights.min() - 0.05)


def surface(kind: str, **numbers: object) -> SurfaceSpec:
    """A surface far from the robot's hands, without damping and friction unless they are given."""
    values = {"height": None, "position": (0.0, 3.0, 0.2), "rotation": (0.0, 0.0, 0.0), "size": None}
    values |= {"stiffness": 20000.0, "damping": 0.0, "friction": 0.0}
    return SurfaceSpec(kind, **{**values, **numbers})


SHAPES = {
    "cylinder": surface("cylinder", size=(0.2, 0.4)),
    "sphere": surface("sphere", size=(0.2,)),
    "saddle": surface("saddle", size=(0.4, 0.3), radii=(0.15, 0.2)),
    "mesh": surface("mesh", mesh=ball_mesh(0.1)),
}
"""One surface of every kind that has a distance of its own."""


def write_stl(path: Path, body: MeshSpec) -> Path:
    corners = body.vertices[body.triangles].astype("<f4")
    records = b"".join(struct.pack("<3f", 0, 0, 0) + tri.tobytes() + b"\0\0" for tri in corners)
    path.write_bytes(b"made".ljust(80) + struct.pack("<I", len(corners)) + records)
    return path


def written_stl(body: MeshSpec) -> str:
    def facet(corners):
        lines = "\n".join("vertex " + " ".join(repr(float(c)) for c in corner) for corner in corners)
        return f"facet normal 0 0 0\nouter loop\n{lines}\nendloop\nendfacet\n"

    return "solid made\n" + "".join(map(facet, body.vertices[body.triangles])) + "endsolid made\n"


def obj_text(body: MeshSpec, *, backwards: bool = False) -> str:
    places = "".join("v " + " ".join(repr(float(c)) for c in place) + "\n" for place in body.vertices)
    shift = -len(body.vertices) if backwards else 1
    faces = "".join("f " + " ".join(f"{k + shift}//1" for k in corners) + "\n" for corners in body.triangles)
    return "# made\no body\nvn 0 0 1\n" + places + "s off\n" + faces
