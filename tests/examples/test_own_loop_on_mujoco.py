# SPDX-License-Identifier: BSD-3-Clause
"""The example with a loop of its own carries its task out."""

import runpy

import pytest

from impedance_modules.control.supervisor import Ending
from tests.support.paths import CHECKOUT


def test_it_ends_as_the_task_says(capsys: pytest.CaptureFixture[str]) -> None:
    supervisor = runpy.run_path(str(CHECKOUT / "examples" / "own_loop_on_mujoco.py"))["main"]()
    assert supervisor.ending is Ending.DONE
    assert [name for name, _, _ in supervisor.sequence.ended] == ["rise", "return"]
    assert "2.5 s  return" in capsys.readouterr().out
