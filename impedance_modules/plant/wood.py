# SPDX-License-Identifier: BSD-3-Clause
r"""Wood on top of a box: a texture that is worn away, splinters that hold and break.

At (u, v) in the box's axes, fresh wood stands h above smooth wood. What is left of it is r, 1 at first:

    h = r H (1 + g(u, v)) / 2,   g = 1/8 \sum_k sin(k_k . (u, v) + \phi_k)      friction \mu + r \mu_r
    r = exp(-e / w)              e the friction work done here per area, w the wood's resistance to wear [J/m^2]

The point has the potential k d^2 / 2 of its depth below that surface: its normal leans with the slope of h, and a
hill gives back going down what it took going up. e is kept on a grid; r between its nodes is bilinear.

A splinter near the point catches it: friction has no bound until it breaks. It bears f, what is beyond friction, and
is damaged as wood is by loads over time (exponential damage rate, Gerhards 1979), broken at D = 1:

    f = max(0, k |s| - \mu N),   D' = exp(10 (f / F - 1)) / T,    F its breaking force, T how long it bears it
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from impedance_modules.compiled import compiled
from impedance_modules.plant.surfaces import to_surface_axes
from impedance_modules.records import Matrix, Row, Table, Vector, new_table
from impedance_modules.robot.rotation import dot
from impedance_modules.spec.task import SurfaceSpec, WoodSpec

if TYPE_CHECKING:
    from impedance_modules.plant.plant_state import PlantState

CELL = 0.01
"""Distance of the nodes at which wood remembers the friction work done on it [m]."""

WAVES = 8
"""Ripples that make up a texture."""

SPREAD = 0.25
"""Wavelengths of a texture lie within this share of the declared one."""

TOP = 3
"""Number of a box's top face."""

BRITTLENESS = 10.0
"""How steeply damage quickens with load: at nine tenths of its breaking force a splinter lasts e times as long."""

WOOD = np.dtype(
    [
        ("surface", np.int64),
        ("half", np.float64, (2,)),
        ("friction", np.float64),
        ("rough_friction", np.float64),
        ("height", np.float64),
        ("wear", np.float64),
        ("waves", np.float64, (WAVES, 3)),
        ("nodes", np.int64, (2,)),
        ("first_node", np.int64),
        ("reach", np.float64),
        ("endurance", np.float64),
        ("first_splinter", np.int64),
        ("last_splinter", np.int64),
        ("friction_work", np.float64),
        ("splinter_work", np.float64),
    ],
    align=True,
)
"""One piece of wood: its texture, its part of the grid and of the splinters, and the work of friction and of breaking
splinters on it [J].
"""

SPLINTER = np.dtype(
    [
        ("u", np.float64),
        ("v", np.float64),
        ("force", np.float64),
        ("damage", np.float64),
        ("broken", np.int64),
    ],
    align=True,
)
"""One splinter: its place in the box's axes [m], its breaking force [N], its damage (1 breaks it)."""


@compiled
def apply_wood_texture(plant: PlantState) -> None:
    """Writes distance, normal and friction of every point on wood, in place of those of the bare box."""
    contacts, found = plant.contacts, np.empty(3)
    for i in range(contacts.size):
        contact = contacts[i]
        if contact.wood < 0:
            continue
        wood, surface = plant.woods[contact.wood], plant.surfaces[contact.surface]
        contact.on_wood = 1 if contact.near and contact.face == TOP else 0
        if not contact.on_wood:
            contact.friction = wood.friction
            contact.splinter = -1
            continue
        to_surface_axes(surface, contact.position, contact.local)
        _remaining_roughness(wood, plant.friction_work, contact.local, found)
        contact.friction = wood.friction + found[0] * wood.rough_friction
        _place_on_texture(contact, surface, wood, found)


@compiled
def _place_on_texture(contact: Row, surface: Row, wood: Row, found: Vector) -> None:
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
        contact.lever[k] += contact.radius * (contact.normal[k] - leaning / length)
        contact.normal[k] = leaning / length


