# SPDX-License-Identifier: BSD-3-Clause
"""The user's path through the command line: check, run, look, replay; and every way to get it wrong."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from impedance_modules.episode.file_format import write_episode
from impedance_modules.episode.reader import read_episode
from tests.support.forecast_tasks import SOFT_HANDS
from tests.support.log_metadata import log_metadata
from tests.support.paths import CHECKOUT

SHORT = f"""\
format: 1
name: short-hold
robot: baxter
{SOFT_HANDS}\
safety: {{tank: {{initial: 2.0, max: 4, floor: 0.5}}}}
phases:
  - {{name: hold, duration: 0.3}}
  - {{name: lift, equilibrium: {{right.hand: {{z: 0.06}}, left.hand: {{z: 0.06}}}}, duration: 0.5}}
"""


COMMAND = [sys.executable, "-m", "impedance_modules"]
ENVIRONMENT = {**os.environ, "PYTHONPATH": str(CHECKOUT)}


def impedance(*words: str, cwd: Path, code: int = 0) -> subprocess.CompletedProcess[str]:
    """Runs a verb, which must end with this code."""
    how = {"capture_output": True, "text": True, "timeout": 300}
    done = subprocess.run([*COMMAND, *words], cwd=cwd, env=ENVIRONMENT, check=False, **how)
    assert done.returncode == code, done.stdout + done.stderr
    return done


def summary_of(run: Path) -> dict:
    return json.loads((run / "summary.json").read_text())


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("user")
    (folder / "short.yaml").write_text(SHORT)
    return folder


@pytest.fixture(scope="module")
def finished(folder: Path) -> Path:
    found = impedance("run", "short.yaml", "--out", "out", cwd=folder)
    assert "the task was carried out" in found.stdout
    return folder / "out"


def test_a_run_leaves_all_its_files(finished: Path) -> None:
    files = {"episode.parquet", "recording.rrd", "summary.json", "picture.png"}
    assert {path.name for path in finished.iterdir()} >= files
    summary = summary_of(finished)
    assert summary["ending"] == "done"
    assert [phase["name"] for phase in summary["phases"]] == ["hold", "lift"]
    episode = read_episode(finished)
    assert episode.complete
    assert len(episode) == summary["cycles"]


def test_every_torque_can_be_computed_again(finished: Path) -> None:
    found = impedance("replay", "--verify", str(finished), cwd=finished.parent)
    assert "bit-equal" in found.stdout


def test_a_changed_torque_is_found(finished: Path, tmp_path: Path) -> None:
    table = pq.read_table(finished / "episode.parquet")
    name = "effort_command.right_e1"
    values = table[name].to_pylist()
    values[400] += 1e-12
    place = table.schema.get_field_index(name)
    pq.write_table(table.set_column(place, name, pa.array(values)), tmp_path / "episode.parquet")
    found = impedance("replay", "--verify", str(tmp_path), cwd=tmp_path, code=4)
    assert "right_e1" in found.stderr
    assert "sample 400" in found.stderr


def test_a_recording_can_be_the_robot(finished: Path, tmp_path: Path) -> None:
    """The same states give the same torques, sample by sample."""
    task = str(finished.parent / "short.yaml")
    impedance("run", task, "--backend", "replay", "--log", str(finished), "--out", "again", cwd=tmp_path)
    first, second = read_episode(finished), read_episode(tmp_path / "again")
    for joint, effort in first.effort_command.items():
        assert (effort == second.effort_command[joint]).all()


def test_an_episode_is_never_overwritten(finished: Path) -> None:
    before = (finished / "episode.parquet").read_bytes()
    found = impedance("run", "short.yaml", "--out", "out", cwd=finished.parent, code=2)
    assert "episode" in found.stderr
    assert (finished / "episode.parquet").read_bytes() == before


def test_ctrl_c_brakes_holds_and_keeps_the_files(folder: Path) -> None:
    (folder / "long.yaml").write_text(SHORT.replace("duration: 0.5}", "duration: 500}"))
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    command = [*COMMAND, "run", "long.yaml", "--out", "stopped"]
    process = subprocess.Popen(command, cwd=folder, env=ENVIRONMENT, **pipes)
    stopped = folder / "stopped"
    for _ in range(6000):
        if any(stopped.glob("episode.part-*")):
            break
        time.sleep(0.1)
    process.send_signal(signal.SIGINT)
    output, errors = process.communicate(timeout=120)
    assert process.returncode == 130, errors
    assert "Traceback" not in errors
    assert read_episode(stopped).complete
    summary = summary_of(stopped)
    assert summary["ending"] == "interrupted"
    assert "interrupt" in summary["reason"]
    assert "interrupt" in output


def test_a_phase_not_met_is_exit_3_with_the_reason(folder: Path) -> None:
    text = SHORT.replace("duration: 0.5}", "duration: 0.5, until: {contact: true}}")
    (folder / "nothing-there.yaml").write_text(text)
    found = impedance("run", "nothing-there.yaml", "--out", "unmet", cwd=folder, code=3)
    assert "no contact within its 0.5 s" in found.stdout
    assert read_episode(folder / "unmet").complete


def test_an_unstable_loop_runs_in_a_simulation_that_allows_it(folder: Path) -> None:
    """At 200 Hz box-hold is refused with its line; allowed, it ends with exit 3, says so, and can be computed again."""
    found = impedance("run", "box-hold", "--rate", "200", "--out", "no", cwd=folder, code=2)
    assert "box-hold.yaml:13:7: arms.right.springs" in found.stderr and "unstable" in found.stderr
    assert not (folder / "no").exists()
    allowed = ("run", "box-hold", "--rate", "200", "--allow-unstable")
    found = impedance(*allowed, "--out", "shaken", cwd=folder, code=3)
    summary, episode = summary_of(folder / "shaken"), read_episode(folder / "shaken")
    assert summary["allow_unstable"] is True and episode.metadata["allow_unstable"] is True
    assert summary["reason"] and summary["reason"].split("(")[0] in found.stdout
    impedance("replay", "--verify", "shaken", cwd=folder)
    found = impedance(*allowed, "--backend", "baxter", "--out", "real", cwd=folder, code=2)
    assert "--allow-unstable" in found.stderr


def test_the_time_given_to_a_run_ends_it_safely(folder: Path) -> None:
    impedance("run", "short.yaml", "--duration", "0.2", "--out", "timed", cwd=folder)
    assert read_episode(folder / "timed").time[-1] < 0.5


def test_a_robot_whose_links_have_no_shapes_is_recorded_as_well(folder: Path) -> None:
    found = impedance("run", "one-joint", "--duration", "0.2", "--out", "wheel", cwd=folder)
    assert found.returncode == 0, found.stderr
    assert set(read_episode(folder / "wheel").pose) == {"hub"}
    assert (folder / "wheel" / "recording.rrd").stat().st_size > 1000


def test_read_only_computes_and_sends_nothing(folder: Path) -> None:
    impedance("run", "short.yaml", "--read-only", "--duration", "0.3", "--out", "quiet", cwd=folder)
    assert summary_of(folder / "quiet")["cycles"] > 200


def test_one_arm_runs_alone_and_softer(folder: Path) -> None:
    options = ("--arm", "right", "--scale", "0.5", "--rate", "500", "--seed", "3")
    impedance("run", "short.yaml", *options, "--out", "one", cwd=folder)
    episode = read_episode(folder / "one")
    assert set(episode.pose) == {"right_hand"}
    assert abs(episode.time[1] - episode.time[0] - 0.002) < 1e-9


BAD = {
    "no such task": ("run", "no-such-task"),
    "no such arm": ("run", "short.yaml", "--arm", "middle"),
    "scale above one": ("run", "short.yaml", "--scale", "2"),
    "scale zero": ("run", "short.yaml", "--scale", "0"),
    "rate too high": ("run", "short.yaml", "--rate", "5000"),
    "negative duration": ("run", "short.yaml", "--duration", "-1"),
    "no such patch": ("run", "short.yaml", "--effects", "nothing.yaml"),
    "a directory": ("run", "."),
    "replay without a log": ("run", "short.yaml", "--backend", "replay"),
    "unknown option": ("run", "short.yaml", "--fast"),
    "unknown verb": ("walk",),
    "no recording": ("replay", "--verify", "nowhere"),
    "not a recording": ("replay", "--verify", "short.yaml"),
}


@pytest.mark.parametrize("arguments", BAD.values(), ids=BAD.keys())
def test_bad_input_is_exit_2_and_leaves_nothing(folder: Path, arguments: tuple[str, ...]) -> None:
    before = set(folder.iterdir())
    found = impedance(*arguments, cwd=folder, code=2)
    assert found.stderr.strip()
    assert "Traceback" not in found.stderr
    assert set(folder.iterdir()) == before


def test_a_log_without_a_task_cannot_be_verified(folder: Path) -> None:
    rows = {"time": np.arange(5) / 100.0, "position.right_s0": np.zeros(5)}
    write_episode(folder / "foreign.parquet", rows, log_metadata(robot="baxter", effort_source=None))
    found = impedance("replay", "--verify", "foreign.parquet", cwd=folder, code=2)
    assert "no task" in found.stderr


@pytest.mark.parametrize("solver", ["proxsuite", "qpsolvers:daqp"])
def test_another_solver_is_a_line_in_the_robot_file(tmp_path: Path, solver: str) -> None:
    robot = tmp_path / "robots" / "baxter"
    shutil.copytree(CHECKOUT / "robots" / "baxter", robot)
    text = (robot / "robot.yaml").read_text()
    (robot / "robot.yaml").write_text(text.replace("solver: daqp", f"solver: {solver}"))
    (tmp_path / "short.yaml").write_text(SHORT)
    impedance("run", "short.yaml", "--duration", "0.2", "--out", "out", cwd=tmp_path)
