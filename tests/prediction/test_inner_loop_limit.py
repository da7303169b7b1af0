# SPDX-License-Identifier: BSD-3-Clause
"""``check`` says up to which gain a robot's own torque loop is passive; a task on such a robot runs and is replayed."""

import shutil
from pathlib import Path

import pytest

from impedance_modules.control.assembly import assemble
from impedance_modules.prediction.inner_loop_limit import inner_loop_limit
from tests.support.commands import invoke, refusal
from tests.support.paths import CHECKOUT


def with_loop(folder: Path, loop: str) -> Path:
    """A short task on a Baxter whose joints feed torque back."""
    robot = folder / "robots" / "baxter"
    shutil.copytree(CHECKOUT / "robots" / "baxter", robot)
    text = (robot / "robot.yaml").read_text()
    (robot / "robot.yaml").write_text(
        text.replace("\nsolver: daqp", f"\ninner_torque_loop: {loop}\nsolver: daqp")
    )
    task = folder / "reach-and-return.yaml"
    shutil.copy(CHECKOUT / "tasks" / "reach-and-return.yaml", task)
    return task


def test_check_prints_the_limit_and_run_and_replay_agree(tmp_path: Path) -> None:
    task = with_loop(tmp_path, "{gain: 1.2}")
    checked = invoke("check", task)
    assert checked.exit_code == 0, checked.stderr
    printed = " ".join(checked.stdout.split())
    assert "inner torque loop: gain 1.2 (passive: at most 2.25" in printed and "2.2 times lighter" in printed
    assert invoke("run", task, "--duration", "0.5", "--out", tmp_path / "out").exit_code == 0
    assert invoke("replay", tmp_path / "out", "--verify").exit_code == 0


@pytest.mark.parametrize(("loop", "most"), [("{gain: 2.5}", "2.25"), ("{gain: 1.1, delay: 0.001}", "1.01")])
def test_a_gain_that_is_not_passive_is_refused_where_it_stands(tmp_path: Path, loop: str, most: str) -> None:
    task = with_loop(tmp_path, loop)
    said = refusal("check", task)
    lines = (tmp_path / "robots" / "baxter" / "robot.yaml").read_text().splitlines()
    line = next(n for n, text in enumerate(lines, 1) if text.startswith("inner_torque_loop"))
    assert f"robot.yaml:{line}:" in said and f"at most {most}" in said
    assert said == refusal("run", task, "--out", tmp_path / "out")
    assert not (tmp_path / "out").exists()
    allowed = invoke("run", task, "--allow-unstable", "--duration", "0.2", "--out", tmp_path / "out")
    assert allowed.exit_code == 0


def test_a_slower_loop_allows_less(tmp_path: Path) -> None:
    """Below 1 kHz the joints' loops fill the control period evenly and are never longer than a millisecond."""
    task = str(with_loop(tmp_path, "{gain: 0.5}"))
    limits = []
    for rate in (1000.0, 700.0, 500.0):
        found = inner_loop_limit(assemble(task, effects=None, rate=rate, scale=1.0, arm=None))
        assert found is not None
        limits.append((found.timing.period, found.limit.gain))
    assert limits[0] == limits[2]
    assert limits[1][0] < limits[0][0] and limits[1][1] > limits[0][1]


def test_a_robot_without_the_loop_has_no_limit() -> None:
    assert (
        inner_loop_limit(assemble("reach-and-return", effects=None, rate=None, scale=1.0, arm=None)) is None
    )
