# SPDX-License-Identifier: BSD-3-Clause
"""One recorded row, filled in by compiled code in the order of ``record.columns``."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from impedance_modules.compiled import compiled
from impedance_modules.control.compiled_memory import (
    EFFORTS,
    RESULT,
    SCALARS,
    TARGET_ROTATION,
    TARGET_TRANSLATION,
    TIME,
    one,
    three,
    two,
)
from impedance_modules.control.memory import CLOCK, GRANTED, PAID
from impedance_modules.safety.compiled_ledger import LEVEL, SCALE

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


@compiled
def quaternion(rotation: Array, out: Array) -> None:
    """Writes the unit quaternion (x, y, z, w), w >= 0, of a rotation matrix."""
    a, b, c = rotation[0, 0], rotation[1, 1], rotation[2, 2]
    if a + b + c >= 0.0:
        r = math.sqrt(1.0 + a + b + c)
        s = 0.5 / r
        out[0] = (rotation[2, 1] - rotation[1, 2]) * s
        out[1] = (rotation[0, 2] - rotation[2, 0]) * s
        out[2] = (rotation[1, 0] - rotation[0, 1]) * s
        out[3] = 0.5 * r
        return
    i = 0
    if b > a:
        i = 1
    if c > rotation[i, i]:
        i = 2
    j, k = (i + 1) % 3, (i + 2) % 3
    r = math.sqrt(1.0 + rotation[i, i] - rotation[j, j] - rotation[k, k])
    s = 0.5 / r
    out[i] = 0.5 * r
    out[j] = (rotation[j, i] + rotation[i, j]) * s
    out[k] = (rotation[k, i] + rotation[i, k]) * s
    out[3] = (rotation[k, j] - rotation[j, k]) * s
    if out[3] < 0.0:
        for m in range(4):
            out[m] = -out[m]


@compiled
def _pose(row: Array, at: int, rotation: Array, translation: Array) -> int:
    for k in range(3):
        row[at + k] = translation[k]
    quaternion(rotation, row[at + 3 : at + 7])
    return at + 7


@compiled
def write_poses(rotation: Array, translation: Array, out: Array) -> None:
    """Writes poses (k, 3, 3), (k, 3) [m] as (k, 7): position, then unit quaternion (x, y, z, w)."""
    for k in range(len(out)):
        _pose(out[k], 0, rotation[k], translation[k])


@compiled
def fill_row(
    row: Array,
    time: float,
    rung: float,
    active: float,
    late: float,
    interrupted: float,
    q: Array,
    v: Array,
    command: Array,
    effort: Array,
    rotation: Array,
    translation: Array,
    wrench: Array,
    target_slots: Indices,
    modules: Indices,
    memory: Array,
    at: Indices,
) -> None:
    """Fills a row.

    Args:
        row: (columns without the phase,), overwritten.
        time: [s].
        rung: Of the stop ladder.
        active: Number of filter rows that changed the torque.
        late: 1 where the last torque missed its deadline, else 0.
        interrupted: 1 where somebody asked for a stop, else 0.
        q: (n,) [rad].
        v: (n,) [rad/s].
        command: (n,) torque that left [N.m].
        effort: (n,) measured [N.m].
        rotation: (frames, 3, 3), hands first.
        translation: (frames, 3) [m].
        wrench: (hands, 6) of the surroundings on each hand.
        target_slots: Springs whose targets are recorded.
        modules: (k, 2) module and joint of every torque that is recorded.
        memory: Of the cycle (``control.memory``), for tank, clock, targets and modules' torques.
        at: Where each array begins in it.
    """
    n, hands = q.size, wrench.shape[0]
    row[0] = time
    for j in range(n):
        row[1 + j] = q[j]
        row[1 + n + j] = v[j]
        row[1 + 2 * n + j] = command[j]
        row[1 + 3 * n + j] = effort[j]
    k = 1 + 4 * n
    scalars, clock = one(memory, at, SCALARS), one(memory, at, TIME)
    row[k], row[k + 1] = scalars[LEVEL], scalars[SCALE]
    row[k + 2], row[k + 3], row[k + 4] = clock[GRANTED], one(memory, at, RESULT)[PAID], clock[CLOCK]
    row[k + 5], row[k + 6], row[k + 7], row[k + 8] = rung, active, late, interrupted
    k += 9
    for h in range(hands):
        k = _pose(row, k, rotation[h], translation[h])
    target_rotation = three(memory, at, TARGET_ROTATION, 3, 3)
    target_translation = two(memory, at, TARGET_TRANSLATION, 3)
    for s in target_slots:
        k = _pose(row, k, target_rotation[s], target_translation[s])
    for h in range(hands):
        row[k : k + 6] = wrench[h]
        k += 6
    efforts = two(memory, at, EFFORTS, n)
    for m in range(modules.shape[0]):
        row[k + m] = efforts[modules[m, 0], modules[m, 1]]
