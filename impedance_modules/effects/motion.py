# SPDX-License-Identifier: BSD-3-Clause
"""What the plant tells a worn effect at every stage of a step, and what it asks for."""

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
        drive: Torque asked of the motors: the command plus what the robot adds by itself [N.m].
        position_command, velocity_command: The joint motion the controller aims at [rad], [rad/s].
    """

    time: float
    position: Array
    velocity: Array
    motor_position: Array
    motor_velocity: Array
    command: Array
    load: Array
    drive: Array
    position_command: Array
    velocity_command: Array


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


class WornTorque(JointTorque, Protocol):
    """A joint torque of the catalogue: it can start over."""

    def start(self, motion: JointMotion, step: float) -> None:
        """Forgets the past: the joints stand as given, and steps of a length [s] follow."""
        ...
