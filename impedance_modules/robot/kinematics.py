# SPDX-License-Identifier: BSD-3-Clause
r"""Everything one control cycle needs to know about the arms' geometry and inertia.

For a state (q, v) and a fixed list of frames F:

    X_WF         pose in world                       J_WF (6, n)   twist = J_WF v, linear then angular,
    (M + I_r)^-1 mobility of the joints (n, n)                     world axes at F's origin
    C(q, v) v    Coriolis and centrifugal torque (n,), without gravity

Memory is taken once. The arrays are live: the next ``update`` overwrites them.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from impedance_modules.robot.model import RobotModel
from impedance_modules.robot.pose import Pose

Array = NDArray[np.float64]

WORLD_AXES = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED


class Kinematics:
    """One cycle's poses, Jacobians, inverse inertia and bias torque.

    Attributes:
        frames: Frame names, in the order of the lists below.
        rotation: Live (3, 3) rotations R_WF.
        translation: Live (3,) origins p_WF [m].
        jacobian: (6, n) Jacobians J_WF.
        inverse_inertia: (n, n) (M + I_r)^-1.
        bias: (n,) C(q, v) v [N.m].
    """

    def __init__(self, model: RobotModel, frames: Sequence[str]) -> None:
        self.model = model
        self.frames = tuple(frames)
        self._pin_model = model.pin_model
        # Coriolis torque alone comes from the same algorithm with gravity switched off.
        self._weightless = pin.Model(model.pin_model)
        self._weightless.gravity.setZero()
        self._data = self._pin_model.createData()
        self._bias_data = self._weightless.createData()
        self._ids = tuple(model.frame_id(frame) for frame in self.frames)
        placements = [self._data.oMf[index] for index in self._ids]
        self.rotation: list[Array] = [placement.rotation for placement in placements]
        self.translation: list[Array] = [placement.translation for placement in placements]
        n = model.n
        self.jacobian: list[Array] = [np.zeros((6, n), order="F") for _ in self.frames]
        self.inverse_inertia: Array = np.zeros((n, n), order="F")
        self.bias: Array = np.zeros(n)

    def update(self, q: Array, v: Array) -> None:
        """Recomputes everything at positions q [rad] and velocities v [rad/s], both (n,)."""
        model, data = self._pin_model, self._data
        pin.computeJointJacobians(model, data, q)
        for slot, index in enumerate(self._ids):
            pin.updateFramePlacement(model, data, index)
            self.jacobian[slot] = pin.getFrameJacobian(model, data, index, WORLD_AXES)
        self.bias = pin.nonLinearEffects(self._weightless, self._bias_data, q, v)
        self.inverse_inertia = pin.computeMinverse(model, data, q)

    def pose(self, frame: str) -> Pose:
        """Copies X_WF of one of the frames."""
        slot = self.frames.index(frame)
        return Pose(self.rotation[slot].copy(), self.translation[slot].copy())

    def jacobian_of(self, frame: str) -> Array:
        """Returns J_WF (6, n) of one of the frames."""
        return self.jacobian[self.frames.index(frame)]
