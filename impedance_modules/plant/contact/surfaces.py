# SPDX-License-Identifier: BSD-3-Clause
"""Surfaces of the task's environment: their shapes, and their distance from a point, by coal but for sheets.

A point near a surface asks coal for distance and normal, and asks again once it has moved a little; far
ones are passed over by a bound on the distance (``contact.compiled_contact.find_near``).
"""

from __future__ import annotations

from collections.abc import Sequence

import coal
import numpy as np
from numpy.typing import NDArray

from impedance_modules.errors import BadInput
from impedance_modules.plant.contact.points import Point
from impedance_modules.plant.sheet import spans_of
from impedance_modules.plant.plant_state import CONTACT_POINT, SURFACE, Row, Table
from impedance_modules.robot.rotation import exp3
from impedance_modules.spec.task import SurfaceSpec

Array = NDArray[np.float64]

NEAR = 0.01
"""Clearance below which coal is asked [m]: a point covers it in one step only above 40 m/s."""


def surface_table(surfaces: Sequence[SurfaceSpec]) -> Table:
    """Tabulates the surfaces' poses and sizes for the search for near points."""
    table = np.zeros(len(surfaces), SURFACE)
    for row, surface in zip(table, surfaces, strict=True):
        row["flat"] = surface.surface == "plane"
        row["rotation"] = exp3(np.array(surface.rotation))
        row["translation"] = _origin(surface)
        if surface.size is not None:
            row["half"] = 0.5 * np.array(surface.size)
        if surface.sheet is not None:
            spans = spans_of(surface.sheet)
            row["half"][1] = 0.5 * surface.sheet.width
            row["span_count"], row["softness"] = len(spans), 1.0 / surface.sheet.bending_stiffness
            row["spans"][: len(spans)] = spans
    return table


def _origin(surface: SurfaceSpec) -> Array:
    """Gives a point of a plane, the centre of a box, or the origin of a sheet [m].

    Raises:
        BadInput: The numbers do not describe the surface.
    """
    if surface.surface == "plane" and surface.height is not None:
        return np.array([0.0, 0.0, surface.height])
    if surface.surface == "box" and surface.position is not None and surface.size is not None:
        return np.array(surface.position)
    if surface.surface == "sheet" and surface.position is not None and surface.sheet is not None:
        return np.array(surface.position)
    raise BadInput(
        f"surface '{surface.surface}' is not one the plant knows, or lacks its numbers"
        " (valid: plane with height; box with position and size; sheet with position, supports, width and bending"
        " stiffness)"
    )


def contact_table(surfaces: Sequence[SurfaceSpec], bodies: Sequence[Sequence[Point]], woods: Table) -> Table:
    """Tabulates every point of every body against every surface and the wood on it."""
    rows = [
        (number, point, index)
        for number, points in enumerate(bodies)
        for point in points
        for index in range(len(surfaces))
    ]
    table = np.zeros(len(rows), CONTACT_POINT)
    table["caught"] = -1
    on_surface = {int(wood["surface"]): number for number, wood in enumerate(woods)}
    for row, (body, (centre, radius), index) in zip(table, rows, strict=True):
        row["body"], row["surface"], row["centre"], row["radius"] = body, index, centre, radius
        row["wood"] = on_surface.get(index, -1)
        for name in ("stiffness", "damping", "friction"):
            row[name] = getattr(surfaces[index], name)
        row["normal_stiffness"] = surfaces[index].stiffness
    return table


class Surfaces:
    """Coal's shapes, one query per pair of point and surface, and the table that takes the answers."""

    def __init__(self, surfaces: Sequence[SurfaceSpec], contacts: Table) -> None:
        table = surface_table(surfaces)
        shapes = [_shape(surface, row) for surface, row in zip(surfaces, table, strict=True)]
        self._stale = contacts["stale"]
        self._position, self._radius = contacts["position"], contacts["radius"]
        self._asked, self._measured = contacts["asked"], contacts["measured"]
        self._normal = contacts["normal"]
        self._point = coal.Sphere(0.0)
        self._at = coal.Transform3s()
        self._request = coal.DistanceRequest()
        self._request.enable_signed_distance = True
        self._result = coal.DistanceResult()
        # A sheet is never asked of coal, so no point on it goes stale.
        asked = [(i, shapes[index]) for i, index in enumerate(contacts["surface"])]
        # Kept whole: a query does not keep the shape that it asks about.
        self._shapes = {i: shape for i, shape in asked if shape is not None}
        self._queries = {
            i: coal.ComputeDistance(self._point, shape) for i, (shape, _) in self._shapes.items()
        }

    def measure(self) -> None:
        """Writes signed distance [m] (below 0 inside) and outward normal of every stale point."""
        at, request, result = self._at, self._request, self._result
        for i in self._stale.nonzero()[0].tolist():
            self._asked[i] = self._position[i]
            at.setTranslation(self._position[i])
            result.clear()
            distance = self._queries[i](at, self._shapes[i][1], request, result)
            self._measured[i] = distance - self._radius[i]
            self._normal[i] = -result.normal


def _shape(surface: SurfaceSpec, row: Row) -> tuple[coal.CollisionGeometry, coal.Transform3s] | None:
    """Builds coal's shape and pose of one surface; None of a sheet."""
    if surface.sheet is not None:
        return None
    if surface.size is None:
        normal = np.array(row["rotation"][:, 2])
        return coal.Halfspace(normal, float(normal @ row["translation"])), coal.Transform3s()
    pose = coal.Transform3s()
    pose.setRotation(np.array(row["rotation"]))
    pose.setTranslation(np.array(row["translation"]))
    return coal.Box(*surface.size), pose
