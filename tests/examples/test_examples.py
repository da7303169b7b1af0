# SPDX-License-Identifier: BSD-3-Clause
"""The scripts of examples/ run as they are, each in a process of its own, and print what their first lines promise."""

import re

import pytest

from tests.support.commands import python
from tests.support.paths import CHECKOUT

EXAMPLES = CHECKOUT / "examples"

PRINTED = {
    "diagnose_a_csv": r"payload at [\s\S]*with it",
    "effect_of_ones_own": r"explained[\s\S]*cubic_friction at panda_joint1",
    "fr3_pair_carries_a_box": r"ended: done[\s\S]*rose by 9\d mm",
    "keep_a_path": r"kept 4\d\d samples of right_hand",
    "module_of_ones_own": r"without the ball: 1\d mm[\s\S]*with the ball: [4-9]\d mm",
    "own_loop_on_mujoco": r"done",
    "policy_streams_set_points": r"3\d\d set-points accepted, 0 refused",
}


def test_every_script_is_known() -> None:
    assert set(PRINTED) == {path.stem for path in EXAMPLES.glob("*.py")}


@pytest.mark.parametrize("name", PRINTED)
def test_it_runs_and_says_what_it_found(name, tmp_path):
    done = python(str(EXAMPLES / f"{name}.py"), str(tmp_path / "out"))
    assert done.returncode == 0, done.stderr[-2000:]
    assert re.search(PRINTED[name], done.stdout), done.stdout
