# SPDX-License-Identifier: BSD-3-Clause
"""What still water does to the plant's links as torques on their joints: it lifts them and holds them back."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from impedance_modules.effects.motion import JointMotion
from impedance_modules.robot.model import RobotModel
from impedance_modules.robot.rotation import skew

Array = NDArray[np.float64]


class WaterTorque:
    """A torque on the links that depends on where they are and how they move, and on nothing before."""

    port: Literal["motor", "link"] = "link"

    def settle(self, motion: JointMotion) -> None:
        """Remembers nothing."""

    def start(self, motion: JointMotion, step: float) -> None:
        """Has nothing to forget."""


class Buoyancy(WaterTorque):
    """The weight of displaced water, upwards: J_c^T (-m g) summed over links.

    It is minus the weight of a robot whose links are nothing but the displaced water.
    """

    def __init__(self, model: RobotModel, links: Mapping[str, tuple[float, Array]]) -> None:
        """Takes link -> mass of the displaced water [kg] and its centre (3,) in the link's frame [m]."""
        self._water = pin.Model(model.pin_model)
        for joint in range(self._water.njoints):
            self._water.inertias[joint] = pin.Inertia.Zero()
        for link, (mass, centre) in links.items():
            frame = self._water.frames[model.frame_id(link)]
            body = pin.Inertia(mass, centre, np.zeros((3, 3)))
            self._water.appendBodyToJoint(frame.parentJoint, body, frame.placement)
        self._data = self._water.createData()

    def torque(self, motion: JointMotion) -> Array:
        """Gives what lifts the links (n,) [N.m]."""
        return self.lift(motion.position)

    def lift(self, position: Array) -> Array:
        """Gives the same at joint positions (n,) [rad]."""
        return np.array(pin.computeGeneralizedGravity(self._water, self._data, position))

    def potential(self, position: Array) -> float:
        """Gives the energy that sinking the links has stored in the water [J], up to a constant."""
        return -float(pin.computePotentialEnergy(self._water, self._data, position))


class Drag(WaterTorque):
    """Resistance -|v| D v at a point of each link, v that point's velocity in the link's axes."""

    def __init__(self, model: RobotModel, links: Mapping[str, tuple[Array, Array]]) -> None:
        """Takes link -> drag (3,) along its axes [N.s^2/m^2] and the point (3,) in its frame [m]."""
        self._model = model.pin_model
        self._data = self._model.createData()
        self._frames = [model.frame_id(link) for link in links]
        self._drag = np.array([drag for drag, _ in links.values()])
        # v + w x p, from a twist at the link's origin to the point.
        self._to_point = [np.hstack([np.eye(3), -skew(point)]) for _, point in links.values()]

    def torque(self, motion: JointMotion) -> Array:
        """Gives what holds the links back (n,) [N.m]."""
        pin.computeJointJacobians(self._model, self._data, motion.position)
        out = np.zeros(motion.position.size)
        for frame, drag, to_point in zip(self._frames, self._drag, self._to_point, strict=True):
            J = pin.getFrameJacobian(self._model, self._data, frame, pin.ReferenceFrame.LOCAL)
            at_point = to_point @ J
            v = at_point @ motion.velocity
            out -= at_point.T @ (drag * v * np.sqrt(v @ v))
        return out
