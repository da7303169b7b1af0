# SPDX-License-Identifier: BSD-3-Clause
"""Electric grippers of a Baxter: orders become configure and go, faults stop; in one process, then over real ROS."""

import json
import re
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from impedance_modules.backends.baxter import topics
from impedance_modules.backends.baxter.gripper_link import GripperLink
from impedance_modules.backends.baxter.ros.messages import (
    EndEffectorCommand,
    EndEffectorProperties,
    EndEffectorState,
)
from impedance_modules.backends.baxter.simulator.electric_gripper import ElectricGripper, properties
from impedance_modules.backends.grippers import GripperReport, GripperState
from impedance_modules.episode.reader import read_episode
from impedance_modules.errors import RobotRefused
from impedance_modules.runs.verify import verify
from impedance_modules.spec.gripper_spec import GripperMotion, GripperOrder
from impedance_modules.spec.locate import find_task
from impedance_modules.spec.robot_reader import read_robot
from tests.support.baxter_process import (
    BUSY,
    MachineBusyError,
    again_when_busy,
    ended,
    impedance,
    simulator,
    start,
)
from tests.support.in_process_transport import InProcessMaster, InProcessTransport
from tests.support.ros_master import until

SPEC = read_robot("baxter").limbs["right"].gripper
assert SPEC is not None
CLOSE = GripperOrder("close", force=20.0, speed=0.05).motion(SPEC)
THING = 0.02
COMMAND = topics.gripper_command("right")


class Bench:
    """A simulated gripper and a link to it, without time and without a network; every ``live`` is 26 ms of it."""

    def __init__(self, *, time_out: float = 5.0) -> None:
        hub = InProcessMaster()
        robot, user = InProcessTransport(hub, "/robot"), InProcessTransport(hub, "/user")
        self.gripper = ElectricGripper(SPEC)
        self.commands: list[EndEffectorCommand] = []
        self.ignored = 0
        robot.subscribe(COMMAND, EndEffectorCommand, lambda message, _: self.take(message))
        self.states = robot.advertise(topics.gripper_state("right"), EndEffectorState)
        self.what = robot.advertise(topics.gripper_properties("right"), EndEffectorProperties, latch=True)
        self.what.send(properties())
        self.link = GripperLink(user, "right", replace(SPEC, time_out=time_out))
        self.link.attach()

    def take(self, command: EndEffectorCommand) -> None:
        self.commands.append(command)
        if self.ignored > 0:
            self.ignored -= 1
        else:
            self.gripper.take(command)

    def live(self) -> GripperReport:
        self.gripper.advance(0.026)
        if not self.gripper.silent:
            self.states.send(self.gripper.state(0))
        return self.link.report()

    def until(self, wanted: Callable[[GripperReport], bool], seconds: float = 3.0) -> GripperReport:
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            report = self.live()
            if wanted(report):
                return report
            time.sleep(0.001)
        raise AssertionError(report)


def rested(report: GripperReport) -> bool:
    return report.state in (GripperState.REST, GripperState.HELD)


def test_an_order_is_configured_before_it_goes_and_ends_by_the_gripper_s_own_state() -> None:
    bench = Bench()
    bench.gripper.body.thing = THING
    bench.live()
    bench.link.order(CLOSE)
    assert bench.live().state is GripperState.MOVING
    report = bench.until(rested)
    assert report.state is GripperState.HELD
    assert (report.width, report.force) == pytest.approx((THING, 20.0), abs=1e-3)
    assert [command.command for command in bench.commands] == ["configure", "go"]
    settings = json.loads(bench.commands[0].args)
    assert (
        settings["moving_force"] == settings["holding_force"] == pytest.approx(100.0 * 20.0 / 35.0, abs=1e-3)
    )
    assert settings["velocity"] == pytest.approx(50.0)
    assert json.loads(bench.commands[1].args) == {"position": 0.0}
    bench.link.order(GripperMotion(0.03, 0.1, None))
    report = bench.until(rested)
    assert report.state is GripperState.REST and report.width == pytest.approx(0.03, abs=0.002)


def test_a_command_that_is_not_answered_is_repeated_and_no_go_leaves_before() -> None:
    bench = Bench()
    bench.live()
    bench.ignored = 2
    bench.link.order(CLOSE)
    report = bench.until(rested)
    assert report.state is GripperState.REST and report.width == pytest.approx(0.0, abs=1e-6)
    assert [command.command for command in bench.commands] == ["configure"] * 3 + ["go"]
    assert len({command.sender for command in bench.commands}) == 2


def test_a_close_on_the_thing_already_held_waits_for_its_own_answer() -> None:
    bench = Bench()
    bench.gripper.body.thing = THING
    bench.live()
    bench.link.order(CLOSE)
    bench.until(rested)
    bench.ignored = 3
    bench.link.order(CLOSE)
    for _ in range(5):
        assert bench.live().state is GripperState.MOVING
    assert bench.until(rested).state is GripperState.HELD


def spoil_error(gripper: ElectricGripper) -> None:
    gripper.error = True


def spoil_calibration(gripper: ElectricGripper) -> None:
    gripper.calibrated = False


def spoil_silence(gripper: ElectricGripper) -> None:
    gripper.silent = True


@pytest.mark.parametrize(
    ("spoil", "why"),
    [
        (spoil_error, "it reports an error"),
        (spoil_calibration, "it reports that it is not calibrated"),
        (spoil_silence, "no end of its order within 0.3 s, the fingers"),
    ],
)
def test_what_goes_wrong_on_the_way_fails_and_stays_failed(spoil, why: str) -> None:
    bench = Bench(time_out=0.3)
    bench.live()
    bench.link.order(CLOSE)
    bench.live()
    spoil(bench.gripper)
    report = bench.until(lambda report: report.state is GripperState.FAILED)
    assert why in report.why
    bench.gripper.error, bench.gripper.calibrated, bench.gripper.silent = False, True, False
    assert bench.live().why == report.why
    sent = len(bench.commands)
    bench.link.close()
    bench.live()
    assert len(bench.commands) == sent


