# SPDX-License-Identifier: BSD-3-Clause
r"""Everything one control cycle needs to know about the arms' geometry and inertia.

For a state (q, v) and a fixed list of frames F:

    X_WF         pose in world                       J_WF (6, n)   twist = J_WF v, linear then angular,
    (M + I_r)^-1 mobility of the joints (n, n)                     world axes at F's origin
    C(q, v) v    Coriolis and centrifugal torque (n,), without gravity

Memory is taken once, as a record that the laws of a cycle read: the next ``update`` overwrites its arrays.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from impedance_modules.arrays import Array
from impedance_modules.records import Array3, IndexMatrix, Matrix, Record, Vector
from impedance_modules.robot.model import RobotModel
from impedance_modules.robot.pose import Pose

Indices = NDArray[np.int64]

WORLD_AXES = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED


class ArmGeometry(Record):
    """What the laws of a cycle know of the arms at one state; frames in the order of ``Kinematics.frames``.

    Attributes:
        rotation: (frames, 3, 3) R_WF.
        translation: (frames, 3) origins p_WF [m].
        jacobian: (frames, 6, n) J_WF.
        inverse_inertia: (n, n) (M + I_r)^-1.
        bias: (n,) C(q, v) v [N.m].
        weight: (n,) torque that holds the arms' weight and winds their parallel springs [N.m].
        coupled: (2, n) for each joint the first and one past the last joint that shares its tree: everything
            else in its row of the inverse inertia is zero, always.
        moved_by: (2, frames) likewise the joints that can move each frame: its other columns of J are zero.
    """

    rotation: Array3
    translation: Matrix
    jacobian: Array3
    inverse_inertia: Matrix
    bias: Vector
    weight: Vector
    coupled: IndexMatrix
    moved_by: IndexMatrix


class Kinematics:
    """One cycle's poses, Jacobians, inverse inertia and bias torque.

    Attributes:
        frames: Frame names; the order of the first axis of the arrays below.
        arms: The record that laws read; the arrays below are its own.
        rotation, translation, jacobian, inverse_inertia, bias, coupled, moved_by: See ``ArmGeometry``.
        pin_data: Pinocchio's results of the last update; for robot/ and plant/ only.
    """

    def __init__(self, model: RobotModel, frames: Sequence[str]) -> None:
        self.model = model
        self.frames = tuple(frames)
        self._pin_model = model.pin_model
        self._wound = bool(model.spec.parallel_springs)
        # Coriolis torque alone comes from the same algorithm with gravity switched off.
        self._weightless = pin.Model(model.pin_model)
        self._weightless.gravity.setZero()
        self.pin_data: pin.Data = self._pin_model.createData()
        self._bias_data = self._weightless.createData()
        # Views of pinocchio's own memory, taken once: taking one costs more than a mass matrix row.
        placements = [(model.frame_id(f), self.pin_data.oMf[model.frame_id(f)]) for f in self.frames]
        self._live = [(i, X_WF.rotation, X_WF.translation) for i, X_WF in placements]
        count, n = len(self.frames), model.n
        self.arms = ArmGeometry(
            rotation=np.zeros((count, 3, 3)),
            translation=np.zeros((count, 3)),
            jacobian=np.zeros((count, 6, n)),
            inverse_inertia=np.zeros((n, n)),
            bias=np.zeros(n),
            weight=np.zeros(n),
            coupled=_coupled(model),
            moved_by=_moved_by(model, self.frames),
        )
        self.rotation, self.translation = self.arms.rotation, self.arms.translation
        self.jacobian, self.bias = self.arms.jacobian, self.arms.bias
        self.inverse_inertia = self.arms.inverse_inertia
        self.coupled, self.moved_by = self.arms.coupled, self.arms.moved_by

    def update(self, q: Array, v: Array) -> None:
        """Recomputes everything at positions q [rad] and velocities v [rad/s], both (n,)."""
        model, data = self._pin_model, self.pin_data
        self.arms.weight[:] = pin.computeGeneralizedGravity(model, data, q)
        if self._wound:
            self.arms.weight[:] += self.model.parallel_spring_effort(q)
        pin.computeJointJacobians(model, data, q)
        for slot, (index, rotation, translation) in enumerate(self._live):
            pin.updateFramePlacement(model, data, index)
            # One joint alone comes back as a vector.
            self.jacobian[slot] = pin.getFrameJacobian(model, data, index, WORLD_AXES).reshape(6, -1)
            self.rotation[slot] = rotation
            self.translation[slot] = translation
        self.bias[:] = pin.nonLinearEffects(self._weightless, self._bias_data, q, v)
        self.inverse_inertia[:] = pin.computeMinverse(model, data, q)

    def pose(self, frame: str) -> Pose:
        """Copies X_WF of one of the frames."""
        slot = self.frames.index(frame)
        return Pose(self.rotation[slot].copy(), self.translation[slot].copy())

    def jacobian_of(self, frame: str) -> Array:
        """Returns J_WF (6, n) of one of the frames, as a view."""
        return np.asarray(self.jacobian[self.frames.index(frame)])


def _joints_of_tree(model: RobotModel, joint: int) -> list[int]:
    """Finds the velocity indices of all joints behind the same first joint as ``joint``."""
    pin_model = model.pin_model
    root = pin_model.supports[joint][1]
    return [int(pin_model.idx_vs[i]) for i in pin_model.subtrees[root]]


def _coupled(model: RobotModel) -> Indices:
    found = np.zeros((2, model.n), dtype=np.int64)
    for joint in range(1, model.pin_model.njoints):
        tree = _joints_of_tree(model, joint)
        found[:, int(model.pin_model.idx_vs[joint])] = min(tree), max(tree) + 1
    return found


def _moved_by(model: RobotModel, frames: Sequence[str]) -> Indices:
    found = np.zeros((2, len(frames)), dtype=np.int64)
    for slot, frame in enumerate(frames):
        joint = model.pin_model.frames[model.frame_id(frame)].parentJoint
        if joint > 0:
            tree = _joints_of_tree(model, joint)
            found[:, slot] = min(tree), max(tree) + 1
    return found
