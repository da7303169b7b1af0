# SPDX-License-Identifier: BSD-3-Clause
r"""Signed distance of a point from a closed body of triangles, which keeps its shape: dents, holes and all.

The distance is that to the nearest point c of the nearest triangle, which lies on its face, an edge or a corner. Each
of these features has a normal m: a face its own, an edge the sum of its two faces' normals, a corner the sum of all
its faces' normals, each times the angle that the face has there. With it,

    d = sign((p - c) . m) |p - c|,         n = (p - c) / d

has the right sign for every point, near corners and edges too (angle-weighted pseudonormals: Baerentzen and Aanaes,
Signed distance computation using the angle weighted pseudonormal, IEEE TVCG 11, 2005), and n is the gradient of d. d
is continuous, so that a hand which slides from one triangle to the next neither gains nor loses: across an outward
edge n turns at once, across an inward one little by little.

Triangles lie in a tree of boxes, in the order in which it is walked: the first child of a node follows it, ``skip``
leads to the next node that is not inside it. A point remembers its nearest triangle, from which the search begins.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from impedance_modules.compiled import compiled
from impedance_modules.records import Indices, Matrix, Row, Table, Vector, new_table
from impedance_modules.spec.task import MeshSpec

FACE = 6
"""The feature of a triangle that is neither corner (0 to 2) nor edge (3 to 5, from corner k to the next)."""

IN_A_LEAF = 4
"""Triangles in a box that is not divided further."""

ON_THE_SURFACE = 1e-9
"""Nearer than this, p - c has no direction: n is m [m]."""

TRIANGLE = np.dtype(
    [
        ("corners", np.float64, (3, 3)),
        ("edge_normals", np.float64, (3, 3)),
        ("corner_normals", np.float64, (3, 3)),
        ("face_normal", np.float64, (3,)),
    ],
    align=True,
)
"""One triangle in its mesh's axes: corners [m], normals of its edges, corners and face, of length 1."""

NODE = np.dtype(
    [
        ("low", np.float64, (3,)),
        ("high", np.float64, (3,)),
        ("begin", np.int64),
        ("end", np.int64),
        ("skip", np.int64),
    ],
    align=True,
)
"""One box around triangles [m]: which triangles, none if it is divided, and which node comes after all inside."""


@compiled
def nearest_on_triangle(triangle: Row, point: Vector, foot: Vector) -> int:
    """Writes the point (3,) of a triangle nearest to a point (3,) [m]; returns the feature on which it is."""
    corners, normal = triangle.corners, triangle.face_normal
    feature, least = FACE, math.inf
    for k in range(3):
        start, end = corners[k], corners[(k + 1) % 3]
        x, y, z = end[0] - start[0], end[1] - start[1], end[2] - start[2]
        a, b, c = point[0] - start[0], point[1] - start[1], point[2] - start[2]
        # Above zero on the triangle's side of this edge.
        inside = normal[0] * (y * c - z * b) + normal[1] * (z * a - x * c) + normal[2] * (x * b - y * a)
        if inside >= 0.0:
            continue
        share = min(1.0, max(0.0, (x * a + y * b + z * c) / (x * x + y * y + z * z)))
        away = (a - share * x) ** 2 + (b - share * y) ** 2 + (c - share * z) ** 2
        if away < least:
            least = away
            feature = k if share == 0.0 else (k + 1) % 3 if share == 1.0 else 3 + k
            foot[0], foot[1], foot[2] = start[0] + share * x, start[1] + share * y, start[2] + share * z
    if feature == FACE:
        height = 0.0
        for k in range(3):
            height += normal[k] * (point[k] - corners[0, k])
        for k in range(3):
            foot[k] = point[k] - height * normal[k]
    return feature


