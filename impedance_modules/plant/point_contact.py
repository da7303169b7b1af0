# SPDX-License-Identifier: BSD-3-Clause
r"""Force of one point on one surface, compiled: a unilateral spring-damper with stick-slip friction.

    N = max(0, k d - c d_n')    only while the depth d > 0; never adhesive
    f_t = -k s - c v_t          s the stretch of a tangential spring that stuck at first touch,
    |f_t| <= mu N               beyond which the point slides and the spring is drawn along; no bound while a
                                splinter holds the point (``compiled_wood``)

Between two questions to coal the surface counts as flat: the normal stays, the depth changes linearly. While the
same face of the surface is nearest that is exact; around edges coal is asked again every ``FRESH``. A flexible sheet
is asked anew at every stage instead (``compiled_sheet``), and its normal force is the gradient of its energy.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import coal
import numpy as np
from numpy.typing import NDArray

from impedance_modules.compiled import compiled
from impedance_modules.errors import BadInput
from impedance_modules.plant.plant_state import CONTACT_POINT, SURFACE, Row, Table
from impedance_modules.plant.sheet import find_on_sheet, place_on_sheet, press_on_sheet, spans_of
from impedance_modules.robot.rotation import add_cross, dot, exp3, turn
from impedance_modules.spec.task import SurfaceSpec

Array = NDArray[np.float64]

FRESH = 1e-4
"""How far a point may move around an edge before coal is asked again [m]."""

EDGE = 0
"""In place of a face's number: an edge or corner is nearest."""


@compiled
def find_near(
    contacts: Table, surfaces: Table, hands: Table, body: Table, object_position: Array, margin: float
) -> int:
    """Places every point in world, marks those within ``margin`` [m] of their surface, counts the stale.

    Stale is a point that since coal was asked about it has come near, met another face, or moved by more
    than ``FRESH`` around an edge.
    """
    count = 0
    local = np.empty(3)
    for i in range(contacts.size):
        contact = contacts[i]
        if contact.body < hands.size:
            hand = hands[contact.body]
            _place_point(contact, hand.rotation, hand.translation)
        else:
            _place_point(contact, body[0].rotation, object_position)
        was_near, surface = contact.near, surfaces[contact.surface]
        clearance = _clearance(surface, contact.position, local)
        if surface.span_count > 0:
            find_on_sheet(surface, contact, local, margin)
            continue
        contact.near = clearance < contact.radius + margin
        contact.stale = 0
        if not contact.near:
            continue
        face = _face(surface, local)
        known = was_near and (face == contact.face if face != EDGE else _moved(contact) < FRESH)
        if not known:
            contact.stale, contact.face = 1, face
            count += 1
    return count


@compiled
def _place_point(contact: Row, rotation: Array, origin: Array) -> None:
    """Writes the centre of a point in world [m]."""
    turn(rotation, contact.centre, contact.position)
    for k in range(3):
        contact.position[k] += origin[k]


@compiled
def _moved(contact: Row) -> float:
    """Gives how far a point has come since coal was asked [m]."""
    square = 0.0
    for k in range(3):
        square += (contact.position[k] - contact.asked[k]) ** 2
    return math.sqrt(square)


@compiled
def _clearance(surface: Row, position: Array, local: Array) -> float:
    """Bounds the distance of a point to a surface from below [m], in the surface's own axes."""
    for k in range(3):
        local[k] = 0.0
        for j in range(3):
            local[k] += surface.rotation[j, k] * (position[j] - surface.translation[j])
    if surface.flat or surface.span_count > 0:
        return float(local[2])
    gap = -math.inf
    for k in range(3):
        gap = max(gap, abs(local[k]) - surface.half[k])
    return gap


@compiled
def _face(surface: Row, local: Array) -> int:
    """Numbers the face nearest to a point in the surface's own axes: the axis (1 to 3) with its sign, or ``EDGE``."""
    if surface.flat:
        return 3
    outside, gap, face = 0, -math.inf, 0
    for k in range(3):
        beyond = abs(local[k]) - surface.half[k]
        outside += beyond > 0.0
        if beyond > gap:
            gap, face = beyond, k + 1 if local[k] > 0.0 else -k - 1
    return face if outside < 2 else EDGE


