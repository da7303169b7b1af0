# SPDX-License-Identifier: BSD-3-Clause
"""What must happen when something goes wrong while a task runs, over a real ROS master; and power on and off.

The simulated Baxter runs in a process of its own; its event log, on its own clock, is the evidence.
"""

import re
import signal
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from impedance_modules.backends.baxter.ros.master_client import MasterClient
from impedance_modules.backends.baxter.ros.messages import JointCommand, JointState
from impedance_modules.backends.baxter.ros.socket_transport import SocketTransport
from impedance_modules.cli.main import impedance as command_line
from impedance_modules.errors import BadInput
from tests.support.baxter_process import (
    ATTEMPTS,
    MachineBusyError,
    SimulatorProcess,
    again_when_busy,
    end,
    ended,
    impedance,
    simulator,
    start,
)
from tests.support.ros_master import TRANSPORTS, forget

pytestmark = pytest.mark.ros

RATE = 200
TIME_OUT = 0.05
"""What a run at 200 Hz sets."""


RUN = ("run", "soft-hold", "--backend", "baxter", "--rate", str(RATE))
READY = ("--posture", "soft-hold", "--enabled")


@contextmanager
def running(
    tmp_path: Path, master: str, *options: str, transport: str = "sockets"
) -> Iterator[tuple[SimulatorProcess, subprocess.Popen[str]]]:
    """A simulated Baxter that a task has been commanding for half a second."""
    with simulator(tmp_path, master, *READY, *options) as robot:
        process = start_run(robot, transport, tmp_path)
        try:
            yield robot, process
        finally:
            end(process)
            forget(master, f"/impedance_run_{process.pid}")


def start_run(robot: SimulatorProcess, transport: str, folder: Path) -> subprocess.Popen[str]:
    """Starts a task and waits until it is under way; tries again where a busy machine has made it give up."""
    for attempt in range(ATTEMPTS):
        process = start(*RUN, "--transport", transport, "--out", str(folder / f"run-{attempt}"))
        while process.poll() is None and robot.seconds_of_torque() < 0.5:
            signal.sigtimedwait([], 0.02)
        if process.poll() is None:
            return process
    text, _ = process.communicate()
    raise MachineBusyError(f"{text}{robot.said}")


def kill(robot: SimulatorProcess, process: subprocess.Popen[str]) -> None:
    """Ends a run without a word while its torques come; tries again where a late cycle had ended them before."""
    process.kill()
    if process.wait(10) != -signal.SIGKILL:
        raise MachineBusyError("it had ended by itself")
    after = robot.last()
    if after["last_torque"] != after["last_command"]:
        raise MachineBusyError("its torques had ended before")


@pytest.mark.long
@pytest.mark.parametrize("result", ["hold", "disable", "float"])
@again_when_busy
def test_the_robots_time_out_acts_when_the_controller_is_killed(tmp_path, master, result) -> None:
    with running(tmp_path, master, "--time-out-result", result) as (robot, process):
        kill(robot, process)
        reaction = robot.wait_for(f"no command for {TIME_OUT:g} s: {result}")
        silence = reaction["time"] - max(reaction["last_command"].values())
        assert silence <= TIME_OUT + 0.02
        after = robot.last()
        assert after["enabled"] == (result != "disable")
        assert after["modes"]["right"] == ("floats" if result == "float" else "holds")


@pytest.mark.long
@pytest.mark.parametrize("transport", TRANSPORTS)
@again_when_busy
def test_registrations_of_a_killed_run_are_ignored(tmp_path: Path, master: str, transport: str) -> None:
    with running(tmp_path, master, transport=transport) as (robot, killed):
        kill(robot, killed)
        robot.wait_for("no command for")
        check = impedance("baxter", "check", "--transport", transport)
        said = re.sub(r"[\s│]+", "", check.stdout)
        left = f"aregistrationof/impedance_run_{killed.pid},whichnolongeranswers,isignored"
        assert check.returncode == 0 and left in said, check.stdout + check.stderr
        end(start_run(robot, transport, tmp_path / "again"))


