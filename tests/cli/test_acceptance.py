# SPDX-License-Identifier: BSD-3-Clause
"""What a run refuses because of files and options, ``check`` refuses too, in the same words."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from impedance_modules.compiled import Law, as_python
from impedance_modules.errors import BadFile, ImpedanceError
from tests.support.commands import invoke
from tests.support.paths import CHECKOUT, TESTS

PAIR = TESTS / "robots" / "six_joint_pair"
HOLD = TESTS / "data" / "pair-hold.yaml"
BOX = TESTS / "data" / "pair-box.yaml"
BROKEN = sorted((TESTS / "broken_tasks").glob("*.yaml"))[::8]

PATCH = """format: 1
robot: six_joint_pair
provenance: {{origin: hand, date: "2026-11-23", note: for a test}}
effects:
  - effect: backlash
    joints: [{rigid}]
    port: actuator
    parameters: {{{rigid}: {{b: {{value: 0.001, unit: rad}}}}}}
"""


def refused(*words: object) -> str:
    """What a verb says that refuses its input; nothing if it does not."""
    try:
        invoke(*words)
    except ImpedanceError as error:
        assert error.exit_code == 2
        return str(error)
    return ""


def both(task: Path, out: Path, *options: object) -> str:
    """What ``run`` says that refuses a task; ``check`` must say the same."""
    said = refused("run", task, *options, "--out", out)
    assert said and refused("check", task, *options) == said
    assert not out.exists()
    return said


def own_robot(folder: Path, task: Path, edit: Callable[[str], str]) -> Path:
    """A task with its robot in ``robots/`` beside it, the robot file edited."""
    target = folder / "robots" / PAIR.name
    shutil.copytree(PAIR, target)
    before = (target / "robot.yaml").read_text()
    assert edit(before) != before
    (target / "robot.yaml").write_text(edit(before))
    return Path(shutil.copy(task, folder / task.name))


@pytest.mark.parametrize("path", BROKEN, ids=lambda path: path.stem)
def test_broken_tasks(path: Path, tmp_path: Path) -> None:
    both(path, tmp_path / "out")


def test_a_solver_that_is_not_installed_is_told_at_its_line(tmp_path: Path) -> None:
    task = own_robot(tmp_path, HOLD, lambda text: text.replace("solver: daqp", "solver: qpsolvers:gone"))
    said = both(task, tmp_path / "out")
    assert "robot.yaml:" in said and ": solver: qpsolvers has no installed dense solver 'gone'" in said


def test_a_rotor_that_no_step_can_follow_is_told_at_its_line(tmp_path: Path) -> None:
    task = own_robot(
        tmp_path, HOLD, lambda text: text.replace("lift: 0.5, bend: 0.3", "lift: 1.0e-9, bend: 0.3")
    )
    said = both(task, tmp_path / "out")
    assert "robot.yaml:" in said and "joints.reflected_inertia." in said
    assert "which no integration step down to 1e-06 s follows" in said


def test_an_effect_that_the_plant_cannot_have_is_told_at_its_line(tmp_path: Path) -> None:
    patch = tmp_path / "play.yaml"
    patch.write_text(PATCH.format(rigid=rigid_joint()))
    said = both(HOLD, tmp_path / "out", "--effects", patch)
    assert said.startswith(f"{patch}:5:13: effects[0].effect: backlash on")


def test_an_object_that_no_step_can_follow_is_told_at_its_line(tmp_path: Path) -> None:
    task = own_robot(tmp_path, BOX, lambda text: text + "# a copy\n")
    task.write_text(BOX.read_text().replace("mass: 1.2", "mass: 1.0e-6"))
    said = both(task, tmp_path / "out")
    assert (
        ": object.mass: the held object on environment[0] has a mode at" in said
        and "which no integration step" in said
    )


@pytest.mark.parametrize("options", [("--rate", 7), ("--scale", 2.0), ("--arm", "third")], ids=str)
def test_options(options: tuple[object, ...], tmp_path: Path) -> None:
    both(HOLD, tmp_path / "out", *options)


def test_laws_run_as_python_only_within_the_block() -> None:
    before = Law.in_machine_code
    with pytest.raises(BadFile), as_python():
        assert Law.in_machine_code is False
        raise BadFile([])
    assert Law.in_machine_code is before


def rigid_joint() -> str:
    """A joint of the pair without a spring."""
    from impedance_modules.spec.robot_reader import read_robot

    return next(name for name, joint in read_robot(PAIR).joints.items() if joint.spring_stiffness is None)


def test_shipped_tasks_are_accepted_as_before() -> None:
    for name in ("soft-hold", "box-hold", "turn-lever"):
        assert refused("check", name) == "", f"{CHECKOUT}: {name}"
