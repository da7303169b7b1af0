# SPDX-License-Identifier: BSD-3-Clause
"""One arm at one state: inertia, damping and stiffness at its hand, and the arm in joint space.

Springs on the hand count as the hand's; springs on any other frame of the arm count as joint springs. The
load that turns with the joints is taken from the joint springs themselves, J^T F_b = K_j (q - q_0) less what
springs elsewhere carry: so at rest, where that is what springs and surfaces exert on the hand.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.modules.arms import ArmModule
from impedance_modules.modules.damping import Damping
from impedance_modules.modules.equilibrium import Equilibrium
from impedance_modules.modules.spring import Spring
from impedance_modules.robot.kinematics import Kinematics
from impedance_modules.robot.pose import Pose
from impedance_modules.superposition.modes import JointSpace, joint_space_stiffness
from impedance_modules.superposition.net_stiffness import (
    NetStiffness,
    as_joint_stiffness,
    carried_wrench,
    gamma,
    hand_damping,
    net_stiffness,
    spring_stiffness,
    spring_stiffness_without_preload,
)
from impedance_modules.superposition.operational_inertia import (
    OperationalInertia,
    operational_inertia,
    without_reflected_inertia,
)
from impedance_modules.superposition.sampled_loop import Gains


@dataclass(frozen=True)
class ArmImpedance:
    """What a push on an arm's hand meets; (6, 6) in world axes at the hand.

    Attributes:
        limb: Name of the arm.
        pose: X_WH of the hand.
        jacobian: (6, k) of the hand over the limb's joints.
        inertia: With reflected inertia.
        inertia_without_reflected: Of the links alone.
        damping: B; None where the joints' damping or the posture is singular.
        stiffness: Net stiffness with its preload.
        stiffness_without_preload: The same springs, relaxed.
        preload: (6,) F_b, what the joint springs carry [N, N.m].
        wrench: (6,) of the hand's springs and hybrid axes [N, N.m].
        system: The arm in joint space.
        relaxed: (k, k) its stiffness in joint space without any load [N.m/rad].
        fixed, scaled: Its gains, split for ``highest_stable_stiffness``.
    """

    limb: str
    pose: Pose
    jacobian: Array
    inertia: OperationalInertia
    inertia_without_reflected: OperationalInertia
    damping: Array | None
    stiffness: NetStiffness
    stiffness_without_preload: NetStiffness
    preload: Array
    wrench: Array
    system: JointSpace
    relaxed: Array
    fixed: Gains
    scaled: Gains


@dataclass(frozen=True)
class _FrameSprings:
    """Springs of one arm on one frame, summed: its Jacobian over the limb's joints, and (6, 6) matrices."""

    jacobian: Array
    stiffness: Array
    relaxed: Array
    modal: Array
    explicit: Array
    wrench: Array


@dataclass(frozen=True)
class SideSprings:
    """What acts on the joints besides the hand's springs.

    Attributes:
        stiffness: (k, k) with its load [N.m/rad].
        relaxed: (k, k) without [N.m/rad].
        load: (k,) torque that the joints carry for it, minus its own [N.m].
        damping: (k, k) [N.m.s/rad].
    """

    stiffness: Array
    relaxed: Array
    load: Array
    damping: Array

    def plus(self, other: SideSprings) -> SideSprings:
        """Adds what else acts on the same joints."""
        return SideSprings(
            self.stiffness + other.stiffness,
            self.relaxed + other.relaxed,
            self.load + other.load,
            self.damping + other.damping,
        )


