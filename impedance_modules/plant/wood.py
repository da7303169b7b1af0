# SPDX-License-Identifier: BSD-3-Clause
"""Pieces of wood on the tops of boxes: their tables, and what has become of them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impedance_modules.compiled import compiled
from impedance_modules.plant.plant_state import CELL, SPLINTER, WAVES, WOOD, Memory, Row, Table
from impedance_modules.robot.rotation import dot
from impedance_modules.spec.task import SurfaceSpec
from impedance_modules.spec.wood import WoodSpec

Array = NDArray[np.float64]

SPREAD = 0.25
"""Wavelengths of a texture lie within this share of the declared one."""


@dataclass(frozen=True)
class WoodState:
    """What has become of one piece of wood.

    Attributes:
        surface: Its place in the task's environment.
        rubbed: Work of friction on it [J].
        broken_work: Energy set free by splinters that broke [J].
        broken: How many splinters broke.
        standing: How many still stand.
        remaining: (nodes along x, nodes along y) share of the roughness that is left, every ``CELL``.
        damage: (splinters,) of each that still stands, 0 fresh, below 1.
    """

    surface: int
    rubbed: float
    broken_work: float
    broken: int
    standing: int
    remaining: Array
    damage: Array


def wood_tables(surfaces: Sequence[SurfaceSpec]) -> tuple[Table, Array, Table]:
    """Tabulates every piece of wood, the grid of work done on it, and its splinters, all fresh."""
    woods: list[Table] = []
    splinters: list[Table] = [np.zeros(0, SPLINTER)]
    nodes = 0
    for index, surface in enumerate(surfaces):
        if surface.wood is None or surface.size is None:
            continue
        row = _wood_row(index, surface, surface.wood, surface.size)
        grown = _grow(surface.wood, surface.size)
        row["first_node"] = nodes
        row["first_splinter"] = sum(table.size for table in splinters)
        row["last_splinter"] = row["first_splinter"] + grown.size
        nodes += int(np.prod(row["nodes"]))
        woods.append(row)
        splinters.append(grown)
    table = np.concatenate(woods) if woods else np.zeros(0, WOOD)
    return table, np.zeros(nodes), np.concatenate(splinters)


def _wood_row(index: int, surface: SurfaceSpec, wood: WoodSpec, size: Sequence[float]) -> Table:
    """Fills in the constants of one piece, (1,)."""
    row = np.zeros(1, WOOD)
    row["surface"], row["friction"] = index, surface.friction
    row["half"] = 0.5 * np.array(size[:2])
    row["nodes"] = [math.ceil(length / CELL) + 1 for length in size[:2]]
    row["wear"] = 1.0
    if wood.roughness is not None:
        row["height"], row["wear"] = wood.roughness.height, wood.roughness.wear
        row["rough_friction"] = wood.roughness.friction
        row["waves"] = _waves(np.random.default_rng([wood.seed, 0]), wood.roughness.wavelength)
    if wood.splinters is not None:
        row["reach"], row["endurance"] = wood.splinters.reach, wood.splinters.endurance
    return row


def _waves(source: np.random.Generator, wavelength: float) -> Array:
    """Draws ripples (8, 3): wave numbers along both axes [rad/m], and phase [rad]."""
    size = 2.0 * math.pi / (wavelength * (1.0 + SPREAD * source.uniform(-1.0, 1.0, WAVES)))
    way = source.uniform(0.0, 2.0 * math.pi, WAVES)
    phase = source.uniform(0.0, 2.0 * math.pi, WAVES)
    return np.column_stack([size * np.cos(way), size * np.sin(way), phase])


def _grow(wood: WoodSpec, size: Sequence[float]) -> Table:
    """Strews splinters over the top face."""
    if wood.splinters is None:
        return np.zeros(0, SPLINTER)
    source = np.random.default_rng([wood.seed, 1])
    count = int(source.poisson(wood.splinters.density * size[0] * size[1]))
    found = np.zeros(count, SPLINTER)
    found["u"] = size[0] * source.uniform(-0.5, 0.5, count)
    found["v"] = size[1] * source.uniform(-0.5, 0.5, count)
    found["force"] = source.uniform(*wood.splinters.force, count)
    return found


def renew_wood(memory: Memory) -> None:
    """Makes all wood as fresh as on the first day."""
    memory.worn[:] = 0.0
    memory.splinters["damage"], memory.splinters["broken"] = 0.0, 0
    memory.woods["rubbed"], memory.woods["broken"] = 0.0, 0.0
    for name in ("on_wood", "slid"):
        memory.contacts[name] = 0
    memory.contacts["caught"] = -1


def wood_states(memory: Memory) -> tuple[WoodState, ...]:
    """Says what has become of every piece of wood."""
    found = []
    for row in memory.woods:
        own = memory.splinters[row["first_splinter"] : row["last_splinter"]]
        nodes = (int(row["nodes"][0]), int(row["nodes"][1]))
        worn = memory.worn[row["first_node"] : row["first_node"] + nodes[0] * nodes[1]]
        standing = own["broken"] == 0
        found.append(
            WoodState(
                surface=int(row["surface"]),
                rubbed=float(row["rubbed"]),
                broken_work=float(row["broken"]),
                broken=int(np.sum(~standing)),
                standing=int(np.sum(standing)),
                remaining=np.exp(-worn / row["wear"]).reshape(nodes),
                damage=own["damage"][standing].copy(),
            )
        )
    return tuple(found)


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
