# SPDX-License-Identifier: BSD-3-Clause
"""A robot that is known beside a task only: found by every verb, and again when a recording is looked at elsewhere."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from impedance_modules.errors import BadInput
from impedance_modules.spec.locate import find_robot
from impedance_modules.spec.task_text import find_steps
from tests.support.commands import invoke, refusal
from tests.support.paths import CHECKOUT


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a task and its robot, in which the user works."""
    work = tmp_path / "work"
    shutil.copytree(CHECKOUT / "robots" / "single_wheel", work / "robots" / "my_wheel")
    text = (CHECKOUT / "tasks" / "thesis" / "one-joint.yaml").read_text()
    (work / "task.yaml").write_text(text.replace("robot: single_wheel", "robot: my_wheel"))
    monkeypatch.chdir(work)
    return work


def test_a_recording_is_verified_from_another_folder(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert invoke("run", "task.yaml", "--duration", 0.1, "--out", "out/run").return_value in (0, 3)
    assert "bit-equal" in invoke("replay", "out/run", "--verify").output
    elsewhere = here.parent / "elsewhere"
    elsewhere.mkdir()
    monkeypatch.chdir(elsewhere)
    assert "bit-equal" in invoke("replay", here / "out" / "run", "--verify").output


def test_a_robot_in_the_working_folder_goes_by_its_name(here: Path) -> None:
    assert find_robot("my_wheel") == here / "robots" / "my_wheel"
    invoke("run", "task.yaml", "--duration", 0.1, "--out", "out/run")
    # So short a run is refused for its data, that is after its robot was found.
    assert "velocity.axle" in refusal("diagnose", "out/run", "--robot", "my_wheel")
    assert "there is no robot 'your_wheel'" in refusal("diagnose", "out/run", "--robot", "your_wheel")
    with pytest.raises(BadInput, match="my_wheel"):
        find_robot("my_wheal")


def test_a_key_with_a_dot_in_it_is_found() -> None:
    data = {"phases": [{"name": "lift", "equilibrium": {"right.hand": {"z": 0.1}}, "right": {"hand": 1}}]}
    assert find_steps(data, "phases.lift.equilibrium.right.hand.z") == (
        "phases", 0, "equilibrium", "right.hand", "z",
    )  # fmt: skip
    assert find_steps(data, "phases.lift.right.hand") == ("phases", 0, "right", "hand")
    with pytest.raises(BadInput, match=r"did you mean 'right.hand'"):
        find_steps(data, "phases.lift.equilibrium.right.hond.z")