def arm_impedance(
    arm: ArmModule,
    kinematics: Kinematics,
    targets: Equilibrium,
    q: Array,
    damping: Damping,
    *,
    at_rest: bool = True,
    beside: SideSprings | None = None,
) -> ArmImpedance:
    """Analyses one arm at the state for which ``kinematics`` was last updated.

    Args:
        arm: The module, with the gains of the phase.
        kinematics: Holding the hand and the frames of all springs.
        targets: Equilibria.
        q: (n,) [rad].
        damping: Of the phase.
        at_rest: Whether the hand's springs and what touches it carry what the joint springs ask for. On the way they do
            not: the load that turns with the joints is then what the hand's springs exert.
        beside: What acts on the joints besides the arm's own modules; None for nothing.
    """
    joints, hand = arm.limb.joints, arm.limb.hand
    frames = dict.fromkeys([hand, *(spring.frame for spring in arm.springs)])
    parts = {frame: _springs_on(arm, frame, kinematics, targets, damping) for frame in frames}
    end = parts[hand]
    side = _joint_springs(arm, [parts[frame] for frame in frames if frame != hand], targets, q, damping)
    side = side if beside is None else side.plus(beside)
    preload = carried_wrench(end.jacobian, side.load) if at_rest else end.wrench
    inverse = kinematics.inverse_inertia[np.ix_(joints, joints)]
    bare = without_reflected_inertia(inverse, kinematics.model.reflected_inertia[joints])
    system, scaled = _system(inverse, end, side, preload), _scaled(list(parts.values()))
    return ArmImpedance(
        limb=arm.limb.name,
        pose=kinematics.pose(hand),
        jacobian=end.jacobian,
        inertia=operational_inertia(end.jacobian, inverse),
        inertia_without_reflected=operational_inertia(end.jacobian, bare),
        damping=hand_damping(end.jacobian, side.damping, end.modal + end.explicit),
        stiffness=net_stiffness(end.jacobian, side.stiffness, end.stiffness, preload),
        stiffness_without_preload=net_stiffness(end.jacobian, side.relaxed, end.relaxed, np.zeros(6)),
        preload=preload,
        wrench=end.wrench,
        system=system,
        relaxed=side.relaxed + end.jacobian.T @ end.relaxed @ end.jacobian,
        fixed=Gains(system.stiffness - scaled.stiffness, system.damping - scaled.damping),
        scaled=scaled,
    )


def _springs_on(
    arm: ArmModule, frame: str, kinematics: Kinematics, targets: Equilibrium, damping: Damping
) -> _FrameSprings:
    pose = kinematics.pose(frame)
    springs = [spring for spring in arm.springs if spring.frame == frame]
    placed: list[tuple[Spring, Pose]] = [(spring, targets.springs[spring.name]) for spring in springs]
    return _FrameSprings(
        jacobian=kinematics.jacobian_of(frame)[:, arm.limb.joints],
        stiffness=_sum([spring_stiffness(spring, pose, target) for spring, target in placed]),
        relaxed=_sum([spring_stiffness_without_preload(spring, pose, target) for spring, target in placed]),
        modal=_sum([damping.spring_modal[spring.name] for spring in springs]),
        explicit=_sum([damping.spring_explicit[spring.name] for spring in springs]),
        wrench=np.sum(
            [np.zeros(6), *(spring.wrench(pose, target) + spring.axis_force() for spring, target in placed)],
            axis=0,
        ),
    )


def _joint_springs(
    arm: ArmModule, others: Sequence[_FrameSprings], targets: Equilibrium, q: Array, damping: Damping
) -> SideSprings:
    """Collects joint springs and the springs on other frames than the hand."""
    bias, k = arm.bias, len(arm.limb.joints)
    stiffness, load, damped = np.zeros((k, k)), np.zeros(k), np.zeros((k, k))
    if bias is not None:
        stiffness = np.diag(bias.stiffness)
        load = bias.stiffness * (q[bias.joints] - targets.rests[bias.limb])
        damped = damping.of_joints(arm.limb.name)
    relaxed = stiffness
    for part in others:
        stiffness = stiffness + as_joint_stiffness(part.jacobian, part.stiffness, part.wrench)
        relaxed = relaxed + part.jacobian.T @ part.relaxed @ part.jacobian
        load = load - part.jacobian.T @ part.wrench
        damped = damped + part.jacobian.T @ (part.modal + part.explicit) @ part.jacobian
    return SideSprings(stiffness, relaxed, load, damped)


def _system(inverse_inertia: Array, end: _FrameSprings, side: SideSprings, preload: Array) -> JointSpace:
    """Writes the arm in joint space, K_q = K_j - Gamma + J^T K_end J and likewise D_q."""
    J = end.jacobian
    inertia = np.asarray(np.linalg.inv(inverse_inertia), dtype=np.float64)
    stiffness = joint_space_stiffness(J, side.stiffness, end.stiffness, gamma(J, preload))
    return JointSpace(inertia, stiffness, side.damping + J.T @ (end.modal + end.explicit) @ J)


def _scaled(parts: Sequence[_FrameSprings]) -> Gains:
    """Sums what grows when the springs on frames are made stiffer."""
    stiffness = [part.jacobian.T @ part.stiffness @ part.jacobian for part in parts]
    modal = [part.jacobian.T @ part.modal @ part.jacobian for part in parts]
    return Gains(np.asarray(np.sum(stiffness, axis=0)), np.asarray(np.sum(modal, axis=0)))


def _sum(matrices: Sequence[Array]) -> Array:
    return np.asarray(sum(matrices, np.zeros((6, 6))))
