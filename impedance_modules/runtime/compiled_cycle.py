# SPDX-License-Identifier: BSD-3-Clause
"""One control cycle, compiled: ``before`` from state to quadratic program, ``after`` from its solution to torque.

The order is that of docs/passivity.md: measure what the last interval cost, move the equilibrium as far as the
tank can pay, settle, sum the modules, fill in the filter; then, after the solver, pay for what leaves. The laws are
in modules/ and safety/; this file only cuts the views out of ``CycleMemory`` and calls them.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from impedance_modules.modules.compiled_motion import COLUMNS, minimum_jerk, targets
from impedance_modules.modules.compiled_object import object_efforts
from impedance_modules.modules.compiled_springs import (
    bias_efforts,
    bias_energy,
    spring_efforts,
    spring_energies,
)
from impedance_modules.runtime.memory import (
    AVAILABLE,
    BLEND_TIME,
    BLENDED,
    CLOCK,
    DURATION,
    ENERGY,
    GRANTED,
    LIFT,
    PAID,
    PERIOD,
    SHARE,
    STATUS,
    TOO_FAST,
    CycleSizes,
    float_shapes,
    integer_shapes,
)
from impedance_modules.safety import compiled_filter, compiled_ledger
from impedance_modules.safety.compiled_ledger import FLOOR, LEVEL, SCALE, SHORT

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

_NAMES = tuple(float_shapes(CycleSizes(1, 1, 1, 1, 1, 1, 1)))
_INTEGER_NAMES = tuple(integer_shapes(CycleSizes(1, 1, 1, 1, 1, 1, 1)))

STIFFNESS, DAMPING, FORCE = (_NAMES.index(name) for name in ("stiffness", "damping", "force"))
BIAS_STIFFNESS, BIAS_DAMPING = _NAMES.index("bias_stiffness"), _NAMES.index("bias_damping")
MOVERS, OFFSETS, REST_ENDS = (_NAMES.index(name) for name in ("movers", "offsets", "rest_ends"))
TARGET_ROTATION, TARGET_TRANSLATION = _NAMES.index("target_rotation"), _NAMES.index("target_translation")
REST, SQUEEZE, WEIGHT = (_NAMES.index(name) for name in ("rest", "squeeze", "weight"))
GRASP_TURN, SCALARS, CONSTANTS = (
    _NAMES.index(name) for name in ("grasp_turn", "book_scalars", "book_constants")
)
SPEED_BOUND, COMPLIANCE, SENSING_ERROR, SENSING_DEVIATION = (
    _NAMES.index(name) for name in ("speed_bound", "compliance", "sensing_error", "sensing_deviation")
)
MOTOR_POSITION, APPLIED, PENDING = (_NAMES.index(name) for name in ("motor_position", "applied", "pending"))
JOINT_LIMITS, SCALAR_LIMITS, KAPPA, METRIC = (
    _NAMES.index(name) for name in ("joint_limits", "scalar_limits", "kappa", "metric_constants")
)
WIND, WIND_RATE, PREVIOUS, MOTOR_VELOCITY = (
    _NAMES.index(name) for name in ("wind", "wind_rate", "previous", "motor_velocity")
)
EFFORTS, WRENCHES, DESIRED, TIME, RESULT = (
    _NAMES.index(name) for name in ("efforts", "wrenches", "desired", "clock", "result")
)
SIZES, SLOTS, RIDES, LIMB_OF_JOINT, HAND_SLOTS, MOVER_COUNT = range(len(_INTEGER_NAMES))

TRIALS = 12
"""Bisections for the largest affordable part of a motion, as in ``ledger.grant``."""


@njit(cache=True)
def _one(block: Array, at: Indices, which: int) -> Array:
    return block[at[which] : at[which + 1]]


@njit(cache=True)
def _two(block: Array, at: Indices, which: int, columns: int) -> Array:
    flat = block[at[which] : at[which + 1]]
    return flat.reshape((flat.size // columns if columns else 0, columns))


@njit(cache=True)
def _three(block: Array, at: Indices, which: int, rows: int, columns: int) -> Array:
    flat = block[at[which] : at[which + 1]]
    return flat.reshape((flat.size // (rows * columns), rows, columns))


@njit(cache=True)
def _blend(memory: Array, at: Indices, springs: int, n: int, clock: float) -> None:
    """Sets the gains now in force: minimum jerk from the last phase's to this phase's."""
    time = _one(memory, at, TIME)
    if time[BLENDED] > 0.0 and clock >= time[BLEND_TIME]:
        return
    part = minimum_jerk(clock / time[BLEND_TIME])
    for which, entries in (
        (STIFFNESS, springs * 36),
        (DAMPING, springs * 36),
        (FORCE, springs * 6),
        (BIAS_DAMPING, n * n),
    ):
        block = memory[at[which] : at[which + 1]]
        for k in range(entries):
            first = block[k]
            block[2 * entries + k] = first + part * (block[entries + k] - first)
    time[BLENDED] = 1.0 if clock >= time[BLEND_TIME] else 0.0


@njit(cache=True)
def _place(
    memory: Array, at: Indices, integers: Indices, where: Indices, n: int, springs: int, clock: float
) -> None:
    """Sets gains and equilibria to a phase clock."""
    _blend(memory, at, springs, n, clock)
    ends = _two(memory, at, REST_ENDS, n)
    movers = _two(memory, at, MOVERS, COLUMNS)
    targets(
        movers[: integers[where[MOVER_COUNT]]],
        integers[where[RIDES] : where[RIDES + 1]],
        _two(memory, at, OFFSETS, 12),
        ends[0],
        ends[1],
        _one(memory, at, TIME)[DURATION],
        clock,
        _three(memory, at, TARGET_ROTATION, 3, 3),
        _two(memory, at, TARGET_TRANSLATION, 3),
        _one(memory, at, REST),
    )


@njit(cache=True)
def _potential(
    memory: Array,
    at: Indices,
    integers: Indices,
    where: Indices,
    springs: int,
    q: Array,
    rotation: Array,
    translation: Array,
) -> float:
    """Returns U of all springs and joint biases at the gains and equilibria now in force [J]."""
    stiffness = _three(memory, at, STIFFNESS, 6, 6)[2 * springs :]
    total = spring_energies(
        stiffness,
        integers[where[SLOTS] : where[SLOTS + 1]],
        rotation,
        translation,
        _three(memory, at, TARGET_ROTATION, 3, 3),
        _two(memory, at, TARGET_TRANSLATION, 3),
    )
    return total + bias_energy(_one(memory, at, BIAS_STIFFNESS), _one(memory, at, REST), q)


@njit(cache=True)
def start(
    memory: Array,
    at: Indices,
    integers: Indices,
    where: Indices,
    q: Array,
    rotation: Array,
    translation: Array,
) -> float:
    """Sets gains and equilibria at the phase clock as it stands and returns U there [J]."""
    sizes = integers[where[SIZES] : where[SIZES + 1]]
    _one(memory, at, TIME)[BLENDED] = 0.0
    _place(memory, at, integers, where, sizes[0], sizes[1], _one(memory, at, TIME)[CLOCK])
    return _potential(memory, at, integers, where, sizes[1], q, rotation, translation)


@njit(cache=True)
def _finite(vector: Array) -> bool:
    for value in vector:
        if not math.isfinite(value):
            return False
    return True


@njit(cache=True)
def _move(
    memory: Array,
    at: Indices,
    integers: Indices,
    where: Indices,
    n: int,
    springs: int,
    q: Array,
    rotation: Array,
    translation: Array,
) -> None:
    """Advances the phase clock by one period, or by the part of it that the tank can pay for."""
    time, scalars = _one(memory, at, TIME), _one(memory, at, SCALARS)
    constants = _one(memory, at, CONSTANTS)
    before, period = time[CLOCK], time[PERIOD]
    budget = compiled_ledger.budget(scalars, constants)
    part, granted, refused = 1.0, 0.0, 1.0
    potential = 0.0
    for trial in range(TRIALS + 1):
        _place(memory, at, integers, where, n, springs, before + part * period)
        potential = _potential(memory, at, integers, where, springs, q, rotation, translation)
        affordable = compiled_ledger.change_cost(scalars, potential) <= budget
        if affordable:
            granted = part
        else:
            refused = part
        if granted == 1.0:
            break
        part = 0.5 * (granted + refused)
    if granted == 0.0:
        scalars[SHORT] = 1.0
    if granted < 1.0:
        _place(memory, at, integers, where, n, springs, before + granted * period)
        potential = _potential(memory, at, integers, where, springs, q, rotation, translation)
    compiled_ledger.take_change(scalars, constants, potential)
    time[CLOCK] = before + granted * period
    time[GRANTED] = granted


@njit(cache=True)
def _sum_modules(
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
    sizes = integers[where[SIZES] : where[SIZES + 1]]
    n, S, L = sizes[0], sizes[1], sizes[3]
    scale = _one(memory, at, SCALARS)[SCALE]
    efforts = _two(memory, at, EFFORTS, n)
    energy = spring_efforts(
        _three(memory, at, STIFFNESS, 6, 6)[2 * S :],
        _three(memory, at, DAMPING, 6, 6)[2 * S :],
        _two(memory, at, FORCE, 6)[2 * S :],
        integers[where[SLOTS] : where[SLOTS + 1]],
        rotation,
        translation,
        jacobian,
        _three(memory, at, TARGET_ROTATION, 3, 3),
        _two(memory, at, TARGET_TRANSLATION, 3),
        scale,
        v,
        _two(memory, at, WRENCHES, 6),
        efforts[:S],
    )
    energy += bias_efforts(
        _one(memory, at, BIAS_STIFFNESS),
        _three(memory, at, BIAS_DAMPING, n, n)[2],
        _one(memory, at, REST),
        integers[where[LIMB_OF_JOINT] : where[LIMB_OF_JOINT + 1]],
        scale,
        q,
        v,
        efforts[S : S + L],
    )
    object_efforts(
        _two(memory, at, SQUEEZE, 6),
        _three(memory, at, WEIGHT, 6, 3),
        _one(memory, at, TIME)[LIFT],
        integers[where[HAND_SLOTS] : where[HAND_SLOTS + 1]],
        _two(memory, at, GRASP_TURN, 3),
        rotation,
        jacobian,
        efforts[S + L],
        efforts[S + L + 1],
    )
    desired = _one(memory, at, DESIRED)
    for j in range(n):
        desired[j] = 0.0
        for k in range(efforts.shape[0]):
            desired[j] += efforts[k, j]
    return energy


@njit(cache=True)
def _motor_velocity(memory: Array, at: Indices, v: Array, effort: Array) -> None:
    """Estimates the rotors' speed, v + d(effort / K_sea)/dt, as ``modules.motor_velocity`` does."""
    velocity, wind, rate = (
        _one(memory, at, MOTOR_VELOCITY),
        _one(memory, at, WIND),
        _one(memory, at, WIND_RATE),
    )
    compliance, time = _one(memory, at, COMPLIANCE), _one(memory, at, TIME)
    for j in range(v.size):
        now = effort[j] * compliance[j]
        rate[j] += time[SHARE] * ((now - wind[j]) / time[PERIOD] - rate[j])
        wind[j] = now
        velocity[j] = v[j] + rate[j]


