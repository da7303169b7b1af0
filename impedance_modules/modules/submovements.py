# SPDX-License-Identifier: BSD-3-Clause
r"""Submovements: minimum-jerk displacements of an equilibrium that overlap in time and add.

A target that jumps while the hand is on its way is answered by a second movement, which begins before the first has
ended; the first goes on. With t the phase's clock, t_i and T_i start and duration of submovement i, and d_i its
displacement in the axes of ``expressed_in`` (linear [m], then a rotation vector [rad]),

    \delta(t) = \sum_i s((t - t_i) / T_i) d_i,       s(x) = 10 x^3 - 15 x^4 + 6 x^5 on [0, 1]
    p(t) = p_0(t) + \delta_v(t),       R(t) = exp(\delta_w(t)) R_0(t)

with p_0 and R_0 what the other coordinates do. A sum does not depend on the order of its terms, velocity and
acceleration are continuous because those of s are zero at both ends, and when all are over the target has gone by
\sum d_i. Turns add as rotation vectors: for turns about one axis that is the turn by the sum of their angles; for
others it is a choice, which no experiment on hands supports as those on reaching do.

Sources: T. Flash, N. Hogan, "The coordination of arm movements", J. Neurosci. 5 (1985), the minimum jerk; T. Flash,
E. Henis, "Arm trajectory modifications during reaching towards visual targets", J. Cogn. Neurosci. 3 (1991), the sum
for a target that jumps; B. Rohrer, N. Hogan, "Avoiding spurious submovement decompositions", Biol. Cybern. 89 (2003)
and 94 (2006).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.compiled import compiled
from impedance_modules.modules.minimum_jerk import minimum_jerk, minimum_jerk_slope
from impedance_modules.records import Indices, Matrix, Record, Vector
from impedance_modules.robot.rotation import exp3, exponential_jacobian
from impedance_modules.spec.submovement_spec import Submovement


class SubmovementTable(Record):
    """The submovements of several motions, as arrays.

    Attributes:
        first: (motions + 1,) where those of each motion begin.
        turns: (motions,) 1 where any of them turns the target.
        start, duration: (k,) [s].
        by: (k, 6) displacement, linear [m] then rotation vector [rad].
    """

    first: Indices
    turns: Indices
    start: Vector
    duration: Vector
    by: Matrix


def lay_out_submovements(motions: Sequence[Sequence[Submovement]]) -> SubmovementTable:
    """Lays out the submovements of several motions, in their order."""
    every = [movement for movements in motions for movement in movements]
    return SubmovementTable(
        first=np.cumsum([0, *(len(movements) for movements in motions)], dtype=np.int64),
        turns=np.array([any(m.turns for m in movements) for movements in motions], dtype=np.int64),
        start=np.array([movement.start for movement in every], dtype=float),
        duration=np.array([movement.duration for movement in every], dtype=float),
        by=np.array([movement.by for movement in every], dtype=float).reshape(-1, 6),
    )


@compiled
def write_displacement(table: SubmovementTable, m: int, clock: float, out: Array) -> None:
    """Writes the displacement (6,) of motion ``m`` at a phase clock [s]; zero without submovements."""
    for k in range(6):
        out[k] = 0.0
    for i in range(table.first[m], table.first[m + 1]):
        part = minimum_jerk((clock - table.start[i]) / table.duration[i])
        for k in range(6):
            out[k] += part * table.by[i, k]


def displacement_of_all(movements: Sequence[Submovement], clock: float) -> Array:
    """Gives the displacement (6,) at a phase clock [s]; the law is ``write_displacement``."""
    out = np.empty(6)
    write_displacement(lay_out_submovements([movements]), 0, clock, out)
    return out


def displacement_rate(movements: Sequence[Submovement], clock: float) -> Array:
    """Gives d delta / dt (6,) at a phase clock [s], [m/s, rad/s]."""
    found = np.zeros(6)
    for movement in movements:
        slope = minimum_jerk_slope((clock - movement.start) / movement.duration) / movement.duration
        found += slope * np.array(movement.by)
    return found


def added_twist(movements: Sequence[Submovement], clock: float, angular: Array) -> tuple[Array, Array]:
    r"""Gives what submovements make of the velocity of a target, in the axes of ``expressed_in``.

    v = \delta_v',      w = J(\delta_w) \delta_w' + exp(\delta_w) w_0,      J the left Jacobian of the exponential

    Args:
        movements: Of the target.
        clock: Of the phase [s].
        angular: (3,) w_0, how fast the target turns without them [rad/s].

    Returns:
        (3,) what is added to the linear velocity [m/s], and (3,) the angular velocity [rad/s].
    """
    displacement, rate = displacement_of_all(movements, clock), displacement_rate(movements, clock)
    turn = displacement[3:]
    return rate[:3], exponential_jacobian(turn) @ rate[3:] + exp3(turn) @ angular