@pytest.mark.long
@pytest.mark.parametrize("fault", ["silence", "freeze"])
def test_no_torque_is_sent_after_100_ms_without_states(tmp_path: Path, master: str, fault: str) -> None:
    with running(tmp_path, master) as (robot, process):
        robot.fault(fault)
        silent = robot.wait_for(f"fault: {fault}")
        code, text = ended(process, "no state")
        assert code == 3 and "no state" in text, text
        assert max(robot.last()["last_torque"].values()) <= silent["time"] + 0.1
        # Gripper messages went on all the time.
        assert robot.lines()[-1]["enabled"]


@again_when_busy
def test_nothing_is_sent_after_an_emergency_stop(tmp_path: Path, master: str) -> None:
    with running(tmp_path, master, transport="auto") as (robot, process):
        robot.fault("estop")
        pressed = robot.wait_for("fault: estop")
        code, text = ended(process, "e-stop")
        assert code == 3 and "e-stop" in text, text
        robot.fault("estop-release")
        after = robot.last()
        # The robot says so every 10 ms; what was under way then is all that may still come.
        assert max(after["last_command"].values()) <= pressed["time"] + 0.03
        assert after["stopped"] and not after["enabled"]


@pytest.mark.long
@pytest.mark.parametrize(
    ("fault", "reason"),
    [("cuff right", "cuff"), ("push right 0 0 -80 0.2", "collision"), ("joint-fault", "joint fault")],
)
@again_when_busy
def test_the_robots_own_stops_end_the_run(tmp_path: Path, master: str, fault: str, reason: str) -> None:
    with running(tmp_path, master) as (robot, process):
        robot.fault(fault)
        stopped = robot.wait_for("fault:")
        code, text = ended(process, reason)
        assert code == 3 and reason in text, text
        assert max(robot.last()["last_torque"].values()) <= stopped["time"] + 0.2


@pytest.mark.long
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@again_when_busy
def test_a_person_ends_the_run_and_the_arms_are_held(tmp_path: Path, master: str, number: int) -> None:
    with running(tmp_path, master) as (robot, process):
        process.send_signal(number)
        code, text = ended(process, "asked to stop")
        assert code == 130 and "asked to stop" in text, text
        after = robot.last()
        assert after["enabled"] and after["modes"]["right"] == "holds"
        # Left in position mode, not by the time-out of torque mode.
        assert max(after["last_command"].values()) > max(after["last_torque"].values())
    assert list(tmp_path.glob("run-*/episode.parquet"))


REFUSED = [
    (["--posture", "soft-hold"], "baxter enable"),
    ([*READY, "--fault", "duplicate"], "/another_robot"),
    ([*READY, "--fault", "wrong-md5"], "std_msgs/Bool"),
    ([*READY, "--fault", "partial"], "never reported"),
    ([*READY, "--fault", "nan"], "not finite"),
    ([*READY, "--software-version", "1.1.1"], "1.1.1"),
    ([*READY, "--mount-offset", "left=0,0,0.09"], "mount"),
    (["--posture", "tucked", "--enabled"], "untuck"),
    (["--posture", "neutral", "--enabled"], "--approach"),
]


@pytest.mark.long
@pytest.mark.parametrize(("options", "reason"), REFUSED, ids=[reason for _, reason in REFUSED])
def test_an_unfit_robot_is_refused_before_anything_is_sent(tmp_path, master, options, reason) -> None:
    with simulator(tmp_path, master, *options) as robot:
        run = impedance(*RUN, "--out", str(tmp_path / "run"))
        assert run.returncode == 2 and reason in run.stderr, run.stdout + run.stderr
        assert "Traceback" not in run.stderr
        assert robot.last()["commands"]["right"] == 0 and not (tmp_path / "run" / "episode.parquet").exists()


@pytest.mark.long
@pytest.mark.parametrize("transport", TRANSPORTS)
def test_limits_that_disagree_are_refused_before_anything_is_sent(tmp_path, master, transport) -> None:
    with simulator(tmp_path, master, *READY) as robot:
        client = MasterClient(master, "/somebody")
        served = str(client.get_parameter("/robot_description"))
        client.set_parameter("/robot_description", served.replace('lower="-2.147"', 'lower="-1.147"'))
        run = impedance("run", "soft-hold", "--backend", "baxter", "--transport", transport)
        assert run.returncode == 2 and "lower limit -1.147 rad, robot.yaml says -2.147" in run.stderr
        assert robot.last()["commands"]["right"] == 0


