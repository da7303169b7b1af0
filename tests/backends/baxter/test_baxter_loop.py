# SPDX-License-Identifier: BSD-3-Clause
"""The control loop on a robot of wires: whatever ends it, the robot is left held, or left alone when it is off."""

from __future__ import annotations

import time
from types import SimpleNamespace

import numpy as np
import pytest

from impedance_modules.control.loop import Interrupt, run_loop
from impedance_modules.safety.stop_levels import Event
from tests.support.baxter_driving import POSITION, SPEC, TORQUE, Drive, driving
from tests.support.baxter_stand_in import StandIn


class Law:
    """A supervisor that asks for one torque, and fails when it is told to."""

    def __init__(self, n: int, fails: Exception | None, after: int) -> None:
        self.assembly = SimpleNamespace(period=0.01, model=SimpleNamespace(n=n))
        self.ending, self.released, self.halted = None, False, None
        self._effort, self._fails, self._left = np.full(n, 1.5), fails, after

    def step(self, state, *, late, stop_request):
        self._left -= 1
        if self._left == 0 and self._fails is not None:
            raise self._fails
        if stop_request is not None or self._left < -300:
            self.ending = "interrupted"
            return None
        return self._effort

    def look(self) -> None:
        """Sees nothing."""

    def halt(self, event: Event, detail: str) -> None:
        self.ending, self.halted, self.released = "stopped", event, event is Event.ROBOT_DISABLED

    def note(self, text: str) -> None:
        """Nobody asks."""


def live_through(drive: Drive, law: Law, interrupt: Interrupt) -> None:
    first = drive.backend.start()
    run_loop(
        law,
        drive.backend,
        first.state,
        lambda *cycle: None,
        interrupt,
        duration=None,
        paced=False,
        read_only=False,
    )


def test_an_exception_in_the_controller_holds_the_robot() -> None:
    robot = StandIn(SPEC)
    with driving(robot) as drive:
        with pytest.raises(ZeroDivisionError):
            live_through(drive, Law(robot.model.n, ZeroDivisionError(), 20), Interrupt())
        assert robot.modes() == [TORQUE, POSITION, TORQUE, POSITION]


def test_touch_and_phases_wait_until_the_torque_has_left() -> None:
    robot, before, after = StandIn(SPEC), [], []
    with driving(robot) as drive:
        law = Law(robot.model.n, ZeroDivisionError(), 20)
        step = law.step

        def torques() -> int:
            return sum(mode == TORQUE for _, _, mode, _ in list(robot.commands))

        def counted(state, *, late, stop_request):
            before.append(torques())
            return step(state, late=late, stop_request=stop_request)

        law.step, law.look = counted, lambda: after.append(torques())
        with pytest.raises(ZeroDivisionError):
            live_through(drive, law, Interrupt())
    assert len(after) == 19 and all(b > a for a, b in zip(before, after, strict=False))


def test_a_wish_to_stop_holds_the_robot() -> None:
    robot, interrupt = StandIn(SPEC), Interrupt()
    with driving(robot) as drive:
        law = Law(robot.model.n, None, 0)
        step = law.step

        def stop_after(state, *, late, stop_request):
            interrupt.asked = len(robot.commands) > 60
            return step(state, late=late, stop_request=stop_request)

        law.step = stop_after
        live_through(drive, law, interrupt)
        assert law.ending == "interrupted"
        assert robot.modes()[-1] == POSITION


def test_the_supervisor_hears_why_the_robot_stopped_and_releases_it() -> None:
    robot = StandIn(SPEC)
    with driving(robot) as drive:
        law = Law(robot.model.n, None, 0)
        step, count = law.step, [0]

        def stopped_on_the_way(state, *, late, stop_request):
            count[0] += 1
            if count[0] == 20:
                robot.power(enabled=False)
                drive.started = time.monotonic()
            return step(state, late=late, stop_request=stop_request)

        law.step = stopped_on_the_way
        live_through(drive, law, Interrupt())
        assert law.halted is Event.ROBOT_DISABLED
        assert drive.since(drive.started) == []
