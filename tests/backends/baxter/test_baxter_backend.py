# SPDX-License-Identifier: BSD-3-Clause
"""Backend and control loop on a stub robot: how torque control begins, what every stop sends, how it ends."""

import time
from pathlib import Path
from types import SimpleNamespace
from unittest import mock

import numpy as np
import pytest

from impedance_modules.backends.baxter import baxter_backend as backend
from impedance_modules.backends.baxter import driver as watchdog
from impedance_modules.backends.baxter.driver import CHECK_PERIOD, PROCESS_PAUSE, Watchdog
from impedance_modules.backends.baxter.position_mode import ARRIVED
from impedance_modules.backends.computer import CpuIdleInhibitor
from impedance_modules.control.loop import Interrupt, run_loop
from impedance_modules.errors import RobotRefused, RobotStopped
from impedance_modules.safety.stop_levels import Event
from tests.support.baxter_stub import POSITION, SPEC, STALE, TORQUE, Drive, StubBaxter, driving, started


@pytest.fixture
def robot():
    return StubBaxter(SPEC)


@pytest.fixture
def begun(robot):
    """In torque mode; no torque has been sent yet."""
    with driving(robot) as drive:
        yield started(drive)


@pytest.fixture
def drive(begun):
    """In torque mode for five cycles."""
    begun.cycle(5)
    return begun


def test_torque_mode_begins_at_zero_after_time_out_and_rate_are_set(robot, begun) -> None:
    tried = [command for command in robot.commands if command.mode == TORQUE]
    assert len(tried) >= 3
    assert not np.any([command.values for command in tried])
    assert robot.timeouts[-1][1] == 0.05
    assert robot.timeouts[0][0] < tried[0].time
    assert robot.rates[0][1] == 100
    # Held until the law is ready, in position mode at the measured angles.
    time.sleep(0.05)
    assert robot.commands[-1].mode == POSITION
    assert np.allclose(robot.commands[-1].values, 0.3)
    begun.cycle(5, effort=2.0)
    assert robot.modes() == [TORQUE, POSITION, TORQUE]
    assert np.array_equal(robot.commands[-1].values, np.full(7, 2.0))
    assert {command.limb for command in robot.commands} == {"left"}


def test_the_first_torque_leaves_for_the_first_state_and_waits_for_no_other(robot, begun) -> None:
    begun.backend.newest()
    robot.frozen = True
    before = len(robot.commands)
    begun.backend.write(np.full(robot.model.n, 2.0))
    first = next(command for command in robot.commands[before:] if command.mode == TORQUE)
    assert np.array_equal(first.values, np.full(7, 2.0))


def test_the_loop_ticks_on_the_robots_states_and_catches_nothing_up(robot, begun) -> None:
    times = []
    for k in range(30):
        begun.backend.write(np.zeros(robot.model.n))
        if k == 10:
            time.sleep(0.08)
        state = begun.backend.read()
        if state is not None:
            times.append(state.time)
    assert (np.diff(times) > 0.0).all()
    # Eight periods slept through are one longer step, not eight short ones.
    assert max(np.diff(times)) > 0.04


def test_a_warm_up_cycle_runs_before_its_state_and_sends_nothing(robot, begun) -> None:
    sent = []
    begun.backend.warm_up_with(lambda: sent.append(len(robot.commands)))
    begun.cycle(20)
    # A few times per state at most, and not for one that is here already.
    assert 1 <= len(sent) <= 20 * backend.MOST_WARM_UPS
    begun.backend.write(np.zeros(robot.model.n))
    assert sent == sorted(sent) and len(robot.commands) > sent[-1]


def test_fast_states_need_no_warm_up(robot) -> None:
    warmed_up = []
    with driving(robot) as drive, mock.patch.object(backend, "COLD_AFTER", 0.02):
        drive.backend.warm_up_with(lambda: warmed_up.append(1))
        started(drive)
        drive.cycle(20)
    assert warmed_up == []


def test_no_state_is_none_in_time_and_not_forever(robot, begun) -> None:
    begun.cycle(3)
    robot.frozen = True
    begun.backend.read()
    began, misses = time.monotonic(), 0
    with pytest.raises(RobotStopped) as stop:
        while time.monotonic() - began < 3.0:
            misses += begun.backend.read() is None
    assert misses >= 5
    assert stop.value.event in (Event.STATE_LOST, Event.CONTROLLER_SILENT)


def test_a_frozen_robot_is_held_and_no_torque_is_repeated(robot, drive) -> None:
    robot.frozen = True
    frozen = time.monotonic()
    assert drive.until_stopped().event == Event.STATE_LOST
    time.sleep(0.1)
    late = [command for command in drive.since(frozen + STALE + 0.05) if command.mode == TORQUE]
    assert all(not np.any(command.values == 1.0) for command in late)
    assert robot.commands[-1].mode == POSITION


