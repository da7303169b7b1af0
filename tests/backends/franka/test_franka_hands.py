# SPDX-License-Identifier: BSD-3-Clause
"""Franka Hands over the maker's protocol, on simulated arms: orders carried out, replayed, not homed."""

import time
from pathlib import Path

import numpy as np
import pytest

from impedance_modules.control.assembly import assemble
from impedance_modules.episode.reader import read_episode
from impedance_modules.errors import RobotRefused
from impedance_modules.runs.arm_backends import franka_backend
from impedance_modules.runs.execution import RunOptions, RunResult, carry_out
from impedance_modules.runs.verify import verify
from impedance_modules.spec.connection_file import read_connection
from tests.support.baxter_process import ATTEMPTS, BUSY
from tests.support.franka_robot import write_robot, write_task
from tests.support.franka_simulator import NO_FRANKA, THING, SimulatedArms, simulated_arms

pytestmark = [pytest.mark.realtime, pytest.mark.skipif(bool(NO_FRANKA), reason=NO_FRANKA)]

ONE = ("right",)
PHASES = """phases:
  - {name: close, duration: 12, grippers: {right: {close: {force: 20}}}, until: {gripper: {right: held}}}
  - {name: part, duration: 12, grippers: {right: {width: 0.06}}, until: {gripper: {right: reached}}}
"""


@pytest.fixture(scope="module")
def arms():
    with simulated_arms(1) as simulated:
        yield simulated


def started(arms: SimulatedArms, folder: Path, time_out: float = 8.0):
    """Assembles the task and makes its backend, not yet started."""
    folder.mkdir(exist_ok=True)
    task = write_task(folder / "task.yaml", write_robot(folder / "robots" / "arms", ONE), ONE)
    file = folder / "robots" / "arms" / "robot.yaml"
    file.write_text(file.read_text().replace("time_out: 8", f"time_out: {time_out:g}"))
    task.write_text(task.read_text().split("phases:")[0] + PHASES)
    path = folder / "connection.yaml"
    path.write_text(arms.connection(ONE))
    assembly = assemble(str(task), effects=None, rate=100.0, scale=1.0, arm=None)
    connection = read_connection(path).franka
    assert connection is not None
    return assembly, franka_backend(assembly, connection, recover=False, read_only=False, approach=False)


def run(arms: SimulatedArms, folder: Path, fault: str, time_out: float) -> RunResult:
    """Runs the task with a fault, or a thing between the fingers."""
    arms.fault("home")
    time.sleep(0.5)
    assembly, backend = started(arms, folder, time_out)
    arms.fault(fault)
    options = RunOptions(folder / "out", 0, None, live=False, read_only=False, backend="franka")
    return carry_out(assembly, backend, options, lambda time, phase: None)


def carried_out(
    arms: SimulatedArms, folder: Path, fault: str, time_out: float = 8.0
) -> tuple[RunResult, Path]:
    """Runs the task; again where the machine's load stopped it."""
    for attempt in range(ATTEMPTS):
        result = run(arms, folder / f"attempt-{attempt}", fault, time_out)
        if not BUSY.search(result.reason):
            break
    return result, folder / f"attempt-{attempt}" / "out"


def test_a_hand_holds_parts_and_is_replayed_bit_for_bit(arms, tmp_path) -> None:
    result, out = carried_out(arms, tmp_path, "thing")
    assert result.summary["ending"] == "done", result.reason
    episode = read_episode(out)
    assert verify(episode, lambda part: None).samples == len(episode.time)
    state, width = (episode.extra[f"gripper.right.{part}"] for part in ("state", "width"))
    assert set(state) == {0.0, 1.0, 2.0}
    assert np.abs(width[state == 2.0] - THING).max() < 0.002
    assert abs(width[-1] - 0.06) < 0.002


def test_a_hand_that_was_not_homed_is_refused_before_anything_moves(arms, tmp_path) -> None:
    arms.fault("unhomed")
    _, backend = started(arms, tmp_path / "task")
    with pytest.raises(RobotRefused, match=r"by its homing it opens 0\.000 m, the robot file states 0\.08 m"):
        backend.start()
    arms.fault("home")
