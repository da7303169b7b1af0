# SPDX-License-Identifier: BSD-3-Clause
r"""How fast equilibria and rest angles move: what dampers ``damping_against: equilibrium`` count from.

A damper against the world brakes a hand on its way: the hand trails behind its equilibrium by about D V / K. One that
counts from the equilibrium resists only what differs from the way,

    w = -dU/dx + F - D (V - V_d),        \tau = -K_j (q - q_0) - D_j (v - \dot q_0)

with V_d and \dot q_0 the differences of equilibria and rest angles from one cycle to the next: where the energy tank
stops them, they are zero. D V_d has no potential. Its work is measured at the motors like all other work, and the tank
pays it (docs/passivity.md).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.compiled import compiled
from impedance_modules.modules.joint_bias import JointSprings
from impedance_modules.modules.spring import Springs
from impedance_modules.records import Array3, Flag, Indices, Matrix, Record, Scalar, Vector


class TargetMotion(Record):
    """Where equilibria and rest angles were in the cycle before.

    Attributes:
        period: Between two cycles [s].
        known: Whether there was a cycle before; without one nothing moves.
        active: Whether any damper counts from its equilibrium.
        springs: (springs,) 1 where the spring's damper does.
        joints: (n,) 1 where the joint spring's damper does.
        rotation, translation: (springs, 3, 3), (springs, 3) equilibria in the cycle before [m].
        rest: (n,) rest angles in the cycle before [rad].
    """

    period: Scalar
    known: Flag = False
    active: Flag
    springs: Indices
    joints: Indices
    rotation: Array3
    translation: Matrix
    rest: Vector


def target_motion(springs: Sequence[bool], joints: Sequence[bool], period: float) -> TargetMotion:
    """Takes the memory.

    Args:
        springs: (springs,) whether each spring's damper counts from its equilibrium.
        joints: (n,) likewise for the joint springs.
        period: Of the control [s].
    """
    count, n = len(springs), len(joints)
    return TargetMotion(
        period=period,
        active=bool(np.any(springs) or np.any(joints)),
        springs=np.asarray(springs, dtype=np.int64),
        joints=np.asarray(joints, dtype=np.int64),
        rotation=np.zeros((count, 3, 3)),
        translation=np.zeros((count, 3)),
        rest=np.zeros(n),
    )


@compiled
def measure_target_motion(motion: TargetMotion, springs: Springs, bias: JointSprings) -> None:
    """Writes V_d and the rates of the rest angles for the equilibria in force, and remembers these.

    Args:
        motion: Of the task.
        springs: ``target_twist`` is overwritten where a damper counts from its equilibrium.
        bias: ``rest_velocity`` likewise.
    """
    if not motion.active:
        return
    for s in range(motion.springs.size):
        if motion.springs[s] > 0 and motion.known:
            difference_twist(
                springs.target_rotation[s],
                springs.target_translation[s],
                motion.rotation[s],
                motion.translation[s],
                springs.target_twist[s],
            )
            for k in range(6):
                springs.target_twist[s, k] /= motion.period
    for j in range(motion.joints.size):
        if motion.joints[j] > 0 and motion.known:
            bias.rest_velocity[j] = (bias.rest[j] - motion.rest[j]) / motion.period
    motion.known = True
    motion.rotation[:] = springs.target_rotation
    motion.translation[:] = springs.target_translation
    motion.rest[:] = bias.rest


@compiled
def difference_twist(
    rotation: Array, translation: Array, last_rotation: Array, last_translation: Array, out: Array
) -> None:
    """Writes the small displacement from one pose to the next, (6,) in world axes [m, rad].

    The turn within a cycle is as small as its sine.
    """
    for a in range(3):
        out[a] = translation[a] - last_translation[a]
        b, c = (a + 1) % 3, (a + 2) % 3
        turn = 0.0
        for k in range(3):
            turn += rotation[c, k] * last_rotation[b, k]
            turn -= rotation[b, k] * last_rotation[c, k]
        out[3 + a] = 0.5 * turn
