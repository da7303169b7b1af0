# SPDX-License-Identifier: BSD-3-Clause
r"""The torque filter as data: which rows exist, their numbers in one cycle, and what they are made from.

    minimise over tau   1/2 (tau - desired)^T W (tau - desired) + sum_soft 1/2 w_r s_r^2
    subject to          -effort_max <= tau <= effort_max                        hard
                        lower_r <= a_r . tau <= upper_r                         hard rows (power)
                        lower_r - s_r <= a_r . tau <= upper_r + s_r, s_r >= 0   soft rows

The hard set always holds tau = 0 and every other row can give way, so a solution always exists,
also from outside every limit. A cycle filters in three steps:

1. build: ``metric.write_metric`` and ``rows.write_rows`` write the ``FilterProblem`` of a ``FilterState``;
2. solve: ``active_set.solve``, and where that proves nothing the robot's solver (``solvers``);
3. attribute: ``attribute.attribute`` tells which row changed the torque, at which module's cost.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from impedance_modules.compiled import compiled
from impedance_modules.records import Array3, IndexMatrix, Matrix, Record, Scalar, Vector

LOWEST_PENALTY = 1.2e3
"""kappa of the lowest rank: about 1 / kappa of the excess that the desired torque asks for gets through."""

RANK_FACTOR = 12.0
"""kappa of a rank over that of the rank below it."""

HARD_TOLERANCE = 1e-7
"""Most that a solver may break a hard bound [N.m] before its answer counts as a failure."""

POWER_ROW = 0
"""Index of the only hard row."""


class RowKind(Enum):
    """What a row protects, in the order in which rows stand; ``RANK`` says who yields to whom."""

    POWER = 0
    RATE = 1
    MOTOR = 2
    VELOCITY = 3
    DISTANCE = 4
    POSITION = 5

    @property
    def hard(self) -> bool:
        """A hard row never gives way; its bounds must hold zero torque."""
        return self is RowKind.POWER

    @property
    def label(self) -> str:
        """Lower-case name, the first word of every row label."""
        return self.name.lower()


RANK = {RowKind.RATE: 2, RowKind.MOTOR: 2, RowKind.VELOCITY: 2, RowKind.DISTANCE: 1, RowKind.POSITION: 0}
"""Of soft kinds: each yields to those above. Kinds of one rank, and those of one joint, never contradict each other:
``rows.narrow``."""


def relative_penalty(kind: RowKind) -> float:
    """Returns kappa of a soft kind: LOWEST_PENALTY at the lowest rank, RANK_FACTOR times more per rank above.

    Two rows of the same direction that cannot both hold are broken in the ratio of their kappas. The penalty of a row
    follows from it and the arm's mobility, see ``rows.py``.

    Raises:
        ValueError: For a hard kind, which has no penalty.
    """
    if kind.hard:
        raise ValueError(f"a {kind.label} row is hard; only soft rows have a penalty")
    return LOWEST_PENALTY * RANK_FACTOR ** RANK[kind]


@dataclass(frozen=True)
class FilterLayout:
    """Which rows a filter has and where they stand, fixed for a run.

    Order: one power row; per joint one torque-rate row, one motor row, one velocity row; one row per distance pair;
    one position row per joint.

    Attributes:
        joints: Joint names in the order of the torque vector; n of them.
        pairs: Labels of the distance rows.
    """

    joints: tuple[str, ...]
    pairs: tuple[str, ...]

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.joints)

    @property
    def m(self) -> int:
        """Number of rows, m = 1 + 4 n + pairs."""
        return 1 + 4 * self.n + len(self.pairs)

    @cached_property
    def rate(self) -> slice:
        """Torque-rate rows."""
        return slice(1, 1 + self.n)

    @cached_property
    def motor(self) -> slice:
        """Rows of the motors' speed."""
        return slice(self.rate.stop, self.rate.stop + self.n)

    @cached_property
    def velocity(self) -> slice:
        """Velocity rows."""
        return slice(self.motor.stop, self.motor.stop + self.n)

    @cached_property
    def distance(self) -> slice:
        """Distance rows."""
        return slice(self.velocity.stop, self.velocity.stop + len(self.pairs))

    @cached_property
    def position(self) -> slice:
        """Position rows."""
        return slice(self.distance.stop, self.distance.stop + self.n)

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


