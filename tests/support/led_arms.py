# SPDX-License-Identifier: BSD-3-Clause
"""Tasks that listen to set-points, a source that sends at random, and what the run made of it."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from impedance_modules.backends.protocol import FirstState
from impedance_modules.control.assembly import Assembly, assemble
from impedance_modules.control.controller import Controller
from impedance_modules.control.equilibrium_following import Following
from impedance_modules.control.set_point_source import RunReport
from impedance_modules.errors import BadInput
from impedance_modules.robot.rotation import exp3, write_quaternion
from impedance_modules.robot.state import RobotState
from impedance_modules.streaming.inbox import Inbox
from impedance_modules.streaming.set_point_message import make_message

TASK = """
format: 1
name: led
robot: baxter
arms:
  right:
    posture: {s0: 0.2706, s1: -0.4171, e0: 0.8304, e1: 1.4871, w0: -0.9774, w1: 0.9511, w2: -2.5284}
    joint_bias: {stiffness: {s0: 3, s1: 3, e0: 3, e1: 3, w0: 1, w1: 1, w2: 1}, damping_ratio: 0.7}
    springs:
      - name: hand
        frame: right_hand
        expressed_in: right_hand
        stiffness: [[300, 0, 20, 0, 0, 0], [0, 200, 0, 0, 0, 0], [20, 0, 100, 0, 0, 0],
                    [0, 0, 0, 8, 0, 1], [0, 0, 0, 0, 8, 0], [0, 0, 0, 1, 0, 8]]
        damping_ratio: 0.7
        axes: {z: {force: FORCE, speed_limit: 0.1}}
  left: {mirror: right}
OBJECT
safety: {tank: {initial: TANK, max: 10, floor: 0.1}}
set_points:
  age: 0.1
  lag: 0.04
  targets: {TARGETS}
phases:
  - {name: follow, duration: 0.8, listen: true}
  - {name: pause, duration: 0.1}
  - {name: again, duration: 0.3, listen: true}
"""
LIMITS = "{speed: 0.3, turn_speed: 0.8, step: 0.12, turn: 0.5}"
BOX = "object: {held_by: [right, left], shape: box, mass: 1.0, size: [0.3, 0.5, 0.2], grasp: weld}"


def led_assembly(folder: Path, *, tank: float = 3.0, held: bool = False, force: float = -4.0) -> Assembly:
    """A task in which both hands, or the box between them, follow set-points."""
    targets = f"object: {LIMITS}" if held else f"right.hand: {LIMITS}, left.hand: {LIMITS}"
    text = TASK.replace("TARGETS", targets).replace("TANK", str(tank)).replace("FORCE", str(force))
    text = text.replace("OBJECT", BOX if held else "")
    path = folder / "led.yaml"
    path.write_text(text, encoding="utf-8")
    return assemble(str(path), effects=None, rate=None, scale=1.0, arm=None)


def started(assembly: Assembly) -> Controller:
    """A controller at rest at the task's start, in its first phase."""
    controller = Controller(assembly)
    n = assembly.model.n
    state = RobotState(0.0, assembly.modules.posture, np.zeros(n), np.zeros(n))
    controller.start(FirstState(state, np.zeros(n)), assembly.task.phases[0])
    return controller


def quaternion(vector: np.ndarray) -> np.ndarray:
    """The unit quaternion (x, y, z, w) of a rotation vector [rad]."""
    found = np.empty(4)
    write_quaternion(exp3(vector), found)
    return found


class RandomSender:
    """Sends set-points near the equilibria at random, at a rate, and loses some; a ``SetPointSource``.

    Attributes:
        inbox: What takes them.
        seen: (cycle, target) velocities of the equilibria and where they are.
    """

    def __init__(self, assembly: Assembly, seed: int, *, rate: float, loss: float) -> None:
        self.random, self.rate, self.loss = np.random.default_rng(seed), rate, loss
        self.now, self.due, self.sequence = 0.0, 0.0, 0
        self.names = tuple(assembly.task.set_points.targets)
        self.inbox = Inbox(assembly.task.set_points, clock=lambda: self.now, calendar=lambda: self.now)
        self.velocities: list[np.ndarray] = []
        self.places: list[np.ndarray] = []
        self.granted: list[float] = []

    def begin(self, phase: str, following: Following) -> None:
        self.inbox.begin(phase, following)

    def write(self, following: Following, state: RobotState) -> None:
        self.now = state.time
        self.velocities.append(following.velocity.copy())
        self.places.append(following.translation.copy())
        self.granted.append(following.granted)
        while self.due <= self.now:
            # Jitter as large as the step: they come in bursts.
            self.due += self.random.uniform(0.0, 2.0 / self.rate)
            if self.random.random() > self.loss:
                self._send(following)
        self.inbox.write(following, state)

    def look(self, report: RunReport) -> list[str]:
        return self.inbox.look(report)

    def _send(self, following: Following) -> None:
        self.sequence += 1
        targets: dict[str, Any] = {}
        for k, name in enumerate(self.names):
            asked: dict[str, Any] = {}
            if self.random.random() < 0.9:
                away = self.random.uniform(-0.08, 0.08, 3)
                asked["position"] = (following.translation[k] + away).tolist()
            if self.random.random() < 0.5:
                asked["rotation"] = self._turned(following.rotation[k]).tolist()
            if following.spring[k] >= 0:
                parts = self.random.uniform(0.0, 1.0, 6)
                asked["stiffness"] = (parts * np.diag(following.stated_stiffness[k])).tolist()
                asked["force"] = (self.random.uniform() * following.stated_force[k]).tolist()
            targets[name] = asked or {"position": following.translation[k].tolist()}
        with suppress(BadInput):
            self.inbox.put(make_message({"sequence": self.sequence, "targets": targets}), "random")

    def _turned(self, rotation: np.ndarray) -> np.ndarray:
        found = np.empty(4)
        write_quaternion(exp3(self.random.uniform(-0.2, 0.2, 3)) @ rotation, found)
        return found
