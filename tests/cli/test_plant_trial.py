# SPDX-License-Identifier: BSD-3-Clause
"""A task that would meet joint limits is tried on the plant first, and refused if a joint is too fast there."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.runs.speed_and_place import ROBOTS, Observed, Robots, assembled, carry_out
from impedance_modules.control.assembly import Assembly, assemble
from impedance_modules.errors import BadFile
from impedance_modules.prediction.feasibility import refuse_infeasible
from impedance_modules.prediction.joint_limits import SWINGS_ON, limits_met
from impedance_modules.runs.trial_run import ALLOWED, try_on_plant
from tests.support.commands import invoke, python, refusal
from tests.support.paths import CHECKOUT

FORWARD_PATH = CHECKOUT / "tasks" / "thesis" / "forward-path.yaml"
FAST, NOISY = 778, 1312
"""Random tasks of seed 1: an elbow drawn along at more than its limit; a loop that noise alone makes swing."""


@pytest.fixture(scope="module")
def robots() -> Robots:
    return Robots(ROBOTS)


def drawn(robots: Robots, number: int, folder: Path) -> tuple[Path, float, Assembly]:
    """A random task's file, its rate [Hz], and the task."""
    found, _ = robots.draw(1, number)
    assert found is not None
    assembly = assembled(found, folder)
    return folder / "task.yaml", found.rate, assembly


def test_check_and_run_refuse_what_is_too_fast_on_the_plant(robots: Robots, tmp_path: Path) -> None:
    path, rate, assembly = drawn(robots, FAST, tmp_path)
    assert limits_met(assembly.model, refuse_infeasible(assembly)).joints
    out = tmp_path / "run"
    for command in (("check", path), ("run", path, "--out", out)):
        text = refusal(*command, "--rate", rate)
        assert f"{path}:" in text and ": on the built-in plant, motor or link of" in text
        assert "right_e1" in text and "declared limit is 1.5 rad/s" in text and "would reach" in text
    assert not out.exists()
    run = invoke("run", path, "--rate", rate, "--allow-unstable", "--out", out)
    assert run.return_value == 3 and "overspeed" in run.output


def test_a_loop_that_hardly_damps_is_tried_with_several_noises(robots: Robots, tmp_path: Path) -> None:
    """The first noise alone would let this one pass."""
    _, _, assembly = drawn(robots, NOISY, tmp_path)
    met = limits_met(assembly.model, refuse_infeasible(assembly))
    assert not met.joints and met.swings and f"{SWINGS_ON}" > met.first.split()[-1]
    with pytest.raises(BadFile, match="right_e0 moves at"):
        try_on_plant(assembly, met, 0, lambda *_: None)
    once = replace(met, joints=met.swings, swings=())
    assert try_on_plant(assembly, once, 0, lambda *_: None).ended.startswith("done")


def test_a_trial_is_the_run_with_the_same_noise(tmp_path: Path) -> None:
    assembly = assemble(str(FORWARD_PATH), effects=None, rate=None, scale=1.0, arm=None)
    met = limits_met(assembly.model, refuse_infeasible(assembly))
    assert met.first == "phase 'swing-3': right_w1 would reach 4.46 rad/s" and not met.swings
    progress: list[float] = []
    trial = try_on_plant(assembly, met, 4, lambda time, _: progress.append(time))
    _, seen = carry_out(assembly, NoShapes(), 4)
    worst = int(np.argmax(seen.ratio))
    assert trial.joint == assembly.model.joint_names[worst]
    assert trial.speed / trial.limit == pytest.approx(seen.ratio[worst], rel=1e-12, abs=0.0)
    assert trial.speed <= ALLOWED * trial.limit
    assert np.diff(progress) == pytest.approx(0.1)


class NoShapes:
    """Of a task whose distances nobody asks for."""

    def closest(self, q: object) -> float:
        return Observed.closest


def test_what_was_tried_is_said(tmp_path: Path) -> None:
    text = " ".join(invoke("check", FORWARD_PATH).output.split())
    assert "tried on the built-in plant, because it would meet joint limits: done after 5." in text
    assert "fastest joint right_s0, 1.2" in text
    assert "tried" not in invoke("check", "box-hold").output
    ran = " ".join(invoke("run", FORWARD_PATH, "--duration", 0.1, "--out", tmp_path / "run").output.split())
    assert "tried on the built-in plant" in ran


def test_a_task_that_meets_no_limit_is_not_tried_and_needs_no_compiler() -> None:
    code = (
        "import sys; from impedance_modules.cli.main import impedance\n"
        "impedance(['check', 'box-hold'], standalone_mode=False)\n"
        "print('numba' in sys.modules, 'impedance_modules.runs.trial_run' in sys.modules)"
    )
    assert python("-c", code).stdout.splitlines()[-1] == "False False"
