# SPDX-License-Identifier: BSD-3-Clause
"""Control modes of each limb and the joint boards: commands become torques and servo targets for the plant.

``LimbDrive`` holds the command of one limb and its time-out; ``JointBoards`` combines all limbs into one set of orders
and adds the robot's own gravity and spring compensation.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import Enum, IntEnum

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.backends.baxter.simulator.parameters import (
    BRAKE_SPEED,
    DEFAULT_TIME_OUT,
    EASE,
    INTEGRAL_LIMIT,
    INTEGRAL_RATE,
    LONGEST_TIME_OUT,
    POSITION_LAG,
    SPEED_LIMITS,
    SPEED_RATIO,
    TICK,
    TORQUE_LIMITS,
    SimulatorOptions,
)
from impedance_modules.plant.joint_servos import (
    BoardOrders,
    DrivenPlant,
    JointRange,
    Sensed,
    Servo,
    ServoReference,
    ServoTuning,
)
from impedance_modules.robot.model import Limb, RobotModel
from impedance_modules.robot.state import RobotState

INERTIA_TICKS = 100
"""The servos are adapted to the arms' inertia every so many ticks."""


class CommandMode(IntEnum):
    """Modes of a JointCommand."""

    POSITION = 1
    VELOCITY = 2
    TORQUE = 3
    RAW_POSITION = 4


class LimbActivity(Enum):
    """What a limb with power does; without power it does nothing."""

    HOLDS = "holds"
    COMMANDED = "commanded"
    FLOATS = "floats"


@dataclass(frozen=True)
class LimbOrders:
    """For the joint boards, each (k,): torque [N.m], or target of the position servos [rad].

    ``servo`` says which of the two applies.
    """

    effort: Array
    position: Array
    servo: bool


class LimbDrive:
    """Control modes and command time-out of one limb.

    Attributes:
        activity: Now.
        mode: Of the last command that was taken; None before the first and after a time-out.
        command: (k,) its numbers, clipped.
        fault: Why a joint board failed; empty while it has not.
        expired: Whether the commands in force have timed out in the present tick.
        received, last_received: How many commands came in all, and when the last did [s]; 0 before the first.
        last_torque: When the last torque command came [s].
        ignored: Invalid commands, and those that came while the limb paused or had no power.
    """

    def __init__(self, model: RobotModel, limb: Limb, options: SimulatorOptions) -> None:
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
        self.activity = LimbActivity.HOLDS
        self.mode: CommandMode | None = None
        self.command: Array = np.zeros(self._k)
        self.fault = ""
        self.expired = False
        self.ignored = self.received = 0
        self.last_received = self.last_torque = 0.0
        self.time_out = DEFAULT_TIME_OUT
        self.speed_ratio = SPEED_RATIO
        self._commanded_at = -math.inf
        self._pause_end = -math.inf

    @property
    def served(self) -> bool:
        """Says whether the position servo controls the limb, not a torque command or nothing."""
        return self.activity is LimbActivity.HOLDS or (
            self.activity is LimbActivity.COMMANDED and self.mode is not CommandMode.TORQUE
        )

    def paused(self, now: float) -> bool:
        """Says whether a collision makes the limb ignore commands."""
        return now < self._pause_end

    def set_time_out(self, seconds: float) -> None:
        """Sets the command time-out [s], clipped to what the robot accepts; NaN changes nothing."""
        if math.isfinite(seconds):
            self.time_out = min(max(seconds, 0.0), LONGEST_TIME_OUT)

    def set_speed_ratio(self, ratio: float) -> None:
        """Sets the share of the top speed in position mode; NaN changes nothing."""
        if math.isfinite(ratio):
            self.speed_ratio = min(max(ratio, 0.0), 1.0)

    def settle(self, position: Array) -> None:
        """Leaves every mode and holds at measured positions (k,) [rad]."""
        self.activity, self.mode = LimbActivity.HOLDS, None
        self.command = np.zeros(self._k)
        self.reference.settle(position)

    def float_free(self) -> None:
        """Leaves every mode; only the robot's own gravity compensation remains."""
        self.activity, self.mode = LimbActivity.FLOATS, None
        self.command = np.zeros(self._k)

    def pause(self, now: float, seconds: float, position: Array) -> None:
        """Holds and ignores commands for a while."""
        self.settle(position)
        self._pause_end = now + seconds

    def take(
        self, now: float, mode: int, names: Sequence[str], values: Sequence[float], position: Array
    ) -> None:
        """Takes a JointCommand; an invalid one, or one during a pause, is ignored.

        Args:
            now: Clock [s].
            mode: ``CommandMode``.
            names: Joints; those left out do not move.
            values: Angle, rate or torque of each.
            position: (k,) measured [rad].
        """
        known = [self._index.get(name) for name in names]
        numbers = np.array(values, dtype=float)
        valid = (
            mode in CommandMode._value2member_map_
            and len(known) == numbers.size > 0
            and None not in known
            and bool(np.isfinite(numbers).all())
        )
        if not valid or self.paused(now):
            self.ignored += 1
            return
        self._enter(CommandMode(mode), position)
        places = [place for place in known if place is not None]
        self._commanded_at = now
        if self.mode is CommandMode.TORQUE:
            numbers = self._bounded(places, numbers)
        self.command[places] = numbers

    def _enter(self, mode: CommandMode, position: Array) -> None:
        """Changes the mode: a servo starts at its present reference, or else at the measured position."""
        moves = mode in (CommandMode.POSITION, CommandMode.RAW_POSITION)
        if mode is not self.mode:
            if self.activity is LimbActivity.FLOATS or self.mode is CommandMode.TORQUE:
                self.reference.settle(position)
            self.command = self.reference.position.copy() if moves else np.zeros(self._k)
        elif not moves:
            self.command = np.zeros(self._k)
        self.mode, self.activity = mode, LimbActivity.COMMANDED

    def _bounded(self, places: Sequence[int], torque: Array) -> Array:
        """Clips a torque to what the boards can give, or reports a fault."""
        limit = self.torque_limit[list(places)]
        beyond = np.abs(torque) > limit
        if beyond.any() and self._options.over_torque == "fault":
            joint = self.limb.joint_names[places[int(np.argmax(beyond))]]
            self.fault = f"{joint}: torque beyond the board's limit"
        return np.clip(torque, -limit, limit)

    def check_time(self, now: float) -> None:
        """Leaves a mode whose commands have stopped coming; ``expired`` tells."""
        self.expired = self.activity is LimbActivity.COMMANDED and now - self._commanded_at > self.time_out

    def orders(self, sensed: Sensed, servo: Servo) -> LimbOrders:
        """Advances by one tick; takes what the joints measure and their servos' settings."""
        if not self.served:
            return LimbOrders(self.command, sensed.position, servo=False)
        if self.activity is LimbActivity.HOLDS:
            self.reference.stay()
        elif self.mode is CommandMode.POSITION:
            self.reference.approach(self.command, self.speed_ratio)
        elif self.mode is CommandMode.RAW_POSITION:
            self.reference.follow(self.command)
        else:
            self.reference.run(self.command)
        return LimbOrders(np.zeros(self._k), self.reference.motor_target(sensed, servo), servo=True)


