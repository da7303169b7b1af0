# SPDX-License-Identifier: BSD-3-Clause
"""The torque filter as data: which rows exist, and their numbers in one cycle.

    minimise over tau   1/2 (tau - desired)^T W (tau - desired) + sum_soft 1/2 w_r s_r^2
    subject to          -effort_max <= tau <= effort_max                        hard
                        lower_r <= a_r . tau <= upper_r                         hard rows (power)
                        lower_r - s_r <= a_r . tau <= upper_r + s_r, s_r >= 0   soft rows

The hard set always holds tau = 0 and every other row can give way, so a solution always exists,
also from outside every limit. Solvers read a `FilterProblem`; nothing else passes between stages.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from enum import Enum
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]


class RowKind(Enum):
    """What a row protects. The order is the rank: 0 is hard, then each kind yields to those above."""

    POWER = 0
    RATE = 1
    DISTANCE = 2
    POSITION = 3
    VELOCITY = 4

    @property
    def hard(self) -> bool:
        """A hard row never gives way; its bounds must hold zero torque."""
        return self is RowKind.POWER

    @property
    def label(self) -> str:
        """Lower-case name, the first word of every row label."""
        return self.name.lower()


@dataclass(frozen=True)
class FilterLayout:
    """Which rows a filter has and where they stand, fixed for a run.

    Order: one power row, one torque-rate row per joint, one row per distance pair, one position
    row per joint, one velocity row per joint.

    Attributes:
        joints: Joint names in the order of the torque vector; n of them.
        pairs: Labels of the distance slots.
    """

    joints: tuple[str, ...]
    pairs: tuple[str, ...]

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.joints)

    @property
    def m(self) -> int:
        """Number of rows, m = 1 + 3 n + pairs."""
        return 1 + 3 * self.n + len(self.pairs)

    @cached_property
    def power(self) -> int:
        """Index of the power row."""
        return 0

    @cached_property
    def rate(self) -> slice:
        """Torque-rate rows."""
        return slice(1, 1 + self.n)

    @cached_property
    def distance(self) -> slice:
        """Distance rows."""
        return slice(self.rate.stop, self.rate.stop + len(self.pairs))

    @cached_property
    def position(self) -> slice:
        """Position rows."""
        return slice(self.distance.stop, self.distance.stop + self.n)

    @cached_property
    def velocity(self) -> slice:
        """Velocity rows."""
        return slice(self.position.stop, self.position.stop + self.n)

    @cached_property
    def kinds(self) -> tuple[RowKind, ...]:
        """Kind of each row; ``kinds[r].value`` is its rank."""
        counts = {RowKind.POWER: 1, RowKind.DISTANCE: len(self.pairs)}
        return tuple(kind for kind in RowKind for _ in range(counts.get(kind, self.n)))

    @cached_property
    def labels(self) -> tuple[str, ...]:
        """Name of each row, e.g. ``power``, ``position <joint>``, ``distance <pair>``."""
        names = {RowKind.DISTANCE: self.pairs}
        soft = (kind for kind in RowKind if not kind.hard)
        named = (f"{kind.label} {name}" for kind in soft for name in names.get(kind, self.joints))
        return (RowKind.POWER.label, *named)

    @cached_property
    def box_labels(self) -> tuple[str, ...]:
        """Name of each torque limit, ``torque <joint>``."""
        return tuple(f"torque {joint}" for joint in self.joints)

    @cached_property
    def soft(self) -> NDArray[np.bool_]:
        """(m,) True where a row may give way."""
        return np.array([not kind.hard for kind in self.kinds])


@dataclass(frozen=True)
class FilterProblem:
    """One cycle's quadratic program, in torques [N.m].

    Attributes:
        layout: Names, kinds and ranks of the rows.
        desired: (n,) torque the modules ask for.
        metric: (n, n) W, symmetric positive definite [1/(kg.m^2)].
        effort_max: (n,) torque limits, hard.
        matrix: (m, n) A; a row without meaning in this cycle is zero with infinite bounds.
        lower: (m,) -inf where absent.
        upper: (m,) inf where absent.
        penalty: (m,) w of each soft row, positive and finite; inf for hard rows.
    """

    layout: FilterLayout
    desired: Vector
    metric: Matrix
    effort_max: Vector
    matrix: Matrix
    lower: Vector
    upper: Vector
    penalty: Vector

    def snapshot(self) -> FilterProblem:
        """A read-only copy, for keeping beyond the cycle in which a workspace filled it."""
        return FilterProblem(self.layout, *(_frozen(getattr(self, name)) for name in _ARRAYS))


_ARRAYS = tuple(field.name for field in fields(FilterProblem) if field.name != "layout")


def _frozen(array: Vector) -> Vector:
    copy = array.copy()
    copy.setflags(write=False)
    return copy


class FilterWorkspace:
    """Arrays of fixed shape that one builder fills every cycle, so that no cycle allocates them.

    ``problem`` is the view of them that solvers read. A fresh workspace asks for nothing: zero
    desired torque, unit metric, no limit.

    Args:
        layout: Which rows there are.
    """

    def __init__(self, layout: FilterLayout) -> None:
        n, m = layout.n, layout.m
        self.layout = layout
        self.problem = FilterProblem(
            layout=layout,
            desired=np.zeros(n),
            metric=np.eye(n),
            effort_max=np.full(n, np.inf),
            matrix=np.zeros((m, n)),
            lower=np.full(m, -np.inf),
            upper=np.full(m, np.inf),
            penalty=np.where(layout.soft, 1.0, np.inf),
        )
        self.problem.matrix[layout.rate] = np.eye(n)
