# SPDX-License-Identifier: BSD-3-Clause
"""The place where an effect hooks into the plant: a torque at the motor or at the link of its joints.

An effect is any object with the two methods of ``JointTorque``. The plant adds what it returns to the
motor's or the link's equation at every Runge-Kutta stage, and books its work under ``effects``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass
class JointMotion:
    """Live views of the joints at one stage, all (n,); read them, do not write.

    Attributes:
        time: Of the step's start [s].
        position, velocity: Of the links [rad], [rad/s].
        motor_position, motor_velocity: Of the rotors, seen at the joint; a rigid joint's are its link's.
        command: Torque command that acts now [N.m].
        load: Torque between gear and link at the step's start [N.m].
    """

    time: float
    position: Array
    velocity: Array
    motor_position: Array
    motor_velocity: Array
    command: Array
    load: Array


class JointTorque(Protocol):
    """An effect that acts as a torque on joints."""

    @property
    def port(self) -> Literal["motor", "link"]:
        """Which of the two equations of motion the torque enters (thesis eq. 3.1 or 3.2)."""
        ...

    def torque(self, motion: JointMotion) -> Array:
        """Gives the torque (n,) [N.m] at one stage; must not remember anything."""
        ...

    def settle(self, motion: JointMotion) -> None:
        """Is told the motion at the end of each step; the place for memory such as a stuck bristle."""
        ...
