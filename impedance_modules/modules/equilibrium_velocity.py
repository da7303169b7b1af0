# SPDX-License-Identifier: BSD-3-Clause
r"""The joint velocity that a task desires: how springs and dampers alone would follow their equilibria.

Where the equilibria move with the twists V_d and the rest angles with \dot q_0, springs and dampers stay in balance,
D v = H (q_d - q), if

    D \dot v_d + H v_d = \sum_springs J^T K V_d + K_j \dot q_0

    H = \sum_springs J^T K J + K_j + \lambda 1,      D = \sum_springs J^T D_s J + D_j

so the arm is desired as late as its own dampers make it, nothing is divided by a Jacobian, and a joint that no spring
holds does not move: \lambda is a small part of the mean stiffness. Friction, inertia and the force of a hybrid axis
are in none of it, and no sensor but the posture in J: twists are differences of the equilibria from cycle to cycle.
One step of the period h is implicit, (H + D / h) v_d = pull + (D / h) v_before.
"""

from __future__ import annotations

import math

import numpy as np

from impedance_modules.compiled import compiled
from impedance_modules.modules.joint_bias import JointSprings
from impedance_modules.modules.spring import Springs
from impedance_modules.records import Array3, Flag, Matrix, Record, Scalar, Vector
from impedance_modules.robot.kinematics import ArmGeometry

LEAST_STIFFNESS = 1e-3
"""Lambda over the mean of the stiffness's diagonal."""


class EquilibriumVelocity(Record):
    """The velocity and its memory.

    Attributes:
        period: Between two cycles, h [s].
        known: Whether the equilibria of the cycle before are known; without them nothing is desired.
        rotation, translation: (springs, 3, 3), (springs, 3) of the equilibria in the cycle before [m].
        rest: (n,) rest angles in the cycle before [rad].
        matrix: (n, n) H + D / h, then its Cholesky factor [N.m/rad].
        pull: (n,) right side of the equation [N.m/s].
        column: (2, 6) one column of K J, and of D_s J / h.
        twist: (2, 6) V_d of one spring, and J v_before [m/s, rad/s].
        velocity: (n,) v_d [rad/s].
    """

    period: Scalar
    known: Flag = False
    rotation: Array3
    translation: Matrix
    rest: Vector
    matrix: Matrix
    pull: Vector
    column: Matrix
    twist: Matrix
    velocity: Vector


def equilibrium_velocity(springs: int, n: int, period: float) -> EquilibriumVelocity:
    """Takes the memory for some springs on n joints and a control period [s]."""
    return EquilibriumVelocity(
        period=period,
        rotation=np.zeros((springs, 3, 3)),
        translation=np.zeros((springs, 3)),
        rest=np.zeros(n),
        matrix=np.zeros((n, n)),
        pull=np.zeros(n),
        column=np.zeros((2, 6)),
        twist=np.zeros((2, 6)),
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
    else:
        motion.velocity[:] = 0.0
    motion.known = True
    motion.rotation[:] = springs.target_rotation
    motion.translation[:] = springs.target_translation
    motion.rest[:] = bias.rest


@compiled
def _gather(motion: EquilibriumVelocity, springs: Springs, bias: JointSprings, arms: ArmGeometry) -> None:
    """Writes H + D / h and the right side of the equation."""
    n, h = bias.rest.size, motion.period
    mean = 0.0
    motion.matrix[:, :] = 0.0
    for j in range(n):
        motion.matrix[j, j] = bias.stiffness[j]
        motion.pull[j] = bias.stiffness[j] * (bias.rest[j] - motion.rest[j]) / h
        mean += bias.stiffness[j] / n
    for s in range(springs.frame.size):
        mean += _add_spring(motion, springs, s, arms) / n
    for j in range(n):
        motion.matrix[j, j] += LEAST_STIFFNESS * mean + 1e-12
        for k in range(arms.coupled[0, j], arms.coupled[1, j]):
            motion.matrix[j, k] += bias.damping[j, k] / h
            motion.pull[j] += bias.damping[j, k] / h * motion.velocity[k]


@compiled
def _add_spring(motion: EquilibriumVelocity, springs: Springs, s: int, arms: ArmGeometry) -> float:
    """Adds one spring with its damper; returns the sum of its stiffness's diagonal [N.m/rad]."""
    f, h, total = springs.frame[s], motion.period, 0.0
    _write_twists(motion, springs, s, arms)
    for j in range(arms.moved_by[0, f], arms.moved_by[1, f]):
        for a in range(6):
            motion.column[0, a], motion.column[1, a] = 0.0, 0.0
            for b in range(6):
                motion.column[0, a] += springs.stiffness[s, a, b] * arms.jacobian[f, b, j]
                motion.column[1, a] += springs.damping[s, a, b] / h * arms.jacobian[f, b, j]
        for a in range(6):
            motion.pull[j] += (
                motion.column[0, a] * motion.twist[0, a] + motion.column[1, a] * motion.twist[1, a]
            )
            total += motion.column[0, a] * arms.jacobian[f, a, j]
        for i in range(arms.moved_by[0, f], arms.moved_by[1, f]):
            for a in range(6):
                motion.matrix[i, j] += arms.jacobian[f, a, i] * (motion.column[0, a] + motion.column[1, a])
    return total


@compiled
def _write_twists(motion: EquilibriumVelocity, springs: Springs, s: int, arms: ArmGeometry) -> None:
    """Writes V_d of one spring and J v_before; a turn within a cycle is as small as its sine."""
    f = springs.frame[s]
    for a in range(3):
        away = springs.target_translation[s, a] - motion.translation[s, a]
        motion.twist[0, a] = away / motion.period
        b, c = (a + 1) % 3, (a + 2) % 3
        turn = 0.0
        for k in range(3):
            turn += springs.target_rotation[s, c, k] * motion.rotation[s, b, k]
            turn -= springs.target_rotation[s, b, k] * motion.rotation[s, c, k]
        motion.twist[0, 3 + a] = 0.5 * turn / motion.period
    for a in range(6):
        motion.twist[1, a] = 0.0
        for j in range(arms.moved_by[0, f], arms.moved_by[1, f]):
            motion.twist[1, a] += arms.jacobian[f, a, j] * motion.velocity[j]


@compiled
def _solve(motion: EquilibriumVelocity, arms: ArmGeometry) -> None:
    """Solves for the velocity in place by Cholesky; joints of different arms share no entry."""
    L, v = motion.matrix, motion.velocity
    v[:] = motion.pull
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
