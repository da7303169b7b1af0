# SPDX-License-Identifier: BSD-3-Clause
"""Tasks on simulated FR3 arms over the maker's protocol: carried out, replayed bit for bit, stopped, refused."""

import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from impedance_modules.backends.franka.commands import LARGEST_STEP
from impedance_modules.control.assembly import assemble
from impedance_modules.episode.reader import read_episode
from impedance_modules.errors import RobotRefused
from impedance_modules.runs.arm_backends import franka_backend
from impedance_modules.runs.execution import RunOptions, RunResult, carry_out
from impedance_modules.runs.verify import verify
from impedance_modules.spec.connection_file import read_connection
from tests.support.baxter_process import ATTEMPTS, BUSY
from tests.support.franka_robot import write_robot, write_task
from tests.support.franka_simulator import NO_FRANKA, SimulatedArms, simulated_arms

pytestmark = [pytest.mark.realtime, pytest.mark.skipif(bool(NO_FRANKA), reason=NO_FRANKA)]

PAIR = ("right", "left")
IMPEDANCE = [sys.executable, "-m", "impedance_modules"]


@pytest.fixture(scope="module")
def arms():
    with simulated_arms(2) as simulated:
        yield simulated


@pytest.fixture(autouse=True)
def sound(request) -> None:
    """No fault and no pose is left over from the test before."""
    if "arms" in request.fixturenames:
        simulated = request.getfixturevalue("arms")
        for k in range(2):
            simulated.fault("home", k)
        time.sleep(0.2)


def given_task(folder: Path, limbs: tuple[str, ...] = PAIR, seconds: float = 1.2) -> Path:
    robot = write_robot(folder / "robots" / "arms", limbs)
    return write_task(folder / "task.yaml", robot, limbs, seconds)


def backend_of(folder: Path, task: Path, connection: str, arm=None, **asked):
    """Assembles a task and makes its backend."""
    path = folder / "connection.yaml"
    path.write_text(connection)
    assembly = assemble(str(task), effects=None, rate=100.0, scale=1.0, arm=arm)
    options = {"recover": False, "read_only": False, "approach": False, **asked}
    return assembly, franka_backend(assembly, read_connection(path).franka, **options)


def run(folder: Path, task: Path, connection: str, on_progress=None, arm=None, **asked) -> RunResult:
    assembly, backend = backend_of(folder, task, connection, arm, **asked)
    options = RunOptions(
        folder / "out", 0, None, live=False, read_only=asked.get("read_only", False), backend="franka"
    )
    return carry_out(assembly, backend, options, on_progress or (lambda time, phase: None))


def carried_out(arms: SimulatedArms, folder: Path, task: Path, **asked) -> Path:
    """Runs a task to its end; again, from the start, where the machine's load stopped it. Returns its folder."""
    for attempt in range(ATTEMPTS):
        out = folder / f"attempt-{attempt}"
        out.mkdir()
        result = run(out, task, arms.connection(PAIR), **asked)
        if result.summary["ending"] == "done":
            break
        assert BUSY.search(result.reason), result.reason
        for k in range(2):
            arms.fault("home", k)
        time.sleep(0.2)
    assert result.summary["ending"] == "done", result.reason
    return out / "out"


def refusal(folder: Path, task: Path, connection: str, **asked) -> str:
    _, backend = backend_of(folder, task, connection, **asked)
    with pytest.raises(RobotRefused) as found:
        backend.start()
    return str(found.value)


def command(folder: Path, task: Path, connection: str) -> list[str]:
    (folder / "connection.yaml").write_text(connection)
    return [
        *IMPEDANCE, "run", str(task), "--backend", "franka", "--rate", "100",
        "--connection", str(folder / "connection.yaml"), "--out", str(folder / "out"),
    ]  # fmt: skip


def begin(folder: Path, arms: SimulatedArms) -> subprocess.Popen:
    """Starts a run from the command line and waits until it records."""
    task = given_task(folder, seconds=20.0)
    process = subprocess.Popen(
        command(folder, task, arms.connection(PAIR)),
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    for _ in range(600):
        if list((folder / "out").rglob("*.parquet")) or process.poll() is not None:
            break
        time.sleep(0.1)
    assert process.poll() is None, process.communicate()[0]
    return process


def test_a_task_on_a_pair_is_carried_out_and_replayed_bit_for_bit(arms, tmp_path) -> None:
    episode = read_episode(carried_out(arms, tmp_path, given_task(tmp_path)))
    assert episode.metadata["backend"] == "franka"
    assert verify(episode, lambda part: None).samples == len(episode.time)
    for limb in PAIR:
        sent = np.column_stack([episode.extra[f"sent.{limb}_joint{k}"] for k in range(1, 8)])
        assert np.abs(sent[0]).max() <= 4 * LARGEST_STEP
        assert np.abs(sent).max() > 0.5
        assert episode.position[f"{limb}_joint1"][-1] > 0.08
        assert set(episode.extra[f"fresh_torque.{limb}"]) <= {0.0, 1.0}
        assert np.max(episode.extra[f"answer_time.{limb}"]) > 0.0


def test_one_arm_of_a_pair_moves_and_the_other_is_watched(arms, tmp_path) -> None:
    episode = read_episode(carried_out(arms, tmp_path, given_task(tmp_path), arm="left"))
    assert np.ptp(episode.position["left_joint1"]) > 0.05
    assert np.ptp(episode.position["right_joint1"]) < 0.005
    assert not np.any(episode.extra["sent.right_joint4"])


def test_read_only_sends_nothing(arms, tmp_path) -> None:
    run(tmp_path, given_task(tmp_path, seconds=0.5), arms.connection(PAIR), read_only=True)
    episode = read_episode(tmp_path / "out")
    assert np.ptp(episode.position["left_joint1"]) < 0.005
    assert not np.any(episode.extra["sent.left_joint4"])


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        ("reflex", "joint_reflex"),
        ("user_stop", "left"),
        ("mute", "no state"),
        ("unplug", "backend lost|no state"),
        ("nan", "not finite"),
    ],
)
def test_a_fault_of_one_arm_stops_both_with_the_reason(arms, tmp_path, fault, words) -> None:
    def inject(time: float, phase: str) -> None:
        if time > 0.3:
            arms.fault(fault, 1)

    result = run(tmp_path, given_task(tmp_path, seconds=20.0), arms.connection(PAIR), inject)
    assert result.summary["ending"] == "stopped"
    assert re.search(words, result.reason)
    assert len(read_episode(tmp_path / "out").time) > 10


