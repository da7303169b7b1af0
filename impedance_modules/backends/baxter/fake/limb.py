# SPDX-License-Identifier: BSD-3-Clause
"""One arm of the double: what it was commanded, how long ago, and what that makes of its joint boards."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import Enum, IntEnum

import numpy as np
from numpy.typing import NDArray

from impedance_modules.backends.baxter.fake.numbers import (
    DEFAULT_TIME_OUT,
    INTEGRAL_LIMIT,
    INTEGRAL_RATE,
    LONGEST_TIME_OUT,
    POSITION_LAG,
    SPEED_LIMITS,
    SPEED_RATIO,
    TICK,
    TORQUE_LIMITS,
)
from impedance_modules.backends.baxter.fake.options import FakeOptions
from impedance_modules.plant.joint_servos import JointRange, Sensed, Servo, ServoReference, ServoTuning
from impedance_modules.robot.model import Limb, RobotModel

Array = NDArray[np.float64]


class CommandMode(IntEnum):
    """Modes of a JointCommand."""

    POSITION = 1
    VELOCITY = 2
    TORQUE = 3
    RAW_POSITION = 4


class Doing(Enum):
    """What a powered limb does; without power it does nothing at all."""

    HOLDS = "holds"
    OBEYS = "obeys"
    FLOATS = "floats"


@dataclass(frozen=True)
class LimbOrders:
    """For the joint boards, each (k,): torque [N.m], or where the servo pulls the motors [rad].

    ``servo`` says which of the two acts.
    """

    effort: Array
    position: Array
    servo: bool


class LimbDrive:
    """Control modes and command time-out of one limb.

    Attributes:
        doing: Now.
        mode: Of the last command that was taken; None before the first and after a time-out.
        command: (k,) its numbers, clamped.
        fault: Why a joint board failed; empty while it has not.
        expired: Whether the commands in force have timed out in the present tick.
        received, last_received: How many commands came in all, and when the last did [s]; 0 before the first.
        last_torque: When the last torque command came [s].
        ignored: Commands that made no sense, or came while the limb paused or had no power.
    """

    def __init__(self, model: RobotModel, limb: Limb, options: FakeOptions) -> None:
        self.limb = limb
        self._options = options
        shorts = limb.short_names
        self._index: Mapping[str, int] = {name: i for i, name in enumerate(limb.joint_names)}
        self.torque_limit = np.array([TORQUE_LIMITS[short] for short in shorts])
        specs = [model.spec.joints[name] for name in limb.joint_names]
        low = np.array([spec.position_min for spec in specs])
        high = np.array([spec.position_max for spec in specs])
        speed = np.array([SPEED_LIMITS[short] for short in shorts])
        tuning = ServoTuning(TICK, POSITION_LAG, INTEGRAL_RATE, INTEGRAL_LIMIT)
        self.reference = ServoReference(JointRange(low, high, speed), tuning)
        self._k = len(specs)
        self.doing = Doing.HOLDS
        self.mode: CommandMode | None = None
        self.command: Array = np.zeros(self._k)
        self.fault = ""
        self.expired = False
        self.ignored = self.received = 0
        self.last_received = self.last_torque = 0.0
        self.time_out = DEFAULT_TIME_OUT
        self.speed_ratio = SPEED_RATIO
        self._heard = -math.inf
        self._pause_end = -math.inf

    @property
    def served(self) -> bool:
        """Says whether the limb's servo acts, not a torque command or nothing."""
        return self.doing is Doing.HOLDS or (
            self.doing is Doing.OBEYS and self.mode is not CommandMode.TORQUE
        )

    def paused(self, now: float) -> bool:
        """Says whether a collision makes the limb ignore commands."""
        return now < self._pause_end

    def set_time_out(self, seconds: float) -> None:
        """Sets the patience with silent commanders, cut to what the robot accepts; NaN changes nothing."""
        if math.isfinite(seconds):
            self.time_out = min(max(seconds, 0.0), LONGEST_TIME_OUT)

    def set_speed_ratio(self, ratio: float) -> None:
        """Sets the share of the top speed in position mode; NaN changes nothing."""
        if math.isfinite(ratio):
            self.speed_ratio = min(max(ratio, 0.0), 1.0)

    def settle(self, position: Array) -> None:
        """Leaves every mode and holds at measured positions (k,) [rad]."""
        self.doing, self.mode = Doing.HOLDS, None
        self.command = np.zeros(self._k)
        self.reference.settle(position)

    def float_free(self) -> None:
        """Leaves every mode; only the robot's own help with the weight remains."""
        self.doing, self.mode = Doing.FLOATS, None
        self.command = np.zeros(self._k)

    def pause(self, now: float, seconds: float, position: Array) -> None:
        """Holds and ignores commands for a while."""
        self.settle(position)
        self._pause_end = now + seconds

    def take(
        self, now: float, mode: int, names: Sequence[str], values: Sequence[float], position: Array
    ) -> None:
        """Takes a JointCommand; one that makes no sense, or comes in a pause, is ignored.

        Args:
            now: Clock [s].
            mode: ``CommandMode``.
            names: Joints; those left out keep still.
            values: Angle, rate or torque of each.
            position: (k,) measured [rad].
        """
        known = [self._index.get(name) for name in names]
        numbers = np.array(values, dtype=float)
        sensible = (
            mode in CommandMode._value2member_map_
            and len(known) == numbers.size > 0
            and None not in known
            and bool(np.isfinite(numbers).all())
        )
        if not sensible or self.paused(now):
            self.ignored += 1
            return
        self._enter(CommandMode(mode), position)
        places = [place for place in known if place is not None]
        self._heard = now
        if self.mode is CommandMode.TORQUE:
            numbers = self._bounded(places, numbers)
        self.command[places] = numbers

    def _enter(self, mode: CommandMode, position: Array) -> None:
        """Changes the mode: a servo starts where it holds already, or else where the arm is."""
        moves = mode in (CommandMode.POSITION, CommandMode.RAW_POSITION)
        if mode is not self.mode:
            if self.doing is Doing.FLOATS or self.mode is CommandMode.TORQUE:
                self.reference.settle(position)
            self.command = self.reference.position.copy() if moves else np.zeros(self._k)
        elif not moves:
            self.command = np.zeros(self._k)
        self.mode, self.doing = mode, Doing.OBEYS

    def _bounded(self, places: Sequence[int], torque: Array) -> Array:
        """Keeps a torque within what the boards give, or faults."""
        limit = self.torque_limit[list(places)]
        beyond = np.abs(torque) > limit
        if beyond.any() and self._options.over_torque == "fault":
            joint = self.limb.joint_names[places[int(np.argmax(beyond))]]
            self.fault = f"{joint}: torque beyond the board's limit"
        return np.clip(torque, -limit, limit)

    def check_time(self, now: float) -> None:
        """Leaves a mode whose commands have stopped coming; ``expired`` tells."""
        self.expired = self.doing is Doing.OBEYS and now - self._heard > self.time_out

    def orders(self, sensed: Sensed, servo: Servo) -> LimbOrders:
        """Moves on by one tick, with what the joints report and how their servo is set."""
        if not self.served:
            return LimbOrders(self.command, sensed.position, servo=False)
        if self.doing is Doing.HOLDS:
            self.reference.stay()
        elif self.mode is CommandMode.POSITION:
            self.reference.approach(self.command, self.speed_ratio)
        elif self.mode is CommandMode.RAW_POSITION:
            self.reference.follow(self.command)
        else:
            self.reference.run(self.command)
        return LimbOrders(np.zeros(self._k), self.reference.motor_target(sensed, servo), servo=True)
