# SPDX-License-Identifier: BSD-3-Clause
"""What the robot adds by itself: it carries its arms' weight, and the parallel springs it knows of."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from impedance_modules.errors import BadInput
from impedance_modules.effects.worn import WornPlant
from impedance_modules.robot.model import RobotModel

Array = NDArray[np.float64]

GRAVITY_COMPENSATION = ("robot", "command", "none")


class WeightCompensation:
    """The robot's own torque g(q) + k q - preload, with the links upright and without a patch's bodies.

    Attributes:
        acts: Whether the robot does this, as its file declares.
        share: (n,) how much of it each joint gets now; 1 unless a robot can switch it off joint by joint.
    """

    def __init__(self, model: RobotModel, worn: WornPlant, gravity: tuple[float, float, float]) -> None:
        """Takes the robot, what it wears (its ``spring_stiffness``, ``spring_preload``) and gravity [m/s^2].

        Raises:
            BadInput: The robot file names nobody known to compensate gravity.
        """
        spec = model.spec
        if spec.gravity_compensation not in GRAVITY_COMPENSATION:
            raise BadInput(
                f"gravity_compensation is '{spec.gravity_compensation}'"
                f" (valid: {', '.join(GRAVITY_COMPENSATION)})"
            )
        self.acts = spec.gravity_compensation == "robot"
        self.share: Array = np.ones(model.n)
        known = RobotModel(replace(spec, body_changes=())) if spec.body_changes else model
        self._links = pin.Model(known.pin_model)
        self._links.gravity.linear = np.array(gravity)
        self._data = self._links.createData()
        self._stiffness, self._preload = worn.spring_stiffness, worn.spring_preload
        self._springs = bool(self._stiffness.any() or self._preload.any())

    def torque(self, position: Array) -> Array:
        """Computes the torque now at a measured position (n,) [N.m]; zero where the robot does not do this."""
        return self.share * self.full(position)

    def full(self, position: Array) -> Array:
        """Computes the torque at a measured position (n,) [N.m], every joint taking its whole share."""
        if not self.acts:
            return np.zeros(position.size)
        weight = np.array(pin.computeGeneralizedGravity(self._links, self._data, position))
        if self._springs:
            weight += self._stiffness * position - self._preload
        return weight
