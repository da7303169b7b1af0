# SPDX-License-Identifier: BSD-3-Clause
r"""Contact of points with surfaces: a unilateral spring-damper with stick-slip friction; distances by coal.

    N = max(0, k d - c d_n')    only while the depth d > 0; never adhesive                                    [N]
    f_t = -k s - c v_t          s the stretch of a tangential spring that stuck at first touch,
    |f_t| <= mu N               beyond which the point slides and the spring is drawn along; no bound while a
                                splinter holds the point (``wood``)

A hand touches with the origin of its frame, so a surface is met where the hand frame meets it. A box touches with its
eight corners, a cylinder (axis z) with eight points of each rim, a sphere with itself.

A point near a surface queries coal for distance and normal; far ones are passed over by a bound on the distance.
Between two queries the surface counts as flat: the normal stays, the depth changes linearly. While the same face of the
surface is nearest that is exact; around edges coal is queried again every ``FRESH``. A flexible sheet (``sheet``),
round surfaces and meshes (``surfaces``) are evaluated anew at every stage instead, and their normal force is the
gradient of their energy.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import coal
import numpy as np

from impedance_modules.compiled import compiled
from impedance_modules.plant.sheet import find_on_sheet, place_on_sheet, press_on_sheet
from impedance_modules.plant.surfaces import (
    FLAT,
    find_on_shape,
    shape_push,
    surface_row,
    to_surface_axes,
)
from impedance_modules.records import Matrix, Row, Table, Vector, new_table
from impedance_modules.robot.rotation import add_cross, dot, turn
from impedance_modules.spec.task import SurfaceSpec

if TYPE_CHECKING:
    from impedance_modules.plant.plant_state import PlantState

Point = tuple[Vector, float]
"""Centre (3,) in the body's axes and radius of a small sphere [m]."""

CLEARANCE = 0.01
"""Clearance below which coal is queried [m]: a point covers it in one step only above 40 m/s."""

FRESH = 1e-4
"""How far a point may move around an edge before coal is queried again [m]."""

EDGE = 0
"""In place of a face's number: an edge or corner is nearest."""

CORNER_RADIUS = 2e-3
"""Of an object's small spheres [m]; they lie inside the shape and touch its faces from within."""

RIM_POINTS = 8

CONTACT_POINT = np.dtype(
    [
        ("near", np.int64),
        ("face", np.int64),
        ("stale", np.int64),
        ("touching", np.int64),
        ("body", np.int64),
        ("surface", np.int64),
        ("centre", np.float64, (3,)),
        ("radius", np.float64),
        ("stiffness", np.float64),
        ("normal_stiffness", np.float64),
        ("damping", np.float64),
        ("friction", np.float64),
        ("position", np.float64, (3,)),
        ("measured_at", np.float64, (3,)),
        ("measured", np.float64),
        ("normal", np.float64, (3,)),
        ("distance", np.float64),
        ("lever", np.float64, (3,)),
        ("stretch", np.float64, (3,)),
        ("displacement", np.float64, (3,)),
        ("force", np.float64, (3,)),
        ("normal_force", np.float64),
        ("slip", np.float64),
        ("wood", np.int64),
        ("on_wood", np.int64),
        ("splinter", np.int64),
        ("local", np.float64, (3,)),
    ],
    align=True,
)
"""One small sphere of a body against one surface.

Coal gave the distance ``measured`` at the place ``measured_at``; ``distance`` follows the present position from there,
exactly while the same ``face`` is nearest. On a sheet the distance is the gap above its shape at rest, and
``normal_stiffness`` what it opposes to the depth there; elsewhere it is ``stiffness``. ``lever`` goes from the body's
origin to the contact, ``stretch`` is that of the tangential spring, ``slip`` by how much the last step has drawn it
along [m]. ``wood`` is the surface's piece of wood or -1, ``splinter`` the one that holds the point or -1, ``local`` the
point in the box's axes while it is ``on_wood``.
"""


@compiled
def find_near_points(plant: PlantState, clearance: float) -> int:
    """Places every point in world, marks those within a clearance [m] of their surface, counts the stale.

    Stale is a point that since the last query has come near, met another face, or moved by more
    than ``FRESH`` around an edge.
    """
    contacts, hands, count, local = plant.contacts, plant.hands, 0, np.empty(3)
    for i in range(contacts.size):
        contact = contacts[i]
        if contact.body < hands.size:
            hand = hands[contact.body]
            _place_point(contact, hand.rotation, hand.translation)
        else:
            _place_point(contact, plant.body.rotation, plant.start.object_position)
        was_near, surface = contact.near, plant.surfaces[contact.surface]
        to_surface_axes(surface, contact.position, local)
        if surface.sheet.span_count > 0:
            find_on_sheet(surface.sheet, contact, local, clearance)
            continue
        if surface.kind != FLAT:
            find_on_shape(plant, surface, contact, local, clearance)
            continue
        contact.near = _distance_bound(surface, local) < contact.radius + clearance
        contact.stale = 0
        if not contact.near:
            continue
        face = _nearest_face(surface, local)
        known = was_near and (face == contact.face if face != EDGE else _moved(contact) < FRESH)
        if not known:
            contact.stale, contact.face = 1, face
            count += 1
    return count


