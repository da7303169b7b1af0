# SPDX-License-Identifier: BSD-3-Clause
"""The object in the hands at one state: the sum of the arms, and the system that they make together."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impedance_modules.modules.held_object import HeldObject, carry_weight, squeeze_forces
from impedance_modules.robot.pose import Pose
from impedance_modules.superposition.arm_impedance import ArmImpedance
from impedance_modules.superposition.modes import HeldTogether, JointSpace, hold_together
from impedance_modules.superposition.object_impedance import (
    HandImpedance,
    ObjectImpedance,
    superpose,
    turning_stiffness,
)

Array = NDArray[np.float64]


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
    """

    pose: Pose
    hands: tuple[HandImpedance, ...]
    impedance: ObjectImpedance
    impedance_without_reflected: ObjectImpedance
    joints_singular: bool
    folds: bool
    motion: HeldTogether
    system: JointSpace


def held_impedance(held: HeldObject, arms: Mapping[str, ArmImpedance]) -> HeldImpedance:
    """Sums the holding arms at the object.

    Args:
        held: The object and its grasps.
        arms: Limb name -> its analysis at the same state, for every holding arm.
    """
    holding = [arms[limb] for limb in held.limbs]
    pose = held.pose_from(tuple(arm.pose for arm in holding))
    offsets = np.array([arm.pose.translation - pose.translation for arm in holding])
    own = held.inertia(pose.rotation)
    hands = _hands(held, holding, offsets, with_reflected=True)
    motion = hold_together([arm.jacobian for arm in holding], list(offsets))
    stacked = JointSpace(
        _block([arm.system.inertia for arm in holding]),
        _block([arm.system.stiffness for arm in holding]),
        _block([arm.system.damping for arm in holding]),
    )
    turning = np.sum([turning_stiffness(-hand.wrench[:3], hand.offset) for hand in hands], axis=0)
    summed = superpose(hands, own)
    return HeldImpedance(
        pose=pose,
        hands=hands,
        impedance=summed,
        impedance_without_reflected=superpose(_hands(held, holding, offsets, with_reflected=False), own),
        joints_singular=any(arm.stiffness.stiffness is None and not arm.stiffness.folds for arm in holding),
        folds=any(arm.stiffness.folds_held for arm in holding) or _unstable(summed.stiffness),
        motion=motion,
        system=motion.system(stacked, own, turning),
    )


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


def _block(matrices: list[Array]) -> Array:
    """Stacks matrices along the diagonal."""
    ends = np.cumsum([len(matrix) for matrix in matrices])
    found = np.zeros((ends[-1], ends[-1]))
    for end, matrix in zip(ends, matrices, strict=True):
        place = slice(end - len(matrix), end)
        found[place, place] = matrix
    return found
