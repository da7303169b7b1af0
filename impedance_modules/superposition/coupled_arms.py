# SPDX-License-Identifier: BSD-3-Clause
r"""What springs between arms, and obstacles, are in the joints of all arms: blocks of stiffness and damping.

With x the poses of both frames, J their stacked Jacobian, w the wrenches on them, and \tau = J^T w,

    -d\tau/dq = J^T K_x J - \Gamma(w),     K_x = -dw/dx = G^T K G + (what turns with the load),     D_q = (G J)^T D G J

(``modules.between_spring`` has G). The block of one arm alone, the other held still, counts among its joint springs;
the blocks between two arms couple them. Where both hands hold one object, all blocks together add to the object's
stiffness, hands i and k, X_i = ``carry(r_i)``:

    K = \sum_ik X_i^T K_ik X_k + \sum diag(0, [f_i]x [r_i]x),     (K_ik) = (J H^-1 J^T)^-1 over both hands, H coupled
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impedance_modules.arrays import Array
from impedance_modules.modules.arms import TaskModules
from impedance_modules.modules.between_spring import (
    BetweenSpring,
    between_efforts,
    lay_out_between,
    relative_jacobian,
    springs_at,
)
from impedance_modules.modules.damping import Damping
from impedance_modules.modules.equilibrium import Equilibrium
from impedance_modules.modules.obstacle import Obstacles, obstacles_at, push_force
from impedance_modules.robot.kinematics import ArmGeometry, Kinematics
from impedance_modules.robot.model import Limb
from impedance_modules.robot.pose import Pose, carry
from impedance_modules.robot.rotation import exp3, skew
from impedance_modules.superposition.arm_impedance import ArmImpedance, SideSprings
from impedance_modules.superposition.modes import JointSpace, block_diagonal
from impedance_modules.superposition.net_stiffness import SINGULAR, gamma, through_arm
from impedance_modules.superposition.sampled_loop import Gains

STEP = 1e-3
"""Displacement [m, rad] of the central differences that give dw/dx, of fourth order: exact to about 1e-11."""


PUSH_STEP = 1e-4
"""The same for an obstacle's push [m]."""


@dataclass(frozen=True)
class JointCoupling:
    """Springs between arms, and pushes of obstacles, summed over all joints of the robot.

    Attributes:
        effort: (n,) torque of their potentials [N.m].
        stiffness: (n, n) -d effort / dq [N.m/rad].
        relaxed: (n, n) the same springs without their load.
        modal, explicit: (n, n) dampers that follow from a damping ratio, and declared ones [N.m.s/rad].
        groups: Sets of arms that they join, each in the task's order.
    """

    effort: Array
    stiffness: Array
    relaxed: Array
    modal: Array
    explicit: Array
    groups: tuple[tuple[str, ...], ...]

    @property
    def damping(self) -> Array:
        """(n, n) of all dampers [N.m.s/rad]."""
        return self.modal + self.explicit

    def on(self, joints: NDArray[np.intp]) -> SideSprings:
        """Gives what acts on one arm while the others are held still."""
        own = np.ix_(joints, joints)
        return SideSprings(self.stiffness[own], self.relaxed[own], -self.effort[joints], self.damping[own])


def across(matrix: Array, parts: Sequence[NDArray[np.intp]]) -> Array:
    """Takes of a matrix (n, n) what couples several arms: over their stacked joints, blocks of single arms zero."""
    joints = np.concatenate(parts)
    found = matrix[np.ix_(joints, joints)]
    ends = np.cumsum([0] + [len(part) for part in parts])
    for first, last in itertools.pairwise(ends):
        found[first:last, first:last] = 0.0
    return found


@dataclass(frozen=True)
class CoupledArms:
    """Arms that springs join and no object does, in joint space over their stacked joints.

    Attributes:
        limbs: Their names.
        system: Inertia, stiffness and damping.
        fixed, scaled: Its gains, split for ``highest_stable_stiffness``.
        stiffness, damping: (6 h, 6 h) at the h hands, world axes, the blocks between two hands are the coupling; None
            where a posture is singular.
        folds: Together they do not return under their loads.
    """

    limbs: tuple[str, ...]
    system: JointSpace
    fixed: Gains
    scaled: Gains
    stiffness: Array | None
    damping: Array | None
    folds: bool

    @property
    def name(self) -> str:
        """What reports call them."""
        return " and ".join(self.limbs)