@compiled
def _place_point(contact: Row, rotation: Matrix, origin: Vector) -> None:
    """Writes the centre of a point in world [m]."""
    turn(rotation, contact.centre, contact.position)
    for k in range(3):
        contact.position[k] += origin[k]


@compiled
def _moved(contact: Row) -> float:
    """Gives how far a point has come since the last query [m]."""
    square = 0.0
    for k in range(3):
        square += (contact.position[k] - contact.measured_at[k]) ** 2
    return math.sqrt(square)


@compiled
def _distance_bound(surface: Row, local: Vector) -> float:
    """Bounds the distance of a point in the surface's axes to a plane or a box from below [m]."""
    if surface.is_plane:
        return float(local[2])
    gap = -math.inf
    for k in range(3):
        gap = max(gap, abs(local[k]) - surface.half[k])
    return gap


@compiled
def _nearest_face(surface: Row, local: Vector) -> int:
    """Numbers the face nearest to a point in the surface's own axes: the axis (1 to 3) with its sign, or ``EDGE``."""
    if surface.is_plane:
        return 3
    outside, gap, face = 0, -math.inf, 0
    for k in range(3):
        beyond = abs(local[k]) - surface.half[k]
        outside += beyond > 0.0
        if beyond > gap:
            gap, face = beyond, k + 1 if local[k] > 0.0 else -k - 1
    return face if outside < 2 else EDGE


@compiled
def place_contacts(plant: PlantState) -> None:
    """Writes each near point's distance now, and the lever from its body's origin to its contact [m]."""
    contacts, hands, local = plant.contacts, plant.hands, np.empty(3)
    for i in range(contacts.size):
        contact = contacts[i]
        if not contact.near:
            continue
        on_hand, surface = contact.body < hands.size, plant.surfaces[contact.surface]
        if surface.sheet.span_count > 0:
            to_surface_axes(surface, contact.position, local)
            place_on_sheet(surface, contact, local)
        else:
            contact.distance = contact.measured
            for k in range(3):
                contact.distance += contact.normal[k] * (contact.position[k] - contact.measured_at[k])
        for k in range(3):
            origin = hands[contact.body].translation[k] if on_hand else plant.start.object_position[k]
            contact.lever[k] = contact.position[k] - origin - contact.radius * contact.normal[k]


@compiled
def contact_forces(plant: PlantState) -> float:
    """Adds the wrenches of all touching points to their bodies; returns the power they give them [W]."""
    contacts, power, velocity = plant.contacts, 0.0, np.empty(3)
    for i in range(contacts.size):
        contact = contacts[i]
        contact.touching = 0
        contact.normal_force = 0.0
        if not contact.near:
            continue
        displacement, twist = plant.displacement[contact.body], plant.twist[contact.body]
        for k in range(3):
            contact.displacement[k] = displacement[k]
            velocity[k] = twist[k]
        add_cross(displacement[3:], contact.lever, contact.displacement)
        add_cross(twist[3:], contact.lever, velocity)
        if point_force(plant, contact, velocity):
            wrench = plant.contact_wrench[contact.body]
            for k in range(3):
                wrench[k] += contact.force[k]
            add_cross(contact.lever, contact.force, wrench[3:])
            power += dot(contact.force, velocity)
    return power


@compiled
def point_force(plant: PlantState, contact: Row, velocity: Vector) -> bool:
    """Writes the force on one point with a velocity (3,) [m/s] in newtons; returns whether it touches."""
    normal, surface = contact.normal, plant.surfaces[contact.surface]
    if surface.sheet.span_count > 0:
        push = _sheet_push(surface, contact)
    elif surface.kind != FLAT:
        push = shape_push(plant, surface, contact)
    else:
        push = -contact.stiffness * (contact.distance + dot(normal, contact.displacement))
    if push <= 0.0:
        return False
    approach = -dot(normal, velocity)
    normal_force = max(0.0, push + contact.damping * approach)
    length = 0.0
    along = dot(normal, contact.displacement)
    for k in range(3):
        stretch = contact.stretch[k] + contact.displacement[k] - along * normal[k]
        slide = velocity[k] + approach * normal[k]
        contact.force[k] = -contact.stiffness * stretch - contact.damping * slide
        length += contact.force[k] ** 2
    length = math.sqrt(length)
    bound = contact.friction * normal_force
    share = bound / length if length > bound and contact.splinter < 0 else 1.0
    for k in range(3):
        contact.force[k] = share * contact.force[k] + normal_force * normal[k]
    contact.normal_force = normal_force
    contact.touching = 1
    return True


@compiled
def _sheet_push(surface: Row, contact: Row) -> float:
    """Writes the normal of a bent sheet under a moved point; returns the force along it [N]."""
    moved, local = np.empty(3), np.empty(3)
    for k in range(3):
        moved[k] = contact.position[k] + contact.displacement[k]
    to_surface_axes(surface, moved, local)
    return float(press_on_sheet(surface, contact, local))


