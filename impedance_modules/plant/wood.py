# SPDX-License-Identifier: BSD-3-Clause
"""Pieces of wood on the tops of boxes: their tables, and what has become of them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impedance_modules.plant.plant_state import CELL, SPLINTER, WAVES, WOOD, Memory, Table
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
