# SPDX-License-Identifier: BSD-3-Clause
r"""Wood under a touching point, compiled: a texture that wears off, splinters that hold and break.

On top of a box, at (u, v) in its own axes, fresh wood stands h above smooth wood. What is left of it is r, 1 at first:

    h = r H (1 + g(u, v)) / 2,   g = 1/8 \sum_k sin(k_k . (u, v) + \phi_k)      friction \mu + r \mu_r
    r = exp(-e / w)              e the friction work done here per area, w the wood's resistance to wear [J/m^2]

The point feels the potential k d^2 / 2 of its depth below that surface: its normal leans with the slope of h, and a
hill gives back going down what it took going up. e is kept on a grid; r between its nodes is bilinear.

A splinter near the point catches it: friction has no bound until it breaks. It bears f, what is beyond friction, and
is damaged as wood is by loads over time (exponential damage rate, Gerhards 1979), broken at D = 1:

    f = max(0, k |s| - \mu N),   D' = exp(10 (f / F - 1)) / T,    F its breaking force, T how long it bears it
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from impedance_modules.compiled import compiled
from impedance_modules.plant.plant_state import CELL, Row, Table
from impedance_modules.robot.rotation import dot

Array = NDArray[np.float64]

TOP = 3
"""Number of a box's top face."""

BRITTLENESS = 10.0
"""How steeply damage quickens with load: at nine tenths of its breaking force a splinter lasts e times as long."""


@compiled
def roughen(contacts: Table, surfaces: Table, woods: Table, worn: Array) -> None:
    """Writes distance, normal and friction of every point on wood, in place of those of the bare box."""
    found = np.empty(3)
    for i in range(contacts.size):
        contact = contacts[i]
        if contact.wood < 0:
            continue
        wood, surface = woods[contact.wood], surfaces[contact.surface]
        contact.on_wood = 1 if contact.near and contact.face == TOP else 0
        if not contact.on_wood:
            contact.friction = wood.friction
            contact.caught = -1
            continue
        local = contact.local
        for k in range(3):
            local[k] = 0.0
            for j in range(3):
                local[k] += surface.rotation[j, k] * (contact.position[j] - surface.translation[j])
        _remaining(wood, worn, local, found)
        contact.friction = wood.friction + found[0] * wood.rough_friction
        _stand_on(contact, surface, wood, found)


@compiled
def _stand_on(contact: Row, surface: Row, wood: Row, found: Array) -> None:
    """Writes distance and normal of a point above the texture; ``found`` is r and its slopes [1/m]."""
    ripple, along_u, along_v = 0.0, 0.0, 0.0
    waves = wood.waves
    for k in range(waves.shape[0]):
        phase = waves[k, 0] * contact.local[0] + waves[k, 1] * contact.local[1] + waves[k, 2]
        ripple += math.sin(phase) / waves.shape[0]
        along_u += waves[k, 0] * math.cos(phase) / waves.shape[0]
        along_v += waves[k, 1] * math.cos(phase) / waves.shape[0]
    half = 0.5 * wood.height
    height = half * found[0] * (1.0 + ripple)
    slope_u = half * (found[1] * (1.0 + ripple) + found[0] * along_u)
    slope_v = half * (found[2] * (1.0 + ripple) + found[0] * along_v)
    length = math.sqrt(1.0 + slope_u**2 + slope_v**2)
    contact.distance = (contact.local[2] - surface.half[2] - contact.radius - height) / length
    for k in range(3):
        leaning = surface.rotation[k, 2] - slope_u * surface.rotation[k, 0] - slope_v * surface.rotation[k, 1]
        contact.arm[k] += contact.radius * (contact.normal[k] - leaning / length)
        contact.normal[k] = leaning / length


