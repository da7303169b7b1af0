# SPDX-License-Identifier: BSD-3-Clause
"""Backend and control loop on a stub robot: how torque control begins, what every stop sends, how it ends."""

from __future__ import annotations

import time
from pathlib import Path
from types import SimpleNamespace
from unittest import mock

import numpy as np
import pytest

from impedance_modules.backends.baxter import baxter_backend as backend
from impedance_modules.backends.baxter import driver as watchdog
from impedance_modules.backends.baxter.baxter_backend import CpuIdleInhibitor
from impedance_modules.backends.baxter.driver import CHECK_PERIOD, PROCESS_PAUSE, Watchdog
from impedance_modules.backends.baxter.position_mode import ARRIVED
from impedance_modules.control.loop import Interrupt, run_loop
from impedance_modules.errors import RobotRefused, RobotStopped
from impedance_modules.safety.stop_levels import Event
from tests.support.baxter_stub import POSITION, SPEC, STALE, TORQUE, Drive, StubBaxter, driving, started


def test_torque_mode_begins_at_zero_after_time_out_and_rate_are_set() -> None:
    robot = StubBaxter(SPEC)
    with driving(robot) as drive:
        started(drive)
        tried = [values for _, _, mode, values in robot.commands if mode == TORQUE]
        assert len(tried) >= 3
        assert not np.any(tried)
        assert robot.timeouts[-1][1] == 0.05
        assert robot.timeouts[0][0] < next(c[0] for c in robot.commands if c[2] == TORQUE)
        assert robot.rates[0][1] == 100
        # Held until the law is ready, in position mode at the measured angles.
        time.sleep(0.05)
        assert robot.commands[-1][2] == POSITION
        assert np.allclose(robot.commands[-1][3], 0.3)
        drive.cycle(5, effort=2.0)
        assert robot.modes() == [TORQUE, POSITION, TORQUE]
        assert np.array_equal(robot.commands[-1][3], np.full(7, 2.0))
        assert {command[1] for command in robot.commands} == {"left"}


def test_the_first_torque_leaves_for_the_first_state_and_waits_for_no_other() -> None:
    robot = StubBaxter(SPEC)
    with driving(robot) as drive:
        started(drive)
        drive.backend.newest()
        robot.frozen = True
        before = len(robot.commands)
        drive.backend.write(np.full(robot.model.n, 2.0))
        first = next(command for command in robot.commands[before:] if command[2] == TORQUE)
        assert np.array_equal(first[3], np.full(7, 2.0))


def test_the_loop_ticks_on_the_robots_states_and_catches_nothing_up() -> None:
    robot = StubBaxter(SPEC)
    with driving(robot) as drive:
        started(drive)
        times = []
        for k in range(30):
            drive.backend.write(np.zeros(robot.model.n))
            if k == 10:
                time.sleep(0.08)
            state = drive.backend.read()
            if state is not None:
                times.append(state.time)
        assert (np.diff(times) > 0.0).all()
        # Eight periods slept through are one longer step, not eight short ones.
        assert max(np.diff(times)) > 0.04


def test_a_warm_up_cycle_runs_before_its_state_and_sends_nothing() -> None:
    robot, sent = StubBaxter(SPEC), []
    with driving(robot) as drive:
        started(drive)
        drive.backend.warm_up_with(lambda: sent.append(len(robot.commands)))
        drive.cycle(20)
        # A few times per state at most, and not for one that is here already.
        assert 1 <= len(sent) <= 20 * backend.MOST_WARM_UPS
        drive.backend.write(np.zeros(robot.model.n))
        assert sent == sorted(sent) and len(robot.commands) > sent[-1]


def test_fast_states_need_no_warm_up() -> None:
    robot, warmed_up = StubBaxter(SPEC), []
    with driving(robot) as drive, mock.patch.object(backend, "COLD_AFTER", 0.02):
        drive.backend.warm_up_with(lambda: warmed_up.append(1))
        started(drive)
        drive.cycle(20)
    assert warmed_up == []


def test_no_state_is_none_in_time_and_not_forever() -> None:
    robot = StubBaxter(SPEC)
    with driving(robot) as drive:
        started(drive)
        drive.cycle(3)
        robot.frozen = True
        drive.backend.read()
        began = time.monotonic()
        misses = 0
        with pytest.raises(RobotStopped) as stop:
            while time.monotonic() - began < 3.0:
                misses += drive.backend.read() is None
        assert misses >= 5
        assert stop.value.event in (Event.STATE_LOST, Event.CONTROLLER_SILENT)


