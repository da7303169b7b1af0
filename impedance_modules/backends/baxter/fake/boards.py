# SPDX-License-Identifier: BSD-3-Clause
"""The joint boards: what all limbs want, put together into torques, servo targets and assistance for the plant."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impedance_modules.backends.baxter.fake.limb import LimbDrive
from impedance_modules.backends.baxter.fake.numbers import BRAKE_SPEED, EASE
from impedance_modules.plant.joint_servos import BoardOrders, DrivenPlant, Sensed, Servo
from impedance_modules.robot.model import RobotModel
from impedance_modules.robot.state import RobotState

Array = NDArray[np.float64]

INERTIA_TICKS = 100
"""The servos are told the arms' inertia every so many ticks."""


@dataclass(frozen=True)
class Claim:
    """What one limb wants of its boards.

    Attributes:
        drive: Its control mode.
        assisted: Gravity and shoulder springs are compensated.
        kept_off: The force field pushes it.
    """

    drive: LimbDrive
    assisted: bool
    kept_off: bool


class Boards:
    """All joints' boards with their servos.

    Attributes:
        stiffness, damping: (n,) of the position servos [N.m/rad, N.m.s/rad].
    """

    def __init__(self, model: RobotModel, plant: DrivenPlant) -> None:
        """Takes the servo gains from the plant."""
        self.stiffness, self.damping = plant.servo_gains()
        self._model, self._plant = model, plant
        self._lead = self.damping / self.stiffness
        self._ease: Array = np.zeros(model.n)
        self._brake = model.column("effort_max") / BRAKE_SPEED

    def weigh(self, q: Array) -> None:
        """Tells the servos the arms' inertia at positions (n,) [rad]: how gently each may begin to move."""
        inertia = np.diag(self._model.mass_matrix(q)) - self._model.reflected_inertia
        self._ease = EASE * np.sqrt(inertia / self.stiffness)

    def orders(self, state: RobotState, claims: Sequence[Claim] | None, field: Array) -> BoardOrders:
        """Puts the limbs' claims together.

        Args:
            state: What the sensors say.
            claims: Of every limb; None without power, when brakes alone act.
            field: (n,) torque of the force field [N.m].
        """
        n = self._model.n
        nothing = np.zeros(n)
        if claims is None:
            return BoardOrders(nothing, nothing, self._brake, state.position, nothing)
        effort, position, servo, assisted = nothing.copy(), nothing.copy(), nothing.copy(), np.ones(n)
        ahead = nothing
        if any(claim.drive.served for claim in claims):
            weight, springs = self._plant.compensation(state.position)
            ahead = (weight + springs) / self.stiffness
        for claim in claims:
            joints = claim.drive.limb.joints
            sensed = Sensed(np.asarray(state.position[joints]), state.velocity[joints])
            orders = claim.drive.orders(sensed, Servo(ahead[joints], self._lead[joints], self._ease[joints]))
            effort[joints], position[joints], servo[joints] = orders.effort, orders.position, orders.servo
            assisted[joints] = claim.assisted
            if claim.kept_off:
                effort[joints] += field[joints]
        return BoardOrders(effort, servo * self.stiffness, servo * self.damping, position, assisted)
