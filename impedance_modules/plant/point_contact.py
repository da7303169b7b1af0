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

import math

import numpy as np
from numpy.typing import NDArray

from impedance_modules.compiled import compiled
from impedance_modules.plant.contact.compiled_sheet import find_on_sheet, place_on_sheet, press_on_sheet
from impedance_modules.plant.plant_state import Row, Table
from impedance_modules.robot.rotation import add_cross, dot, turn

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
