# SPDX-License-Identifier: BSD-3-Clause
"""From the controller to the motor: commands that arrive late, a time-out, and what the robot adds by itself.

A torque issued in one period acts, unchanged, for the whole of the period ``delay`` later, with
delay = ceil(command_delay x rate). Silence longer than the time-out makes the robot hold its position. What the robot
adds is the torque that carries its arms' weight and the parallel springs it knows of.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, replace
from enum import Enum

import numpy as np
import pinocchio as pin

from impedance_modules.effects.plant_builder import PlantEffects
from impedance_modules.errors import BadInput
from impedance_modules.records import Vector
from impedance_modules.robot.model import RobotModel
from impedance_modules.spec.robot_spec import TimingSpec

GRAVITY_COMPENSATION = ("robot", "command", "none")
"""Who carries the arms' weight."""


class Mode(Enum):
    """What the robot does: the commanded torque, its own position hold, or no torque but gravity's."""

    TORQUE = "torque"
    HOLD = "hold"
    RELEASE = "release"


@dataclass(frozen=True)
class Order:
    """One period's message: a mode and, in torque mode, the torque (n,) [N.m]; zero in the others."""

    mode: Mode
    effort: Vector


def delay_periods(timing: TimingSpec, rate: float) -> int:
    """Counts the whole periods by which a command at ``rate`` [Hz] is late; rounds up."""
    return math.ceil(timing.command_delay * rate - 1e-9)


class CommandQueue:
    """The orders under way, and the time-out.

    Attributes:
        delay: Whole periods between issuing an order and its acting.
        acting: The order that acts in the present period.
    """

    def __init__(self, timing: TimingSpec, rate: float, start: Order) -> None:
        """Starts with ``start`` acting and filling the queue."""
        self.delay = delay_periods(timing, rate)
        self.acting = start
        self._timeout_periods = timing.command_timeout * rate
        self._silent_periods = 0
        self._queue: deque[Order | None] = deque([start] * self.delay)

    def exchange(self, issued: Order | None) -> Order:
        """Takes what was issued in this period, None for nothing, and gives the order that acts."""
        self._queue.append(issued)
        arrived = self._queue.popleft()
        if arrived is not None:
            self.acting, self._silent_periods = arrived, 0
            return arrived
        self._silent_periods += 1
        if self.acting.mode is Mode.TORQUE and self._silent_periods > self._timeout_periods:
            self.acting = Order(Mode.HOLD, np.zeros(self.acting.effort.size))
        return self.acting


def checked_effort(command: Vector, n: int) -> Vector:
    """Copies a torque command.

    Raises:
        BadInput: It has another length, or a number that is not finite.
    """
    effort = np.array(command, dtype=float)
    if effort.shape != (n,) or not np.isfinite(effort).all():
        raise BadInput(f"a torque command needs {n} finite numbers [N.m]; got {command!r}")
    return effort


class WeightCompensation:
    """The robot's own torque g(q) + k q - preload, with the links upright and without a patch's bodies.

    Attributes:
        acts: Whether the robot does this, as its file declares.
        share: (n,) how much of it each joint gets now; 1 unless a robot can switch it off joint by joint.
    """

    def __init__(self, model: RobotModel, effects: PlantEffects, gravity: tuple[float, float, float]) -> None:
        """Takes the robot, its effects (their ``spring_stiffness``, ``spring_preload``) and gravity [m/s^2].

        Raises:
            BadInput: The robot file names no known way of compensating gravity.
        """
        spec = model.spec
        if spec.gravity_compensation not in GRAVITY_COMPENSATION:
            raise BadInput(
                f"gravity_compensation is '{spec.gravity_compensation}'"
                f" (valid: {', '.join(GRAVITY_COMPENSATION)})"
            )
        self.acts = spec.gravity_compensation == "robot"
        self.share: Vector = np.ones(model.n)
        known = RobotModel(replace(spec, body_changes=())) if spec.body_changes else model
        self._links = pin.Model(known.pin_model)
        self._links.gravity.linear = np.array(gravity)
        self._data = self._links.createData()
        self._stiffness, self._preload = effects.spring_stiffness, effects.spring_preload
        self._springs = bool(self._stiffness.any() or self._preload.any())

    def torque(self, position: Vector) -> Vector:
        """Computes the torque now at a measured position (n,) [N.m]; zero where the robot does not do this."""
        return self.share * self.full(position)

    def full(self, position: Vector) -> Vector:
        """Computes the torque at a measured position (n,) [N.m], every joint taking its whole share."""
        if not self.acts:
            return np.zeros(position.size)
        weight = np.array(pin.computeGeneralizedGravity(self._links, self._data, position))
        if self._springs:
            weight += self._stiffness * position - self._preload
        return weight
