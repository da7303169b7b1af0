# SPDX-License-Identifier: BSD-3-Clause
"""What the built-in plant really had where a map was made, and the errors of the map against it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.errors import BadInput
from impedance_modules.prediction.contact_geometry import PlacedSurface, place_surface, surface_distance
from impedance_modules.spec.task import SurfaceSpec
from impedance_modules.tools.surface_fit import SurfaceMap

STEPS = 20
"""Repetitions after which a point of a tilted sheet is found to the last digit."""


DESCENTS, STRIDE, ARRIVED = 10_000, 2e-3, 1e-9
"""Most steps down to a round surface or a mesh, the length of those beside a saddle, and the distance that ends them
[m]."""


@dataclass(frozen=True)
class TrueSurface:
    """Height of the topmost surface under each cell of a map [m], and upward compliance [m/N], (M,) each.

    Where the hand was pressed below several surfaces at once, a sheet and the table under it, their stiffnesses add.
    """

    height: Array
    compliance: Array


@dataclass(frozen=True)
class MapErrors:
    """How far a map is from the truth.

    Attributes:
        shape: RMS of the height at rest [m], over ``shape_cells`` cells.
        pressed: RMS of the pressed height against the shape at rest: what a tactile map alone would be wrong by [m].
        stiffness: Median of |k / k_true - 1|, over ``stiffness_cells`` cells.
        stiffness_worst: The largest of them.
        covered: Share of cells whose true compliance lies within two standard errors.
    """

    shape: float
    shape_cells: int
    pressed: float
    stiffness: float
    stiffness_worst: float
    stiffness_cells: int
    covered: float


def true_surface(surfaces: Sequence[SurfaceSpec], found: SurfaceMap) -> TrueSurface:
    """Looks from above for what carried the hand in every cell.

    Raises:
        BadInput: There is nothing under a cell.
    """
    placed = [place_surface(surface) for surface in surfaces]
    rows = []
    for (x, y), pressed in zip(found.place, found.pressed, strict=True):
        seen = [hit for surface in placed if (hit := _under(surface, float(x), float(y))) is not None]
        if not seen:
            raise BadInput(
                f"the task has no surface under x = {x:.3f}, y = {y:.3f} m, where the hand was pressed"
            )
        height, compliance = max(seen)
        carrying = [1.0 / yielding for level, yielding in seen if level > pressed]
        rows.append((height, 1.0 / sum(carrying) if carrying else compliance))
    table = np.array(rows)
    return TrueSurface(table[:, 0], table[:, 1])


def _under(surface: PlacedSurface, x: float, y: float) -> tuple[float, float] | None:
    """Gives height and upward compliance of one surface at (x, y); None where it is not.

    A tilted face with normal n and stiffness k gives by f_z / (k n_z^2) to an upward force without friction.
    """
    rotation, origin = surface.rotation, surface.origin
    if surface.sheet is not None:
        return _under_sheet(surface, x, y)
    if surface.shape is not None:
        return _under_shape(surface, x, y)
    normal = rotation[:, 2]
    foot = origin if surface.spec.size is None else origin + 0.5 * surface.spec.size[2] * normal
    height = float(foot[2] - (normal[0] * (x - foot[0]) + normal[1] * (y - foot[1])) / normal[2])
    if surface.spec.size is not None:
        local = rotation.T @ (np.array([x, y, height]) - origin)
        if (np.abs(local[:2]) > 0.5 * np.array(surface.spec.size[:2])).any():
            return None
    return height, float(1.0 / (surface.spec.stiffness * normal[2] ** 2))


def _under_sheet(surface: PlacedSurface, x: float, y: float) -> tuple[float, float] | None:
    """The same of a sheet, whose axes may be tilted: the foot of the vertical is found by repetition."""
    sheet = surface.sheet
    if sheet is None:
        return None
    height = float(surface.origin[2])
    compliance = 0.0
    for _ in range(STEPS):
        local = surface.rotation.T @ (np.array([x, y, height]) - surface.origin)
        point = sheet.point(float(local[0]))
        if point is None or abs(local[1]) > sheet.half_width:
            return None
        height += (point.height - float(local[2])) / float(surface.rotation[2, 2])
        compliance = 1.0 / surface.spec.stiffness + point.compliance
    return height, compliance


def _under_shape(surface: PlacedSurface, x: float, y: float) -> tuple[float, float] | None:
    """The same of a round surface or a mesh: from above it goes down by the distance, which passes nothing over.

    A saddle is met where the vertical comes down on its rectangle from above; beside that it has no distance.
    """
    lowest, height = _heights(surface)
    for _ in range(DESCENTS):
        if height < lowest:
            return None
        distance, normal = surface_distance(surface, np.array([x, y, height]))
        if abs(distance) < ARRIVED:
            return height, float(1.0 / (surface.spec.stiffness * normal[2] ** 2))
        if distance < 0.0:
            return None
        # Beside a saddle nothing is known: a small step passes over no more than itself.
        height -= distance if distance < np.inf else STRIDE
    return None


def _heights(surface: PlacedSurface) -> tuple[float, float]:
    """Gives the lowest and highest height of the box around a round surface or a mesh, in world [m]."""
    if surface.shape is None:
        return 0.0, 0.0
    low, high, turn = surface.shape.low, surface.shape.high, surface.rotation[2]
    middle = float(surface.origin[2] + turn @ (0.5 * (low + high)))
    reach = float(np.abs(turn) @ (0.5 * (high - low)))
    return middle - reach - STRIDE, middle + reach + STRIDE


def map_errors(found: SurfaceMap, truth: TrueSurface) -> MapErrors:
    """Compares a map with the truth."""
    fitted = np.isfinite(found.rest)
    known = np.isfinite(found.stiffness)
    ratio = np.abs(found.stiffness[known] * truth.compliance[known] - 1.0)
    within = np.abs(found.compliance - truth.compliance)[fitted] <= 2.0 * found.compliance_error[fitted]
    nothing = float("nan")
    return MapErrors(
        shape=float(np.sqrt(np.mean((found.rest - truth.height)[fitted] ** 2))) if fitted.any() else nothing,
        shape_cells=int(np.count_nonzero(fitted)),
        pressed=float(np.sqrt(np.mean((found.pressed - truth.height) ** 2))),
        stiffness=float(np.median(ratio)) if ratio.size else nothing,
        stiffness_worst=float(ratio.max()) if ratio.size else nothing,
        stiffness_cells=int(np.count_nonzero(known)),
        covered=float(within.mean()) if within.size else nothing,
    )