def test_a_registration_of_an_ended_node_is_no_second_robot(tmp_path: Path, master: str) -> None:
    with simulator(tmp_path, master, "--posture", "neutral", "--enabled", "--fault", "dead"):
        check = impedance("baxter", "check")
        assert check.returncode == 0 and "realtime_loop_of_yesterday" in re.sub(r"[\s│]+", "", check.stdout)


def test_zero_torque_holds_the_pose(tmp_path: Path, master: str) -> None:
    with simulator(tmp_path, master, "--posture", "neutral", "--enabled") as robot:
        node = SocketTransport("/zero_torque", master)
        seen: list[JointState] = []
        node.subscribe("/robot/joint_states", JointState, lambda m, _: seen.append(m))
        command = node.advertise("/robot/limb/left/joint_command", JointCommand)
        joints = tuple(f"left_{short}" for short in ("s0", "s1", "e0", "e1", "w0", "w1", "w2"))
        while robot.lines()[-1]["commands"]["left"] < 300:
            command.send(JointCommand(JointCommand.TORQUE_MODE, (0.0,) * 7, joints))
            signal.sigtimedwait([], 0.005)
        node.close()
        arms = [m for m in seen if "left_s0" in m.name]
        moved = np.ptp([m.position for m in arms], axis=0)
        assert len(arms) > 100 and moved.max() < 5e-3


def refuse(words: str, *reasons: str) -> None:
    """A verb of the Baxter ends with exit 2 and these reasons."""
    refused = impedance("baxter", *words.split())
    assert refused.returncode == 2, refused.stdout + refused.stderr
    assert all(reason in refused.stderr for reason in reasons), refused.stderr


def switch(said: str, *words: str) -> None:
    """A verb of the Baxter says just that."""
    done = impedance("baxter", *words)
    assert (done.returncode, done.stdout) == (0, f"{said}\n"), done.stderr


def test_power_goes_on_and_off_only_as_told(master: str, tmp_path: Path) -> None:
    with simulator(tmp_path, master) as robot:
        refuse("enable", "--tucked", "right_s1 at -2.1")
        assert not robot.last()["enabled"]
        switch("enabled", "enable", "--tucked")
        robot.fault("estop")
        refuse("enable --reset --tucked", "turn the e-stop button")
        robot.fault("estop-release")
        robot.wait_for("estop-release")
        refuse("enable --tucked", "enable --reset")
        assert not robot.lines()[-1]["enabled"]
        switch("enabled", "enable", "--reset", "--tucked", "--transport", "sockets")
        switch("disabled", "disable")


@pytest.mark.long
@pytest.mark.parametrize(
    ("options", "reason"),
    [(["--software-version", "1.1.1"], "1.1.1"), (["--mount-offset", "left=0,0,0.09"], "mount")],
)
def test_another_robot_gets_no_power(master: str, tmp_path: Path, options: list[str], reason: str) -> None:
    with simulator(tmp_path, master, "--posture", "tucked", *options) as robot:
        for words in ("enable --tucked", "untuck --enable"):
            refuse(words, reason, "(valid: ")
        assert not robot.last()["enabled"]
        assert not [line for line in robot.lines() if "enabled" in line["event"]]


def test_two_robots_are_refused(master: str, tmp_path: Path) -> None:
    with simulator(tmp_path, master, "--posture", "neutral", "--fault", "duplicate"):
        refuse("enable", "/another_robot")


def test_no_robot_on_the_master(master: str) -> None:
    # Whether it says "nobody" or names somebody long gone depends on what earlier tests left with the master.
    refuse("enable", "no /robot/state", "ROS_MASTER_URI")


def test_invalid_simulator_options_are_refused_before_it_starts(master: str) -> None:
    for words, part in (
        (("--fault", "estopp"), "did you mean 'estop'"),
        (("--posture", "standing"), "tucked"),
        (("--mount-offset", "left=1"), "LIMB=X,Y,Z"),
        (("--mount-offset", "lef=0,0,0.01"), "did you mean 'left'"),
        (("--mount-offset", "left=0,0,9"), "at most 0.1 m"),
        (("--duration", "0"), "above 0"),
    ):
        with pytest.raises(BadInput, match=part.replace("?", ".")):
            command_line.main(["baxter", "fake", *words], standalone_mode=False)


def test_no_master_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_MASTER_URI", "http://127.0.0.1:9")
    for verb in ("fake", "enable", "disable"):
        refuse(verb, "127.0.0.1:9")
