# SPDX-License-Identifier: BSD-3-Clause
r"""Joint springs that pull an arm to a posture, unprojected and part of the declared stiffness (thesis eq. 4.25).

    U = 1/2 (q - q_0)^T K_j (q - q_0),     \tau = -K_j (q - q_0) - D_j (v - v_0)

v_0 = 0 for dampers against the world, or the rate of q_0 (``modules.target_motion``).

The laws below are what runs in every cycle, over all joints of a task; ``JointBias`` says what a task file declares.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impedance_modules.arrays import Array
from impedance_modules.compiled import compiled
from impedance_modules.records import Indices, Matrix, Record, Vector
from impedance_modules.robot.kinematics import ArmGeometry
from impedance_modules.spec.task import WORLD


class JointSprings(Record):
    """The joint springs of all arms as they are in force now, and what they ask for.

    Attributes:
        stiffness: (n,) K_j [N.m/rad]; 0 for a joint without a spring.
        damping: (n, n) D_j [N.m.s/rad].
        rest: (n,) q_0 [rad].
        rest_velocity: (n,) v_0 [rad/s].
        limb: (n,) number of the arm that each joint belongs to.
        effort: (arms, n) what each arm's joint springs ask for [N.m].
    """

    stiffness: Vector
    damping: Matrix
    rest: Vector
    rest_velocity: Vector
    limb: Indices
    effort: Matrix


@compiled
def bias_energy(bias: JointSprings, q: Array) -> float:
    """Returns (q - q_0)^T K_j (q - q_0) / 2 [J] at positions q (n,) [rad]."""
    total = 0.0
    for j in range(q.size):
        total += 0.5 * bias.stiffness[j] * (q[j] - bias.rest[j]) ** 2
    return total


@compiled
def bias_efforts(bias: JointSprings, arms: ArmGeometry, q: Array, velocity: Array, scale: float) -> float:
    """Writes -s K_j (q - q_0) - D_j (v - v_0) of each arm into ``bias.effort``; returns the energy [J].

    Args:
        bias: In force.
        arms: For the joints that a joint's damping can couple it with.
        q: (n,) [rad].
        velocity: (n,) that dampers act on [rad/s].
        scale: s in [0, 1]: relaxes the potential, not the dampers.
    """
    total = 0.0
    bias.effort[:, :] = 0.0
    for j in range(q.size):
        pull = scale * bias.stiffness[j] * (q[j] - bias.rest[j])
        total += 0.5 * pull * (q[j] - bias.rest[j])
        for k in range(arms.coupled[0, j], arms.coupled[1, j]):
            pull += bias.damping[j, k] * (velocity[k] - bias.rest_velocity[k])
        bias.effort[bias.limb[j], j] -= pull
    return total


@dataclass(frozen=True)
class JointBias:
    """One torsion spring and damper per joint of a limb.

    The springs are not projected into a null space: they add to the hand's stiffness, and
    ``superposition.net_stiffness`` says by how much.

    Attributes:
        limb: Arm on whose joints it acts.
        joints: (k,) their indices in the model's vectors, from the base outwards.
        stiffness: (k,) [N.m/rad]; 0 leaves a joint free.
        rest: (k,) angles at rest at the start [rad].
        damping: (k,) explicit damping [N.m.s/rad].
        damping_ratio: Zeta of the damping that follows from (K_j, M + I_r); None adds none.
        damping_against: ``world``, or ``equilibrium``: dampers count from the rate of the rest angles.
    """

    limb: str
    joints: NDArray[np.intp]
    stiffness: Array
    rest: Array
    damping: Array
    damping_ratio: float | None
    damping_against: str = WORLD
