# SPDX-License-Identifier: BSD-3-Clause
r"""How hard a hand presses on a table, at rest: springs at the hand and at the joints, without friction.

At rest the energy

    U(q) = 1/2 sum_i k_i (q_i - r_i)^2 + 1/2 (p - x_d)^T K_end (p - x_d) + 1/2 k_s d^2 + 1/2 k_r |log(R R_0^T)|^2

is least: r where the joint springs rest, x_d where the spring at the hand does, d how deep the hand's point p is in a
table of stiffness k_s. The last term, present where the hand lies flat on the table, keeps its orientation R_0. The
table bears F = k_s d. Every term is a square, so that least squares find the minimum (Levenberg and Marquardt).

With everything linear about the posture on the table, and joint springs that rest with the hand as deep as the spring
at the hand does, this is F = K_zz D of eq. 4.15 (eq. 4.24 with relaxed joint springs): what ``net_force`` gives.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from impedance_modules.arrays import Array
from impedance_modules.robot.kinematics import Kinematics
from impedance_modules.robot.model import Limb, RobotModel
from impedance_modules.robot.pose import Pose
from impedance_modules.robot.rotation import log3
from impedance_modules.superposition.net_stiffness import net_stiffness

TABLE = 2e4
"""Stiffness of the table, that of ``slide-flat`` [N/m]."""
FLAT = 1e3
"""Stiffness with which a table keeps the orientation of a hand that lies flat on it [N.m/rad]."""
PLACE_WEIGHT, TURN_WEIGHT, POSTURE_WEIGHT = 100.0, 30.0, 1e-2
"""Of a posture that is looked for: place [1/m], orientation [1/rad], and nearness to a posture [1/rad]."""
Z = 2


@dataclass(frozen=True)
class Pressed:
    """A hand at rest on a table.

    Attributes:
        force: That the table bears [N].
        q: (k,) the arm's joints [rad].
    """

    force: float
    q: Array


class PressingArm:
    """An arm that presses down: its kinematics and springs.

    Attributes:
        joint_stiffness: (k,) [N.m/rad].
        end_stiffness: (3, 3) of the spring at the hand, world axes [N/m].
    """

    def __init__(self, model: RobotModel, limb: Limb, joint_stiffness: Array, end_stiffness: Array) -> None:
        self.joint_stiffness, self.end_stiffness = joint_stiffness, end_stiffness
        self._kinematics = Kinematics(model, (limb.hand,))
        self._limb, self._whole = limb, np.zeros(model.n)
        self._low = model.column("position_min")[limb.joints]
        self._high = model.column("position_max")[limb.joints]

    def look(self, q: Array) -> tuple[Pose, Array]:
        """Gives the hand's pose and its Jacobian (6, k), world axes, at q (k,) [rad]."""
        self._whole[self._limb.joints] = q
        self._kinematics.update(self._whole, np.zeros_like(self._whole))
        hand = self._limb.hand
        return self._kinematics.pose(hand), self._kinematics.jacobian_of(hand)[:, self._limb.joints].copy()

    def posture_at(self, place: Array, near: Array, rotation: Array | None) -> Array:
        """Finds the posture (k,) nearest to another one, within the joints' limits, with the hand at a place.

        Args:
            place: (3,) [m]. Out of reach it is approached as near as the weights have it.
            near: (k,) [rad].
            rotation: (3, 3) of the hand; None lets it turn.
        """

        def miss(q: Array) -> Array:
            pose, _ = self.look(q)
            turned = np.zeros(0) if rotation is None else TURN_WEIGHT * log3(pose.rotation @ rotation.T)
            return np.concatenate(
                [PLACE_WEIGHT * (pose.translation - place), turned, POSTURE_WEIGHT * (q - near)]
            )

        start = np.clip(near, self._low + 1e-6, self._high - 1e-6)
        found = least_squares(miss, start, bounds=(self._low, self._high), xtol=1e-10, ftol=1e-10)
        return np.asarray(found.x)

    def press(self, rest: Array, goal: Array, table: float, start: Array, *, flat: bool) -> Pressed:
        """Finds the rest of the hand on a table.

        Args:
            rest: (k,) where the joint springs are at rest [rad].
            goal: (3,) where the spring at the hand is [m].
            table: Its height [m].
            start: (k,) with the hand on the table [rad]; where it lies flat, its orientation is kept.
            flat: Whether the hand lies flat on the table; otherwise it touches with a point and may turn.
        """
        kept = self.look(start)[0].rotation
        joint, end = np.sqrt(self.joint_stiffness), np.linalg.cholesky(self.end_stiffness).T

        def parts(q: Array) -> Array:
            pose, _ = self.look(q)
            depth = max(0.0, table - float(pose.translation[Z]))
            turned = np.sqrt(FLAT) * log3(pose.rotation @ kept.T) if flat else np.zeros(0)
            spring = end @ (pose.translation - goal)
            return np.concatenate([joint * (q - rest), spring, [np.sqrt(TABLE) * depth], turned])

        found = least_squares(parts, start, xtol=1e-12, ftol=1e-12, gtol=1e-12, x_scale="jac")
        depth = max(0.0, table - float(self.look(found.x)[0].translation[Z]))
        return Pressed(TABLE * depth, np.asarray(found.x))

    def net_stiffness(self, q: Array) -> Array:
        """Computes eq. 4.15 (6, 6), world axes at the hand, at q (k,) [rad]; nan where the posture is singular."""
        end = np.zeros((6, 6))
        end[:3, :3] = self.end_stiffness
        net = net_stiffness(self.look(q)[1], self.joint_stiffness, end, np.zeros(6)).at_hand
        return np.full((6, 6), np.nan) if net is None else net

    def net_force(self, q: Array, depth: float) -> float:
        """Gives K_zz D of eq. 4.15, the hand's orientation and its place on the table kept [N].

        Args:
            q: (k,) with the hand on the table [rad].
            depth: D, of the equilibrium under the table [m].
        """
        return float(self.net_stiffness(q)[Z, Z]) * depth
