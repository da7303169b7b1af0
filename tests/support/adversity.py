# SPDX-License-Identifier: BSD-3-Clause
"""An environment and a robot that do their worst, and the books beside what the plant's motors really did."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from impedance_modules.backends.sim_backend import SimBackend
from impedance_modules.control.supervisor import Supervisor
from impedance_modules.effects.joint_motion import JointMotion
from impedance_modules.plant.plant import Plant
from impedance_modules.robot.state import RobotState
from impedance_modules.safety.stop_levels import StopLevel
from tests.support.tank_worlds import sensing_uncertainty

Random = np.random.Generator


class Pushes:
    """An environment that pushes every link at will, and pulls where the controller pushes, to make it work.

    Both die down where a joint runs: the claim rests on the declared speed of the rotors.
    """

    port: Literal["link"] = "link"

    def __init__(self, random: Random, n: int, size: float, greed: float) -> None:
        weak = np.resize([1.0, 1.0, 1.0, 1.0, 0.2, 0.2, 0.2], n)
        self.size, self.greed = size * random.uniform(0.2, 1.0, n) * weak, greed * weak
        self.rate, self.phase = random.uniform(1.0, 40.0, n), random.uniform(0.0, 6.0, n)

    def torque(self, motion: JointMotion) -> np.ndarray:
        push = self.size * np.sin(self.rate * motion.time + self.phase)
        return push + self.greed * np.tanh(motion.command) - 3.0 * motion.velocity

    def settle(self, motion: JointMotion) -> None:
        """Remembers nothing."""


class UnreliableRobot:
    """Its states come late, are overtaken, lost, repeated or swapped; a torque for a late one misses its period."""

    def __init__(self, robot: SimBackend, seed: int, **shares: float) -> None:
        self.robot, self.random, self.shares = robot, np.random.default_rng(seed), shares
        self.kept: RobotState | None = None
        self.before: RobotState | None = None
        self.too_late = False
        self.seen = dict.fromkeys(shares, 0)

        self.start, self.finish = robot.start, robot.finish

    def write(self, effort: np.ndarray) -> None:
        if not self.too_late:
            self.robot.write(effort)

    def read(self) -> RobotState | None:
        self.too_late = self.kept is not None
        if self.kept is not None:
            state, self.kept = self.kept, None
            return state
        luck, state = self.random.random(), self.robot.read()
        for what, share in self.shares.items():
            luck -= share
            if luck < 0.0:
                self.seen[what] += 1
                return getattr(self, what)(state)
        self.before = state
        return state

    def late(self, state: RobotState) -> None:
        """It comes, but only after it was given up."""
        self.kept = state

    def overtaken(self, state: RobotState) -> RobotState:
        """The loop was asleep: it sees one or two states later, and was told of no miss."""
        for _ in range(self.random.integers(1, 3)):
            state = self.robot.read()
        return state

    def lost(self, state: RobotState) -> None:
        """It never comes."""

    def repeated(self, state: RobotState) -> RobotState | None:
        """The state before comes once more; this one never comes."""
        return state if self.before is None else self.before

    def swapped(self, state: RobotState) -> RobotState | None:
        """The next state comes first, and this one after it."""
        self.kept = state
        return self.robot.read()


@dataclass
class Books:
    """What the tank claims in one random world, beside what the plant's motors did."""

    supervisor: Supervisor
    plant: Plant
    least_margin: float = np.inf
    largest_error: float = 0.0
    largest_bound: float = 0.0
    cycles: int = 0

    def watch(self, state: RobotState, effort: np.ndarray, late: bool, asked: bool) -> None:
        tank, true = self.supervisor.controller.tank, self.plant.motor_work
        self.least_margin = min(self.least_margin, tank.work_bound - true)
        if self.supervisor.stop_level < StopLevel.HOLD:
            # Once the robot's own hold has the arms, nobody books what the last torque under way does: it was reserved.
            excess = abs(true - tank.work) - sensing_uncertainty(tank)
            self.largest_error = max(self.largest_error, excess)
        self.largest_bound = max(self.largest_bound, sensing_uncertainty(tank))
        self.cycles += 1
