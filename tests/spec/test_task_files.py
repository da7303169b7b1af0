# SPDX-License-Identifier: BSD-3-Clause
"""Task files: the design's example, every broken fixture, finding tasks and robots."""

import functools
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml

from impedance_modules.errors import BadFile, BadInput
from impedance_modules.spec.gripper_spec import GripperCondition, GripperOrder
from impedance_modules.spec.locate import find_robot, find_schema, find_task, list_robots
from impedance_modules.spec.robot_reader import read_robot
from impedance_modules.spec.task import ContactCondition, HybridAxis, ReachedCondition, Sine, SmoothCondition
from impedance_modules.spec.task_reader import read_task
from tests.support.paths import EVERY_KEY, PRESS_BOX, TESTS

BROKEN = sorted((TESTS / "broken_tasks").glob("*.yaml"))

cached_robot = functools.lru_cache(read_robot)

EXPECT = re.compile(r"# expect (\d+):(\d+) \| (\S+) \| (.*?)(?: \| valid: (.*))?")


def test_there_are_enough_broken_fixtures():
    assert len(BROKEN) >= 60


@pytest.mark.parametrize("path", BROKEN, ids=lambda path: path.stem)
def test_a_broken_task_gets_exactly_the_expected_problems(path):
    lines = path.read_bytes().decode("utf-8", "replace").split("\n")
    expected = [found.groups() for line in lines if (found := EXPECT.fullmatch(line))]
    assert expected, "a fixture begins with its expectations"
    with pytest.raises(BadInput) as caught:
        read_task(path, cached_robot)
    found = caught.value.problems
    for (line, column, place, fragment, valid), problem in zip(expected, found, strict=True):
        assert (problem.line, problem.column) == (int(line), int(column)), problem
        assert (problem.path or "(file)") == place
        assert fragment in problem.message
        assert set(valid.split(", ") if valid else ()) <= set(problem.valid)
        assert str(problem).startswith(f"{path}:{line}:{column}: ")


def test_the_designs_example_reads_as_it_is_written():
    task, robot = read_task(PRESS_BOX, cached_robot)
    right, left = task.arms["right"], task.arms["left"]
    assert robot.name == task.robot == "baxter"
    assert right.springs[0].stiffness.tolist() == np.diag([300, 300, 50, 10, 10, 10]).tolist()
    assert right.springs[0].axes == {"z": HybridAxis(force=-12.0, speed_limit=0.1)}
    assert left.posture["s0"] == -right.posture["s0"] and left.posture["s1"] == right.posture["s1"]
    assert left.springs[0].frame == "left_hand" and left.springs[0].axes["z"].force == -12.0
    assert left.joint_bias == right.joint_bias
    assert task.object.held_by == ("left", "right") and task.object.grasp == "weld"
    assert (task.tank.initial, task.tank.max, task.tank.floor) == (5.0, 10.0, 0.5)
    lower, slide = task.phases
    assert lower.equilibrium == {"object": {"z": -0.05}} and lower.otherwise == "stop"
    assert lower.until == ContactCondition(present=True, force=None, time=None, target=None)
    assert slide.equilibrium["object"]["y"] == Sine(amplitude=0.1, frequency=0.3, center=None)
    assert task.text == PRESS_BOX.read_text()


def test_what_the_examples_leave_out_follows_the_stated_rules():
    task, _ = read_task(PRESS_BOX, cached_robot)
    assert task.object.position is None and task.object.friction is None and not task.object.carry_weight
    assert task.environment[0].rotation == (0.0, 0.0, 0.0)
    assert task.arms["right"].springs[0].damping is None
    assert task.phases[1].until is None and task.phases[0].posture == {}