class FilterState(Record):
    """What the filter must know of one cycle.

    Attributes:
        q: (n,) joint positions expected when the torque begins to act (``expected_motion``) [rad].
        v: (n,) joint velocities expected then, of motor and link together [rad/s].
        link_velocity: (n,) of the links alone, expected then [rad/s].
        push: (n,) acceleration by forces that are not the robot's own [rad/s^2].
        swing: (n,) speed of each motor against its link expected then [rad/s].
        load: (n,) torque of each joint's spring expected then, without the arms' weight [N.m].
        motor_velocity: (n,) thetadot, speed at the port where energy is counted [rad/s].
        inverse_inertia: (n, n) (M + I_r)^-1 [1/(kg.m^2)].
        bias: (n,) torque that keeps v constant, (M + I_r) vdot = tau - bias; without gravity where
            the robot compensates it [N.m].
        jacobian: (hands, 6, n) of each hand, world axes, linear rows first.
        previous: (n,) torque of the last cycle [N.m].
        available: Tank level above its floor, >= 0 (``tank.available``) [J].
        distance: (pairs,) smallest distance of each pair [m].
        gradient: (pairs, n) rate of the distance = row . v; zero where a pair is far [m/rad].
        drift: (pairs,) how the distance accelerates at constant v: its gradient turns [m/s^2].
    """

    q: Vector
    v: Vector
    link_velocity: Vector
    push: Vector
    swing: Vector
    load: Vector
    motor_velocity: Vector
    inverse_inertia: Matrix
    bias: Vector
    jacobian: Array3
    previous: Vector
    available: Scalar = 0.0
    distance: Vector
    gradient: Matrix
    drift: Vector


class FilterProblem(Record):
    """One cycle's quadratic program, in torques [N.m]; much of it is zero, as arms do not accelerate each other.

    Attributes:
        desired: (n,) torque the modules ask for.
        metric: (n, n) W, symmetric positive definite [1/(kg.m^2)].
        effort_max: (n,) torque limits, hard.
        matrix: (m, n) A; a row without meaning in this cycle is zero with infinite bounds.
        lower: (m,) -inf where absent.
        upper: (m,) inf where absent.
        penalty: (m,) w of each soft row, positive and finite; inf for the hard row.
        kappa: (m,) relative penalty of each row's kind, constant; 1 for the hard row, unused.
        reach: (2, m) first and one past the last column of each row that can be other than zero, constant.
        coupled: (2, n) first and one past the last joint that each joint's inertia couples it with, constant.
        moved_by: (2, hands or more) first and one past the last joint that can move each hand, constant.
    """

    desired: Vector
    metric: Matrix
    effort_max: Vector
    matrix: Matrix
    lower: Vector
    upper: Vector
    penalty: Vector
    kappa: Vector
    reach: IndexMatrix
    coupled: IndexMatrix
    moved_by: IndexMatrix


def make_problem(
    layout: FilterLayout,
    effort_max: Vector,
    coupled: IndexMatrix | None = None,
    moved_by: IndexMatrix | None = None,
) -> FilterProblem:
    """Makes a problem that asks for nothing: zero desired torque, unit metric, no limit but of torque.

    Args:
        layout: Which rows there are.
        effort_max: (n,) [N.m].
        coupled: See ``FilterProblem``; None: every joint may accelerate every other.
        moved_by: See ``FilterProblem``; None: every joint may move every hand, of two at most.
    """
    n, m = layout.n, layout.m
    all_joints = np.array([[0], [n]])
    coupled = np.tile(all_joints, (1, n)) if coupled is None else np.array(coupled, dtype=np.int64)
    reach = np.tile(all_joints, (1, m))
    matrix = np.zeros((m, n))
    for rows in (layout.rate, layout.motor, layout.velocity, layout.position):
        reach[:, rows] = np.arange(n), np.arange(1, n + 1)
        matrix[rows] = np.eye(n)
    return FilterProblem(
        desired=np.zeros(n),
        metric=np.eye(n),
        effort_max=np.array(effort_max, dtype=np.float64),
        matrix=matrix,
        lower=np.full(m, -np.inf),
        upper=np.full(m, np.inf),
        penalty=np.where(layout.soft, 1.0, np.inf),
        kappa=np.array([1.0 if kind.hard else relative_penalty(kind) for kind in layout.kinds]),
        reach=reach,
        coupled=coupled,
        moved_by=np.tile(all_joints, (1, 2)) if moved_by is None else np.array(moved_by, dtype=np.int64),
    )


@compiled
def clip(problem: FilterProblem, change: Vector, effort: Vector) -> None:
    """Writes the filtered torque, desired + change, inside the torque limits to the last bit.

    Args:
        problem: The problem solved.
        change: (n,) as solved [N.m].
        effort: (n,) overwritten [N.m].
    """
    for i in range(effort.size):
        tau = problem.desired[i] + change[i]
        effort[i] = min(max(tau, -problem.effort_max[i]), problem.effort_max[i])
