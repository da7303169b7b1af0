# SPDX-License-Identifier: BSD-3-Clause
"""The surfaces of a plant: where each is, of which kind, and how far a point is from those that are round or meshes.

Planes and boxes are measured by coal once per face (``point_contact``), a sheet bends (``sheet``). Cylinders, spheres,
saddles and meshes have one exact signed distance, evaluated anew at every stage of a step, so that their normal force
is the gradient of a potential wherever the point goes. A saddle is one face without a body: it acts only on a point
that came from above it and has not left it by its edges since.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from impedance_modules.compiled import compiled
from impedance_modules.errors import BadInput
from impedance_modules.plant.curved_surface import cylinder_distance, saddle_distance, sphere_distance
from impedance_modules.plant.mesh_surface import (
    MeshTree,
    distance_from_triangle,
    mesh_tables,
    nearest_triangle,
)
from impedance_modules.plant.sheet import ABOVE, SHEET, sheet_row
from impedance_modules.records import Matrix, Row, Table, Vector, new_table
from impedance_modules.robot.rotation import exp3, turn
from impedance_modules.spec.task import SurfaceSpec

if TYPE_CHECKING:
    from impedance_modules.plant.plant_state import PlantState

FLAT, CYLINDER, SPHERE, SADDLE, MESH = range(5)
KINDS = {"cylinder": CYLINDER, "sphere": SPHERE, "saddle": SADDLE, "mesh": MESH}
"""What has a signed distance of its own; planes, boxes and sheets are ``FLAT``."""

SURFACE = np.dtype(
    [
        ("is_plane", np.int64),
        ("translation", np.float64, (3,)),
        ("rotation", np.float64, (3, 3)),
        ("half", np.float64, (3,)),
        ("sheet", SHEET),
        ("kind", np.int64),
        ("middle", np.float64, (3,)),
        ("radii", np.float64, (2,)),
        ("root", np.int64),
        ("first_triangle", np.int64),
        ("triangle_count", np.int64),
    ],
    align=True,
)
"""One surface: its pose, half its edges about its ``middle``, in its axes [m], and its sheet, whose ``span_count`` is 0
if it is none; a saddle's radii of curvature [m], and where a mesh's nodes and triangles begin."""


@compiled
def to_surface_axes(surface: Row, position: Vector, local: Vector) -> None:
    """Writes a point of the world in the surface's own axes (3,) [m]."""
    for k in range(3):
        local[k] = 0.0
        for j in range(3):
            local[k] += surface.rotation[j, k] * (position[j] - surface.translation[j])


@compiled
def box_gap(surface: Row, local: Vector) -> float:
    """Bounds the distance of a point (3,) in the surface's axes from below by that of the box around it [m]."""
    gap = -math.inf
    for k in range(3):
        gap = max(gap, abs(local[k] - surface.middle[k]) - surface.half[k])
    return gap


@compiled
def find_on_shape(plant: PlantState, surface: Row, contact: Row, local: Vector, clearance: float) -> None:
    """Measures a point against a round surface or a mesh, where it may be within a clearance [m] of it."""
    contact.stale, contact.near = 0, 0
    if box_gap(surface, local) >= contact.radius + clearance:
        contact.face = 0
        return
    contact.measured = shape_distance(plant, surface, contact, local) - contact.radius
    for k in range(3):
        contact.measured_at[k] = contact.position[k]
    contact.near = contact.measured < clearance
    if surface.kind == SADDLE:
        if contact.measured == math.inf:
            contact.face = 0
        elif contact.measured >= 0.0:
            contact.face = ABOVE
        contact.near = contact.near and contact.face == ABOVE


@compiled
def shape_push(plant: PlantState, surface: Row, contact: Row) -> float:
    """Writes the normal at a point that has moved on in the step; returns the spring's force along it [N]."""
    moved, local = np.empty(3), np.empty(3)
    for k in range(3):
        moved[k] = contact.position[k] + contact.displacement[k]
    to_surface_axes(surface, moved, local)
    return float(contact.stiffness * (contact.radius - shape_distance(plant, surface, contact, local)))


@compiled
def shape_distance(plant: PlantState, surface: Row, contact: Row, local: Vector) -> float:
    """Writes the normal (3,) out of a round surface or a mesh in world; returns the signed distance of a centre [m]."""
    normal = np.empty(3)
    if surface.kind == CYLINDER:
        distance = cylinder_distance(surface, local, normal)
    elif surface.kind == SPHERE:
        distance = sphere_distance(surface, local, normal)
    elif surface.kind == SADDLE:
        distance = saddle_distance(surface, local, normal)
    else:
        guess = surface.first_triangle + min(contact.face, surface.triangle_count - 1)
        nearest = nearest_triangle(plant.mesh_nodes, plant.triangles, surface.root, local, guess)
        contact.face = nearest - surface.first_triangle
        distance = distance_from_triangle(plant.triangles[nearest], local, normal)
    turn(surface.rotation, normal, contact.normal)
    return float(distance)