@njit(cache=True)
def before(
    memory: Array,
    at: Indices,
    integers: Indices,
    where: Indices,
    q: Array,
    v: Array,
    effort: Array,
    rotation: Array,
    translation: Array,
    jacobian: Array,
    bias: Array,
    inverse_inertia: Array,
    distance: Array,
    gradient: Array,
    matrix: Array,
    lower: Array,
    upper: Array,
    penalty: Array,
    metric: Array,
) -> int:
    """From a finite state to the desired torque and the filled quadratic program; returns ``STATUS``."""
    sizes = integers[where[SIZES] : where[SIZES + 1]]
    n, S = sizes[0], sizes[1]
    result, scalars = _one(memory, at, RESULT), _one(memory, at, SCALARS)
    constants, time = _one(memory, at, CONSTANTS), _one(memory, at, TIME)
    if not (_finite(q) and _finite(v) and _finite(effort)):
        result[STATUS] = 1.0
        return 1
    potential = _potential(memory, at, integers, where, S, q, rotation, translation)
    result[TOO_FAST] = compiled_ledger.measure(
        scalars,
        constants,
        _one(memory, at, SPEED_BOUND),
        _one(memory, at, COMPLIANCE),
        _one(memory, at, SENSING_ERROR),
        _one(memory, at, SENSING_DEVIATION),
        _one(memory, at, MOTOR_POSITION),
        _one(memory, at, APPLIED),
        _two(memory, at, PENDING, n),
        q,
        effort,
        potential,
    )
    _move(memory, at, integers, where, n, S, q, rotation, translation)
    compiled_ledger.settle(scalars, constants, _one(memory, at, APPLIED), _one(memory, at, SENSING_ERROR))
    motor_velocity = _one(memory, at, MOTOR_VELOCITY)
    _motor_velocity(memory, at, v, effort)
    result[ENERGY] = _sum_modules(
        memory, at, integers, where, q, motor_velocity, rotation, translation, jacobian
    )
    if not _finite(_one(memory, at, DESIRED)):
        result[STATUS] = 2.0
        return 2
    available = max(0.0, scalars[LEVEL] - constants[FLOOR])
    result[AVAILABLE] = available
    weights = _one(memory, at, METRIC)
    compiled_filter.metric(inverse_inertia, jacobian[: sizes[3]], weights[0], weights[1], weights[2], metric)
    compiled_filter.fill(
        matrix,
        lower,
        upper,
        penalty,
        _two(memory, at, JOINT_LIMITS, n),
        _one(memory, at, SCALAR_LIMITS),
        _one(memory, at, KAPPA),
        q,
        v,
        motor_velocity,
        inverse_inertia,
        bias,
        _one(memory, at, PREVIOUS),
        available,
        distance,
        gradient,
    )
    result[STATUS] = 0.0
    return 0


