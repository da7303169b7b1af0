# SPDX-License-Identifier: BSD-3-Clause
"""Postures of one arm with its hand in one place: the elbow wanders, the hand does not."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impedance_modules.robot.kinematics import Kinematics
from impedance_modules.robot.model import Limb, RobotModel
from impedance_modules.robot.pose import Pose
from impedance_modules.robot.rotation import log3

Array = NDArray[np.float64]

SELF_MOTION_STEP = 0.02
"""Joint-space length of a step [rad]."""

FARTHEST = 4.0
"""Joint-space length at which a self-motion is given up [rad]."""

LIMIT_DISTANCE = 0.05
"""Distance kept from the joints' limits [rad]."""

CORRECTIONS = 4
HAND_TOLERANCE = 1e-8
"""Of the hand, m and rad, after the corrections."""


@dataclass(frozen=True)
class Posture:
    """One posture of the self-motion.

    Attributes:
        along: Way along the self-motion from the task's posture, in joint space [rad].
        q: (n,) all joints [rad].
    """

    along: float
    q: Array


def self_motion(model: RobotModel, limb: Limb, q: Array, count: int) -> tuple[Posture, ...]:
    """Lists postures with the hand where it is at q, spread evenly between the joints' limits.

    An arm of six joints or fewer has none but its own.

    Args:
        model: The robot.
        limb: The arm.
        q: (n,) posture to begin at; it is always among them.
        count: How many at most.
    """
    if count == 1 or limb.joints.size <= 6:
        return (Posture(0.0, q),)
    follower = _Follower(model, limb, q)
    path = [*reversed(follower.walk(-1.0)), Posture(0.0, q), *follower.walk(1.0)]
    wanted = np.linspace(path[0].along, path[-1].along, count - 1)
    nearest = [min(path, key=lambda posture, w=w: abs(posture.along - w)) for w in wanted]  # type: ignore[misc]
    found = {posture.along: posture for posture in [*nearest, Posture(0.0, q)]}
    return tuple(found[along] for along in sorted(found))


class _Follower:
    """Walks along the null space of the hand's Jacobian."""

    def __init__(self, model: RobotModel, limb: Limb, q: Array) -> None:
        self._kinematics = Kinematics(model, (limb.hand,))
        self._limb, self._start = limb, q
        self._still = np.zeros(model.n)
        self._low = model.column("position_min")[limb.joints] + LIMIT_DISTANCE
        self._high = model.column("position_max")[limb.joints] - LIMIT_DISTANCE
        self._goal = self._look(q)[0]

    def _look(self, q: Array) -> tuple[Pose, Array]:
        self._kinematics.update(q, self._still)
        hand = self._limb.hand
        pose = self._kinematics.pose(hand)
        kept = Pose(pose.rotation.copy(), pose.translation.copy())
        return kept, self._kinematics.jacobian_of(hand)[:, self._limb.joints].copy()

    def walk(self, sign: float) -> list[Posture]:
        """Steps one way until a joint's limit, a singular posture, or far enough."""
        q, along, found = self._start.copy(), 0.0, list[Posture]()
        direction = sign * _null(self._look(q)[1])
        while along < FARTHEST:
            ahead = _null(self._look(q)[1])
            direction = ahead if ahead @ direction > 0.0 else -ahead
            q = self._corrected(q, direction)
            here = q[self._limb.joints]
            missed, _ = self._miss(q)
            if np.abs(missed).max() > HAND_TOLERANCE or np.any(here < self._low) or np.any(here > self._high):
                break
            along += SELF_MOTION_STEP
            found.append(Posture(sign * along, q.copy()))
        return found

    def _corrected(self, q: Array, direction: Array) -> Array:
        q = q.copy()
        q[self._limb.joints] += SELF_MOTION_STEP * direction
        for _ in range(CORRECTIONS):
            missed, J = self._miss(q)
            q[self._limb.joints] += np.linalg.pinv(J) @ missed
        return q

    def _miss(self, q: Array) -> tuple[Array, Array]:
        pose, J = self._look(q)
        turn = log3(self._goal.rotation @ pose.rotation.T)
        return np.concatenate([self._goal.translation - pose.translation, turn]), J


def _null(jacobian: Array) -> Array:
    """Gives the joint direction (k,) that moves the hand least, of length 1."""
    return np.asarray(np.linalg.svd(jacobian)[2][-1])
