# SPDX-License-Identifier: BSD-3-Clause
"""Tasks on a simulated robot behind ROS 2 topics: carried out, replayed bit for bit, stopped, refused."""

import time
from pathlib import Path

import numpy as np
import pytest

from impedance_modules.control.assembly import assemble
from impedance_modules.episode.reader import read_episode
from impedance_modules.errors import BadFile, BadInput, RobotRefused
from impedance_modules.robot.model import RobotModel
from impedance_modules.runs.arm_backends import ros2_backend
from impedance_modules.runs.execution import RunOptions, RunResult, carry_out
from impedance_modules.runs.verify import verify
from impedance_modules.spec.connection_file import read_connection
from impedance_modules.spec.robot_reader import read_robot
from tests.support.baxter_process import ATTEMPTS, BUSY
from tests.support.commands import refusal as refused
from tests.support.paths import CHECKOUT
from tests.support.ros2_robot import NO_ROS2, ROS2_PYTHON, own_domain, simulated_robot

RATE = 200.0
TOPIC = "/forward_effort_controller/commands"
JOINTS = tuple(f"panda_joint{k}" for k in range(1, 8))

over_ros2 = [pytest.mark.realtime, pytest.mark.skipif(bool(NO_ROS2), reason=NO_ROS2)]


def given_task(folder: Path, seconds: float = 1.2) -> Path:
    folder.mkdir(exist_ok=True)
    path = folder / "task.yaml"
    path.write_text(
        f"""format: 1
name: lean
description: The arm leans to one side.
robot: panda
arms:
  right:
    posture: {{joint1: 0, joint2: 0.3, joint3: 0, joint4: -2, joint5: 0, joint6: 2.3, joint7: 0.8}}
    joint_bias:
      stiffness: {{joint1: 60, joint2: 60, joint3: 40, joint4: 40, joint5: 10, joint6: 10, joint7: 10}}
      damping_ratio: 0.7
safety: {{tank: {{initial: 4, max: 8, floor: 0.3}}}}
phases:
  - {{name: hold, duration: {0.25 * seconds}}}
  - {{name: lean, posture: {{right: {{joint1: 0.15, joint4: -1.9}}}}, duration: {0.5 * seconds}}}
  - {{name: rest, duration: {0.25 * seconds}}}
"""
    )
    return path


def connection(gravity: str = "robot", joints=JOINTS, more: str = "", effort: str = "with_weight") -> str:
    listed = ", ".join(joints)
    return (
        f"format: 1\nros2:\n  gravity: {gravity}\n  effort: {effort}\n"
        f"  controllers: [{{topic: {TOPIC}, joints: [{listed}]}}]\n"
        f"  python: {ROS2_PYTHON or 'none'}\n"
        f"  watch: {{patience: 0.2, stale: 0.4, oldest: 0.8, least_share: 0.3}}\n{more}"
    )


@pytest.fixture(autouse=True)
def alone(monkeypatch) -> None:
    """The nodes of a test hear no others."""
    for key, value in own_domain().items():
        monkeypatch.setenv(key, value)


def backend_of(folder: Path, task: Path, text: str, read_only: bool = False):
    (folder / "connection.yaml").write_text(text)
    assembly = assemble(str(task), effects=None, rate=RATE, scale=1.0, arm=None)
    part = read_connection(folder / "connection.yaml").ros2
    assert part is not None
    return assembly, ros2_backend(assembly, part, read_only)


def run(folder: Path, task: Path, text: str, on_progress=None, read_only: bool = False) -> RunResult:
    assembly, backend = backend_of(folder, task, text, read_only)
    options = RunOptions(folder / "out", 0, None, live=False, read_only=read_only, backend="ros2")
    return carry_out(assembly, backend, options, on_progress or (lambda time, phase: None))


def carried_out(folder: Path, text: str, **robot) -> Path:
    """Runs a task to its end; again, with a new robot, where the machine's load stopped it. Returns its folder."""
    for attempt in range(ATTEMPTS):
        out = folder / f"attempt-{attempt}"
        task = given_task(out)
        with simulated_robot(task, RATE, **robot):
            result = run(out, task, text)
        if result.summary["ending"] == "done":
            break
        assert BUSY.search(result.reason), result.reason
    assert result.summary["ending"] == "done", result.reason
    return out / "out"


