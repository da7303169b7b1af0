# SPDX-License-Identifier: BSD-3-Clause
"""Every fault of the loop ends as it should: it goes on, or stops in time and calmly.

``python -m benchmarks.control.loop_faults`` prints what follows each of them.
"""

from __future__ import annotations

import pytest

from impedance_modules.control.assembly import Assembly
from impedance_modules.safety.stop_levels import StopLevel
from tests.support.loop_faults import faults, faults_task, run_with

STOPS = {
    "no state any more": ("stale state", 0.03),
    "the same state for ever": ("stale state", 0.03),
    "a velocity is NaN": ("state not finite", 0.0),
    "an encoder jumps by 0.1 rad": ("right: overspeed (motor or link of right_e1", 0.0),
    "the robot's clock steps back by 1 s": ("stale state", 0.03),
    "the filter has no solution": ("solver failed", 0.0),
    "every cycle takes two periods": ("late cycles", 0.06),
    "no memory is left": ("memory short", 0.0),
    "the process is paused for 1 s": ("state lost (no state for 1.0", 0.0),
}
"""Fault -> reason, and the longest time to the stop [s]."""

GOES_ON = {
    "none": 0.7,
    "every tenth state lost": 0.7,
    "every other state lost": 0.7,
    "every other state repeated": 0.7,
    "states swapped in pairs": 0.7,
    "an effort sensor reads 0": 1.5,
}
"""Fault -> largest true motor speed over the declared one; what no sensor shows cannot stop the run."""

LOOSENS = ("every fifth state a period late", "an encoder stands still")
"""At 100 Hz these shake the arms, until a joint that is too fast stops the run."""


@pytest.fixture(scope="module")
def assembly(tmp_path_factory: pytest.TempPathFactory) -> Assembly:
    return faults_task(tmp_path_factory.mktemp("faults"))


def test_every_fault_is_judged_here() -> None:
    assert set(faults()) == {*STOPS, *GOES_ON, *LOOSENS}


@pytest.mark.parametrize("name", STOPS)
def test_a_fault_stops_in_time_with_its_reason_and_calms(assembly: Assembly, name: str) -> None:
    reason, longest = STOPS[name]
    verdict = run_with(assembly, name)
    assert verdict.level >= StopLevel.DAMP
    assert reason in verdict.reason
    assert verdict.seconds <= longest + 1e-9
    assert verdict.effort <= 0.1
    assert verdict.speed <= 0.5


@pytest.mark.parametrize("name", GOES_ON)
def test_a_run_goes_on_within_its_limits(assembly: Assembly, name: str) -> None:
    verdict = run_with(assembly, name)
    assert verdict.level is StopLevel.RUN
    assert verdict.reason == ""
    assert verdict.effort <= 1.0
    assert verdict.speed <= GOES_ON[name]


@pytest.mark.parametrize("name", LOOSENS)
def test_a_loop_that_a_fault_loosens_stops_before_a_joint_is_too_fast(assembly: Assembly, name: str) -> None:
    verdict = run_with(assembly, name)
    assert "overspeed" in verdict.reason
    assert verdict.effort <= 1.0
    assert verdict.speed <= 1.05
