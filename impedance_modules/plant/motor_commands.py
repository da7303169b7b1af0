# SPDX-License-Identifier: BSD-3-Clause
"""From the controller to the motor: a line of whole periods, a time-out, and the robot's own modes.

A torque issued in one period acts, unchanged, for the whole of the period ``delay`` later, with
delay = ceil(command_delay x rate). Silence longer than the time-out makes the robot hold its position.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, replace
from enum import Enum

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from impedance_modules.effects.worn import WornPlant
from impedance_modules.errors import BadInput
from impedance_modules.robot.model import RobotModel
from impedance_modules.spec.robot import TimingSpec

Array = NDArray[np.float64]


class Mode(Enum):
    """What the robot does: the commanded torque, its own position hold, or no torque but gravity's."""

    TORQUE = "torque"
    HOLD = "hold"
    RELEASE = "release"


@dataclass(frozen=True)
class Order:
    """One period's message: a mode and, in torque mode, the torque (n,) [N.m]; zero in the others."""

    mode: Mode
    effort: Array


def delay_periods(timing: TimingSpec, rate: float) -> int:
    """Counts the whole periods by which a command at ``rate`` [Hz] is late; rounds up."""
    return math.ceil(timing.command_delay * rate - 1e-9)


class CommandLine:
    """The queue of orders under way, and the robot's patience.

    Attributes:
        delay: Whole periods between issuing an order and its acting.
        acting: The order that acts in the present period.
    """

    def __init__(self, timing: TimingSpec, rate: float, start: Order) -> None:
        """Starts with ``start`` acting and filling the line."""
        self.delay = delay_periods(timing, rate)
        self.acting = start
        self._patience = timing.command_timeout * rate
        self._silence = 0
        self._line: deque[Order | None] = deque([start] * self.delay)

    def pass_on(self, issued: Order | None) -> Order:
        """Takes what was issued in this period, None for nothing, and gives the order that acts."""
        self._line.append(issued)
        arrived = self._line.popleft()
        if arrived is not None:
            self.acting, self._silence = arrived, 0
            return arrived
        self._silence += 1
        if self.acting.mode is Mode.TORQUE and self._silence > self._patience:
            self.acting = Order(Mode.HOLD, np.zeros(self.acting.effort.size))
        return self.acting


def checked_effort(command: Array, n: int) -> Array:
    """Copies a torque command.

    Raises:
        BadInput: It has another length, or a number that is not finite.
    """
    effort = np.array(command, dtype=float)
    if effort.shape != (n,) or not np.isfinite(effort).all():
        raise BadInput(f"a torque command needs {n} finite numbers [N.m]; got {command!r}")
    return effort


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