def couple_arms(
    coupling: JointCoupling, limbs: Sequence[Limb], arms: Mapping[str, ArmImpedance]
) -> CoupledArms:
    """Joins the analysed arms of one group.

    Args:
        coupling: At the same state.
        limbs: Of the group.
        arms: Limb name -> its analysis, ``coupling.on`` of its joints included.
    """
    parts, single = [limb.joints for limb in limbs], [arms[limb.name] for limb in limbs]
    joints = np.concatenate(parts)
    own = np.ix_(joints, joints)
    system = JointSpace(
        block_diagonal([arm.system.inertia for arm in single]),
        block_diagonal([arm.system.stiffness for arm in single]) + across(coupling.stiffness, parts),
        block_diagonal([arm.system.damping for arm in single]) + across(coupling.damping, parts),
    )
    scaled = Gains(
        block_diagonal([arm.scaled.stiffness for arm in single]) + coupling.relaxed[own],
        block_diagonal([arm.scaled.damping for arm in single]) + coupling.modal[own],
    )
    J = stacked_jacobian(single)
    values = np.linalg.eigvalsh(0.5 * (system.stiffness + system.stiffness.T))
    return CoupledArms(
        limbs=tuple(limb.name for limb in limbs),
        system=system,
        fixed=Gains(system.stiffness - scaled.stiffness, system.damping - scaled.damping),
        scaled=scaled,
        stiffness=through_arm(J, system.stiffness),
        damping=through_arm(J, system.damping),
        folds=bool(values[0] < -SINGULAR * np.max(np.abs(values))),
    )


def stacked_jacobian(arms: Sequence[ArmImpedance]) -> Array:
    """Stacks the hands' Jacobians, (6 h, k) over all joints of the arms."""
    ends = np.cumsum([0] + [arm.jacobian.shape[1] for arm in arms])
    found = np.zeros((6 * len(arms), ends[-1]))
    for row, (arm, first, last) in enumerate(zip(arms, ends, ends[1:], strict=False)):
        found[6 * row : 6 * row + 6, first:last] = arm.jacobian
    return found


@dataclass(frozen=True)
class CouplingAtObject:
    """What springs between its hands add to an object beyond the sum of the single arms, (6, 6) at its origin.

    Attributes:
        stiffness, relaxed, damping: With load, without, and of dampers; None where a posture is singular or an arm has
            no such matrix.
        joint_stiffness, joint_damping: (k, k) over the stacked joints of the holding arms, between arms only.
    """

    stiffness: Array | None
    relaxed: Array | None
    damping: Array | None
    joint_stiffness: Array
    joint_damping: Array


def coupling_at_object(
    coupling: JointCoupling, limbs: Sequence[Limb], arms: Sequence[ArmImpedance], offsets: Sequence[Array]
) -> CouplingAtObject:
    """Carries the coupling of the hands that hold an object to its origin.

    Args:
        coupling: At the same state.
        limbs: That hold the object.
        arms: Their analyses, ``coupling.on`` of their joints included.
        offsets: (3,) from the object's origin to each hand [m].
    """
    parts, J = [limb.joints for limb in limbs], stacked_jacobian(arms)
    at_hands = np.vstack([carry(offset) for offset in offsets])
    stiffness, damping = across(coupling.stiffness, parts), across(coupling.damping, parts)

    def beyond(single: list[Array], joined: Array, hands: list[Array | None]) -> Array | None:
        whole = through_arm(J, block_diagonal(single) + joined)
        known = [hand for hand in hands if hand is not None]
        if whole is None or len(known) < len(hands):
            return None
        return np.asarray(at_hands.T @ (whole - block_diagonal(known)) @ at_hands)

    return CouplingAtObject(
        stiffness=beyond(
            [arm.system.stiffness for arm in arms], stiffness, [arm.stiffness.at_hand for arm in arms]
        ),
        relaxed=beyond(
            [arm.relaxed for arm in arms],
            across(coupling.relaxed, parts),
            [arm.stiffness_without_preload.at_hand for arm in arms],
        ),
        damping=beyond([arm.system.damping for arm in arms], damping, [arm.damping for arm in arms]),
        joint_stiffness=stiffness,
        joint_damping=damping,
    )


def joint_coupling(
    modules: TaskModules, kinematics: Kinematics, targets: Equilibrium, damping: Damping
) -> JointCoupling | None:
    """Sums springs between arms and obstacles at the state of ``kinematics``; None for a task without any.

    Args:
        modules: Of the task.
        kinematics: Of the state.
        targets: Rests.
        damping: Of the phase.
    """
    if not modules.between and not modules.obstacles:
        return None
    arms, n = kinematics.arms, kinematics.model.n
    found = springs_at(modules.between, kinematics, targets.springs)
    stiffness, relaxed, modal, explicit = (np.zeros((n, n)) for _ in range(4))
    for s, spring in enumerate(modules.between):
        moves = relative_jacobian(found, arms, s)
        relaxed += moves.T @ spring.spec.stiffness @ moves
        modal += moves.T @ damping.between_modal[spring.name] @ moves
        if spring.spec.damping is not None:
            explicit += moves.T @ spring.spec.damping @ moves
        stacked = np.vstack([kinematics.jacobian_of(frame) for frame in spring.frames])
        poses = [kinematics.pose(frame) for frame in spring.frames]
        stiffness += (
            stacked.T @ pair_stiffness(spring, poses[0], poses[1], targets.springs[spring.name]) @ stacked
        )
        for end, limb in enumerate(spring.limbs):
            joints = modules.arm(limb).limb.joints
            J = kinematics.jacobian_of(spring.frames[end])[:, joints]
            stiffness[np.ix_(joints, joints)] -= gamma(J, found.wrench[s, 6 * end : 6 * end + 6])
    effort = found.effort.sum(axis=0)
    for pushed, K, declared, dampers in _pushes(modules, kinematics):
        effort, stiffness = effort + pushed, stiffness + K
        relaxed, explicit = relaxed + declared, explicit + dampers
    return JointCoupling(effort, stiffness, relaxed, modal, explicit, joined_arms(modules))