def test_every_key_arrives():
    task, _ = read_task(EVERY_KEY, cached_robot)
    raw = yaml.safe_load(EVERY_KEY.read_text())
    hand, elbow = task.arms["right"].springs
    assert hand.stiffness.tolist() == raw["arms"]["right"]["springs"][0]["stiffness"]
    assert np.diag(hand.damping).tolist() == [10, 10, 25, 0.5, 0.5, 0.5]
    assert elbow.stiffness[2, 2] == 40 and np.count_nonzero(elbow.stiffness) == 1
    assert task.arms["left"].springs[1].frame == "left_upper_forearm"
    assert task.object.size == (0.2, 0.3) and task.object.friction == 0.6 and task.object.squeeze == 20
    lower, press, slide, rub, grip, widen = task.phases
    assert grip.grippers == {
        "right": GripperOrder("close", force=20.0, speed=0.05),
        "left": GripperOrder("open"),
    }
    assert grip.until == GripperCondition({"right": "held"})
    assert widen.grippers == {"right": GripperOrder("width", width=0.04, speed=0.05)}
    assert rub.until == SmoothCondition("right", "-x", "z", "spectrum", 0.12, 4, 0.95)
    assert task.environment[1].wood.splinters.force == (10.0, 25.0)
    assert lower.until == ContactCondition(True, 4.0, 0.1, "object") and lower.otherwise == "next"
    assert press.until == ReachedCondition(0.01, 0.05)
    assert press.stiffness["right.elbow"][2, 2] == 60
    assert press.posture["right"] == task.arms["right"].posture and press.posture["left"] == {"e0": -0.9}
    assert slide.until.present is False
    with pytest.raises(ValueError, match="read-only"):
        hand.stiffness[0, 0] = 1.0


@pytest.fixture
def beside(tmp_path):
    """A robot of the name baxter in ``robots/`` of the folder."""
    return Path(shutil.copytree(find_robot("baxter"), tmp_path / "robots" / "baxter"))


@pytest.mark.parametrize("said", ["baxter", "../robots/baxter"])
def test_a_robot_beside_the_task_wins_over_a_shipped_one(tmp_path, beside, said):
    (tmp_path / "tasks").mkdir()
    task_file = tmp_path / "tasks" / "task.yaml"
    task_file.write_text(PRESS_BOX.read_text().replace("robot: baxter", f"robot: {said}"))
    _, robot = read_task(task_file)
    assert robot.folder.resolve() == beside.resolve()


def test_the_faults_of_a_robot_come_with_those_of_its_task(tmp_path, beside):
    robot_file = beside / "robot.yaml"
    robot_file.write_text(robot_file.read_text().replace("solver:", "slover:"))
    task_file = tmp_path / "task.yaml"
    task_file.write_text(PRESS_BOX.read_text().replace("floor: 0.5", "floor: 50"))
    with pytest.raises(BadFile) as caught:
        read_task(task_file)
    assert {Path(p.file).name for p in caught.value.problems} == {"robot.yaml", "task.yaml"}


def test_unknown_names_come_with_the_nearest_and_all_valid_ones(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for find, name, said in (
        (find_robot, "baxtr", r"no robot 'baxtr'; did you mean 'baxter'\? \(valid: .*baxter"),
        (find_task, "no-such-task", r"no task 'no-such-task'.*\(valid: "),
        (find_schema, "tsk", r"no schema 'tsk'; did you mean 'task'"),
    ):
        with pytest.raises(BadInput, match=said):
            find(name)
    assert "baxter" in list_robots()


def test_a_path_wins_over_a_name(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("press-box").write_text("format: 1\n")
    assert find_task("press-box") == Path("press-box")
    assert find_task("./anything") == Path("anything")
    assert find_task("other.yaml") == Path("other.yaml")


def test_checking_a_task_starts_fast():
    code = (
        "from impedance_modules.spec.task_reader import read_task; import sys; "
        "read_task(sys.argv[1]); print(*sys.modules)"
    )
    run = subprocess.run([sys.executable, "-c", code, PRESS_BOX], capture_output=True, text=True, check=True)
    heavy = {"pinocchio", "coal", "numba", "scipy", "pyarrow", "rerun", "matplotlib"}
    assert not heavy & set(run.stdout.split())