@dataclass(frozen=True)
class BoardRequest:
    """What one limb requests of its boards.

    Attributes:
        drive: Its control mode.
        assisted: Gravity and shoulder springs are compensated.
        kept_off: Collision avoidance acts on it.
    """

    drive: LimbDrive
    assisted: bool
    kept_off: bool


class JointBoards:
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

    def update_inertia(self, q: Array) -> None:
        """Adapts the servos' damping of the links' oscillation to the inertia at positions (n,) [rad]."""
        inertia = np.diag(self._model.mass_matrix(q)) - self._model.reflected_inertia
        self._ease = EASE * np.sqrt(inertia / self.stiffness)

    def orders(self, state: RobotState, requests: Sequence[BoardRequest] | None, field: Array) -> BoardOrders:
        """Combines the limbs' requests.

        Args:
            state: What the sensors say.
            requests: Of every limb; None without power, when only the brakes act.
            field: (n,) torque of collision avoidance [N.m].
        """
        n = self._model.n
        nothing = np.zeros(n)
        if requests is None:
            return BoardOrders(nothing, nothing, self._brake, state.position, nothing)
        effort, position, servo, assisted = nothing.copy(), nothing.copy(), nothing.copy(), np.ones(n)
        ahead = nothing
        if any(request.drive.served for request in requests):
            weight, springs = self._plant.compensation(state.position)
            ahead = (weight + springs) / self.stiffness
        for request in requests:
            joints = request.drive.limb.joints
            sensed = Sensed(np.asarray(state.position[joints]), state.velocity[joints])
            orders = request.drive.orders(
                sensed, Servo(ahead[joints], self._lead[joints], self._ease[joints])
            )
            effort[joints], position[joints], servo[joints] = orders.effort, orders.position, orders.servo
            assisted[joints] = request.assisted
            if request.kept_off:
                effort[joints] += field[joints]
        return BoardOrders(effort, servo * self.stiffness, servo * self.damping, position, assisted)