@compiled
def distance_from_triangle(triangle: Row, point: Vector, normal: Vector) -> float:
    """Writes n (3,) at a point (3,) whose nearest triangle is given; returns its signed distance [m]."""
    foot, outwards = np.empty(3), np.empty(3)
    feature = nearest_on_triangle(triangle, point, foot)
    for k in range(3):
        if feature < 3:
            outwards[k] = triangle.corner_normals[feature, k]
        elif feature < FACE:
            outwards[k] = triangle.edge_normals[feature - 3, k]
        else:
            outwards[k] = triangle.face_normal[k]
    square, along = 0.0, 0.0
    for k in range(3):
        square += (point[k] - foot[k]) ** 2
        along += (point[k] - foot[k]) * outwards[k]
    away = math.sqrt(square)
    distance = away if along >= 0.0 else -away
    for k in range(3):
        normal[k] = (point[k] - foot[k]) / distance if away > ON_THE_SURFACE else outwards[k]
    return distance


@compiled
def nearest_triangle(nodes: Table, triangles: Table, root: int, point: Vector, guess: int) -> int:
    """Finds the triangle of a mesh nearest to a point (3,); the search begins with a guess and keeps it in a tie."""
    foot = np.empty(3)
    nearest = guess
    nearest_on_triangle(triangles[guess], point, foot)
    least = _square(point, foot)
    i, end = root, nodes[root].skip
    while i < end:
        node = nodes[i]
        gap = 0.0
        for k in range(3):
            beyond = max(node.low[k] - point[k], point[k] - node.high[k], 0.0)
            gap += beyond * beyond
        if gap >= least:
            i = node.skip
            continue
        for t in range(node.begin, node.end):
            nearest_on_triangle(triangles[t], point, foot)
            square = _square(point, foot)
            if square < least:
                nearest, least = t, square
        i += 1
    return nearest


