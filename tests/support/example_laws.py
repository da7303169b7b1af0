# SPDX-License-Identifier: BSD-3-Clause
"""Laws of no meaning that use every kind of field and of call, for the tests of laws and records."""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np

from impedance_modules.compiled import compiled
from impedance_modules.records import (
    Array3,
    Flag,
    IndexMatrix,
    Indices,
    Integer,
    Matrix,
    Record,
    Row,
    Scalar,
    Table,
    Vector,
)

CELL = np.dtype(
    [("kind", np.int64), ("level", np.float64), ("axis", np.float64, (3,)), ("turn", np.float64, (3, 3))],
    align=True,
)


class Tank(Record):
    """A record with defaults, arrays and a table."""

    level: Scalar
    spilled: Scalar = 0.0
    missed: Integer = 0
    short: Flag = False
    applied: Vector
    pending: Matrix
    cells: Annotated[Table, CELL]


class Cycle(Record):
    """A record that holds another."""

    clock: Scalar
    tank: Tank
    stiffness: Array3
    reach: IndexMatrix
    slots: Indices
    rest: Vector


@compiled
def book(tank: Tank, q: Vector, potential: float) -> float:
    """Numbers, arrays and a flag of a record, a loop and a branch."""
    work = 0.0
    for i in range(q.size):
        work += abs(tank.pending[0, i]) * q[i]
        tank.applied[i] = q[i] * math.sqrt(potential)
    tank.level -= work
    tank.missed += 1
    tank.short = tank.level < 0.0
    if tank.short:
        tank.spilled = max(0.0, -tank.level)
    return work


@compiled
def absolute_dot(effort: Vector, weight: Vector) -> float:
    """A law that others call, by place and by name."""
    total = 0.0
    for i in range(effort.size):
        total += abs(effort[i]) * weight[i]
    return total


@compiled
def fill(cell: Row, rate: float) -> float:
    """Changes one row of a table."""
    cell.level += rate
    cell.axis[1] = cell.level
    return float(cell.level if cell.kind == 1 else -cell.level)


@compiled
def fill_all(tank: Tank, rate: float) -> float:
    """Changes a table row by row, through a row and through the table."""
    total = 0.0
    for i in range(tank.cells.size):
        cell = tank.cells[i]
        total += fill(cell, rate) + fill(tank.cells[i], 0.5 * rate)
        tank.cells[i].turn[0, 2] = total
        cell.kind = 1 - cell.kind
    return total


@compiled
def cycle(memory: Cycle, q: Vector) -> tuple[float, int]:
    memory.clock += 0.001
    cost = book(memory.tank, q, 2.0) + absolute_dot(q, memory.rest)
    memory.tank.level += absolute_dot(effort=q, weight=memory.rest)
    n = q.size
    memory.rest[:] = 0.0
    memory.rest[2 * 1 :] = memory.stiffness[0, 0, : n - 2]
    memory.stiffness[1] = memory.stiffness[0]
    memory.reach[1, 0] += memory.slots[0]
    shift(memory.tank.pending)
    cost += fill_all(memory.tank, 0.25)
    memory.tank.pending[-1, :] = 0.0
    rest = memory.rest
    rest *= 2.0
    return cost, memory.reach[1, 0]


@compiled
def shift(pending: Matrix) -> None:
    for k in range(pending.shape[0] - 1):
        pending[k, :] = pending[k + 1, :]


@compiled
def same_tank(memory: Cycle) -> Tank:
    return memory.tank


@compiled
def rest_of(memory: Cycle) -> Vector:
    return memory.rest


@compiled
def rebind(memory: Cycle, q: Vector) -> None:
    memory.rest = q


@compiled
def with_default(x: float, factor: float = 3.0, shift: float | None = None) -> float:
    return x * factor + (0.0 if shift is None else shift)


def new(n: int = 4) -> Cycle:
    rng = np.random.default_rng(1)
    cells = np.zeros(3, CELL)
    cells["kind"] = [0, 1, 0]
    tank = Tank(level=1.0, applied=np.zeros(n), pending=rng.normal(size=(3, n)), cells=cells)
    return Cycle(
        clock=0.0,
        tank=tank,
        stiffness=rng.normal(size=(3, 2, n)),
        rest=rng.normal(size=n),
        reach=np.arange(6).reshape(2, 3),
        slots=np.array([5, 6]),
    )
