# SPDX-License-Identifier: BSD-3-Clause
"""Second opinion: two arms on one object as a closed chain, by pinocchio's constrained dynamics."""

import numpy as np
import pinocchio as pin

from impedance_modules.robot.model import RobotModel
from tests.support.arm_samples import Array


class ClosedChain:
    """A robot and a free object whose placement is welded to both hands."""

    def __init__(self, model: RobotModel, hands: tuple[str, ...]) -> None:
        self.model = pin.Model(model.pin_model)
        self.model.gravity.setZero()
        self.n = model.n
        self.frames = [model.frame_id(hand) for hand in hands]
        self.object = self.model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "object")

    def acceleration_per_wrench(self, q: Array, origin: Array, rotation: Array, body: Array) -> Array:
        """Accelerations (6, 6) of the object from rest, world axes, one column per unit wrench at O.

        Args:
            q: (n,) of the robot.
            origin, rotation: X_WO.
            body: Mass, and (3, 3) inertia about O in object axes.
        """
        mass, moments = body
        self.model.inertias[self.object] = pin.Inertia(mass, np.zeros(3), moments)
        welds = pin.StdVec_RigidConstraintModel()
        state = np.concatenate([q, origin, pin.Quaternion(rotation).coeffs()])
        data = self.model.createData()
        pin.framesForwardKinematics(self.model, data, state)
        for index in self.frames:
            frame, ends = self.model.frames[index], pin.ReferenceFrame.LOCAL
            grasp = data.oMi[self.object].actInv(data.oMf[index])
            hand = (frame.parentJoint, frame.placement)
            welds.append(
                pin.RigidConstraintModel(
                    pin.ContactType.CONTACT_6D, self.model, *hand, self.object, grasp, ends
                )
            )
        parts = pin.StdVec_RigidConstraintData()
        parts.extend([weld.createData() for weld in welds])
        pin.initConstraintDynamics(self.model, data, welds, parts)
        settings = pin.ProximalSettings(1e-14, 1e-14, 0.0, 1)
        turn = np.kron(np.eye(2), rotation)
        columns = []
        for unit in np.eye(6):
            torque = np.concatenate([np.zeros(self.n), turn.T @ unit])
            still = np.zeros(self.model.nv)
            answer = pin.constraintDynamics(self.model, data, state, still, torque, welds, parts, settings)
            columns.append(turn @ answer[self.n :])
        return np.array(columns).T