@compiled
def _corner(wood: Row, local: Array, part: Array) -> int:
    """Finds the grid cell of a place: number of its first node; writes how far into the cell it is (2,)."""
    u = min(max((local[0] + wood.half[0]) / CELL, 0.0), wood.nodes[0] - 1.000001)
    v = min(max((local[1] + wood.half[1]) / CELL, 0.0), wood.nodes[1] - 1.000001)
    part[0], part[1] = u - math.floor(u), v - math.floor(v)
    return int(wood.first_node + math.floor(u) * wood.nodes[1] + math.floor(v))


@compiled
def _remaining(wood: Row, worn: Array, local: Array, found: Array) -> None:
    """Writes r at a place, and its slopes along both axes [1/m]."""
    part = np.empty(2)
    first = _corner(wood, local, part)
    a, b = part[0], part[1]
    here, ahead = first, first + wood.nodes[1]
    r00, r01 = math.exp(-worn[here] / wood.wear), math.exp(-worn[here + 1] / wood.wear)
    r10, r11 = math.exp(-worn[ahead] / wood.wear), math.exp(-worn[ahead + 1] / wood.wear)
    found[0] = (1 - a) * ((1 - b) * r00 + b * r01) + a * ((1 - b) * r10 + b * r11)
    found[1] = ((1 - b) * (r10 - r00) + b * (r11 - r01)) / CELL
    found[2] = ((1 - a) * (r01 - r00) + a * (r11 - r10)) / CELL


@compiled
def settle_wood(contacts: Table, woods: Table, worn: Array, splinters: Table, step: float) -> None:
    """Wears the wood by what a step [s] has rubbed; lets splinters catch, bear and break."""
    part = np.empty(2)
    for i in range(contacts.size):
        contact = contacts[i]
        if contact.wood < 0:
            continue
        if not (contact.on_wood and contact.touching):
            contact.caught = -1
            continue
        wood = woods[contact.wood]
        work = contact.friction * contact.pressure * contact.slid
        if work > 0.0:
            _wear(wood, worn, contact.local, work, part)
        if contact.caught >= 0:
            _bear(contact, wood, splinters, step)
        else:
            contact.caught = _catch(wood, splinters, contact.local)


@compiled
def _wear(wood: Row, worn: Array, local: Array, work: float, part: Array) -> None:
    """Adds friction work [J] to the four nodes around a place, as work per area."""
    first = _corner(wood, local, part)
    a, b, area = part[0], part[1], CELL**2
    worn[first] += (1 - a) * (1 - b) * work / area
    worn[first + 1] += (1 - a) * b * work / area
    worn[first + wood.nodes[1]] += a * (1 - b) * work / area
    worn[first + wood.nodes[1] + 1] += a * b * work / area
    wood.rubbed += work


@compiled
def _catch(wood: Row, splinters: Table, local: Array) -> int:
    """Finds the nearest standing splinter within reach of a place; -1 where there is none."""
    nearest, least = -1, wood.reach**2
    for j in range(wood.first_splinter, wood.last_splinter):
        if splinters[j].broken == 0:
            square = (splinters[j].u - local[0]) ** 2 + (splinters[j].v - local[1]) ** 2
            if square < least:
                nearest, least = j, square
    return nearest


@compiled
def _bear(contact: Row, wood: Row, splinters: Table, step: float) -> None:
    """Damages the splinter that holds a point; where it breaks, the point's spring snaps back to friction's reach."""
    splinter = splinters[contact.caught]
    stretch = math.sqrt(dot(contact.slip, contact.slip))
    reach = contact.friction * contact.pressure / contact.stiffness
    load = contact.stiffness * (stretch - reach)
    if load <= 0.0:
        return
    splinter.damage += (
        step / wood.endurance * math.exp(min(BRITTLENESS * (load / splinter.force - 1.0), 30.0))
    )
    if splinter.damage < 1.0:
        return
    splinter.broken = 1
    contact.caught = -1
    wood.broken += 0.5 * contact.stiffness * (stretch**2 - reach**2)
    for k in range(3):
        contact.slip[k] *= reach / stretch