@pytest.mark.parametrize(
    "fields",
    [
        {"estop_button": 1, "stopped": True, "enabled": False},
        {"enabled": False},
        {"estop_source": 3, "stopped": True},
    ],
    ids=["e-stop", "disabled", "fault"],
)
def test_after_power_off_not_one_command_leaves(robot, drive, fields) -> None:
    robot.power(**fields)
    off = time.monotonic()
    assert drive.until_stopped().event == Event.ROBOT_DISABLED
    robot.power()
    time.sleep(0.1)
    drive.backend.finish("release")
    assert drive.since(off) == []


def test_a_collision_is_held_for_as_long_as_the_robot_pauses(robot, drive) -> None:
    robot.collide("left")
    hit = time.monotonic()
    robot.collide("left", False)
    assert drive.until_stopped().event == Event.COLLISION
    drive.backend.finish("hold")
    assert time.monotonic() - hit >= 2.0
    after = drive.since(hit + 0.02)
    assert {command.mode for command in after} == {POSITION}
    assert len(after) > 50


def test_a_squeezed_cuff_gets_nothing_until_it_is_let_go(robot, drive) -> None:
    robot.squeeze("left")
    squeezed = time.monotonic()
    assert drive.until_stopped().event == Event.CUFF
    time.sleep(0.05)
    assert drive.since(squeezed) == []
    robot.place("left_s0", 0.9)
    time.sleep(0.05)
    robot.squeeze("left", False)
    time.sleep(0.1)
    newest = drive.since(squeezed)[-1]
    assert newest.mode == POSITION
    assert newest.values[0] == pytest.approx(0.9)


def test_a_torque_that_is_not_finite_never_leaves(robot, drive) -> None:
    drive.backend.write(np.full(robot.model.n, np.nan))
    assert drive.until_stopped().event == Event.TORQUE_REFUSED
    assert all(np.isfinite(command.values).all() for command in robot.commands)


def test_the_watchdog_holds_while_the_controller_is_stuck(robot, drive) -> None:
    time.sleep(STALE + 0.1 + 20 * CHECK_PERIOD)  # the controller's thread does nothing
    assert robot.commands[-1].mode == POSITION
    assert drive.until_stopped().event == Event.CONTROLLER_SILENT


def test_a_run_ends_with_a_ramp_a_hold_and_the_robots_own_settings(robot, begun) -> None:
    begun.cycle(10, effort=4.0)
    end = time.monotonic()
    begun.backend.finish("hold")
    ramp = [command.values[0] for command in begun.since(end) if command.mode == TORQUE]
    assert len(ramp) >= 3
    assert (np.diff(ramp) <= 1e-12).all()
    assert ramp[-1] < 2.0
    holds = [command for command in begun.since(end) if command.mode == POSITION]
    assert len(holds) >= 5
    assert np.allclose(holds[-1].values, 0.3)
    assert robot.modes(end)[-1] == POSITION
    assert (robot.timeouts[-1][1], robot.rates[-1][1]) == (0.2, 100)
    assert not any(end.node == "/us" for end in (*robot.hub.publishers, *robot.hub.subscriptions))


def test_arms_elsewhere_are_refused_or_brought_there_slowly(robot) -> None:
    far = np.full(robot.model.n, 0.3)
    far[robot.model.limbs["left"].joints[0]] = 0.5
    refusal = pytest.raises(RobotRefused, match=r"left_s0 is -0\.200 rad.*--approach")
    with driving(robot, start=far) as drive, refusal:
        drive.backend.start()
    assert robot.commands == []
    robot = StubBaxter(SPEC)
    with driving(robot, start=far, approach=True) as drive:
        started(drive)
        path = np.array([command.values[0] for command in robot.commands if command.mode == POSITION])
        assert path[-1] == pytest.approx(0.5, abs=ARRIVED)  # it ends by holding where the arm is
        assert path.max() <= 0.5 + ARRIVED
        assert (np.diff(path[path < 0.499]) >= -1e-9).all()


def test_an_arm_that_drifts_at_zero_torque_is_not_driven(robot) -> None:
    robot.drift = 0.01
    refusal = pytest.raises(
        (RobotRefused, RobotStopped), match=r"does not carry it|from where the task begins"
    )
    with driving(robot) as drive, refusal:
        drive.backend.start()
    assert not np.any([command.values for command in robot.commands if command.mode == TORQUE])


def test_a_robot_that_does_not_keep_the_rate_is_refused(robot) -> None:
    robot.obeys_rate = False
    refusal = pytest.raises(RobotRefused, match=r"come at .* Hz, not at .* 500 Hz")
    with driving(robot, rate=500.0) as drive, refusal:
        drive.backend.start()
    assert robot.commands == []


def test_read_only_sends_nothing_at_all(robot) -> None:
    with driving(robot, read_only=True) as drive:
        started(drive)
        assert any(drive.backend.read() is not None for _ in range(10))
        drive.backend.finish("hold")
    assert robot.commands == robot.timeouts == robot.rates == []


def test_what_the_robot_adds_by_itself_is_recorded(robot, begun) -> None:
    names = begun.backend.extra_columns()
    values = dict(zip(names, begun.backend.extra_values(), strict=True))
    gravity = robot.model.gravity(np.full(robot.model.n, 0.3))
    left = [name for name in names if name.startswith("gravity.left")]
    assert len(left) == 7
    for name in left:
        assert values[name] == pytest.approx(gravity[robot.model.joint_names.index(name[8:])])


