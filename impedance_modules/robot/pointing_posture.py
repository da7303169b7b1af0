# SPDX-License-Identifier: BSD-3-Clause
r"""A posture to begin with: the hand at a place, pointing in a direction, far from singular postures and from limits.

Damped Newton steps on e = (p - p_d, z x z_d), z the hand's third axis, from many starts:

    dq = J^T (J J^T + lambda 1)^-1 (-e)

Of the postures that are found the best has a large least singular value of J, joints far from their limits and near
the middle of their ranges, and links high. The hand may turn about the direction that it points in, so that arms with
five joints have one, too.
"""

from __future__ import annotations

import math

import numpy as np
import pinocchio as pin

from impedance_modules.arrays import Array
from impedance_modules.robot.model import Limb, RobotModel

STARTS, STEPS = 60, 80
FRUITLESS = 12
"""Starts after which a search that has found nothing ends."""

LONGEST_STEP = 0.3
"""Of all joints together [rad]."""

DAMPING = 1e-6
ARRIVED = 1e-6
"""[m], [1]."""

HAND_LENGTH = 0.3
"""Turning by an angle counts as much as moving by this length times it [m]."""

ENOUGH = 0.4
"""Distance from a limit beyond which more is no better [rad]."""

HEIGHT, MIDDLE = 1.0, 0.02
"""What a posture gains for the mean height of its joints over the arm's reach, and loses for the mean square of its
joints' distances from the middle of their ranges [1/rad^2]; a least singular value is about 0.1."""

WORST = -1e9
INSIDE = 0.05
"""How far from limits a posture stays [rad]."""


def pointing_posture(model: RobotModel, limb: Limb, place: Array, direction: Array | None) -> Array | None:
    """Finds joint angles of a limb.

    Args:
        model: Of the robot; joints of other limbs where ``RobotModel.position`` puts them.
        limb: The limb.
        place: (3,) where the hand is, in world [m].
        direction: (3,) unit vector along which its third axis points, in world; None for any.

    Returns:
        (k,) angles from the base outwards [rad]; None if no posture was found.
    """
    low, high = (model.column(end)[limb.joints] for end in ("position_min", "position_max"))
    low, high = np.maximum(low + INSIDE, -math.pi), np.minimum(high - INSIDE, math.pi)
    if np.any(low >= high):
        return None
    shoulder = model.joint_place(limb.joint_names[0])
    short = float(np.linalg.norm(place - shoulder)) > model.reach(limb.name)
    if short or len(limb.joints) < (3 if direction is None else 5):
        return None
    search = _Search(model, limb, place, direction)
    random = np.random.default_rng(0)
    best, found = WORST, None
    for start in range(STARTS):
        if start == FRUITLESS and found is None:
            return None
        q = 0.5 * (low + high) if start == 0 else random.uniform(low, high)
        quality, q = search.descend(q, low, high)
        if quality > best:
            best, found = quality, q
    return found


class _Search:
    """One limb, one place, one direction."""

    def __init__(self, model: RobotModel, limb: Limb, place: Array, direction: Array | None) -> None:
        self._model, self._data = model.pin_model, model.pin_model.createData()
        self._frame, self._joints = model.frame_id(limb.hand), limb.joints
        self._q = model.position({})
        self._place, self._direction = place, direction
        self._reach = max(model.reach(limb.name), 1e-3)
        self._tree = [model.pin_model.getJointId(name) for name in limb.joint_names]

    def descend(self, q: Array, low: Array, high: Array) -> tuple[float, Array]:
        """Steps from one start; returns how good the end is, and its angles."""
        for _ in range(STEPS):
            error, jacobian = self._look(q)
            if float(np.linalg.norm(error)) < ARRIVED:
                return self._quality(q, jacobian, low, high), q
            step = jacobian.T @ np.linalg.solve(jacobian @ jacobian.T + DAMPING * np.eye(6), -error)
            length = float(np.linalg.norm(step))
            q = np.clip(q + step * min(1.0, LONGEST_STEP / max(length, 1e-12)), low, high)
        return WORST, q

    def _quality(self, q: Array, jacobian: Array, low: Array, high: Array) -> float:
        """How good a posture is that is there."""
        least = float(np.linalg.svd(jacobian, compute_uv=False)[2 if self._direction is None else 4])
        room = float(np.min(np.minimum(q - low, high - q)))
        heights = [float(self._data.oMi[joint].translation[2]) for joint in self._tree]
        height = (sum(heights) / len(heights) - heights[0]) / self._reach
        middle = float(np.mean((q - 0.5 * (low + high)) ** 2))
        return least * min(room, ENOUGH) / ENOUGH + HEIGHT * height - MIDDLE * middle

    def _look(self, q: Array) -> tuple[Array, Array]:
        """Error (6,) and its Jacobian (6, k), rotations as lengths [m]."""
        self._q[self._joints] = q
        pin.computeJointJacobians(self._model, self._data, self._q)
        X = pin.updateFramePlacement(self._model, self._data, self._frame)
        axes = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        J = pin.getFrameJacobian(self._model, self._data, self._frame, axes).reshape(6, -1)[:, self._joints]
        if self._direction is None:
            nothing = np.zeros((3, self._joints.size))
            return np.concatenate([X.translation - self._place, np.zeros(3)]), np.vstack([J[:3], nothing])
        pointing = X.rotation[:, 2]
        # Turning about the direction itself is no error and is left out of the Jacobian.
        across = np.eye(3) - np.outer(self._direction, self._direction)
        turn = np.cross(self._direction, pointing)
        if float(pointing @ self._direction) < 0.0:
            turn = turn / max(float(np.linalg.norm(turn)), 1e-9)
        error = np.concatenate([X.translation - self._place, HAND_LENGTH * turn])
        return error, np.vstack([J[:3], HAND_LENGTH * across @ J[3:]])
