# SPDX-License-Identifier: BSD-3-Clause
"""One control cycle, compiled: ``tick`` goes from a state to the torque that may leave.

The order is that of docs/passivity.md: measure what the last interval cost, move the equilibrium as far as the
tank can pay, settle, sum the modules, fill in the filter, solve it, pay for what leaves. The laws are in modules/ and
safety/; this file only cuts the views out of ``CycleMemory`` and calls them. Where the fast lane proves nothing,
``tick`` stops before the solver, which works on the filled problem, and ``after`` pays for its answer.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from impedance_modules.compiled import compiled
from impedance_modules.control.compiled_memory import (
    APPLIED,
    COMPLIANCE,
    CONSTANTS,
    COUPLED,
    DESIRED,
    DUALS,
    EFFORT,
    FILTERED,
    JOINT_LIMITS,
    KAPPA,
    KAPPA_OF_ROW,
    LOWER,
    MATRIX,
    METRIC,
    MOTOR_POSITION,
    MOTOR_VELOCITY,
    MOVED_BY,
    PENALTY,
    PENDING,
    PREVIOUS,
    REACH,
    RESULT,
    SCALAR_LIMITS,
    SCALARS,
    SENSING_DEVIATION,
    SENSING_ERROR,
    SIZES,
    SPEED_BOUND,
    UPPER,
    WEIGHTS,
    one,
    ranges,
    two,
    whole,
)
from impedance_modules.control.compiled_place import move, potential_energy
from impedance_modules.control.compiled_sum import estimate_motor_velocity, sum_modules
from impedance_modules.control.memory import (
    AVAILABLE,
    EFFORT_NOT_FINITE,
    ENERGY,
    FINE,
    FOUND,
    PAID,
    STATE_NOT_FINITE,
    STATUS,
    TOO_FAST,
    TRIED,
    UNSOLVED,
)
from impedance_modules.safety import compiled_filter, compiled_lane, compiled_ledger
from impedance_modules.safety.compiled_lane import UNDECIDED
from impedance_modules.safety.compiled_ledger import FLOOR, LEVEL

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


@compiled
def _finite(vector: Array) -> bool:
    finite = True
    for value in vector:
        finite = finite and math.isfinite(value)
    return finite


@compiled
def tick(
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
    fast_lane: bool,
) -> int:
    """From a measured state to the torque that may leave, in the memory's ``effort``.

    Returns:
        FINE, STATE_NOT_FINITE, EFFORT_NOT_FINITE, or UNSOLVED where the filter's problem is left to a solver.
    """
    result = one(memory, at, RESULT)
    result[FOUND], result[TRIED] = UNDECIDED, 0.0
    result[STATUS] = _desire(memory, at, integers, where, q, v, effort, rotation, translation, jacobian)
    if result[STATUS] != FINE:
        return int(result[STATUS])
    _fill(memory, at, integers, where, q, v, jacobian, bias, inverse_inertia, distance, gradient)
    if fast_lane:
        result[FOUND], result[TRIED] = compiled_lane.solve(
            one(memory, at, DESIRED),
            two(memory, at, JOINT_LIMITS, q.size)[compiled_filter.EFFORT],
            two(memory, at, MATRIX, q.size),
            one(memory, at, LOWER),
            one(memory, at, UPPER),
            one(memory, at, PENALTY),
            two(memory, at, WEIGHTS, q.size),
            one(memory, at, KAPPA_OF_ROW),
            ranges(integers, where, REACH),
            ranges(integers, where, COUPLED),
            one(memory, at, FILTERED),
            one(memory, at, DUALS),
        )
    if result[FOUND] == UNDECIDED:
        result[STATUS] = UNSOLVED
        return UNSOLVED
    one(memory, at, EFFORT)[:] = one(memory, at, FILTERED)
    return after(memory, at, q.size, False)


@compiled
def _desire(
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
) -> int:
    """Books the last interval, moves the equilibria and sums what the modules ask for; returns a status."""
    n, springs = q.size, whole(integers, where, SIZES)[1]
    result, scalars = one(memory, at, RESULT), one(memory, at, SCALARS)
    constants = one(memory, at, CONSTANTS)
    if not (_finite(q) and _finite(v) and _finite(effort)):
        return STATE_NOT_FINITE
    potential = potential_energy(memory, at, integers, where, springs, q, rotation, translation)
    result[TOO_FAST] = compiled_ledger.measure(
        scalars,
        constants,
        one(memory, at, SPEED_BOUND),
        one(memory, at, COMPLIANCE),
        one(memory, at, SENSING_ERROR),
        one(memory, at, SENSING_DEVIATION),
        one(memory, at, MOTOR_POSITION),
        one(memory, at, APPLIED),
        two(memory, at, PENDING, n),
        q,
        effort,
        potential,
    )
    move(memory, at, integers, where, n, springs, q, rotation, translation)
    compiled_ledger.settle(scalars, constants, one(memory, at, APPLIED), one(memory, at, SENSING_ERROR))
    estimate_motor_velocity(memory, at, v, effort)
    motor_velocity = one(memory, at, MOTOR_VELOCITY)
    result[ENERGY] = sum_modules(
        memory, at, integers, where, q, motor_velocity, rotation, translation, jacobian
    )
    return FINE if _finite(one(memory, at, DESIRED)) else EFFORT_NOT_FINITE


@compiled
def _fill(
    memory: Array,
    at: Indices,
    integers: Indices,
    where: Indices,
    q: Array,
    v: Array,
    jacobian: Array,
    bias: Array,
    inverse_inertia: Array,
    distance: Array,
    gradient: Array,
) -> None:
    """Writes the filter's metric and rows."""
    n, limbs = q.size, whole(integers, where, SIZES)[3]
    scalars, weights = one(memory, at, SCALARS), one(memory, at, METRIC)
    available = max(0.0, scalars[LEVEL] - one(memory, at, CONSTANTS)[FLOOR])
    one(memory, at, RESULT)[AVAILABLE] = available
    compiled_filter.metric(
        inverse_inertia,
        jacobian[:limbs],
        ranges(integers, where, MOVED_BY),
        weights[0],
        weights[1],
        weights[2],
        two(memory, at, WEIGHTS, n),
    )
    compiled_filter.fill(
        two(memory, at, MATRIX, n),
        one(memory, at, LOWER),
        one(memory, at, UPPER),
        one(memory, at, PENALTY),
        two(memory, at, JOINT_LIMITS, n),
        one(memory, at, SCALAR_LIMITS),
        one(memory, at, KAPPA),
        ranges(integers, where, COUPLED),
        q,
        v,
        one(memory, at, MOTOR_VELOCITY),
        inverse_inertia,
        bias,
        one(memory, at, PREVIOUS),
        available,
        distance,
        gradient,
    )


@compiled
def after(memory: Array, at: Indices, n: int, stopping: bool) -> int:
    """Scales the memory's ``effort`` to what the tank can answer for; returns ``STATUS``."""
    result, effort = one(memory, at, RESULT), one(memory, at, EFFORT)
    if not _finite(effort):
        result[STATUS] = EFFORT_NOT_FINITE
        return EFFORT_NOT_FINITE
    result[PAID] = compiled_ledger.pay(
        one(memory, at, SCALARS),
        one(memory, at, CONSTANTS),
        one(memory, at, SPEED_BOUND),
        one(memory, at, SENSING_ERROR),
        one(memory, at, APPLIED),
        two(memory, at, PENDING, n),
        effort,
        stopping,
    )
    one(memory, at, PREVIOUS)[:] = effort
    result[STATUS] = FINE
    return FINE


@compiled
def missed(memory: Array, at: Indices, n: int) -> None:
    """Books a cycle without a usable state, or whose torque came too late."""
    compiled_ledger.missed(
        one(memory, at, SCALARS),
        one(memory, at, CONSTANTS),
        one(memory, at, SPEED_BOUND),
        two(memory, at, PENDING, n),
    )
