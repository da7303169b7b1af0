# SPDX-License-Identifier: BSD-3-Clause
"""Tasks that name no joint run on every robot; those that do are refused there, with the lines that tie them."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from impedance_modules.cli.main import impedance
from impedance_modules.control.assembly import assemble
from impedance_modules.control.supervisor import Ending
from impedance_modules.episode.reader import read_episode
from impedance_modules.errors import BadFile, BadInput
from impedance_modules.prediction.energy_need import forecast_tank
from impedance_modules.prediction.mechanism import Mechanism
from impedance_modules.prediction.quasi_static import predict_motion
from impedance_modules.runs.verify import verify
from impedance_modules.spec.document import parse_document
from impedance_modules.spec.other_robot import on_robot
from impedance_modules.spec.task_reader import read_task
from tests.support.paths import CHECKOUT
from tests.support.run_on_robot import run_on_robot as run
from tests.support.shipped_runs import SAMPLES, watch

FOLDER = CHECKOUT / "tasks" / "any-robot"
NAMES = tuple(sorted(path.stem for path in FOLDER.glob("*.yaml")))
TWO_ARMS = ("carry-box", "lead-and-follow", "part-and-meet")
GRIPPER = ("pick-and-place",)
ONE_ARM = tuple(name for name in NAMES if name not in (*TWO_ARMS, *GRIPPER))
ROBOTS = ("fr3-pair", "panda", "ur5e-pair")


def test_there_are_enough_of_them() -> None:
    assert len(ONE_ARM) >= 8 and set(TWO_ARMS) < set(NAMES)


@pytest.mark.parametrize("robot", ROBOTS)
@pytest.mark.parametrize("name", ONE_ARM)
def test_one_arm_runs_on_each_robot(name: str, robot: str, tmp_path: Path) -> None:
    assert run(name, robot, tmp_path / "run", duration=0.2) is Ending.INTERRUPTED


@pytest.mark.parametrize("robot", ["fr3-pair", "ur5e-pair"])
@pytest.mark.parametrize("name", TWO_ARMS)
def test_two_arms_run_on_each_pair(name: str, robot: str, tmp_path: Path) -> None:
    assert run(name, robot, tmp_path / "run", duration=0.2) is Ending.INTERRUPTED


@pytest.mark.parametrize("robot", ["fr3-pair", "panda"])
def test_a_gripper_is_ordered_on_each_robot_that_has_one(robot: str, tmp_path: Path) -> None:
    assert run("pick-and-place", robot, tmp_path / "run", duration=0.2) is Ending.INTERRUPTED
    extra = read_episode(tmp_path / "run" / "episode.parquet").extra
    assert extra["gripper.right.ordered_width"][-1] == pytest.approx(0.08)


def test_a_robot_without_grippers_is_refused_with_every_line_that_asks_for_one() -> None:
    with pytest.raises(BadFile) as caught:
        read_task("pick-and-place", robot="ur5e-pair")
    assert [problem.path for problem in caught.value.problems] == [
        "phases[0].grippers.right",
        "phases[1].grippers.right",
        "phases[1].until.gripper.right",
        "phases[5].grippers.right",
        "phases[5].until.gripper.right",
    ]
    for problem in caught.value.problems:
        assert "robot 'ur5e-pair' has no gripper" in problem.message
        assert problem.valid == ("no such key, or a robot that has one: baxter, fr3-pair, panda",)


@pytest.mark.parametrize("robot", ["baxter", *ROBOTS])
def test_a_contact_is_felt_on_every_robot(robot: str, tmp_path: Path) -> None:
    """The whole task: its second phase begins only when the joint torques show the table."""
    assert run("feel-down", robot, tmp_path / "run", duration=None) is Ending.DONE


@pytest.mark.parametrize("name", NAMES)
def test_tanks_fit_the_robot_that_a_task_names(name: str) -> None:
    assembly = assemble(name, effects=None, rate=None, scale=1.0, arm=None)
    need = forecast_tank(assembly, Mechanism(assembly), predict_motion(assembly)).need
    assert need <= assembly.tank.initial <= 1.5 * need


@pytest.mark.parametrize("name", NAMES)
def test_with_its_own_robot_a_task_is_the_same(name: str) -> None:
    task, robot = read_task(name)
    again, same = read_task(name, robot="baxter")
    assert repr((again.arms, again.phases)) == repr((task.arms, task.phases))
    assert (again.text, same.name) == (task.text, robot.name)


def test_a_recording_is_one_of_the_other_robot_and_verifies(tmp_path: Path) -> None:
    run("reach-out", "panda", tmp_path / "run", duration=0.3)
    episode = read_episode(tmp_path / "run" / "episode.parquet")
    assert episode.metadata["robot"] == "panda" and "robot: panda" in episode.metadata["task"]
    assert verify(episode, lambda _: None).samples >= 300


def test_a_task_that_names_joints_is_refused_with_each_line_that_ties_it() -> None:
    with pytest.raises(BadFile) as caught:
        read_task("soft-hold", robot="fr3-pair")
    lines = (CHECKOUT / "tasks" / "soft-hold.yaml").read_text().splitlines()
    found = {problem.path: lines[problem.line - 1] for problem in caught.value.problems}
    assert "s0: 0.5462" in found["arms.right.posture"]
    assert "stiffness: {s0" in found["arms.right.joint_bias.stiffness"]
    assert "frame: right_hand" in found["arms.right.springs[0].frame"]
    assert len(found) == 3


def test_named_joints_of_another_robot_are_refused_even_if_they_exist_there(tmp_path: Path) -> None:
    """Two Franka arms call their joints alike; numbers for one are none for the other."""
    text = (FOLDER / "stand-by.yaml").read_text().replace("robot: baxter", "robot: fr3-pair")
    angles = "{joint1: 0.1, joint2: 0.5, joint3: 0, joint4: -2, joint5: 0, joint6: 2.5, joint7: 1}"
    task = tmp_path / "task.yaml"
    task.write_text(text.replace("posture: palms-down", f"posture: {angles}"))
    read_task(task)
    with pytest.raises(BadFile, match=r"task\.yaml:\d+:\d+: arms\.right\.posture: names joint angles"):
        read_task(task, robot="panda")


def test_an_arm_that_a_robot_lacks_is_refused_with_its_line() -> None:
    with pytest.raises(BadFile, match=r"carry-box\.yaml:\d+:\d+: arms\.left: the robot 'panda' has no limb"):
        read_task("carry-box", robot="panda")


def test_joint_angles_have_no_image_where_no_signs_make_one(tmp_path: Path) -> None:
    text = (FOLDER / "part-and-meet.yaml").read_text().replace("robot: baxter", "robot: ur5e-pair")
    angles = "{shoulder_pan: 0, shoulder_lift: -0.9, elbow: 1.8, wrist_1: -2.4, wrist_2: -1.6, wrist_3: 0}"
    task = tmp_path / "task.yaml"
    task.write_text(text.replace("posture: palms-down", f"posture: {angles}"))
    with pytest.raises(
        BadFile, match=r"arms\.left\.mirror: the joint angles of 'right' have no mirror image"
    ):
        read_task(task)


def test_a_bias_by_rule_is_each_joints_largest_torque_times_a_number() -> None:
    task, robot = read_task("stand-by", robot="ur5e-pair")
    bias = task.arms["right"].joint_bias
    assert bias is not None
    for short, joint in robot.limbs["right"].joints.items():
        assert bias.stiffness[short] == pytest.approx(0.02 * robot.joints[joint].effort_max)


@pytest.mark.parametrize("word", ["baxter", '"baxter"', "'baxter'", "baxter # a comment: robot"])
def test_only_the_name_of_the_robot_changes(word: str, tmp_path: Path) -> None:
    text = (FOLDER / "stand-by.yaml").read_text().replace("robot: baxter", f"robot: {word}")
    changed = on_robot(parse_document(tmp_path / "task.yaml", text), "panda")
    named = word.split(" #", maxsplit=1)[0]
    assert changed.text == text.replace(f"robot: {named}", "robot: panda")


def test_a_robot_beside_the_user_wins_over_none_and_unknown_ones_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.copytree(CHECKOUT / "robots" / "panda", tmp_path / "robots" / "mine")
    monkeypatch.chdir(tmp_path)
    task, robot = read_task("stand-by", robot="mine")
    assert robot.folder == tmp_path / "robots" / "mine" and str(tmp_path) in task.text
    with pytest.raises(BadInput, match=r"--robot: there is no robot 'pnda'; did you mean 'panda'\?|'pnda'"):
        read_task("stand-by", robot="pnda")


def test_check_and_analyze_take_the_option() -> None:
    for verb in ("check", "analyze"):
        result = CliRunner().invoke(impedance, [verb, "stand-by", "--robot", "panda"], standalone_mode=False)
        assert result.exception is None and result.return_value == 0
        assert "panda" in result.output
    checked = CliRunner().invoke(impedance, ["check", "stand-by", "--robot", "panda"], standalone_mode=False)
    assert "robot.yaml:" in checked.output and "is assumed; if it is wrong" in checked.output


def test_a_target_that_jumps_bends_the_way_of_the_hand() -> None:
    """Forwards first, then to the side without a stop in between, and it arrives where both submovements lead."""
    watched = watch(FOLDER / "two-step-reach.yaml", duration=3.0)
    assert watched.slowed == 0 and watched.headroom > 0.0
    at = watched.seen("at right_hand")
    moved = at - at[0]
    early, arrived = moved[round(0.55 * SAMPLES)], moved[-1]
    assert early[0] > 0.008 and abs(early[1]) < 0.002
    assert np.linalg.norm(arrived - [0.06, -0.08, 0.06]) < 0.01
    speed = np.linalg.norm(np.diff(at, axis=0), axis=1) * SAMPLES
    under_way = speed[round(0.4 * SAMPLES) : round(1.5 * SAMPLES)]
    assert np.min(under_way) > 0.3 * np.max(under_way), "it hesitates nowhere"
