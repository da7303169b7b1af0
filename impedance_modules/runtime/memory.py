# SPDX-License-Identifier: BSD-3-Clause
"""All numbers of a control cycle in one block of memory, with named views for people.

Handing an array to compiled code costs 0.13 us; a cycle has fifty. So they lie in two blocks, one of floats
and one of integers, and both sides know where each begins. ``CycleMemory`` is the named side;
``compiled_cycle`` cuts the same views out of the blocks.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

ENTRIES, CONSTANTS = 14, 7
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
    n, S, L = size.joints, size.springs, size.limbs
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
        "clock": (8,),
        "result": (6,),
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
    }


DURATION, BLEND_TIME, CLOCK, PERIOD, LIFT, BLENDED, GRANTED, SHARE = range(8)
"""Places in ``clock``: phase duration, time over which gains blend, phase clock, control period [s]; weight
carried [N]; 1 once the gains are those of the phase; part of the last motion that the tank granted; share of a new
sample in the filtered rate of the springs' wind-up."""

STATUS, ENERGY, PAID, AVAILABLE, TOO_FAST, WORST = range(6)
"""Places in ``result``: 0 fine, 1 state not finite, 2 torque not finite; energy of the springs [J]; scale of the
guarantee; tank level above its floor [J]; first joint beyond its speed bound, or n."""


class CycleMemory:
    """The blocks, and a named view of each array in them.

    Attributes:
        size: How much of everything there is.
        floats, integers: The blocks.
        float_at, integer_at: Where each array begins, in the order of the shapes.
    """

    def __init__(self, size: CycleSizes) -> None:
        self.size = size
        self.floats, self.float_at, self._float_views = _block(float_shapes(size), np.float64)
        self.integers, self.integer_at, self._integer_views = _block(integer_shapes(size), np.int64)
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


def _block(
    shapes: Mapping[str, tuple[int, ...]], kind: type[np.generic]
) -> tuple[NDArray[np.generic], Indices, dict[str, NDArray[np.generic]]]:
    sizes = [int(np.prod(shape)) for shape in shapes.values()]
    starts = np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64)
    block = np.zeros(int(starts[-1]), dtype=kind)
    views = {
        name: block[start : start + count].reshape(shape)
        for (name, shape), start, count in zip(shapes.items(), starts, sizes, strict=False)
    }
    return block, starts, views
