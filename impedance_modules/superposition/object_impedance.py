# SPDX-License-Identifier: BSD-3-Clause
r"""Superposition: the impedance of an object is the sum of its hands' impedances, carried to its origin.

With X_i = ``carry(r_i)``, r_i from the object's origin O to hand i, everything in world axes:

    \Lambda = \Lambda_obj + \sum X_i^T \Lambda_i X_i        B = \sum X_i^T B_i X_i        W = \sum X_i^T w_i
    K = \sum X_i^T K_i X_i + \sum diag(0, [f_i]x [r_i]x)

No closed chain is ever written down. Where an arm is singular its inertia does not exist; the mobilities
are then joined by the parallel sum. f_i is the force that the object puts on hand i, minus the hand's,
squeeze and carried weight apart (see ``shared``): as the object turns, its lever arm turns with it.
``held_impedance`` does this for the arms of a task, beside the system that arms and object make together.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import reduce

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.modules.held_object import HeldObject, carry_weight, share_wrench, squeeze_forces
from impedance_modules.modules.mobility import parallel_sum
from impedance_modules.robot.model import Limb
from impedance_modules.robot.pose import Pose, carry
from impedance_modules.robot.rotation import skew
from impedance_modules.superposition.arm_impedance import ArmImpedance
from impedance_modules.superposition.coupled_arms import CouplingAtObject, JointCoupling, coupling_at_object
from impedance_modules.superposition.modes import HeldTogether, JointSpace, block_diagonal, hold_together
from impedance_modules.superposition.operational_inertia import (
    OperationalInertia,
    carry_inertia,
    from_mobility,
)


@dataclass(frozen=True)
class HandImpedance:
    """One impedance module as its hand offers it to the object; world axes, at the hand.

    Attributes:
        offset: (3,) r_i from the object's origin to the hand [m].
        inertia: Of the arm, with reflected inertia.
        damping: (6, 6) B_i; None where it does not exist.
        stiffness: (6, 6) K_i, ``NetStiffness.at_hand``; None where it does not exist.
        wrench: (6,) on the object by the module, without what is shared [N, N.m].
        shared: (6,) the hand's share of squeeze and carried weight [N, N.m]. Shares follow the hands so
            that their sum at the object stays what it is: it adds to the wrench, not to the stiffness.
    """

    offset: Array
    inertia: OperationalInertia
    damping: Array | None
    stiffness: Array | None
    wrench: Array
    shared: Array


@dataclass(frozen=True)
class ObjectImpedance:
    """What a push on the object meets; world axes, at the object's origin.

    Attributes:
        inertia: Of the object and both arms.
        damping: (6, 6) B; None where a hand has none.
        stiffness: (6, 6) K as it is: symmetric only without a net moment; None where a hand has none.
        wrench: (6,) W, sum of what the modules exert [N, N.m].
        internal: (h, 6) what the hands exert against each other, at each hand; sums to zero at O.
    """

    inertia: OperationalInertia
    damping: Array | None
    stiffness: Array | None
    wrench: Array
    internal: Array


def superpose(hands: Sequence[HandImpedance], object_inertia: Array | None) -> ObjectImpedance:
    """Sums the hands' impedances at the object's origin.

    Args:
        hands: At least one.
        object_inertia: (6, 6) Lambda_obj at O, world axes; None for an object without mass.
    """
    net = np.sum([carry(hand.offset).T @ (hand.wrench + hand.shared) for hand in hands], axis=0)
    return ObjectImpedance(
        inertia=superpose_inertia([hand.inertia.carried(hand.offset) for hand in hands], object_inertia),
        damping=_sum([_carried(hand.damping, hand.offset) for hand in hands]),
        stiffness=_sum([_carried_stiffness(hand) for hand in hands]),
        wrench=net,
        internal=internal_wrenches(hands, net),
    )


def superpose_inertia(
    at_object: Sequence[OperationalInertia], object_inertia: Array | None
) -> OperationalInertia:
    """Adds inertias at one point, or joins mobilities where an inertia does not exist."""
    inertias = [found.inertia for found in at_object]
    total = _sum([*inertias, *([] if object_inertia is None else [object_inertia])])
    if total is not None:
        inverse = np.linalg.inv(total)
        return OperationalInertia(0.5 * (total + total.T), 0.5 * (inverse + inverse.T))
    mobilities = [found.mobility for found in at_object]
    if object_inertia is not None:
        mobilities.append(np.asarray(np.linalg.inv(object_inertia)))
    return from_mobility(reduce(parallel_sum, mobilities))


def lever_arm_stiffness(force_on_hand: Array, offset: Array) -> Array:
    """Gives diag(0, [f]x [r]x), (6, 6): a force whose lever arm turns with the object resists or helps.

    Args:
        force_on_hand: (3,) f_i that the object puts on the hand [N].
        offset: (3,) r_i from O to the hand [m].
    """
    found = np.zeros((6, 6))
    found[3:, 3:] = skew(force_on_hand) @ skew(offset)
    return found


def internal_wrenches(hands: Sequence[HandImpedance], net: Array) -> Array:
    """Splits off what moves the object: each hand's wrench minus its least-effort share of the sum.

    Returns:
        (h, 6) at each hand, squeeze included; carried to the object they sum to zero.
    """
    exerted = np.array([hand.wrench + hand.shared for hand in hands])
    return exerted - share_wrench(np.array([hand.offset for hand in hands]), net)


def squeeze_force(hands: Sequence[HandImpedance], internal: Array) -> float:
    """Measures how hard the hands press: the mean of their internal forces towards the origin [N]."""
    presses = [
        -float(wrench[:3] @ hand.offset) / float(np.linalg.norm(hand.offset))
        for hand, wrench in zip(hands, internal, strict=True)
        if np.any(hand.offset)
    ]
    return float(np.mean(presses)) if presses else 0.0


def _carried_stiffness(hand: HandImpedance) -> Array | None:
    carried = _carried(hand.stiffness, hand.offset)
    return None if carried is None else carried + lever_arm_stiffness(-hand.wrench[:3], hand.offset)


def _carried(matrix: Array | None, offset: Array) -> Array | None:
    return None if matrix is None else carry_inertia(matrix, offset)


def _sum(matrices: Sequence[Array | None]) -> Array | None:
    """Adds; a sum with a missing part is missing."""
    present = [matrix for matrix in matrices if matrix is not None]
    if len(present) < len(matrices):
        return None
    return np.asarray(np.sum(present, axis=0))


@dataclass(frozen=True)
class HeldImpedance:
    """What a push on the held object meets, and how arms and object vibrate.

    Attributes:
        pose: X_WO.
        hands: Each arm's contribution, in the order of ``HeldObject.limbs``.
        impedance: Their sum at the object's origin; its stiffness is what the statics give, stable or not.
        impedance_without_reflected: The same with the links' inertia alone.
        joints_singular: Some arm's joint springs are singular: ``stiffness`` is not to be printed.
        folds: The object's stiffness is not positive semidefinite, or an arm folds though its hand is held.
        motion: Joint motions that keep all grasps.
        system: Arms and object seen in them.
        coupling: What springs between the hands add to the single arms' sum; None without any.
    """

    pose: Pose
    hands: tuple[HandImpedance, ...]
    impedance: ObjectImpedance
    impedance_without_reflected: ObjectImpedance
    joints_singular: bool
    folds: bool
    motion: HeldTogether
    system: JointSpace
    coupling: CouplingAtObject | None = None


def held_impedance(
    held: HeldObject,
    arms: Mapping[str, ArmImpedance],
    between: tuple[JointCoupling, Sequence[Limb]] | None = None,
) -> HeldImpedance:
    """Sums the holding arms at the object.

    Args:
        held: The object and its grasps.
        arms: Limb name -> its analysis at the same state, for every holding arm.
        between: Springs between arms, and the holding limbs; None without any.
    """
    holding = [arms[limb] for limb in held.limbs]
    pose = held.pose_from(tuple(arm.pose for arm in holding))
    offsets = np.array([arm.pose.translation - pose.translation for arm in holding])
    own = held.inertia(pose.rotation)
    hands = _hands(held, holding, offsets, with_reflected=True)
    bearing = None if held.hinge is None else held.hinge.bearing(pose.translation)
    motion = hold_together([arm.jacobian for arm in holding], list(offsets), bearing)
    stacked = JointSpace(
        block_diagonal([arm.system.inertia for arm in holding]),
        block_diagonal([arm.system.stiffness for arm in holding]),
        block_diagonal([arm.system.damping for arm in holding]),
    )
    turning = np.sum([lever_arm_stiffness(-hand.wrench[:3], hand.offset) for hand in hands], axis=0)
    summed, coupling = superpose(hands, own), None
    if between is not None:
        coupling = coupling_at_object(*between, holding, list(offsets))
        summed, stacked = _coupled(summed, coupling), _coupled_joints(stacked, coupling)
    turning = turning + bearing_turns(held, summed.wrench, pose.translation)
    return HeldImpedance(
        pose=pose,
        hands=hands,
        impedance=summed,
        impedance_without_reflected=superpose(_hands(held, holding, offsets, with_reflected=False), own),
        joints_singular=any(arm.stiffness.stiffness is None and not arm.stiffness.folds for arm in holding),
        folds=any(arm.stiffness.folds_held for arm in holding) or _unstable(_left_free(held, summed, pose)),
        motion=motion,
        system=motion.system(stacked, own, turning),
        coupling=coupling,
    )


def _coupled(found: ObjectImpedance, coupling: CouplingAtObject) -> ObjectImpedance:
    """Adds what springs between the hands add at the object."""
    return replace(
        found,
        stiffness=_sum([found.stiffness, coupling.stiffness]),
        damping=_sum([found.damping, coupling.damping]),
    )


def _coupled_joints(stacked: JointSpace, coupling: CouplingAtObject) -> JointSpace:
    return JointSpace(
        stacked.inertia,
        stacked.stiffness + coupling.joint_stiffness,
        stacked.damping + coupling.joint_damping,
    )


def bearing_turns(held: HeldObject, wrench: Array, origin: Array) -> Array:
    """Gives the stiffness (6, 6) by the force on a hinge's bearing, whose lever turns with the object; else zero.

    Args:
        held: The object.
        wrench: (6,) of the hands on it at its origin, world axes [N], [N.m].
        origin: (3,) of the object in world [m].
    """
    if held.hinge is None:
        return np.zeros((6, 6))
    return lever_arm_stiffness(held.bearing_force(wrench), held.hinge.point - origin)


def _left_free(held: HeldObject, found: ObjectImpedance, pose: Pose) -> Array | None:
    """Gives the object's stiffness in the motions that it has: all six, or the one about its hinge."""
    if held.hinge is None or found.stiffness is None:
        return found.stiffness
    S = held.hinge.motion(pose.translation)
    whole = found.stiffness + bearing_turns(held, found.wrench, pose.translation)
    return np.array([[S @ whole @ S]])


def _hands(
    held: HeldObject, holding: list[ArmImpedance], offsets: Array, *, with_reflected: bool
) -> tuple[HandImpedance, ...]:
    """Gathers what each hand offers; on the object a hand exerts what its joint springs do not carry."""
    shared = np.zeros((len(holding), 6))
    if held.spec.squeeze > 0.0:
        shared[:, :3] += squeeze_forces(offsets, held.spec.squeeze)
    if held.spec.carry_weight:
        shared += carry_weight(offsets, held.spec.mass)
    return tuple(
        HandImpedance(
            offset=offsets[index],
            inertia=arm.inertia if with_reflected else arm.inertia_without_reflected,
            damping=arm.damping,
            stiffness=arm.stiffness.at_hand,
            wrench=arm.wrench - arm.preload,
            shared=shared[index],
        )
        for index, arm in enumerate(holding)
    )


def _unstable(stiffness: Array | None) -> bool:
    if stiffness is None:
        return False
    values = np.linalg.eigvalsh(0.5 * (stiffness + stiffness.T))
    return bool(values[0] < -1e-9 * np.max(np.abs(values)))
