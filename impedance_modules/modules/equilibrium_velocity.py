# SPDX-License-Identifier: BSD-3-Clause
r"""The joint velocity that a task desires: how springs and dampers alone would follow their equilibria.

Near the place where all springs together are at rest their torque is J^T K (X_d - X) + K_j (q_0 - q). Where the
equilibria move with the twists V_d and the rest angles with \dot q_0, that place moves with v,

    H v = \sum_springs J^T K V_d + K_j \dot q_0,      H = \sum_springs J^T K J + K_j + \lambda 1

so nothing is divided by a Jacobian, and a joint that no spring holds does not move: \lambda is a small part of the mean
stiffness. Dampers act on the arm's own velocity, and so it comes later; each joint is desired as late as its dampers
and springs make it,

    T_j \dot v_d,j + v_d,j = v_j,      T_j = D_jj / H_jj,      D = \sum_springs J^T D_s J + D_j

Friction, inertia and the force of a hybrid axis are in none of it, and no sensor but the posture in J: twists are
differences of the equilibria from cycle to cycle.
"""

from __future__ import annotations

import math

import numpy as np

from impedance_modules.compiled import compiled
from impedance_modules.modules.joint_bias import JointSprings
from impedance_modules.modules.spring import Springs
from impedance_modules.modules.target_motion import difference_twist
from impedance_modules.records import Array3, Flag, Matrix, Record, Scalar, Vector
from impedance_modules.robot.kinematics import ArmGeometry

LEAST_STIFFNESS = 1e-3
"""Lambda over the mean of the stiffness's diagonal."""

LONGEST_LAG = 0.3
"""Largest T_j [s]: a joint with hardly any spring has no motion of its own that could be late."""


class EquilibriumVelocity(Record):
    """The velocity and its memory.

    Attributes:
        period: Between two cycles, h [s].
        known: Whether the equilibria of the cycle before are known; without them nothing is desired.
        rotation, translation: (springs, 3, 3), (springs, 3) of the equilibria in the cycle before [m].
        rest: (n,) rest angles in the cycle before [rad].
        matrix: (n, n) H, then its Cholesky factor [N.m/rad].
        lag: (n,) D_jj, then T_j [s].
        column: (6,) one column of K J.
        twist: (6,) V_d of one spring [m/s, rad/s].
        moving: (n,) right side of the equation, then v [rad/s].
        velocity: (n,) v_d [rad/s].
    """

    period: Scalar
    known: Flag = False
    rotation: Array3
    translation: Matrix
    rest: Vector
    matrix: Matrix
    lag: Vector
    column: Vector
    twist: Vector
    moving: Vector
    velocity: Vector


def equilibrium_velocity(springs: int, n: int, period: float) -> EquilibriumVelocity:
    """Takes the memory for some springs on n joints and a control period [s]."""
    return EquilibriumVelocity(
        period=period,
        rotation=np.zeros((springs, 3, 3)),
        translation=np.zeros((springs, 3)),
        rest=np.zeros(n),
        matrix=np.zeros((n, n)),
        lag=np.zeros(n),
        column=np.zeros(6),
        twist=np.zeros(6),
        moving=np.zeros(n),
        velocity=np.zeros(n),
    )


@compiled
def follow_equilibrium(
    motion: EquilibriumVelocity, springs: Springs, bias: JointSprings, arms: ArmGeometry
) -> None:
    """Writes the desired velocity for the equilibria in force, and remembers where they are.

    Args:
        motion: Its ``velocity`` goes on from the cycle before; zero at the first call.
        springs: With the gains and equilibria of this cycle.
        bias: Likewise.
        arms: At the state.
    """
    if motion.known:
        _gather(motion, springs, bias, arms)
        _solve(motion, arms)
        for j in range(bias.rest.size):
            share = motion.period / (motion.lag[j] + motion.period)
            motion.velocity[j] += share * (motion.moving[j] - motion.velocity[j])
    else:
        motion.velocity[:] = 0.0
    motion.known = True
    motion.rotation[:] = springs.target_rotation
    motion.translation[:] = springs.target_translation
    motion.rest[:] = bias.rest


@compiled
def _gather(motion: EquilibriumVelocity, springs: Springs, bias: JointSprings, arms: ArmGeometry) -> None:
    """Writes H, the right side of its equation, and every joint's lag."""
    n = bias.rest.size
    mean = 0.0
    motion.matrix[:, :] = 0.0
    for j in range(n):
        motion.matrix[j, j] = bias.stiffness[j]
        motion.moving[j] = bias.stiffness[j] * (bias.rest[j] - motion.rest[j]) / motion.period
        motion.lag[j] = bias.damping[j, j]
    for s in range(springs.frame.size):
        _add_spring(motion, springs, s, arms)
    for j in range(n):
        mean += motion.matrix[j, j] / n
    for j in range(n):
        motion.matrix[j, j] += LEAST_STIFFNESS * mean + 1e-12
        motion.lag[j] = min(motion.lag[j] / motion.matrix[j, j], LONGEST_LAG)


@compiled
def _add_spring(motion: EquilibriumVelocity, springs: Springs, s: int, arms: ArmGeometry) -> None:
    """Adds one spring with its damper."""
    f = springs.frame[s]
    difference_twist(
        springs.target_rotation[s],
        springs.target_translation[s],
        motion.rotation[s],
        motion.translation[s],
        motion.twist,
    )
    for a in range(6):
        motion.twist[a] /= motion.period
    for j in range(arms.moved_by[0, f], arms.moved_by[1, f]):
        for a in range(6):
            motion.column[a] = 0.0
            for b in range(6):
                motion.column[a] += springs.stiffness[s, a, b] * arms.jacobian[f, b, j]
                motion.lag[j] += arms.jacobian[f, a, j] * springs.damping[s, a, b] * arms.jacobian[f, b, j]
        for a in range(6):
            motion.moving[j] += motion.column[a] * motion.twist[a]
        for i in range(arms.moved_by[0, f], arms.moved_by[1, f]):
            for a in range(6):
                motion.matrix[i, j] += arms.jacobian[f, a, i] * motion.column[a]


@compiled
def _solve(motion: EquilibriumVelocity, arms: ArmGeometry) -> None:
    """Solves H v = right side in place by Cholesky; joints of different arms share no entry."""
    L, v = motion.matrix, motion.moving
    for j in range(v.size):
        for i in range(j, arms.coupled[1, j]):
            for k in range(arms.coupled[0, j], j):
                L[i, j] -= L[i, k] * L[j, k]
            L[i, j] = math.sqrt(L[j, j]) if i == j else L[i, j] / L[j, j]
    for j in range(v.size):
        for k in range(arms.coupled[0, j], j):
            v[j] -= L[j, k] * v[k]
        v[j] /= L[j, j]
    for back in range(v.size):
        j = v.size - 1 - back
        for k in range(j + 1, arms.coupled[1, j]):
            v[j] -= L[k, j] * v[k]
        v[j] /= L[j, j]
