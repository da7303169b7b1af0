# SPDX-License-Identifier: BSD-3-Clause
"""The backend on a robot of wires, for the tests of what it sends."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from unittest import mock

import numpy as np
import pytest

from impedance_modules.backends.baxter import baxter_backend as backend
from impedance_modules.backends.baxter.baxter_backend import BaxterBackend, DriveOptions
from impedance_modules.backends.baxter.ros.messages import JointCommand
from impedance_modules.backends.baxter.stop_rules import StopRules
from impedance_modules.backends.baxter.stops import Stops
from impedance_modules.errors import RobotStopped
from impedance_modules.spec.task_reader import read_task
from tests.support.baxter_stub import StandIn, open_session

SPEC = read_task("joint-springs")[1]
TORQUE, POSITION = JointCommand.TORQUE_MODE, JointCommand.POSITION_MODE
STALE = 0.25
"""Generous, so that a busy machine's hiccup is not taken for the robot's silence [s]."""
TOLERANCE = 0.7
"""Likewise of the rate: a busy machine's robot of wires ticks more slowly than it was told to."""


@dataclass
class Drive:
    robot: StandIn
    backend: BaxterBackend
    started: float = field(default_factory=time.monotonic)

    def cycle(self, count: int = 1, effort: float = 1.0) -> None:
        for _ in range(count):
            self.backend.write(np.full(self.robot.model.n, effort))
            self.backend.read()

    def until_stopped(self, seconds: float = 3.0) -> RobotStopped:
        end = time.monotonic() + seconds
        with pytest.raises(RobotStopped) as stop:
            while time.monotonic() < end:
                self.cycle()
        return stop.value

    def since(self, moment: float) -> list:
        return [command for command in list(self.robot.commands) if command[0] > moment]


@contextmanager
def driving(robot: StandIn, *, start=None, check=lambda: None, rate=100.0, **options) -> Iterator[Drive]:
    generous = mock.patch.object(backend, "RATE_TOLERANCE", TOLERANCE)
    with open_session(robot) as session, robot.live(), generous:
        model = session.model
        rules = StopRules(STALE, 0.1, STALE + 0.2, 1.0, model.column("effort_max"), np.eye(model.n) * 5.0)
        limbs = {"left": model.limbs["left"]}
        stops = Stops(rules, {"left": model.limbs["left"].joints})
        start = np.full(model.n, 0.3) if start is None else start
        given = DriveOptions(rate=rate, start=start, **{"read_only": False, "approach": False, **options})
        driven = BaxterBackend(session.link, limbs, stops, given, check)
        try:
            yield Drive(robot, driven)
        finally:
            driven.finish("hold")
            driven.finish("hold")


def started(drive: Drive) -> Drive:
    first = drive.backend.start()
    assert first.state.time == 0.0
    assert not first.acting.any()
    return drive