@compiled
def _grid_cell(wood: Row, local: Vector, part: Vector) -> int:
    """Finds the grid cell of a place: number of its first node; writes how far into the cell it is (2,)."""
    u = min(max((local[0] + wood.half[0]) / CELL, 0.0), wood.nodes[0] - 1.000001)
    v = min(max((local[1] + wood.half[1]) / CELL, 0.0), wood.nodes[1] - 1.000001)
    part[0], part[1] = u - math.floor(u), v - math.floor(v)
    return int(wood.first_node + math.floor(u) * wood.nodes[1] + math.floor(v))


@compiled
def _remaining_roughness(wood: Row, friction_work: Vector, local: Vector, found: Vector) -> None:
    """Writes r at a place, and its slopes along both axes [1/m]."""
    part = np.empty(2)
    first = _grid_cell(wood, local, part)
    a, b = part[0], part[1]
    here, ahead = first, first + wood.nodes[1]
    r00, r01 = math.exp(-friction_work[here] / wood.wear), math.exp(-friction_work[here + 1] / wood.wear)
    r10, r11 = math.exp(-friction_work[ahead] / wood.wear), math.exp(-friction_work[ahead + 1] / wood.wear)
    found[0] = (1 - a) * ((1 - b) * r00 + b * r01) + a * ((1 - b) * r10 + b * r11)
    found[1] = ((1 - b) * (r10 - r00) + b * (r11 - r01)) / CELL
    found[2] = ((1 - a) * (r01 - r00) + a * (r11 - r10)) / CELL


@compiled
def update_wood(plant: PlantState, step: float) -> None:
    """Wears the wood by the friction work of a step [s]; lets splinters catch, bear and break."""
    part = np.empty(2)
    for i in range(plant.contacts.size):
        contact = plant.contacts[i]
        if contact.wood < 0:
            continue
        if not (contact.on_wood and contact.touching):
            contact.splinter = -1
            continue
        wood = plant.woods[contact.wood]
        work = contact.friction * contact.normal_force * contact.slip
        if work > 0.0:
            _add_friction_work(wood, plant.friction_work, contact.local, work, part)
        if contact.splinter >= 0:
            _load_splinter(contact, wood, plant.splinters, step)
        else:
            contact.splinter = _nearest_splinter(wood, plant.splinters, contact.local)


@compiled
def _add_friction_work(wood: Row, friction_work: Vector, local: Vector, work: float, part: Vector) -> None:
    """Adds friction work [J] to the four nodes around a place, as work per area."""
    first = _grid_cell(wood, local, part)
    a, b, area = part[0], part[1], CELL**2
    friction_work[first] += (1 - a) * (1 - b) * work / area
    friction_work[first + 1] += (1 - a) * b * work / area
    friction_work[first + wood.nodes[1]] += a * (1 - b) * work / area
    friction_work[first + wood.nodes[1] + 1] += a * b * work / area
    wood.friction_work += work


@compiled
def _nearest_splinter(wood: Row, splinters: Table, local: Vector) -> int:
    """Finds the nearest standing splinter within reach of a place; -1 where there is none."""
    nearest, least = -1, wood.reach**2
    for j in range(wood.first_splinter, wood.last_splinter):
        if splinters[j].broken == 0:
            square = (splinters[j].u - local[0]) ** 2 + (splinters[j].v - local[1]) ** 2
            if square < least:
                nearest, least = j, square
    return nearest


@compiled
def _load_splinter(contact: Row, wood: Row, splinters: Table, step: float) -> None:
    """Damages the splinter that holds a point; where it breaks, the point's spring snaps back to friction's bound."""
    splinter = splinters[contact.splinter]
    stretch = math.sqrt(dot(contact.stretch, contact.stretch))
    bound = contact.friction * contact.normal_force / contact.stiffness
    load = contact.stiffness * (stretch - bound)
    if load <= 0.0:
        return
    splinter.damage += (
        step / wood.endurance * math.exp(min(BRITTLENESS * (load / splinter.force - 1.0), 30.0))
    )
    if splinter.damage < 1.0:
        return
    splinter.broken = 1
    contact.splinter = -1
    wood.splinter_work += 0.5 * contact.stiffness * (stretch**2 - bound**2)
    for k in range(3):
        contact.stretch[k] *= bound / stretch


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
    remaining: Matrix
    damage: Vector