def refusal(folder: Path, text: str, **robot) -> str:
    task = given_task(folder / "refused")
    with simulated_robot(task, RATE, **robot):
        _, backend = backend_of(folder, task, text)
        with pytest.raises(RobotRefused) as found:
            backend.start()
    return str(found.value)


class TestRuns:
    pytestmark = over_ros2

    def test_a_task_is_carried_out_and_replayed_bit_for_bit(self, tmp_path) -> None:
        episode = read_episode(carried_out(tmp_path, connection()))
        assert episode.metadata["backend"] == "ros2"
        assert verify(episode, lambda part: None).samples == len(episode.time)
        assert episode.position["panda_joint1"][-1] > 0.1
        assert not np.any(episode.extra["weight.panda_joint2"])

    def test_the_order_of_the_controllers_joints_is_the_files(self, tmp_path) -> None:
        order = list(reversed(JOINTS))
        episode = read_episode(carried_out(tmp_path, connection(joints=order), joints=order))
        assert episode.position["panda_joint1"][-1] > 0.1

    def test_a_robot_that_does_not_carry_its_arm_is_carried(self, tmp_path) -> None:
        episode = read_episode(carried_out(tmp_path, connection("controller"), carries=False))
        assert episode.position["panda_joint1"][-1] > 0.1
        assert np.abs(episode.extra["weight.panda_joint2"]).min() > 1.0

    def test_a_weight_that_efforts_leave_out_is_added_to_the_recording(self, tmp_path) -> None:
        text = connection(effort="without_weight")
        episode = read_episode(carried_out(tmp_path, text, effort="without_weight"))
        model = RobotModel(read_robot(CHECKOUT / "robots" / "panda"))
        first = np.array([episode.position[joint][0] for joint in model.joint_names])
        found = np.array([episode.effort[joint][0] for joint in model.joint_names])
        np.testing.assert_allclose(found, model.gravity(first), atol=1.0)
        reported = [episode.extra[f"reported_effort.{joint}"][0] for joint in model.joint_names]
        assert np.abs(found).max() > 10.0 and np.abs(reported).max() < 1.0

    @pytest.mark.parametrize(
        ("word", "reported", "remedy"),
        [
            ("with_weight", "without_weight", "(valid: effort: without_weight"),
            ("without_weight", "with_weight", "(valid: effort: with_weight"),
            ("with_weight", "amperes", "(valid: efforts in N.m, not motor currents in A"),
            ("without_weight", "amperes", "(valid: efforts in N.m, not motor currents in A"),
        ],
    )
    def test_efforts_that_are_not_what_their_word_says_are_refused(
        self, tmp_path, word, reported, remedy
    ) -> None:
        said = refusal(tmp_path, connection(effort=word), effort=reported)
        assert f"effort right: effort: {word}, but panda_joint" in said and remedy in said

    @pytest.mark.parametrize(("fault", "words"), [("mute", "no state"), ("nan", "no state")])
    def test_states_that_stop_end_the_run_calmly(self, tmp_path, fault, words) -> None:
        task = given_task(tmp_path / "task", seconds=20.0)
        with simulated_robot(task, RATE) as robot:
            result = run(tmp_path, task, connection(), lambda t, _: robot.fault(fault) if t > 0.3 else None)
        assert result.summary["ending"] == "stopped" and words in result.reason

    @pytest.mark.parametrize("fault", ["doubled", "disordered"])
    def test_messages_that_come_again_or_out_of_order_are_dropped_and_counted(self, tmp_path, fault) -> None:
        task = given_task(tmp_path / "task", seconds=0.8)
        with simulated_robot(task, RATE) as robot:
            run(tmp_path, task, connection(), lambda t, _: robot.fault(fault) if t > 0.1 else None)
        episode = read_episode(tmp_path / "out")
        word = {"doubled": "doubled", "disordered": "out_of_order"}[fault]
        assert episode.extra[f"dropped.{word}"][-1] >= 1
        assert np.all(np.diff(episode.time) > 0.0)

    def test_read_only_publishes_nothing(self, tmp_path) -> None:
        task = given_task(tmp_path / "task", seconds=0.5)
        with simulated_robot(task, RATE):
            run(tmp_path, task, connection(), read_only=True)
        assert np.ptp(read_episode(tmp_path / "out").position["panda_joint1"]) < 0.01

    @pytest.mark.parametrize(
        ("gravity", "robot", "words"),
        [
            (
                "robot",
                {"carries": False},
                "with gravity: robot the arm's weight is carried by nobody, or twice",
            ),
            ("controller", {}, "with gravity: controller the arm's weight is carried by nobody, or twice"),
            ("robot", {"topic": "/elsewhere"}, f"controller {TOPIC}: nobody listens"),
            ("robot", {"without": ["panda_joint3"]}, "never reported on /joint_states: panda_joint3"),
            ("robot", {"empty": ["tau"]}, "/joint_states leaves effort empty"),
        ],
    )
    def test_a_robot_that_must_not_be_moved_is_refused(self, tmp_path, gravity, robot, words) -> None:
        assert words in refusal(tmp_path, connection(gravity), **robot)

    def test_a_robot_that_is_not_there_is_refused(self, tmp_path) -> None:
        _, backend = backend_of(tmp_path, given_task(tmp_path / "task"), connection())
        with pytest.raises(RobotRefused, match="nobody publishes /joint_states"):
            backend.start()

    def test_a_process_that_dies_stops_the_run(self, tmp_path) -> None:
        task = given_task(tmp_path / "task", seconds=20.0)
        with simulated_robot(task, RATE):
            assembly, backend = backend_of(tmp_path, task, connection())

            def kill(t: float, phase: str) -> None:
                if t > 0.3 and backend._link is not None:
                    backend._link._process.kill()
                    time.sleep(0.05)

            options = RunOptions(tmp_path / "out", 0, None, live=False, read_only=False, backend="ros2")
            result = carry_out(assembly, backend, options, kill)
        assert result.summary["ending"] == "stopped" and "backend lost" in result.reason