def test_a_run_that_is_killed_leaves_the_arms_at_rest_and_idle(arms, tmp_path) -> None:
    process = begin(tmp_path, arms)
    time.sleep(0.5)
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    time.sleep(1.5)
    # Idle and still, or these checks would refuse it.
    assembly, backend = backend_of(tmp_path, tmp_path / "task.yaml", arms.connection(PAIR))
    try:
        state = backend.start().state
    finally:
        backend.finish("hold")
    assert np.abs(state.position - assembly.modules.posture).max() < 0.1


def test_ctrl_c_brakes_ends_torque_mode_and_keeps_the_files(arms, tmp_path) -> None:
    process = begin(tmp_path, arms)
    time.sleep(0.3)
    process.send_signal(signal.SIGINT)
    text, _ = process.communicate(timeout=60)
    assert process.returncode == 130, text
    assert json.loads((tmp_path / "out" / "summary.json").read_text())["ending"] == "interrupted"


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        ("reflex", "mode left: stopped by a reflex (valid: look why it stopped, then 'run --recover')"),
        ("user_stop", "mode left: stopped by its user (valid: release the stop"),
        ("guiding", "mode left: guided by hand (valid: let go of the enabling device"),
        ("nan", "weight left: at rest, torques differ from our model's weight by up to nan N.m"),
    ],
)
def test_a_robot_that_must_not_be_moved_is_refused(arms, tmp_path, fault, words) -> None:
    arms.fault(fault, 1)
    said = refusal(tmp_path, given_task(tmp_path), arms.connection(PAIR))
    assert words in said
    assert "nothing was sent" in said and "right:" not in said


def test_a_reflex_is_recovered_from_only_when_asked_for(arms, tmp_path) -> None:
    arms.fault("reflex", 0)
    carried_out(arms, tmp_path, given_task(tmp_path, seconds=0.4), recover=True)


def test_the_arms_are_brought_to_the_start_only_when_asked_for(arms, tmp_path) -> None:
    task = given_task(tmp_path, seconds=0.4)
    task.write_text(task.read_text().replace("j4: -2.0", "j4: -1.8"))
    said = refusal(tmp_path, task, arms.connection(PAIR))
    assert "right_joint4 is 0.200 rad away from where the task begins (valid: within 0.1 rad" in said
    out = carried_out(arms, tmp_path, task, approach=True)
    start = read_episode(out).position["left_joint4"][0]
    assert abs(start + 1.8) < 0.05


def test_another_robot_is_refused_by_its_weight(arms, tmp_path) -> None:
    task = given_task(tmp_path)
    urdf = tmp_path / "robots" / "arms" / "arms.urdf"
    urdf.write_text(urdf.read_text().replace('mass value="0.73"', 'mass value="2.73"'))
    said = refusal(tmp_path, task, arms.connection(PAIR))
    assert "weight right: at rest, torques differ from our model's weight by up to" in said
    assert "weight left" in said


def test_a_robot_that_cannot_be_reached_is_refused_with_the_remedy(arms, tmp_path) -> None:
    away = arms.connection(PAIR).replace(arms.addresses[1], "127.255.255.9")
    said = refusal(tmp_path, given_task(tmp_path), away)
    assert "left (127.255.255.9)" in said and "FCI activated in Desk" in said and "right" not in said


def test_a_computer_that_is_not_in_real_time_is_refused_unless_that_is_accepted(arms, tmp_path) -> None:
    if (Path("/sys/kernel/realtime")).exists():
        return
    strict = arms.connection(PAIR).replace("realtime: optional", "realtime: required")
    assert "a kernel with PREEMPT_RT" in refusal(tmp_path, given_task(tmp_path), strict)


def test_a_robot_that_does_not_carry_its_arm_is_refused(tmp_path) -> None:
    with simulated_arms(1, "--falling") as falling:
        said = refusal(tmp_path, given_task(tmp_path, ("right",)), falling.connection(("right",)))
    assert "at zero torque: the robot does not carry it" in said


def test_another_version_of_the_makers_software_is_refused(tmp_path) -> None:
    with simulated_arms(1, "--old") as old:
        said = refusal(tmp_path, given_task(tmp_path, ("right",)), old.connection(("right",)))
    assert "ncompatible" in said and "the pylibfranka whose version" in said
