# SPDX-License-Identifier: BSD-3-Clause
"""Squeeze and weight of a held object compiled for the control loop; see ``squeeze.py`` and ``weight.py``.

With rigid grasps both shares are fixed in the object's axes: the squeeze as wrenches, the weight as linear
maps of the direction of gravity. They are computed once and turned with the object.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from impedance_modules.compiled import compiled
from impedance_modules.modules.held_object import STANDARD_GRAVITY, HeldObject, share_wrench, squeeze_forces
from impedance_modules.robot.rotation import compose

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


class ObjectShares(NamedTuple):
    """What each hand adds for the object, in the object's axes O.

    Attributes:
        squeeze: (hands, 6) wrench of each hand on the object [N, N.m].
        weight: (hands, 6, 3) wrench of each hand per force that holds the object up.
        lift: Force that holds it up, m g, along z of the world [N]; 0 when the weight is not carried.
        slots: (hands,) place of each hand among the cycle's frames.
        turn: (3, 3) R_HO of the first hand, from which the object's axes are known.
    """

    squeeze: Array
    weight: Array
    lift: float
    slots: Indices
    turn: Array


def object_shares(held: HeldObject | None, frames: tuple[str, ...]) -> ObjectShares:
    """Computes the shares of a task's object; without an object there are no hands in them."""
    if held is None:
        return ObjectShares(
            np.zeros((0, 6)), np.zeros((0, 6, 3)), 0.0, np.zeros(0, dtype=np.int64), np.eye(3)
        )
    offsets = np.array([grasp.translation for grasp in held.grasps])
    squeeze = np.zeros((len(offsets), 6))
    if held.spec.squeeze > 0.0:
        squeeze[:, :3] = squeeze_forces(offsets, held.spec.squeeze)
    columns = [share_wrench(offsets, np.eye(6)[axis]) for axis in range(3)]
    return ObjectShares(
        squeeze,
        np.stack(columns, axis=2),
        held.spec.mass * STANDARD_GRAVITY if held.spec.carry_weight else 0.0,
        np.array([frames.index(hand) for hand in held.hands], dtype=np.int64),
        np.ascontiguousarray(held.grasps[0].rotation.T),
    )


@compiled
def object_efforts(
    squeeze: Array,
    weight: Array,
    lift: float,
    slots: Indices,
    turn: Array,
    rotation: Array,
    jacobian: Array,
    moved_by: Indices,
    squeeze_effort: Array,
    weight_effort: Array,
) -> None:
    """Writes J^T of every hand's squeeze and weight wrench into two torques (n,) [N.m].

    Args:
        squeeze: Of ``ObjectShares``, like the next four.
        weight: Likewise.
        lift: Likewise.
        slots: Likewise.
        turn: Likewise.
        rotation: (frames, 3, 3).
        jacobian: (frames, 6, n).
        moved_by: (2, frames) first and one past the last joint that moves each frame.
        squeeze_effort: (n,), overwritten.
        weight_effort: (n,), overwritten.
    """
    squeeze_effort[:] = 0.0
    weight_effort[:] = 0.0
    if slots.size == 0:
        return
    R_WO, share = np.empty((3, 3)), np.empty(6)
    compose(rotation[slots[0]], turn, R_WO)
    for h in range(slots.size):
        first, last = moved_by[0, slots[h]], moved_by[1, slots[h]]
        for i in range(6):
            share[i] = 0.0
            for k in range(3):
                share[i] += weight[h, i, k] * R_WO[2, k] * lift
        _add(R_WO, squeeze[h], jacobian[slots[h]], first, last, squeeze_effort)
        _add(R_WO, share, jacobian[slots[h]], first, last, weight_effort)


@compiled
def _add(R_WO: Array, wrench: Array, jacobian: Array, first: int, last: int, effort: Array) -> None:
    """Adds J^T (R_WO wrench)."""
    for i in range(3):
        force, moment = 0.0, 0.0
        for k in range(3):
            force += R_WO[i, k] * wrench[k]
            moment += R_WO[i, k] * wrench[3 + k]
        for j in range(first, last):
            effort[j] += jacobian[i, j] * force + jacobian[3 + i, j] * moment
