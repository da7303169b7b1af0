# SPDX-License-Identifier: BSD-3-Clause
r"""Force of the surroundings on a hand from joint efforts, sample by sample and unfiltered.

    J^T w = C(q, v) v + g(q) - \tau_s          w the least-squares solution, J over the hand's limb

The links' own acceleration is left in (the thesis does so too): what shakes the hand shows, as a force, what it takes
to shake it. ``control.conditions.Touch`` takes it out, and with it everything fast.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from impedance_modules.robot.kinematics import Kinematics
from impedance_modules.robot.model import Limb, RobotModel

Array = NDArray[np.float64]

REGULARISATION = 1e-4
"""Added to J J^T [m^2, rad^2]: along a singular direction no force is claimed."""


class HandForce:
    """Position of a hand and force on it, from one state after another."""

    def __init__(self, model: RobotModel, limb: Limb) -> None:
        """Takes the robot and the limb whose hand it is."""
        self._model = model
        self._limb = limb
        self._kinematics = Kinematics(model, (limb.hand,))

    def of(self, position: Array, velocity: Array, effort: Array) -> tuple[Array, Array]:
        """Returns where the hand is (3,) [m] and the force on it (3,) [N], world axes.

        Args:
            position: (n,) [rad].
            velocity: (n,) [rad/s].
            effort: (n,) between gears and links [N.m].
        """
        self._kinematics.update(position, velocity)
        jacobian = self._kinematics.jacobian_of(self._limb.hand)[:, self._limb.joints]
        held = self._kinematics.bias + self._model.gravity(position)
        torque = (held - effort)[self._limb.joints]
        gram = jacobian @ jacobian.T + REGULARISATION * np.eye(6)
        wrench: Array = np.asarray(np.linalg.solve(gram, jacobian @ torque), dtype=np.float64)
        return self._kinematics.pose(self._limb.hand).translation.copy(), wrench[:3]