def test_a_frozen_robot_is_braked_then_held_and_no_torque_is_repeated() -> None:
    robot = StubBaxter(SPEC)
    with driving(robot) as drive:
        started(drive)
        drive.cycle(5)
        robot.frozen = True
        frozen = time.monotonic()
        stop = drive.until_stopped()
        assert stop.event == Event.STATE_LOST
        time.sleep(0.1)
        late = [c for c in drive.since(frozen + STALE + 0.05) if c[2] == TORQUE]
        assert all(not np.any(values == 1.0) for _, _, _, values in late)
        assert robot.commands[-1][2] == POSITION


@pytest.mark.parametrize(
    "fields",
    [
        {"estop_button": 1, "stopped": True, "enabled": False},
        {"enabled": False},
        {"estop_source": 3, "stopped": True},
    ],
    ids=["e-stop", "disabled", "fault"],
)
def test_after_power_off_not_one_command_leaves(fields) -> None:
    robot = StubBaxter(SPEC)
    with driving(robot) as drive:
        started(drive)
        drive.cycle(5)
        robot.power(**fields)
        off = time.monotonic()
        stop = drive.until_stopped()
        assert stop.event == Event.ROBOT_DISABLED
        robot.power()
        time.sleep(0.1)
        drive.backend.finish("release")
        assert drive.since(off) == []


def test_a_collision_is_held_for_as_long_as_the_robot_pauses() -> None:
    robot = StubBaxter(SPEC)
    with driving(robot) as drive:
        started(drive)
        drive.cycle(5)
        robot.collide("left")
        hit = time.monotonic()
        robot.collide("left", False)
        assert drive.until_stopped().event == Event.COLLISION
        drive.backend.finish("hold")
        assert time.monotonic() - hit >= 2.0
        after = drive.since(hit + 0.02)
        assert {command[2] for command in after} == {POSITION}
        assert len(after) > 50


def test_a_squeezed_cuff_gets_nothing_until_it_is_let_go() -> None:
    robot = StubBaxter(SPEC)
    with driving(robot) as drive:
        started(drive)
        drive.cycle(5)
        robot.squeeze("left")
        squeezed = time.monotonic()
        assert drive.until_stopped().event == Event.CUFF
        time.sleep(0.05)
        assert drive.since(squeezed) == []
        robot.place({"left_s0": 0.9})
        time.sleep(0.05)
        robot.squeeze("left", False)
        time.sleep(0.1)
        assert drive.since(squeezed)[-1][2] == POSITION
        assert drive.since(squeezed)[-1][3][0] == pytest.approx(0.9)


def test_a_torque_that_is_not_finite_never_leaves() -> None:
    robot = StubBaxter(SPEC)
    with driving(robot) as drive:
        started(drive)
        drive.cycle(5)
        drive.backend.write(np.full(robot.model.n, np.nan))
        assert drive.until_stopped().event == Event.TORQUE_REFUSED
        assert all(np.isfinite(command[3]).all() for command in robot.commands)


def test_the_watchdog_holds_while_the_controller_is_stuck() -> None:
    robot = StubBaxter(SPEC)
    with driving(robot) as drive:
        started(drive)
        drive.cycle(5)
        time.sleep(STALE + 0.1 + 20 * CHECK_PERIOD)  # the controller's thread does nothing
        assert robot.commands[-1][2] == POSITION
        assert drive.until_stopped().event == Event.CONTROLLER_SILENT


def test_a_run_ends_with_a_ramp_a_hold_and_the_robots_own_settings() -> None:
    robot = StubBaxter(SPEC)
    with driving(robot) as drive:
        started(drive)
        drive.cycle(10, effort=4.0)
        end = time.monotonic()
        drive.backend.finish("hold")
        ramp = [c[3][0] for c in drive.since(end) if c[2] == TORQUE]
        assert len(ramp) >= 3
        assert (np.diff(ramp) <= 1e-12).all()
        assert ramp[-1] < 2.0
        holds = [c for c in drive.since(end) if c[2] == POSITION]
        assert len(holds) >= 5
        assert np.allclose(holds[-1][3], 0.3)
        assert robot.modes(end)[-1] == POSITION
        assert robot.timeouts[-1][1] == 0.2
        assert robot.rates[-1][1] == 100
        assert not any(p.node == "/us" for p in robot.hub.publishers)
        assert not any(s.node == "/us" for s in robot.hub.subscriptions)