def wood_tables(surfaces: Sequence[SurfaceSpec]) -> tuple[Table, Vector, Table]:
    """Tabulates every piece of wood, the grid of work done on it, and its splinters, all fresh."""
    woods: list[Table] = []
    splinters: list[Table] = []
    nodes = 0
    for index, surface in enumerate(surfaces):
        if surface.wood is None or surface.size is None:
            continue
        row = _wood_row(index, surface, surface.wood, surface.size)
        grown = _draw_splinters(surface.wood, surface.size)
        row["first_node"] = nodes
        row["first_splinter"] = sum(table.size for table in splinters)
        row["last_splinter"] = row["first_splinter"] + grown.size
        nodes += int(np.prod(row["nodes"]))
        woods.append(row)
        splinters.append(grown)
    return _joined(woods, WOOD), np.zeros(nodes), _joined(splinters, SPLINTER)


def _joined(tables: Sequence[Table], row: np.dtype[np.void]) -> Table:
    joined = new_table(sum(table.size for table in tables), row)
    if tables:
        joined[:] = np.concatenate(tables)
    return joined


def _wood_row(index: int, surface: SurfaceSpec, wood: WoodSpec, size: Sequence[float]) -> Table:
    """Fills in the constants of one piece, (1,)."""
    row = new_table(1, WOOD)
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


def _waves(source: np.random.Generator, wavelength: float) -> Matrix:
    """Draws ripples (8, 3): wave numbers along both axes [rad/m], and phase [rad]."""
    size = 2.0 * math.pi / (wavelength * (1.0 + SPREAD * source.uniform(-1.0, 1.0, WAVES)))
    direction = source.uniform(0.0, 2.0 * math.pi, WAVES)
    phase = source.uniform(0.0, 2.0 * math.pi, WAVES)
    return np.column_stack([size * np.cos(direction), size * np.sin(direction), phase])


def _draw_splinters(wood: WoodSpec, size: Sequence[float]) -> Table:
    """Draws splinters, spread evenly over the top face."""
    if wood.splinters is None:
        return new_table(0, SPLINTER)
    source = np.random.default_rng([wood.seed, 1])
    count = int(source.poisson(wood.splinters.density * size[0] * size[1]))
    found = new_table(count, SPLINTER)
    found["u"] = size[0] * source.uniform(-0.5, 0.5, count)
    found["v"] = size[1] * source.uniform(-0.5, 0.5, count)
    found["force"] = source.uniform(*wood.splinters.force, count)
    return found


def renew_wood(plant: PlantState) -> None:
    """Makes all wood fresh again."""
    plant.friction_work[:] = 0.0
    plant.splinters["damage"], plant.splinters["broken"] = 0.0, 0
    plant.woods["friction_work"], plant.woods["splinter_work"] = 0.0, 0.0
    for name in ("on_wood", "slip"):
        plant.contacts[name] = 0
    plant.contacts["splinter"] = -1


def wood_states(plant: PlantState) -> tuple[WoodState, ...]:
    """Says what has become of every piece of wood."""
    found = []
    for row in plant.woods:
        own = plant.splinters[row["first_splinter"] : row["last_splinter"]]
        nodes = (int(row["nodes"][0]), int(row["nodes"][1]))
        work = plant.friction_work[row["first_node"] : row["first_node"] + nodes[0] * nodes[1]]
        standing = own["broken"] == 0
        found.append(
            WoodState(
                surface=int(row["surface"]),
                rubbed=float(row["friction_work"]),
                broken_work=float(row["splinter_work"]),
                broken=int(np.sum(~standing)),
                standing=int(np.sum(standing)),
                remaining=np.exp(-work / row["wear"]).reshape(nodes),
                damage=own["damage"][standing].copy(),
            )
        )
    return tuple(found)