def test_a_python_without_rclpy_is_refused(tmp_path) -> None:
    text = connection().replace(f"python: {ROS2_PYTHON or 'none'}", "python: /no/python")
    _, backend = backend_of(tmp_path, given_task(tmp_path / "task"), text)
    with pytest.raises(RobotRefused, match="the path of a Python that can import rclpy"):
        backend.start()


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (connection(joints=JOINTS[:5]), "no controller takes panda_joint6, panda_joint7"),
        (connection(joints=(*JOINTS, "joint9")), "joint 'joint9' is none of robot 'panda'"),
        (connection(more="  names: {elbow: x}\n"), "joint 'elbow' is none of robot 'panda'"),
    ],
)
def test_a_file_that_does_not_fit_the_robot_is_refused(tmp_path, text, words) -> None:
    with pytest.raises(BadInput, match=words):
        backend_of(tmp_path, given_task(tmp_path / "task"), text)


def test_who_carries_the_weight_must_be_said(tmp_path) -> None:
    path = tmp_path / "lab.yaml"
    path.write_text(connection("somebody"))
    with pytest.raises(BadFile, match="look the robot up in docs/ros2") as found:
        read_connection(path)
    assert f"{path}:3:" in str(found.value)


def test_what_efforts_hold_must_be_said(tmp_path) -> None:
    path = tmp_path / "lab.yaml"
    path.write_text(connection(effort="currents"))
    with pytest.raises(BadFile, match="with the wrong word contact is felt at rest"):
        read_connection(path)
    path.write_text(connection().replace("  effort: with_weight\n", ""))
    with pytest.raises(BadFile, match="effort"):
        read_connection(path)


def test_the_command_line_asks_for_a_connection_file(tmp_path) -> None:
    task = given_task(tmp_path / "task")
    assert "neither topics nor who carries the arm's weight are known" in refused(
        "run", task, "--backend", "ros2"
    )
    assert "an effort controller knows no positions" in refused(
        "run", task, "--backend", "ros2", "--approach"
    )