def test_arms_elsewhere_are_refused_or_brought_there_slowly() -> None:
    robot = StubBaxter(SPEC)
    far = np.full(robot.model.n, 0.3)
    far[robot.model.limbs["left"].joints[0]] = 0.5
    with (
        driving(robot, start=far) as drive,
        pytest.raises(RobotRefused, match=r"left_s0 is -0\.200 rad.*--approach"),
    ):
        drive.backend.start()
    assert robot.commands == []
    robot = StubBaxter(SPEC)
    with driving(robot, start=far, approach=True) as drive:
        started(drive)
        way = np.array([c[3][0] for c in robot.commands if c[2] == POSITION])
        assert way[-1] == pytest.approx(0.5, abs=ARRIVED)  # it ends by holding where the arm is
        assert way.max() <= 0.5 + ARRIVED
        assert (np.diff(way[way < 0.499]) >= -1e-9).all()


def test_an_arm_that_drifts_at_zero_torque_is_not_driven() -> None:
    robot = StubBaxter(SPEC)
    with driving(robot) as drive:
        robot.drift = 0.01
        with pytest.raises((RobotRefused, RobotStopped)) as refusal:
            drive.backend.start()
    assert "does not carry it" in str(refusal.value) or "from where the task begins" in str(refusal.value)
    assert not np.any([values for _, _, mode, values in robot.commands if mode == TORQUE])


def test_a_robot_that_does_not_keep_the_rate_is_refused() -> None:
    robot = StubBaxter(SPEC)
    robot.obeys_rate = False
    with (
        driving(robot, rate=500.0) as drive,
        pytest.raises(RobotRefused, match=r"come at .* Hz, not at .* 500 Hz"),
    ):
        drive.backend.start()
    assert robot.commands == []


def test_read_only_sends_nothing_at_all() -> None:
    robot = StubBaxter(SPEC)
    with driving(robot, read_only=True) as drive:
        started(drive)
        states = [drive.backend.read() for _ in range(10)]
        assert any(state is not None for state in states)
        drive.backend.finish("hold")
    assert robot.commands == []
    assert robot.timeouts == []
    assert robot.rates == []


def test_what_the_robot_adds_by_itself_is_recorded() -> None:
    robot = StubBaxter(SPEC)
    with driving(robot) as drive:
        started(drive)
        names = drive.backend.extra_columns()
        left = [name for name in names if name.startswith("gravity.left")]
        assert len(left) == 7
        values = dict(zip(names, drive.backend.extra_values(), strict=True))
        gravity = robot.model.gravity(np.full(robot.model.n, 0.3))
        for name in left:
            assert values[name] == pytest.approx(gravity[robot.model.joint_names.index(name[8:])])


def test_cpu_idle_states_are_inhibited_during_a_run_only(tmp_path: Path) -> None:
    device = tmp_path / "latency"
    device.write_bytes(b"")
    inhibitor, refused = CpuIdleInhibitor(device), CpuIdleInhibitor(tmp_path / "none")
    for processor in (inhibitor, refused):
        processor.end()
        processor.begin()
        processor.begin()
    assert inhibitor.active and not refused.active
    assert device.read_bytes() == bytes(4)
    inhibitor.end()
    assert not inhibitor.active
    robot = StubBaxter(SPEC)
    with driving(robot) as drive:
        drive.backend._idle_inhibitor = CpuIdleInhibitor(device)
        started(drive)
        assert drive.backend._idle_inhibitor.active
        drive.backend.finish("hold")
        assert not drive.backend._idle_inhibitor.active


@pytest.mark.parametrize(("pause", "waits"), [(2.0 * PROCESS_PAUSE, True), (0.0, False)])
def test_after_a_pause_of_the_process_messages_are_read_before_the_watchdog_acts(
    pause: float, waits: bool
) -> None:
    naps: list[float] = []
    seen: list[int] = []
    dog = Watchdog(lambda: seen.append(len(naps)))
    clock = iter(k * pause for k in range(1000))
    with (
        mock.patch.object(watchdog.time, "monotonic", lambda: next(clock)),
        mock.patch.object(watchdog.time, "sleep", naps.append),
        mock.patch.object(dog._wake, "wait", lambda seconds: setattr(dog, "_stopped", len(seen) == 3)),
    ):
        dog._watch()
    assert seen == ([1, 2, 3] if waits else [0, 0, 0])
    assert naps == [CHECK_PERIOD] * (3 if waits else 0)


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
        """Ignored."""


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
    robot = StubBaxter(SPEC)
    with driving(robot) as drive:
        with pytest.raises(ZeroDivisionError):
            live_through(drive, Law(robot.model.n, ZeroDivisionError(), 20), Interrupt())
        assert robot.modes() == [TORQUE, POSITION, TORQUE, POSITION]


def test_touch_and_phases_wait_until_the_torque_has_left() -> None:
    robot, before, after = StubBaxter(SPEC), [], []
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
    robot, interrupt = StubBaxter(SPEC), Interrupt()
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
    robot = StubBaxter(SPEC)
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