def _pushes(modules: TaskModules, kinematics: Kinematics) -> Iterator[tuple[Array, Array, Array, Array]]:
    """Gives of every frame that an obstacle pushes torque (n,), and stiffness, relaxed stiffness, damping (n, n)."""
    found, limbs = obstacles_at(modules.obstacles, kinematics), [arm.limb for arm in modules.arms]
    for p, (o, f) in enumerate(zip(found.obstacle, found.frame, strict=True)):
        depth = found.distance[o] - found.clearance[p]
        if depth <= 0.0:
            continue
        J, point, normal = kinematics.jacobian[f], kinematics.translation[f], found.normal[p]
        along, force = J[:3].T @ normal, push_force(found, int(o), point)
        turning = np.zeros((len(along), len(along)))
        for limb in limbs:
            own = np.ix_(limb.joints, limb.joints)
            turning[own] = gamma(J[:, limb.joints], np.concatenate([force, np.zeros(3)]))
        K = _push_stiffness(found, int(o), point)
        inside = depth < found.distance[o]
        yield (
            J[:3].T @ force,
            J[:3].T @ K @ J[:3] - turning,
            (found.stiffness[o] if inside else 0.0) * np.outer(along, along),
            found.damping[o] * min(depth / found.distance[o], 1.0) * np.outer(along, along),
        )


def _push_stiffness(found: Obstacles, o: int, point: Array) -> Array:
    """Gives -df/dp (3, 3) of an obstacle's push by central differences of fourth order."""
    K = np.empty((3, 3))
    for k, h in enumerate(PUSH_STEP * np.eye(3)):
        f = [push_force(found, o, point + step * h) for step in (-2, -1, 1, 2)]
        K[:, k] = -(f[0] - 8.0 * f[1] + 8.0 * f[2] - f[3]) / (12.0 * PUSH_STEP)
    return K


def pair_stiffness(spring: BetweenSpring, first: Pose, second: Pose, rest: Pose) -> Array:
    """Gives -dw/dx (12, 12) of a spring with its frames at two poses: world axes, first frame then second.

    Derivatives by the first frame are differences; those by the second follow, as a motion of both as one body turns
    both wrenches with it and does nothing else.
    """
    by_first = np.empty((12, 6))
    for k in range(6):
        w = [_wrench(spring, _displaced(first, k, step * STEP), second, rest) for step in (-2, -1, 1, 2)]
        by_first[:, k] = (w[0] - 8.0 * w[1] + 8.0 * w[2] - w[3]) / (12.0 * STEP)
    wrench = _wrench(spring, first, second, rest)
    turned = -np.vstack([skew(wrench[3 * k : 3 * k + 3]) for k in range(4)])
    lever = first.translation - second.translation
    by_turn = turned - by_first[:, 3:] + by_first[:, :3] @ skew(lever)
    return -np.hstack([by_first, -by_first[:, :3], by_turn])


def _displaced(pose: Pose, axis: int, step: float) -> Pose:
    change = np.zeros(6)
    change[axis] = step
    return Pose(exp3(change[3:]) @ pose.rotation, pose.translation + change[:3])


def _wrench(spring: BetweenSpring, first: Pose, second: Pose, rest: Pose) -> Array:
    """Gives the wrenches (12,) of the potential, by the law of the control loop."""
    none = np.zeros((2, 2), dtype=np.int64)
    arms = ArmGeometry(
        rotation=np.array([first.rotation, second.rotation]),
        translation=np.array([first.translation, second.translation]),
        jacobian=np.zeros((2, 6, 0)),
        inverse_inertia=np.zeros((0, 0)),
        bias=np.zeros(0),
        weight=np.zeros(0),
        coupled=none[:, :0],
        moved_by=none,
    )
    places = rest.rotation[None].copy(), rest.translation[None].copy()
    found = lay_out_between([spring], spring.frames, places, np.zeros((1, 0)))
    between_efforts(found, arms, np.zeros(0), 1.0)
    return np.asarray(found.wrench[0].copy())


def joined_arms(modules: TaskModules) -> tuple[tuple[str, ...], ...]:
    """Collects the arms that hang together by springs between them."""
    order = [arm.limb.name for arm in modules.arms]
    groups: list[set[str]] = []
    for spring in modules.between:
        joined = set(spring.limbs)
        touching = [group for group in groups if group & joined]
        groups = [group for group in groups if group not in touching] + [joined.union(*touching)]
    return tuple(tuple(name for name in order if name in group) for group in groups)