@compiled
def update_friction_springs(plant: PlantState) -> None:
    """Moves the tangential springs to the step's end; those beyond friction's bound are drawn along."""
    for i in range(plant.contacts.size):
        contact = plant.contacts[i]
        contact.slip = 0.0
        if not contact.touching:
            for k in range(3):
                contact.stretch[k] = 0.0
            continue
        displacement = plant.displacement[contact.body]
        for k in range(3):
            contact.displacement[k] = displacement[k]
        add_cross(displacement[3:], contact.lever, contact.displacement)
        along = dot(contact.normal, contact.displacement) + dot(contact.normal, contact.stretch)
        for k in range(3):
            contact.stretch[k] += contact.displacement[k] - along * contact.normal[k]
        length = math.sqrt(dot(contact.stretch, contact.stretch))
        bound = contact.friction * contact.normal_force / contact.stiffness
        if length > bound and contact.splinter < 0:
            contact.slip = length - bound
            for k in range(3):
                contact.stretch[k] *= bound / length


def hand_point() -> Point:
    """Gives a hand's point of contact: centre (3,) in the hand frame [m], radius [m]."""
    return np.zeros(3), 0.0


def object_points(shape: str, size: tuple[float, ...]) -> tuple[Point, ...]:
    """Gives the object's points of contact: centres (3,) in its own axes [m], radii [m]."""
    if shape == "sphere":
        return ((np.zeros(3), 0.5 * size[0]),)
    radius = min(CORNER_RADIUS, 0.25 * min(size))
    if shape == "box":
        reach = [0.5 * edge - radius for edge in size]
        signs = itertools.product((-1.0, 1.0), repeat=3)
        return tuple((np.multiply(sign, reach), radius) for sign in signs)
    across, along = 0.5 * size[0] - radius, 0.5 * size[1] - radius
    angles = [2.0 * math.pi * k / RIM_POINTS for k in range(RIM_POINTS)]
    return tuple(
        (np.array([across * math.cos(angle), across * math.sin(angle), end]), radius)
        for end in (-along, along)
        for angle in angles
    )


def contact_table(surfaces: Sequence[SurfaceSpec], bodies: Sequence[Sequence[Point]], woods: Table) -> Table:
    """Tabulates every point of every body against every surface and the wood on it."""
    rows = [
        (number, point, index)
        for number, points in enumerate(bodies)
        for point in points
        for index in range(len(surfaces))
    ]
    table = new_table(len(rows), CONTACT_POINT)
    table["splinter"] = -1
    on_surface = {int(wood["surface"]): number for number, wood in enumerate(woods)}
    for row, (body, (centre, radius), index) in zip(table, rows, strict=True):
        row["body"], row["surface"], row["centre"], row["radius"] = body, index, centre, radius
        row["wood"] = on_surface.get(index, -1)
        for name in ("stiffness", "damping", "friction"):
            row[name] = getattr(surfaces[index], name)
        row["normal_stiffness"] = surfaces[index].stiffness
    return table


class SurfaceDistances:
    """Coal's shapes, one query per pair of point and surface, and the table that takes the answers."""

    def __init__(self, surfaces: Sequence[SurfaceSpec], contacts: Table) -> None:
        shapes = [_shape(surface) for surface in surfaces]
        self._stale = contacts["stale"]
        self._position, self._radius = contacts["position"], contacts["radius"]
        self._measured_at, self._measured = contacts["measured_at"], contacts["measured"]
        self._normal = contacts["normal"]
        self._point = coal.Sphere(0.0)
        self._at = coal.Transform3s()
        self._request = coal.DistanceRequest()
        self._request.enable_signed_distance = True
        self._result = coal.DistanceResult()
        # Coal is asked about planes and boxes alone: no point on another surface goes stale.
        queried = [(i, shapes[index]) for i, index in enumerate(contacts["surface"])]
        # Kept whole: a query does not keep its shape alive.
        self._shapes = {i: shape for i, shape in queried if shape is not None}
        self._queries = {
            i: coal.ComputeDistance(self._point, shape) for i, (shape, _) in self._shapes.items()
        }

    def measure(self) -> None:
        """Writes signed distance [m] (below 0 inside) and outward normal of every stale point."""
        at, request, result = self._at, self._request, self._result
        for i in self._stale.nonzero()[0].tolist():
            self._measured_at[i] = self._position[i]
            at.setTranslation(self._position[i])
            result.clear()
            distance = self._queries[i](at, self._shapes[i][1], request, result)
            self._measured[i] = distance - self._radius[i]
            self._normal[i] = -result.normal


def _shape(surface: SurfaceSpec) -> tuple[coal.CollisionGeometry, coal.Transform3s] | None:
    """Builds coal's shape and pose of a plane or a box; None of others."""
    if surface.surface not in {"plane", "box"}:
        return None
    row = surface_row(surface)
    if surface.size is None:
        normal = np.array(row["rotation"][:, 2])
        return coal.Halfspace(normal, float(normal @ row["translation"])), coal.Transform3s()
    pose = coal.Transform3s()
    pose.setRotation(np.array(row["rotation"]))
    pose.setTranslation(np.array(row["translation"]))
    return coal.Box(*surface.size), pose
