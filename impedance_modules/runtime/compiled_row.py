# SPDX-License-Identifier: BSD-3-Clause
"""One recorded row, filled in by compiled code in the order of ``record.columns``."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from impedance_modules.compiled import compiled

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
def fill_row(
    row: Array,
    time: float,
    extras: Array,
    q: Array,
    v: Array,
    command: Array,
    effort: Array,
    rotation: Array,
    translation: Array,
    hands: int,
    target_slots: Indices,
    target_rotation: Array,
    target_translation: Array,
    wrench: Array,
    module_rows: Indices,
    module_joints: Indices,
    efforts: Array,
) -> None:
    """Fills a row.

    Args:
        row: (columns without the phase,), overwritten.
        time: [s].
        extras: Tank level and the other scalars.
        q: (n,) [rad].
        v: (n,) [rad/s].
        command: (n,) torque that left [N.m].
        effort: (n,) measured [N.m].
        rotation: (frames, 3, 3), hands first.
        translation: (frames, 3) [m].
        hands: How many.
        target_slots: Springs whose targets are recorded.
        target_rotation: (springs, 3, 3).
        target_translation: (springs, 3) [m].
        wrench: (hands, 6) of the surroundings on each hand.
        module_rows: Of the entries of ``efforts`` that are recorded.
        module_joints: Likewise.
        efforts: (modules, n) torque of every module.
    """
    n = q.size
    row[0] = time
    at = 1
    for j in range(n):
        row[at + j] = q[j]
        row[at + n + j] = v[j]
        row[at + 2 * n + j] = command[j]
        row[at + 3 * n + j] = effort[j]
    at += 4 * n
    for value in extras:
        row[at] = value
        at += 1
    for h in range(hands):
        at = _pose(row, at, rotation[h], translation[h])
    for s in target_slots:
        at = _pose(row, at, target_rotation[s], target_translation[s])
    for h in range(hands):
        for k in range(6):
            row[at + k] = wrench[h, k]
        at += 6
    for k in range(module_rows.size):
        row[at + k] = efforts[module_rows[k], module_joints[k]]
