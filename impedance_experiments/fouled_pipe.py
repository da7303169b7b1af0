# SPDX-License-Identifier: BSD-3-Clause
"""A pipe under water on which something has grown: a closed mesh whose wall is a random height field.

The wall's corners lie on rings along the pipe's axis z, each a random height, even between 0 and ``growth``, above the
bare pipe; the ends are bare and flat.
"""

from __future__ import annotations

import math

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.spec.task import MeshSpec

FILE_UNIT = 1e-3
"""Metres per unit of the file that ``stl_file`` makes: millimetres."""

TITLE = b"Fouled pipe of impedance_modules, BSD-3-Clause; mm; not solid text"


def fouled_pipe(*, seed: int, diameter: float, length: float, growth: float, spacing: float) -> MeshSpec:
    """Makes a pipe about the z axis with something grown on it.

    Args:
        seed: The same seed is the same pipe.
        diameter: Of the bare pipe [m].
        length: Along z, half on either side of the origin [m].
        growth: Of the highest peaks above it [m].
        spacing: About how far the corners of the wall are from each other [m].
    """
    around, rings = round(math.pi * diameter / spacing), round(length / spacing) + 1
    random = np.random.default_rng(seed)
    radius = 0.5 * diameter + growth * random.uniform(0.0, 1.0, (rings, around))
    radius[[0, -1]] = 0.5 * diameter
    angle = 2.0 * math.pi * np.arange(around) / around
    height = np.broadcast_to(np.linspace(-0.5 * length, 0.5 * length, rings)[:, None], radius.shape)
    wall = np.stack([radius * np.cos(angle), radius * np.sin(angle), height], axis=-1).reshape(-1, 3)
    ends = np.array([[0.0, 0.0, -0.5 * length], [0.0, 0.0, 0.5 * length]])
    return MeshSpec("", np.concatenate([wall, ends]), _triangles(rings, around))


def _triangles(rings: int, around: int) -> np.ndarray[tuple[int, ...], np.dtype[np.int64]]:
    """Joins the corners of all rings, and those of the first and last with the middles of the ends, (t, 3)."""
    number = np.arange(rings * around).reshape(rings, around)
    onwards = np.roll(number, -1, axis=1)
    low, low_next, high, high_next = number[:-1], onwards[:-1], number[1:], onwards[1:]
    bottom, top = rings * around, rings * around + 1
    parts = [
        (low, low_next, high_next),
        (low, high_next, high),
        (np.full(around, bottom), onwards[0], number[0]),
        (np.full(around, top), number[-1], onwards[-1]),
    ]
    return np.concatenate([np.stack(part, axis=-1).reshape(-1, 3) for part in parts])


def stl_file(mesh: MeshSpec) -> bytes:
    """Writes a mesh as a binary STL, in millimetres."""
    corners = mesh.vertices[mesh.triangles] / FILE_UNIT
    kind = np.dtype([("normal", "<f4", (3,)), ("corners", "<f4", (3, 3)), ("more", "<u2")])
    records = np.zeros(len(corners), kind)
    records["corners"], records["normal"] = corners, _normals(corners)
    return TITLE.ljust(80) + len(corners).to_bytes(4, "little") + records.tobytes()


def _normals(corners: Array) -> Array:
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return np.asarray(across / np.linalg.norm(across, axis=1, keepdims=True))
