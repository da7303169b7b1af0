# SPDX-License-Identifier: BSD-3-Clause
"""The compiled side of ``memory.CycleMemory``: which place each array has in the blocks, and views cut out of them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from impedance_modules.compiled import compiled
from impedance_modules.control.memory import CycleSizes, float_shapes, integer_shapes

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
MATRIX, LOWER, UPPER, PENALTY, WEIGHTS = (
    _NAMES.index(name) for name in ("matrix", "lower", "upper", "penalty", "metric")
)
KAPPA_OF_ROW, FILTERED, EFFORT, DUALS = (
    _NAMES.index(name) for name in ("kappa_of_row", "filtered", "effort", "duals")
)
SIZES, SLOTS, RIDES, LIMB_OF_JOINT, HAND_SLOTS, MOVER_COUNT, MOVED_BY, COUPLED, REACH = range(
    len(_INTEGER_NAMES)
)


@compiled
def one(block: Array, at: Indices, which: int) -> Array:
    """Cuts a vector out of the block of floats."""
    return block[at[which] : at[which + 1]]


@compiled
def two(block: Array, at: Indices, which: int, columns: int) -> Array:
    """Cuts out a matrix with so many columns."""
    flat = block[at[which] : at[which + 1]]
    return flat.reshape((flat.size // columns if columns else 0, columns))


@compiled
def three(block: Array, at: Indices, which: int, rows: int, columns: int) -> Array:
    """Cuts out a stack of matrices of one size."""
    flat = block[at[which] : at[which + 1]]
    return flat.reshape((flat.size // (rows * columns), rows, columns))


@compiled
def whole(integers: Indices, where: Indices, which: int) -> Indices:
    """Cuts a vector out of the block of integers."""
    return integers[where[which] : where[which + 1]]


@compiled
def ranges(integers: Indices, where: Indices, which: int) -> Indices:
    """Cuts (2, k) out of the block of integers: where ranges begin, and one past where they end."""
    flat = integers[where[which] : where[which + 1]]
    return flat.reshape((2, flat.size // 2))