@njit(cache=True)
def after(memory: Array, at: Indices, n: int, effort: Array, stopping: bool) -> int:
    """Scales the filtered torque in place to what the tank can answer for; returns ``STATUS``."""
    result = _one(memory, at, RESULT)
    if not _finite(effort):
        result[STATUS] = 2.0
        return 2
    result[PAID] = compiled_ledger.pay(
        _one(memory, at, SCALARS),
        _one(memory, at, CONSTANTS),
        _one(memory, at, SPEED_BOUND),
        _one(memory, at, SENSING_ERROR),
        _one(memory, at, APPLIED),
        _two(memory, at, PENDING, n),
        effort,
        stopping,
    )
    previous = _one(memory, at, PREVIOUS)
    for j in range(n):
        previous[j] = effort[j]
    result[STATUS] = 0.0
    return 0


@njit(cache=True)
def missed(memory: Array, at: Indices, n: int) -> None:
    """Books a cycle without a usable state, or whose torque came too late."""
    compiled_ledger.missed(
        _one(memory, at, SCALARS),
        _one(memory, at, CONSTANTS),
        _one(memory, at, SPEED_BOUND),
        _one(memory, at, SENSING_ERROR),
        _one(memory, at, APPLIED),
        _two(memory, at, PENDING, n),
    )
