# SPDX-License-Identifier: BSD-3-Clause
r"""What adds up at a held object, part by part: the thesis's eq. 4.30 with every term, the load's too.

With X_i = ``carry(r_i)`` from the object's origin O to hand i, everything in world axes at O:

    \Lambda = \Lambda_obj + \sum X_i^T \Lambda_i X_i        B = \sum X_i^T B_i X_i
    K = \sum X_i^T K_i X_i + \sum diag(0, [f_i]x [r_i]x)
    W = \sum X_i^T w_i,        w_i = share of W + internal wrench of hand i

The last term of K is the load's: the force f_i that the object puts on hand i keeps its direction while its lever arm
r_i turns with the object. Arms that mirror each other in a plane cancel each other's coupling of motions in that plane
with motions across it; what is left in the sum is told as a share of its largest entry.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.robot.pose import carry
from impedance_modules.spec.task_draft import twist_signs
from impedance_modules.superposition.arm_impedance import ArmImpedance
from impedance_modules.superposition.object_impedance import (
    HandImpedance,
    HeldImpedance,
    lever_arm_stiffness,
    squeeze_force,
)
from impedance_modules.superposition.operational_inertia import carry_inertia


@dataclass(frozen=True)
class Summands:
    """The parts of one matrix of the object, each (6, 6) in world axes at the object's origin.

    Attributes:
        arms: Limb name -> X_i^T A_i X_i; None where the hand has no such matrix.
        more: What is no arm's: ``object``, the inertia of the object itself, ``load``, the stiffness by the forces in
            the grasps, or ``between``, what springs between the hands add; None where it is not to be told.
    """

    arms: Mapping[str, Array | None]
    more: Mapping[str, Array | None]


@dataclass(frozen=True)
class Coupling:
    """Largest entry that couples motions in the mirror plane with motions across it, over the largest of all.

    Attributes:
        arms: Limb name -> of its summand; None where there is none.
        sum: Of the sum; None likewise.
    """

    arms: Mapping[str, float | None]
    sum: float | None


@dataclass(frozen=True)
class ObjectSum:
    """How the hands' impedances and wrenches make the object's.

    Attributes:
        hands: Limb name -> its hand's impedance, and where it is from the object's origin.
        own: (6, 6) inertia of the object itself at its origin, world axes.
        summands: ``inertia``, ``inertia_without_reflected``, ``damping``, ``stiffness`` -> its parts.
        squeeze: Mean force with which the hands press towards the object's origin [N].
        internal: Limb name -> (6,) what its hand exerts against the others, at the hand [N, N.m]; carried to the
            object's origin these sum to zero.
        plane: Mirror plane of the robot; None where it has none.
        coupling: ``inertia``, ``stiffness`` -> across that plane; empty without one.
    """

    hands: Mapping[str, HandImpedance]
    own: Array
    summands: Mapping[str, Summands]
    squeeze: float
    internal: Mapping[str, Array]
    plane: str | None
    coupling: Mapping[str, Coupling]


def sum_at_object(
    limbs: Sequence[str],
    arms: Mapping[str, ArmImpedance],
    held: HeldImpedance,
    own: Array,
    *,
    plane: str | None,
    stiffness: Array | None,
) -> ObjectSum:
    """Lists everything that adds up at the object.

    Args:
        limbs: The holding arms, in the order of ``held.hands``.
        arms: Limb name -> its analysis.
        held: Their sum at the same state.
        own: (6, 6) inertia of the object itself at its origin, world axes.
        plane: Mirror plane of the robot, ``xy``, ``xz`` or ``yz``.
        stiffness: (6, 6) of the object; None where it is not to be told, and its parts neither.
    """
    hands = dict(zip(limbs, held.hands, strict=True))
    bare = {name: arms[name].inertia_without_reflected.inertia for name in limbs}
    summands = {
        "inertia": _parts(hands, {name: hand.inertia.inertia for name, hand in hands.items()}, object=own),
        "inertia_without_reflected": _parts(hands, bare, object=own),
        "damping": _parts(hands, {name: hand.damping for name, hand in hands.items()}),
        "stiffness": _stiffness_parts(hands, hidden=stiffness is None),
    }
    if held.coupling is not None:
        between = {"damping": held.coupling.damping, "stiffness": held.coupling.stiffness}
        for name, part in between.items():
            told = None if name == "stiffness" and stiffness is None else part
            summands[name] = replace(summands[name], more={**summands[name].more, "between": told})
    totals = {"inertia": held.impedance.inertia.inertia, "stiffness": stiffness}
    return ObjectSum(
        hands=hands,
        own=own,
        summands=summands,
        squeeze=squeeze_force(held.hands, held.impedance.internal),
        internal=dict(zip(limbs, held.impedance.internal, strict=True)),
        plane=plane,
        coupling={}
        if plane is None
        else {name: _coupling(summands[name], total, plane) for name, total in totals.items()},
    )


def _parts(
    hands: Mapping[str, HandImpedance], matrices: Mapping[str, Array | None], **more: Array
) -> Summands:
    """Carries every hand's matrix to the object's origin."""
    carried = {
        name: None if matrix is None else carry_inertia(matrix, hands[name].offset)
        for name, matrix in matrices.items()
    }
    return Summands(carried, more)


def _stiffness_parts(hands: Mapping[str, HandImpedance], *, hidden: bool) -> Summands:
    """Lists the arms' stiffness and the load's; nothing where the sum is not to be told."""
    if hidden:
        return Summands(dict.fromkeys(hands), {"load": None})
    turning = np.sum([lever_arm_stiffness(-hand.wrench[:3], hand.offset) for hand in hands.values()], axis=0)
    return _parts(hands, {name: hand.stiffness for name, hand in hands.items()}, load=turning)


def _coupling(parts: Summands, total: Array | None, plane: str) -> Coupling:
    return Coupling({name: _across(part, plane) for name, part in parts.arms.items()}, _across(total, plane))


def _across(matrix: Array | None, plane: str) -> float | None:
    """Gives the largest entry that couples motions in a plane with motions across it, as a share of the largest."""
    if matrix is None:
        return None
    signs = twist_signs(plane)
    odd = 0.5 * (matrix - signs[:, None] * matrix * signs)
    return float(np.max(np.abs(odd)) / np.max(np.abs(matrix)))


def carried_preload(arms: Sequence[ArmImpedance], origin: Array) -> Array:
    r"""Sums what the joint springs of several arms carry at a common point, \sum X_i^T F_b,i, (6,) [N, N.m].

    Args:
        arms: At one state.
        origin: (3,) of that point in world [m].
    """
    parts = [carry(arm.pose.translation - origin).T @ arm.preload for arm in arms]
    return np.asarray(np.sum(parts, axis=0))
