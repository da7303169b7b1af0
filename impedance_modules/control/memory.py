# SPDX-License-Identifier: BSD-3-Clause
"""All numbers of a control cycle in one block of memory, with named views for people.

Handing an array to compiled code costs 0.13 us; a cycle has fifty. So they lie in two blocks, one of floats
and one of integers, and both sides know where each begins. ``CycleMemory`` is the named side;
``compiled_cycle`` cuts the same views out of the blocks.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

ENTRIES, CONSTANTS = 16, 7
"""Scalars and constants of ``safety.compiled_ledger``, repeated here because importing it wakes the compiler."""

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


@dataclass(frozen=True)
class CycleSizes:
    """How much of everything there is.

    Attributes:
        joints: n.
        springs: In the order of the task.
        frames: Of the kinematics.
        limbs: Of the robot.
        pairs: Distance rows.
        hands: That hold an object.
        delay: Whole periods a command waits before it acts.
    """

    joints: int
    springs: int
    frames: int
    limbs: int
    pairs: int
    hands: int
    delay: int

    @property
    def rows(self) -> int:
        """Rows of the filter."""
        return 1 + 3 * self.joints + self.pairs

    @property
    def modules(self) -> int:
        """Rows of ``efforts``: every spring, every limb's joint bias, squeeze, weight."""
        return self.springs + self.limbs + 2


def float_shapes(size: CycleSizes) -> dict[str, tuple[int, ...]]:
    """Names and shapes of all float arrays, in their order in memory.

    Gains come as (from, to, now): a phase blends from the last phase's into its own.
    """
    n, S = size.joints, size.springs
    return {
        "stiffness": (3, S, 6, 6),
        "damping": (3, S, 6, 6),
        "force": (3, S, 6),
        "bias_stiffness": (n,),
        "bias_damping": (3, n, n),
        "movers": (S + 1, 52),
        "offsets": (S, 12),
        "rest_ends": (2, n),
        "target_rotation": (S, 3, 3),
        "target_translation": (S, 3),
        "rest": (n,),
        "squeeze": (size.hands, 6),
        "weight": (size.hands, 6, 3),
        "grasp_turn": (3, 3),
        "book_scalars": (ENTRIES,),
        "book_constants": (CONSTANTS,),
        "speed_bound": (n,),
        "compliance": (n,),
        "sensing_error": (n,),
        "sensing_deviation": (n,),
        "motor_position": (n,),
        "applied": (n,),
        "pending": (size.delay + 1, n),
        "joint_limits": (7, n),
        "scalar_limits": (7,),
        "kappa": (4,),
        "metric_constants": (3,),
        "wind": (n,),
        "wind_rate": (n,),
        "previous": (n,),
        "motor_velocity": (n,),
        "efforts": (size.modules, n),
        "wrenches": (S, 6),
        "desired": (n,),
        "clock": (10,),
        "result": (7,),
        "matrix": (size.rows, n),
        "lower": (size.rows,),
        "upper": (size.rows,),
        "penalty": (size.rows,),
        "metric": (n, n),
        "kappa_of_row": (size.rows,),
        "filtered": (n,),
        "effort": (n,),
        "duals": (n + size.rows,),
    }


def integer_shapes(size: CycleSizes) -> dict[str, tuple[int, ...]]:
    """Names and shapes of all integer arrays, in their order in memory."""
    return {
        "sizes": (7,),
        "slots": (size.springs,),
        "rides": (size.springs,),
        "limb_of_joint": (size.joints,),
        "hand_slots": (size.hands,),
        "mover_count": (1,),
        "moved_by": (2, size.frames),
        "coupled": (2, size.joints),
        "reach": (2, size.rows),
    }


DURATION, BLEND_TIME, CLOCK, PERIOD, LIFT, BLENDED, GRANTED, SHARE, GRIP_START, GRIP = range(10)
"""Places in ``clock``: phase duration, time over which gains blend, phase clock, control period [s]; weight
carried [N]; 1 once the gains are those of the phase; part of the last motion that the tank granted; share of a new
sample in the filtered rate of the springs' wind-up; part of squeeze and carried weight in force, when the phase
began and now."""

STATUS, ENERGY, PAID, AVAILABLE, TOO_FAST, FOUND, TRIED = range(7)
"""Places in ``result``: one of the statuses below; energy of the springs [J]; scale of the guarantee; tank level
above its floor [J]; first joint beyond its speed bound, or n; what the fast lane found, and after how many trials."""

FINE, STATE_NOT_FINITE, EFFORT_NOT_FINITE, UNSOLVED = range(4)
"""How far a cycle came: a torque may leave; there is none; there is none; the robot's solver is asked for one."""


class CycleMemory:
    """The blocks, and a named view of each array in them.

    Attributes:
        size: How much of everything there is.
        floats, integers: The blocks.
        float_at, integer_at: Where each array begins, in the order of the shapes.
    """

    def __init__(self, size: CycleSizes) -> None:
        self.size = size
        floats, whole = float_shapes(size), integer_shapes(size)
        self.float_at, self.integer_at = _starts(floats), _starts(whole)
        self.floats: Array = np.zeros(int(self.float_at[-1]))
        self.integers: Indices = np.zeros(int(self.integer_at[-1]), dtype=np.int64)
        self._float_views = {
            name: self.floats[start : start + math.prod(shape)].reshape(shape)
            for (name, shape), start in zip(floats.items(), self.float_at, strict=False)
        }
        self._integer_views = {
            name: self.integers[start : start + math.prod(shape)].reshape(shape)
            for (name, shape), start in zip(whole.items(), self.integer_at, strict=False)
        }
        self.index("sizes")[:] = (
            size.joints,
            size.springs,
            size.frames,
            size.limbs,
            size.pairs,
            size.hands,
            size.delay,
        )

    def __getitem__(self, name: str) -> Array:
        """Returns the view of a float array by name."""
        return self._float_views[name]

    def index(self, name: str) -> Indices:
        """Returns the view of an integer array by name."""
        return self._integer_views[name]


def _starts(shapes: Mapping[str, tuple[int, ...]]) -> Indices:
    """Where each array begins, and where the last one ends."""
    sizes = [math.prod(shape) for shape in shapes.values()]
    return np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64)