@compiled
def _square(a: Vector, b: Vector) -> float:
    """Squares the distance of two points [m^2]."""
    return float((a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2)


class MeshTree:
    """A mesh in its own axes with its tree of boxes: rows for the plant, and single distances for forecasts.

    Attributes:
        triangles: Of ``TRIANGLE``, in the order of the tree.
        nodes: Of ``NODE``; the first is around everything.
    """

    def __init__(self, mesh: MeshSpec) -> None:
        self.triangles = triangle_table(mesh)
        corners = self.triangles["corners"]
        order, nodes = _divide(corners.min(axis=1), corners.max(axis=1))
        self.triangles = self.triangles[order].view(np.recarray)
        self.nodes = nodes
        leaves = np.flatnonzero(nodes["end"] > nodes["begin"])
        self._leaves = nodes[leaves]

    def distance(self, point: Vector) -> tuple[float, Vector]:
        """Gives signed distance [m] and normal (3,) of one point (3,): the same as the plant's, box by box."""
        beyond = np.maximum(self._leaves["low"] - point, point - self._leaves["high"])
        gaps = np.sum(np.maximum(beyond, 0.0) ** 2, axis=1)
        nearest, least, foot = 0, math.inf, np.empty(3)
        for leaf in np.argsort(gaps, kind="stable"):
            if gaps[leaf] >= least:
                break
            for t in range(self._leaves["begin"][leaf], self._leaves["end"][leaf]):
                nearest_on_triangle(self.triangles[t], point, foot)
                square = _square(point, foot)
                if square < least:
                    nearest, least = t, square
        normal = np.empty(3)
        return float(distance_from_triangle(self.triangles[nearest], point, normal)), normal


def mesh_tables(trees: Sequence[MeshTree | None]) -> tuple[Table, Table, list[int]]:
    """Puts the trees of a plant's surfaces one after the other.

    Args:
        trees: Of each surface; None of one that is no mesh.

    Returns:
        All nodes, all triangles, and where each surface's nodes begin.
    """
    nodes, triangles, roots = [new_table(0, NODE)], [new_table(0, TRIANGLE)], []
    for tree in trees:
        before, many = sum(map(len, nodes)), sum(map(len, triangles))
        roots.append(before)
        if tree is not None:
            moved = tree.nodes.copy()
            moved["skip"] += before
            moved["begin"] += many
            moved["end"] += many
            nodes.append(moved)
            triangles.append(tree.triangles)
    return np.concatenate(nodes).view(np.recarray), np.concatenate(triangles).view(np.recarray), roots


def triangle_table(mesh: MeshSpec) -> Table:
    """Tabulates the triangles of a closed mesh with the normals of all their features."""
    corners = mesh.vertices[mesh.triangles]
    along = np.roll(corners, -1, axis=1) - corners
    across = np.cross(along[:, 0], along[:, 1])
    faces = across / np.linalg.norm(across, axis=1, keepdims=True)
    table = new_table(len(corners), TRIANGLE)
    table["corners"], table["face_normal"] = corners, faces
    table["corner_normals"] = _corner_normals(mesh, along, faces)[mesh.triangles]
    table["edge_normals"] = _edge_normals(mesh, faces)
    return table


def _corner_normals(mesh: MeshSpec, along: Matrix, faces: Matrix) -> Matrix:
    """Sums the faces' normals at every vertex (v, 3), each times its angle there."""
    found = np.zeros_like(mesh.vertices)
    for k in range(3):
        ahead, back = along[:, k], -along[:, k - 1]
        angle = np.arctan2(np.linalg.norm(np.cross(ahead, back), axis=1), np.sum(ahead * back, axis=1))
        np.add.at(found, mesh.triangles[:, k], angle[:, None] * faces)
    return _unit(found)


def _edge_normals(mesh: MeshSpec, faces: Matrix) -> Matrix:
    """Sums the normals of the two faces of every edge, (t, 3, 3)."""
    ends = np.stack([mesh.triangles, np.roll(mesh.triangles, -1, axis=1)], axis=2)
    edges = ends.min(axis=2) * len(mesh.vertices) + ends.max(axis=2)
    names, which = np.unique(edges, return_inverse=True)
    which = which.reshape(edges.shape)
    found = np.zeros((len(names), 3))
    for k in range(3):
        np.add.at(found, which[:, k], faces)
    return np.asarray(_unit(found)[which])


def _unit(vectors: Matrix) -> Matrix:
    """Gives vectors (n, 3) the length 1; a feature whose faces cancel keeps none."""
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.asarray(vectors / np.where(length > 0.0, length, 1.0))


def _divide(low: Matrix, high: Matrix) -> tuple[Indices, Table]:
    """Builds the tree over boxes (t, 3): halves along the longest edge, in the middle of the sorted centres.

    Returns:
        The triangles' order, and the nodes.
    """
    centre, order = 0.5 * (low + high), np.arange(len(low))
    rows: list[tuple[Vector, Vector, int, int]] = []
    skips: list[int] = []
    # Nodes still to come, the next one last, and nodes whose inside has been walked.
    waiting: list[tuple[int, int] | int] = [(0, len(low))]
    while waiting:
        entry = waiting.pop()
        if isinstance(entry, int):
            skips[entry] = len(rows)
            continue
        begin, end = entry
        inside = order[begin:end]
        leaf = end - begin <= IN_A_LEAF
        box = (low[inside].min(axis=0), high[inside].max(axis=0))
        waiting.append(len(rows))
        rows.append((*box, begin, end) if leaf else (*box, 0, 0))
        skips.append(0)
        if not leaf:
            axis = int(np.argmax(np.ptp(centre[inside], axis=0)))
            order[begin:end] = inside[np.argsort(centre[inside, axis], kind="stable")]
            middle = (begin + end) // 2
            waiting += [(middle, end), (begin, middle)]
    nodes = new_table(len(rows), NODE)
    for i, (lows, highs, begin, end) in enumerate(rows):
        nodes[i] = (lows, highs, begin, end, skips[i])
    return order, nodes