def is_open(path: Path) -> bool:
    """Whether this process has a file open: as long as that lasts, the kernel keeps the request."""
    return any(link.is_symlink() and link.readlink() == path for link in Path("/proc/self/fd").iterdir())


def test_cpu_idle_states_are_inhibited_during_a_run_only(robot, tmp_path) -> None:
    device = tmp_path / "latency"
    device.write_bytes(b"")
    inhibitor, refused = CpuIdleInhibitor(device), CpuIdleInhibitor(tmp_path / "none")
    for processor in (inhibitor, refused):
        processor.end()
        processor.begin()
        processor.begin()
    assert is_open(device)
    assert device.read_bytes() == bytes(4)
    inhibitor.end()
    assert not is_open(device)
    with driving(robot) as drive:
        drive.backend._idle_inhibitor = CpuIdleInhibitor(device)
        started(drive)
        assert is_open(device)
        drive.backend.finish("hold")
        assert not is_open(device)


@pytest.mark.parametrize(("pause", "waits"), [(2.0 * PROCESS_PAUSE, True), (0.0, False)])
def test_after_a_pause_of_the_process_messages_are_read_before_the_watchdog_acts(pause, waits) -> None:
    pauses: list[float] = []
    seen: list[int] = []
    checker = Watchdog(lambda: seen.append(len(pauses)))
    clock = iter(k * pause for k in range(1000))
    with (
        mock.patch.object(watchdog.time, "monotonic", lambda: next(clock)),
        mock.patch.object(watchdog.time, "sleep", pauses.append),
        mock.patch.object(
            checker._wake, "wait", lambda seconds: setattr(checker, "_stopped", len(seen) == 3)
        ),
    ):
        checker._watch()
    assert seen == ([1, 2, 3] if waits else [0, 0, 0])
    assert pauses == [CHECK_PERIOD] * (3 if waits else 0)


class StubSupervisor:
    """Asks for one torque until a stop is requested; ``before`` gets the number of every step."""

    def __init__(self, n: int, before=lambda k: None) -> None:
        self.assembly = SimpleNamespace(period=0.01, model=SimpleNamespace(n=n))
        self.ending, self.released, self.halted = None, False, None
        self.look, self.note = lambda: None, lambda text: None
        self._effort, self._before, self._steps = np.full(n, 1.5), before, 0

    def step(self, state, *, late, stop_request):
        self._steps += 1
        self._before(self._steps)
        if stop_request is not None or self._steps > 300:
            self.ending = "interrupted"
            return None
        return self._effort

    def halt(self, event: Event, detail: str) -> None:
        self.ending, self.halted, self.released = "stopped", event, event is Event.ROBOT_DISABLED


def run(drive: Drive, supervisor: StubSupervisor, interrupt: Interrupt | None = None) -> None:
    first = drive.backend.start().state
    ends = {"duration": None, "paced": False, "read_only": False}
    run_loop(supervisor, drive.backend, first, lambda *cycle: None, interrupt or Interrupt(), **ends)


def fail_at_20(k: int) -> None:
    if k == 20:
        raise ZeroDivisionError


def test_an_exception_in_the_controller_holds_the_robot(robot) -> None:
    with driving(robot) as drive:
        with pytest.raises(ZeroDivisionError):
            run(drive, StubSupervisor(robot.model.n, fail_at_20))
        assert robot.modes() == [TORQUE, POSITION, TORQUE, POSITION]


def test_touch_and_phases_wait_until_the_torque_has_left(robot) -> None:
    before, after = [], []

    def torques() -> int:
        return sum(command.mode == TORQUE for command in list(robot.commands))

    def counted(k: int) -> None:
        before.append(torques())
        fail_at_20(k)

    supervisor = StubSupervisor(robot.model.n, counted)
    supervisor.look = lambda: after.append(torques())
    with driving(robot) as drive, pytest.raises(ZeroDivisionError):
        run(drive, supervisor)
    assert len(after) == 19 and all(b > a for a, b in zip(before, after, strict=False))


def test_a_wish_to_stop_holds_the_robot(robot) -> None:
    interrupt = Interrupt()

    def ask(k: int) -> None:
        interrupt.asked = len(robot.commands) > 60

    supervisor = StubSupervisor(robot.model.n, ask)
    with driving(robot) as drive:
        run(drive, supervisor, interrupt)
        assert supervisor.ending == "interrupted"
        assert robot.modes()[-1] == POSITION


def test_the_supervisor_hears_why_the_robot_stopped_and_releases_it(robot) -> None:
    off = []

    def power_off(k: int) -> None:
        if k == 20:
            robot.power(enabled=False)
            off.append(time.monotonic())

    supervisor = StubSupervisor(robot.model.n, power_off)
    with driving(robot) as drive:
        run(drive, supervisor)
        assert supervisor.halted is Event.ROBOT_DISABLED
        assert drive.since(off[0]) == []
