# SPDX-License-Identifier: BSD-3-Clause
"""What all modules ask for together, compiled, and the motors' velocity that their dampers act on."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from impedance_modules.compiled import compiled
from impedance_modules.control.compiled_memory import (
    BIAS_DAMPING,
    BIAS_STIFFNESS,
    COMPLIANCE,
    COUPLED,
    DAMPING,
    DESIRED,
    EFFORTS,
    FORCE,
    GRASP_TURN,
    HAND_SLOTS,
    LIMB_OF_JOINT,
    MOTOR_VELOCITY,
    MOVED_BY,
    REST,
    SCALARS,
    SIZES,
    SLOTS,
    SQUEEZE,
    STIFFNESS,
    TARGET_ROTATION,
    TARGET_TRANSLATION,
    TIME,
    WEIGHT,
    WIND,
    WIND_RATE,
    WRENCHES,
    one,
    ranges,
    three,
    two,
    whole,
)
from impedance_modules.control.memory import GRIP, LIFT, PERIOD, SHARE
from impedance_modules.modules.compiled_object import object_efforts
from impedance_modules.modules.compiled_springs import bias_efforts, spring_efforts
from impedance_modules.safety.compiled_ledger import SCALE

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


@compiled
def sum_modules(
    memory: Array,
    at: Indices,
    integers: Indices,
    where: Indices,
    q: Array,
    v: Array,
    rotation: Array,
    translation: Array,
    jacobian: Array,
) -> float:
    """Writes every module's torque and their sum; returns the energy of the relaxed springs [J]."""
    sizes = whole(integers, where, SIZES)
    n, S, L = sizes[0], sizes[1], sizes[3]
    scale = one(memory, at, SCALARS)[SCALE]
    efforts, moved_by = two(memory, at, EFFORTS, n), ranges(integers, where, MOVED_BY)
    energy = spring_efforts(
        three(memory, at, STIFFNESS, 6, 6)[2 * S :],
        three(memory, at, DAMPING, 6, 6)[2 * S :],
        two(memory, at, FORCE, 6)[2 * S :],
        whole(integers, where, SLOTS),
        rotation,
        translation,
        jacobian,
        moved_by,
        three(memory, at, TARGET_ROTATION, 3, 3),
        two(memory, at, TARGET_TRANSLATION, 3),
        scale,
        v,
        two(memory, at, WRENCHES, 6),
        efforts[:S],
    )
    energy += bias_efforts(
        one(memory, at, BIAS_STIFFNESS),
        three(memory, at, BIAS_DAMPING, n, n)[2],
        one(memory, at, REST),
        whole(integers, where, LIMB_OF_JOINT),
        ranges(integers, where, COUPLED),
        scale,
        q,
        v,
        efforts[S : S + L],
    )
    object_efforts(
        two(memory, at, SQUEEZE, 6),
        three(memory, at, WEIGHT, 6, 3),
        one(memory, at, TIME)[LIFT],
        whole(integers, where, HAND_SLOTS),
        two(memory, at, GRASP_TURN, 3),
        rotation,
        jacobian,
        moved_by,
        efforts[S + L],
        efforts[S + L + 1],
    )
    desired, grip = one(memory, at, DESIRED), one(memory, at, TIME)[GRIP]
    for j in range(n):
        efforts[S + L, j] *= grip
        efforts[S + L + 1, j] *= grip
        desired[j] = 0.0
        for k in range(efforts.shape[0]):
            desired[j] += efforts[k, j]
    return energy


@compiled
def estimate_motor_velocity(memory: Array, at: Indices, v: Array, effort: Array) -> None:
    """Estimates the rotors' speed, v + d(effort / K_sea)/dt, as ``modules.motor_velocity`` does."""
    velocity, wind, rate = (
        one(memory, at, MOTOR_VELOCITY),
        one(memory, at, WIND),
        one(memory, at, WIND_RATE),
    )
    compliance, time = one(memory, at, COMPLIANCE), one(memory, at, TIME)
    for j in range(v.size):
        now = effort[j] * compliance[j]
        rate[j] += time[SHARE] * ((now - wind[j]) / time[PERIOD] - rate[j])
        wind[j] = now
        velocity[j] = v[j] + rate[j]
