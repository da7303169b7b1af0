# SPDX-License-Identifier: BSD-3-Clause
r"""What a torque about the hinge of a held object meets: the modules' sum, seen along the one motion that is left.

With S = (a x r, a), the object's twist per unit rate (``modules.hinge``), and the sums \Lambda, B, K at its origin:

    I = S^T \Lambda S = 1 / (j M^-1 j^T)        D = S^T B S        k = S^T K S + turning loads

The loads are the hands' net force and the weight. j is the hinge's rate by the joint motions that grasps and hinge
allow, M their inertia: so I exists at a singular posture, too, where an arm's own part does not. Beside them stands
what the hinge itself adds: damping and the stiffness of its return spring. A torque that changes slowly and that
friction does not hold turns the hinge by torque / (k + that spring's stiffness).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.modules.held_object import HeldObject
from impedance_modules.modules.hinge import Hinge
from impedance_modules.robot.pose import carry
from impedance_modules.spec.hinge_spec import HingeSpec
from impedance_modules.superposition.object_impedance import HandImpedance, HeldImpedance


@dataclass(frozen=True)
class AxisParts:
    """One quantity about the axis: the sum, and what every part adds to it.

    Attributes:
        sum: Of all parts; None where a part does not exist.
        arms: Limb name -> its module's part; None where the hand has none.
        more: What is no arm's: ``object``, its own inertia; ``load``, levers of forces that turn with the hinge.
    """

    sum: float | None
    arms: Mapping[str, float | None]
    more: Mapping[str, float]


@dataclass(frozen=True)
class HingeImpedance:
    """An object's impedance about its hinge.

    Attributes:
        angle: Of the hinge [rad].
        inertia: I [kg.m^2].
        damping: D of the modules [N.m.s/rad].
        stiffness: k of the modules and loads [N.m/rad].
        torque: Of hands and weight about the axis [N.m]: what return spring, friction and stops hold at rest.
        bearing: (3,) force of hands and weight on the bearing, world axes [N].
        own: What the task file says of the hinge itself.
    """

    angle: float
    inertia: AxisParts
    damping: AxisParts
    stiffness: AxisParts
    torque: float
    bearing: Array
    own: HingeSpec


def hinge_impedance(held: HeldObject, found: HeldImpedance, *, hidden: bool) -> HingeImpedance | None:
    """Projects the hands' sum at the object on the motion about its hinge; None without a hinge.

    Args:
        held: The object and its grasps.
        found: The sum at one state.
        hidden: The stiffness is not to be told: an arm folds, or joint springs are singular.
    """
    hinge = held.hinge
    if hinge is None:
        return None
    origin, S = found.pose.translation, hinge.motion(found.pose.translation)
    hands = dict(zip(held.limbs, found.hands, strict=True))
    net = held.bearing_force(found.impedance.wrench)
    own = S @ held.inertia(found.pose.rotation) @ S
    along = {name: carry(hand.offset) @ S for name, hand in hands.items()}
    load = hinge.turning_load(net, origin) + _levers(hands, S)
    inertia = {name: _projected(hand.inertia.inertia, along[name]) for name, hand in hands.items()}
    damping = {name: _projected(hand.damping, along[name]) for name, hand in hands.items()}
    stiffness = {
        name: None if hidden else _projected(hand.stiffness, along[name]) for name, hand in hands.items()
    }
    return HingeImpedance(
        angle=hinge.angle(found.pose),
        inertia=AxisParts(_summed_inertia(hinge, found), inertia, {"object": float(own)}),
        damping=_parts(damping, {}),
        stiffness=_parts(stiffness, {"load": load}),
        torque=hinge.torque(np.concatenate([net, found.impedance.wrench[3:]]), origin),
        bearing=net,
        own=hinge.spec,
    )


def _summed_inertia(hinge: Hinge, held: HeldImpedance) -> float:
    r"""Gives I as 1 / (j M^-1 j^T), j the hinge's rate by the motions that are left; exists where \Lambda does not."""
    rate = hinge.axis @ held.motion.twist[3:]
    return 1.0 / float(rate @ np.linalg.solve(held.system.inertia, rate))


def _levers(hands: Mapping[str, HandImpedance], S: Array) -> float:
    """Gives what the hands' forces add as their levers about the object's origin turn with it [N.m/rad]."""
    turning = sum(
        (np.cross(S[3:], hand.wrench[:3]) @ np.cross(S[3:], hand.offset) for hand in hands.values()), 0.0
    )
    return float(turning)


def _parts(arms: Mapping[str, float | None], more: Mapping[str, float]) -> AxisParts:
    known = [part for part in arms.values() if part is not None]
    total = sum(known) + sum(more.values()) if len(known) == len(arms) else None
    return AxisParts(total, arms, more)


def _projected(matrix: Array | None, along: Array) -> float | None:
    return None if matrix is None else float(along @ matrix @ along)
