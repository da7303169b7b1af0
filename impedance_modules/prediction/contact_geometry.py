# SPDX-License-Identifier: BSD-3-Clause
r"""Where hands and object press into the task's surfaces: depth, normal and stiffness of every point.

The same points and the same stiffness as the plant's (``plant.point_contact``), with a plane's and a box's distance
written out, so that a forecast needs neither compiler nor collision library; round surfaces and meshes have the plant's
own distance. A sheet is taken, where it is pressed, as a surface with the slope and the stiffness of the bent sheet.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.plant.point_contact import Point
from impedance_modules.plant.sheet import Sheet
from impedance_modules.plant.surfaces import KINDS, SurfaceShape
from impedance_modules.robot.pose import Pose
from impedance_modules.robot.rotation import exp3
from impedance_modules.spec.task import SurfaceSpec

TOO_DEEP = 0.05
"""A point further below a sheet at rest, or a saddle, did not come from above it: a forecast sees single states [m]."""

DIFFERENCE = 1e-6
"""Of a point, for the derivative of a round surface's normal [m]."""

BULGE = 0.05
"""Between its supports a sheet may bulge above the highest by no more than this [m]."""


@dataclass(frozen=True)
class Contact:
    """One point of one body near or inside one surface.

    Attributes:
        key: (body, point, surface), the same from state to state.
        arm: (3,) from the body's origin to the point of contact, world axes [m].
        normal: (3,) out of the surface.
        depth: How far the point is inside [m]; negative outside.
        surface: Stiffness, damping and friction.
        turning: (3, 3) how the normal turns as the point moves, dn/dx [1/m]; None of a flat face.
    """

    key: tuple[int, int, int]
    arm: Array
    normal: Array
    depth: float
    surface: SurfaceSpec
    turning: Array | None = None

    def jacobian(self, body: Array) -> Array:
        """Gives the point's Jacobian (3, k) from its body's (6, k): v + w x r."""
        x, y, z = self.arm
        linear, angular = body[:3], body[3:]
        lever = np.array([[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]])
        return linear + lever @ angular


@dataclass(frozen=True)
class PlacedSurface:
    """A surface with its rotation (3, 3) and a point of it, its centre or the origin of its axes (3,), in world."""

    spec: SurfaceSpec
    rotation: Array
    origin: Array
    sheet: Sheet | None = None
    shape: SurfaceShape | None = None


def place_surface(spec: SurfaceSpec) -> PlacedSurface:
    """Finds where a surface is."""
    rotation = exp3(np.array(spec.rotation))
    if spec.position is not None:
        sheet = None if spec.sheet is None else Sheet(spec.sheet)
        shape = SurfaceShape(spec) if spec.surface in KINDS else None
        return PlacedSurface(spec, rotation, np.array(spec.position), sheet, shape)
    return PlacedSurface(spec, rotation, np.array([0.0, 0.0, 0.0 if spec.height is None else spec.height]))


def find_contacts(
    body: int, pose: Pose, points: Sequence[Point], surfaces: Sequence[PlacedSurface], near: float
) -> list[Contact]:
    """Lists the points of a body that are inside a surface or within ``near`` [m] of it."""
    found = []
    centres = pose.translation + np.array([centre for centre, _ in points]) @ pose.rotation.T
    radii = np.array([radius for _, radius in points])
    for index, surface in enumerate(surfaces):
        close = _clearance(surface, centres) - radii < near
        for number in np.flatnonzero(close):
            local = _surface_at(surface, centres[number], float(radii[number]))
            if local is not None and local.depth > -near:
                arm = centres[number] - pose.translation - radii[number] * local.normal
                key = (body, int(number), index)
                turning = _turning(surface, centres[number]) if local.depth > 0.0 else None
                found.append(Contact(key, arm, local.normal, local.depth, local.surface, turning))
    return found


@dataclass(frozen=True)
class _LocalSurface:
    """Normal, depth and mechanics of a surface under one point."""

    normal: Array
    depth: float
    surface: SurfaceSpec


def _surface_at(placed: PlacedSurface, centre: Array, radius: float) -> _LocalSurface | None:
    """Describes a surface under a point; None beside a sheet or saddle, or too deep in one to have come from above."""
    if placed.sheet is None:
        distance, normal = surface_distance(placed, centre)
        if placed.spec.surface == "saddle" and (distance == math.inf or distance - radius < -TOO_DEEP):
            return None
        return _LocalSurface(normal, radius - distance, placed.spec)
    local = placed.rotation.T @ (centre - placed.origin) - np.array([0.0, 0.0, radius])
    here = placed.sheet.point(float(local[0]))
    if here is None or abs(local[1]) > placed.sheet.half_width or local[2] < here.height - TOO_DEEP:
        return None
    force = placed.sheet.force(local, placed.spec.stiffness)
    upright = np.array([-here.slope, 0.0, 1.0]) if force is None else force
    normal = upright / np.linalg.norm(upright)
    depth = float(here.height - local[2]) * float(normal[2])
    net = 1.0 / (1.0 / placed.spec.stiffness + here.compliance)
    stiffness = net if force is None else float(np.linalg.norm(force)) / depth
    return _LocalSurface(placed.rotation @ normal, depth, replace(placed.spec, stiffness=stiffness))


def _clearance(surface: PlacedSurface, points: Array) -> Array:
    """Bounds the distance of points (p, 3) from a surface from below, (p,) [m]."""
    local = (points - surface.origin) @ surface.rotation
    if surface.shape is not None:
        return surface.shape.gaps(local)
    if surface.spec.sheet is not None:
        return np.asarray(local[:, 2] - max(height for _, height in surface.spec.sheet.supports) - BULGE)
    if surface.spec.size is None:
        return np.asarray(local[:, 2])
    return np.asarray(np.max(np.abs(local) - 0.5 * np.array(surface.spec.size), axis=1))


def _turning(surface: PlacedSurface, point: Array) -> Array | None:
    """Differentiates the normal by the point, (3, 3) [1/m]; None of flat faces, among them those of a mesh."""
    if surface.shape is None or surface.spec.mesh is not None:
        return None
    found = np.empty((3, 3))
    for k, way in enumerate(DIFFERENCE * np.eye(3)):
        ahead, back = (surface_distance(surface, point + side * way)[1] for side in (1.0, -1.0))
        found[:, k] = (ahead - back) / (2.0 * DIFFERENCE)
    return found


def surface_distance(surface: PlacedSurface, point: Array) -> tuple[float, Array]:
    """Measures a point's signed distance from a surface [m], below 0 inside, and the outward normal (3,).

    Infinite beside a saddle.
    """
    local = surface.rotation.T @ (point - surface.origin)
    if surface.shape is not None:
        distance, normal = surface.shape.distance(local)
        return distance, surface.rotation @ normal
    if surface.spec.size is None:
        return float(local[2]), surface.rotation[:, 2]
    excess = np.abs(local) - 0.5 * np.array(surface.spec.size)
    signs = np.where(local < 0.0, -1.0, 1.0)
    outside = np.maximum(excess, 0.0)
    distance = float(np.linalg.norm(outside))
    if distance > 0.0:
        return distance, surface.rotation @ (signs * outside / distance)
    face = int(np.argmax(excess))
    return float(excess[face]), surface.rotation[:, face] * signs[face]
