# SPDX-License-Identifier: BSD-3-Clause
"""Moving equilibria compiled for the control loop; the law is in ``pose_motion.py`` and ``equilibrium.py``.

``motion_table`` lays a phase's motions out as arrays: one mover per row, and for every spring the mover it
rides on and its fixed pose on it. ``targets`` then gives every spring's equilibrium at a phase clock.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from impedance_modules.compiled import compiled
from impedance_modules.modules.arms import TaskModules
from impedance_modules.modules.equilibrium import PhaseMotion
from impedance_modules.modules.held_object import OBJECT
from impedance_modules.modules.pose_motion import PoseMotion
from impedance_modules.robot.pose import Pose
from impedance_modules.robot.rotation import compose, exponential

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

PLACE, START, GOAL, AMPLITUDE, FREQUENCY, TURN, FIRST, LAST, ALONG = 0, 12, 24, 30, 36, 42, 45, 48, 51
COLUMNS = 52
"""Columns of a mover: reference X_WE (12), start X_ET (12), goal, amplitude, frequency (6 each), relative turn,
first and last rotation vector (3 each), and 1 where the rotation follows its vector."""


class MotionTable(NamedTuple):
    """A phase's motions as arrays.

    Attributes:
        movers: (movers, COLUMNS).
        rides: (springs,) row of the mover that carries each spring's equilibrium.
        offsets: (springs, 12) its fixed pose on that mover, rotation by rows then translation.
        rest_start, rest_goal: (n,) rest angles of the joint bias at the phase's ends [rad].
        duration: Of the phase [s].
    """

    movers: Array
    rides: Indices
    offsets: Array
    rest_start: Array
    rest_goal: Array
    duration: float


def motion_table(modules: TaskModules, motion: PhaseMotion, n: int) -> MotionTable:
    """Lays out one phase; springs in the order of the task, joints in the order of the model."""
    names = [spring.name for arm in modules.arms for spring in arm.springs]
    rows: list[Array] = []
    rides = np.zeros(len(names), dtype=np.int64)
    offsets = np.zeros((len(names), 12))
    carrier: int | None = None
    if OBJECT in motion.moved:
        carrier = 0
        rows.append(_mover(motion.moved[OBJECT]))
    for index, name in enumerate(names):
        offset = Pose.identity()
        if carrier is not None and name in motion.carried:
            held = motion.moved[OBJECT]
            offset = (held.reference @ held.start).inverse() @ motion.start.springs[name]
            rides[index] = carrier
        else:
            still = PoseMotion(
                motion.start.springs[name], Pose.identity(), np.zeros(6), np.zeros(6), np.zeros(6), 1.0
            )
            rides[index] = len(rows)
            rows.append(_mover(motion.moved.get(name, still)))
        offsets[index] = _twelve(offset)
    rest_start, rest_goal = _rests(modules, motion, n)
    return MotionTable(np.array(rows), rides, offsets, rest_start, rest_goal, motion.duration)


def _rests(modules: TaskModules, motion: PhaseMotion, n: int) -> tuple[Array, Array]:
    start, goal = np.zeros(n), np.zeros(n)
    for arm in modules.arms:
        if arm.bias is not None:
            name = arm.limb.name
            start[arm.bias.joints] = motion.start.rests[name]
            goal[arm.bias.joints] = motion.goals.get(name, motion.start.rests[name])
    return start, goal


def _twelve(pose: Pose) -> Array:
    return np.concatenate([pose.rotation.reshape(9), pose.translation])


def _mover(motion: PoseMotion) -> Array:
    row = np.zeros(COLUMNS)
    row[PLACE:START], row[START:GOAL] = _twelve(motion.reference), _twelve(motion.start)
    row[GOAL:AMPLITUDE], row[AMPLITUDE:FREQUENCY] = motion.goal, motion.amplitude
    row[FREQUENCY:TURN] = motion.frequency
    row[TURN:FIRST] = motion.relative_turn
    row[FIRST:LAST], row[LAST:ALONG] = motion.triples()
    row[ALONG] = float(motion.turns_along_triple)
    return row


@compiled
def minimum_jerk(fraction: float) -> float:
    """Returns 10 x^3 - 15 x^4 + 6 x^5, held at its ends outside [0, 1]."""
    x = min(max(fraction, 0.0), 1.0)
    return x**3 * (10.0 - 15.0 * x + 6.0 * x**2)


@compiled
def _mover_pose(row: Array, s: float, clock: float, turn: Array, rotation: Array, translation: Array) -> None:
    """Writes X_WT of one mover."""
    wave = np.empty(6)
    for k in range(6):
        wave[k] = row[AMPLITUDE + k] * math.sin(2.0 * math.pi * row[FREQUENCY + k] * clock)
    local = np.empty(3)
    for k in range(3):
        start = row[START + 9 + k]
        local[k] = start + s * (row[GOAL + k] - start) + wave[k]
    reference = row[PLACE : PLACE + 9].reshape((3, 3))
    vector = np.empty(3)
    if row[ALONG] > 0.0:
        for k in range(3):
            vector[k] = row[FIRST + k] + s * (row[LAST + k] - row[FIRST + k]) + wave[3 + k]
        exponential(vector, turn)
        compose(reference, turn, rotation)
    else:
        for k in range(3):
            vector[k] = s * row[TURN + k]
        exponential(vector, turn)
        start_rotation = row[START : START + 9].reshape((3, 3))
        product = np.empty((3, 3))
        compose(start_rotation, turn, product)
        compose(reference, product, rotation)
    for k in range(3):
        translation[k] = row[PLACE + 9 + k]
        for j in range(3):
            translation[k] += reference[k, j] * local[j]


@compiled
def targets(
    movers: Array,
    rides: Indices,
    offsets: Array,
    rest_start: Array,
    rest_goal: Array,
    duration: float,
    clock: float,
    rotation: Array,
    translation: Array,
    rest: Array,
) -> None:
    """Writes every spring's X_WT (springs, 3, 3), (springs, 3) and the rest angles (n,) at ``clock``."""
    s = minimum_jerk(clock / duration)
    turn = np.empty((3, 3))
    place = np.empty((movers.shape[0], 3, 3))
    origin = np.empty((movers.shape[0], 3))
    for m in range(movers.shape[0]):
        _mover_pose(movers[m], s, clock, turn, place[m], origin[m])
    for i in range(rides.size):
        m = rides[i]
        offset = offsets[i, :9].reshape((3, 3))
        compose(place[m], offset, rotation[i])
        for k in range(3):
            translation[i, k] = origin[m, k]
            for j in range(3):
                translation[i, k] += place[m, k, j] * offsets[i, 9 + j]
    for j in range(rest.size):
        rest[j] = rest_start[j] + s * (rest_goal[j] - rest_start[j])