@compiled
def place_contacts(surfaces: Table, contacts: Table, hands: Table, object_position: Array) -> None:
    """Writes each near point's distance now, and the arm from its body's origin to its contact [m]."""
    for i in range(contacts.size):
        contact = contacts[i]
        if not contact.near:
            continue
        on_hand = contact.body < hands.size
        if surfaces[contact.surface].span_count > 0:
            place_on_sheet(surfaces[contact.surface], contact)
        else:
            contact.distance = contact.measured
            for k in range(3):
                contact.distance += contact.normal[k] * (contact.position[k] - contact.asked[k])
        for k in range(3):
            origin = hands[contact.body].translation[k] if on_hand else object_position[k]
            contact.arm[k] = contact.position[k] - origin - contact.radius * contact.normal[k]


@compiled
def contact_forces(surfaces: Table, contacts: Table, motion: Array, wrench: Array) -> float:
    """Adds the wrenches of all touching points to their bodies; returns the power they give them [W]."""
    power, velocity = 0.0, np.empty(3)
    for i in range(contacts.size):
        contact = contacts[i]
        contact.touching = 0
        contact.pressure = 0.0
        if not contact.near:
            continue
        displacement, twist = motion[contact.body, 0], motion[contact.body, 1]
        for k in range(3):
            contact.move[k] = displacement[k]
            velocity[k] = twist[k]
        add_cross(displacement[3:], contact.arm, contact.move)
        add_cross(twist[3:], contact.arm, velocity)
        if _point_force(surfaces[contact.surface], contact, velocity):
            force = wrench[contact.body, 0]
            for k in range(3):
                force[k] += contact.force[k]
            add_cross(contact.arm, contact.force, force[3:])
            power += dot(contact.force, velocity)
    return power


@compiled
def _point_force(surface: Row, contact: Row, velocity: Array) -> bool:
    """Writes the force on one point [N]; returns whether it touches."""
    normal = contact.normal
    if surface.span_count > 0:
        push = press_on_sheet(surface, contact)
    else:
        push = -contact.stiffness * (contact.distance + dot(normal, contact.move))
    if push <= 0.0:
        return False
    approach = -dot(normal, velocity)
    pressure = max(0.0, push + contact.damping * approach)
    length = 0.0
    along = dot(normal, contact.move)
    for k in range(3):
        stretch = contact.slip[k] + contact.move[k] - along * normal[k]
        slide = velocity[k] + approach * normal[k]
        contact.force[k] = -contact.stiffness * stretch - contact.damping * slide
        length += contact.force[k] ** 2
    length = math.sqrt(length)
    bound = contact.friction * pressure
    share = bound / length if length > bound and contact.caught < 0 else 1.0
    for k in range(3):
        contact.force[k] = share * contact.force[k] + pressure * normal[k]
    contact.pressure = pressure
    contact.touching = 1
    return True


@compiled
def settle_contacts(contacts: Table, motion: Array) -> None:
    """Moves the tangential springs to the step's end; those beyond friction's reach are drawn along."""
    for i in range(contacts.size):
        contact = contacts[i]
        contact.slid = 0.0
        if not contact.touching:
            for k in range(3):
                contact.slip[k] = 0.0
            continue
        displacement = motion[contact.body, 0]
        for k in range(3):
            contact.move[k] = displacement[k]
        add_cross(displacement[3:], contact.arm, contact.move)
        along = dot(contact.normal, contact.move) + dot(contact.normal, contact.slip)
        for k in range(3):
            contact.slip[k] += contact.move[k] - along * contact.normal[k]
        length = math.sqrt(dot(contact.slip, contact.slip))
        reach = contact.friction * contact.pressure / contact.stiffness
        if length > reach and contact.caught < 0:
            contact.slid = length - reach
            for k in range(3):
                contact.slip[k] *= reach / length


Point = tuple[Array, float]

CORNER_RADIUS = 2e-3
"""Of the small spheres [m]; they lie inside the shape and touch its faces from within."""

RIM_POINTS = 8


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