class SurfaceShape:
    """A round surface or a mesh in its own axes, for forecasts, drawings and maps.

    Attributes:
        low, high: Corners of the box around it (3,) [m].
    """

    def __init__(self, surface: SurfaceSpec) -> None:
        self._tree = None if surface.mesh is None else MeshTree(surface.mesh)
        self._row = surface_row(surface, self._tree)
        self.low: Vector = self._row["middle"] - self._row["half"]
        self.high: Vector = self._row["middle"] + self._row["half"]

    def distance(self, local: Vector) -> tuple[float, Vector]:
        """Gives signed distance [m] and normal (3,) of a point (3,) in its axes; infinite beside a saddle."""
        if self._tree is not None:
            return self._tree.distance(local)
        law = {CYLINDER: cylinder_distance, SPHERE: sphere_distance, SADDLE: saddle_distance}
        normal = np.empty(3)
        return float(law[int(self._row["kind"])](self._row, local, normal)), normal

    def gaps(self, points: Matrix) -> Vector:
        """Bounds the distances of points (p, 3) in its axes from below, (p,) [m]."""
        return np.asarray(np.max(np.abs(points - self._row["middle"]) - self._row["half"], axis=1))


def surface_tables(surfaces: Sequence[SurfaceSpec]) -> tuple[Table, Table, Table]:
    """Tabulates the surfaces' poses and sizes, and the nodes and triangles of all meshes.

    Raises:
        BadInput: The numbers do not describe a surface.
    """
    trees = [None if surface.mesh is None else MeshTree(surface.mesh) for surface in surfaces]
    nodes, triangles, roots = mesh_tables(trees)
    table = new_table(len(surfaces), SURFACE)
    first = 0
    for i, (surface, tree) in enumerate(zip(surfaces, trees, strict=True)):
        table[i] = surface_row(surface, tree)
        table[i]["root"], table[i]["first_triangle"] = roots[i], first
        first += int(table[i]["triangle_count"])
    return table, nodes, triangles


def surface_row(surface: SurfaceSpec, tree: MeshTree | None = None) -> Row:
    """Makes the row of one surface, with the extent of its mesh if its tree is given.

    Raises:
        BadInput: The numbers do not describe a surface.
    """
    row = new_table(1, SURFACE)[0]
    row["is_plane"], row["kind"] = surface.surface == "plane", KINDS.get(surface.surface, FLAT)
    row["rotation"], row["translation"] = exp3(np.array(surface.rotation)), _origin(surface)
    if surface.sheet is not None:
        row["sheet"] = sheet_row(surface.sheet)
    if tree is not None:
        low, high = tree.nodes[0]["low"], tree.nodes[0]["high"]
        row["middle"], row["half"] = 0.5 * (low + high), 0.5 * (high - low)
        row["triangle_count"] = len(tree.triangles)
    elif surface.size is not None:
        _write_size(row, surface.size, surface.radii)
    return row


def _write_size(row: Row, size: Sequence[float], radii: tuple[float, float] | None) -> None:
    """Writes half the edges of a box, or of the box around a round surface, and the middle of a saddle's [m]."""
    half = 0.5 * np.array(size)
    if radii is not None:
        rise, fall = half**2 / (2.0 * np.array(radii))
        # Below, as deep as a point can press: the normals there meet at the centres of curvature.
        low = -fall - radii[1]
        row["radii"], row["middle"] = radii, (0.0, 0.0, 0.5 * (rise + low))
        row["half"] = (*half, 0.5 * (rise - low))
    elif row["kind"] == CYLINDER:
        row["half"] = (half[0], half[0], half[1])
    else:
        row["half"] = half


def _origin(surface: SurfaceSpec) -> Vector:
    """Gives a point of a plane, the centre of a body, or the origin of a saddle's, mesh's or sheet's axes [m].

    Raises:
        BadInput: The numbers do not describe the surface.
    """
    lengths = {"box": 3, "cylinder": 2, "sphere": 1, "saddle": 2}.get(surface.surface)
    sized = lengths is not None and surface.size is not None and len(surface.size) == lengths
    made = {
        "box": sized,
        "cylinder": sized,
        "sphere": sized,
        "saddle": sized and surface.radii is not None,
        "mesh": surface.mesh is not None,
        "sheet": surface.sheet is not None,
    }
    if surface.surface == "plane" and surface.height is not None:
        return np.array([0.0, 0.0, surface.height])
    if surface.position is not None and made.get(surface.surface):
        return np.array(surface.position)
    raise BadInput(
        f"surface '{surface.surface}' is not one the plant knows, or lacks its numbers"
        " (valid: plane with height; box, cylinder or sphere with position and size; saddle with position, size and"
        " radii; mesh with position and file; sheet with position, supports, width and bending stiffness)"
    )