def test_a_gripper_that_falls_silent_at_rest_fails_within_a_second_or_so() -> None:
    bench = Bench()
    bench.live()
    bench.gripper.silent = True
    assert "no report for 1." in bench.until(lambda report: report.state is GripperState.FAILED).why


@pytest.mark.parametrize(
    ("spoil", "why"),
    [
        (spoil_error, "it reports an error"),
        (spoil_calibration, "not calibrated"),
        (lambda gripper: None, ""),
    ],
)
def test_only_a_fit_gripper_passes_the_preflight_check(spoil, why: str) -> None:
    bench = Bench()
    assert "nothing comes on" in bench.link.check(ordered=True).found
    spoil(bench.gripper)
    bench.live()
    result = bench.link.check(ordered=True)
    assert result.passed is (why == "") and why in result.found
    assert bench.link.check(ordered=False).passed is (True if why == "" else None)
    assert bench.commands == []


def test_another_kind_of_gripper_is_refused() -> None:
    bench = Bench()
    bench.live()
    bench.what.send(replace(properties(), ui_type=EndEffectorProperties.SUCTION_CUP_GRIPPER))
    assert "a suction cup is mounted" in bench.link.check(ordered=True).found


def test_commands_that_nobody_takes_are_refused() -> None:
    user = InProcessTransport(InProcessMaster(), "/user")
    link = GripperLink(user, "right", SPEC)
    link.attach()
    with pytest.raises(RobotRefused, match="nobody listens to /robot/end_effector/right_gripper/command"):
        link.refuse_without_subscriber()


BAXTER = ("--backend", "baxter", "--rate", "100")
PHASES = """phases:
  - {name: close, duration: 12, grippers: {right: {close: {force: 20}}}, until: {gripper: {right: held}}}
  - {name: part, duration: 12, grippers: {right: {width: 0.03}}, until: {gripper: {right: reached}}}
"""


def write_task(folder: Path) -> str:
    text = find_task("pick-and-place").read_text()
    text = re.sub(r"\nobject: .*", "", text).split("phases:")[0]
    text = text.replace("initial: 0.95, max: 1.9", "initial: 40, max: 80")
    # Stable at 100 Hz, at which a busy machine still keeps up.
    text = text.replace("x: 300, y: 300, z: 300", "x: 150, y: 150, z: 150")
    path = folder / "grip.yaml"
    path.write_text(text + PHASES)
    return str(path)


def run(task: str, out: Path) -> tuple[int, str]:
    """Runs a task on the simulated Baxter: exit code, and what it said on one line."""
    done = impedance("run", task, *BAXTER, "--out", str(out), seconds=120.0)
    said = re.sub(r"\s+", " ", done.stdout + done.stderr)
    if done.returncode == 3 and BUSY.search(said):
        raise MachineBusyError(said)
    return done.returncode, said


@pytest.mark.ros
@again_when_busy
def test_over_ros_a_gripper_holds_parts_and_is_replayed_bit_for_bit(master: str, tmp_path: Path) -> None:
    task, out = write_task(tmp_path), tmp_path / "out"
    with simulator(tmp_path, master, "--posture", task, "--enabled", "--fault", f"thing right {THING}"):
        code, said = run(task, out)
    assert code == 0, said
    episode = read_episode(out)
    assert verify(episode, lambda part: None).samples == len(episode.time)
    state, width = (episode.extra[f"gripper.right.{part}"] for part in ("state", "width"))
    assert set(state) == {0.0, 1.0, 2.0}
    assert np.abs(width[state == 2.0] - THING).max() < 0.002
    assert abs(width[-1] - 0.03) < 0.002


@pytest.mark.ros
def test_over_ros_a_gripper_that_is_not_calibrated_is_refused_before_anything_moves(
    master: str, tmp_path: Path
) -> None:
    task = write_task(tmp_path)
    with simulator(
        tmp_path, master, "--posture", task, "--enabled", "--fault", "gripper-uncalibrated right"
    ) as robot:
        done = impedance("run", task, *BAXTER, "--out", str(tmp_path / "out"))
        said = re.sub(r"\s+", " ", done.stdout + done.stderr)
        assert done.returncode == 2, said
        assert "gripper right: it reports that it is not calibrated (valid:" in said
        assert all(count == 0 for count in robot.last()["commands"].values())
    assert not (tmp_path / "out").exists()


@pytest.mark.ros
@pytest.mark.parametrize(
    ("fault", "why"),
    [("gripper-error right", "it reports an error"), ("gripper-silent right", "no report for 1.")],
)
@again_when_busy
def test_over_ros_a_gripper_that_fails_stops_the_run_with_the_reason(
    fault: str, why: str, master: str, tmp_path: Path
) -> None:
    task, out = write_task(tmp_path), tmp_path / "out"
    with simulator(tmp_path, master, "--posture", task, "--enabled") as robot:
        process = start("run", task, *BAXTER, "--out", str(out))
        # Nothing is between the fingers: they have closed, and the first phase waits until the fault.
        until(lambda: process.poll() is not None or robot.seconds_of_torque() > 2.0, 60.0)
        robot.fault(fault)
        code, said = ended(process, why)
    assert code == 3 and "gripper failed" in said and why in said, said
