# SPDX-License-Identifier: BSD-3-Clause
r"""An object's hinge as the arms measure it: its angle from joint positions, the torque about it from joint efforts.

The first holding hand tells the angle, as it tells the object's axes elsewhere: R_EH = R_WE^T R_WH1 R_H1H, \phi the
angle about z. From the wrenches (f_i, t_i) of the surroundings on the holding hands (``contact_detection``) follows
the torque that the hands exert about the axis a through P:

    \tau = -\sum a . (t_i + (p_i - P) x f_i)

At rest, and about a vertical axis, it is what friction, springs and stops of the hinge hold.
"""

from __future__ import annotations

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.compiled import compiled
from impedance_modules.modules.held_object import HeldObject
from impedance_modules.records import Indices, Matrix, Record, Scalar, Vector
from impedance_modules.robot.kinematics import ArmGeometry
from impedance_modules.robot.rotation import twist_angle


class HingeReading(Record):
    r"""What an object's hinge is measured with, and the last measurement.

    Attributes:
        point: (3,) P in world [m].
        frame: (3, 3) R_WE, z along the axis.
        on_hand: (3, 3) R_H1H of the hinge's frame on the object, in the first hand's axes.
        hands: (hands,) place of each holding hand among the cycle's frames, and its row among the hands' wrenches.
        angle: \phi [rad], between -pi and pi.
        torque: \tau [N.m].
    """

    point: Vector
    frame: Matrix
    on_hand: Matrix
    hands: Indices
    angle: Scalar = 0.0
    torque: Scalar = 0.0


@compiled
def read_hinge(reading: HingeReading, arms: ArmGeometry, wrench: Array) -> None:
    """Measures angle and torque from the arms' geometry and the wrenches (arms, 6) on their hands."""
    frame, hand = reading.frame, arms.rotation[reading.hands[0]]
    relative = np.zeros((3, 3))
    for r in range(2):
        for c in range(2):
            for k in range(3):
                for j in range(3):
                    relative[r, c] += frame[k, r] * hand[k, j] * reading.on_hand[j, c]
    reading.angle = twist_angle(relative)
    torque = 0.0
    for h in range(reading.hands.size):
        force, place = wrench[reading.hands[h]], arms.translation[reading.hands[h]]
        for k in range(3):
            i, j = (k + 1) % 3, (k + 2) % 3
            moment = (place[i] - reading.point[i]) * force[j] - (place[j] - reading.point[j]) * force[i]
            torque -= frame[k, 2] * (force[3 + k] + moment)
    reading.torque = torque


def hinge_reading(held: HeldObject | None, hands: tuple[str, ...]) -> HingeReading | None:
    """Lays out the hinge of a held object; None without one.

    Args:
        held: The object.
        hands: Hand frames of all arms; they come first among the cycle's frames.
    """
    if held is None or held.hinge is None:
        return None
    return HingeReading(
        point=np.ascontiguousarray(held.hinge.point),
        frame=np.ascontiguousarray(held.hinge.frame.rotation),
        on_hand=np.ascontiguousarray(held.grasps[0].rotation.T @ held.hinge.on_object.rotation),
        hands=np.array([hands.index(hand) for hand in held.hands], dtype=np.int64),
    )
