# SPDX-License-Identifier: BSD-3-Clause
r"""Superposition: the impedance of an object is the sum of its hands' impedances, carried to its origin.

With X_i = ``carry(r_i)``, r_i from the object's origin O to hand i, everything in world axes:

    \Lambda = \Lambda_obj + \sum X_i^T \Lambda_i X_i        B = \sum X_i^T B_i X_i        W = \sum X_i^T w_i
    K = \sum X_i^T K_i X_i + \sum diag(0, [f_i]x [r_i]x)

No closed chain is ever written down. Where an arm is singular its inertia does not exist; the mobilities
are then joined by the parallel sum. f_i is the force that the object puts on hand i, minus the hand's,
squeeze and carried weight apart (see ``shared``): as the object turns, its lever arm turns with it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce

import numpy as np
from numpy.typing import NDArray

from impedance_modules.modules.held_object import share_wrench
from impedance_modules.modules.mobility import parallel_sum
from impedance_modules.robot.pose import carry
from impedance_modules.robot.rotation import skew
from impedance_modules.superposition.operational_inertia import OperationalInertia, carry_inertia, from_mobility

Array = NDArray[np.float64]


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


def turning_stiffness(force_on_hand: Array, offset: Array) -> Array:
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
    return None if carried is None else carried + turning_stiffness(-hand.wrench[:3], hand.offset)


def _carried(matrix: Array | None, offset: Array) -> Array | None:
    return None if matrix is None else carry_inertia(matrix, offset)


def _sum(matrices: Sequence[Array | None]) -> Array | None:
    """Adds; a sum with a missing part is missing."""
    present = [matrix for matrix in matrices if matrix is not None]
    if len(present) < len(matrices):
        return None
    return np.asarray(np.sum(present, axis=0))
