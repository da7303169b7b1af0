# SPDX-License-Identifier: BSD-3-Clause
"""The tank's claim in random worlds that do their worst: the benchmark's own runs, a few of a thousand."""

from pathlib import Path

import pytest

from benchmarks.runs.adversarial_runs import ROUNDING, judged
from benchmarks.runs.speed_and_place import ROBOTS, Robots

NUMBERS = (0, 56, 60, 15)
"""Drawn with seed 1: tasks that do more work than their tank holds where nobody stops them."""


@pytest.fixture(scope="module")
def robots() -> Robots:
    return Robots(ROBOTS)


@pytest.mark.parametrize("number", NUMBERS)
def test_no_world_gets_more_work_than_was_paid_for(robots: Robots, tmp_path: Path, number: int) -> None:
    kept = judged(robots, 1, number, tmp_path, unpaid=False)
    assert kept["broken_claim"] <= ROUNDING
    assert kept["broken_ledger"] <= ROUNDING


@pytest.mark.parametrize("number", NUMBERS)
def test_without_the_tank_they_do(robots: Robots, tmp_path: Path, number: int) -> None:
    assert judged(robots, 1, number, tmp_path, unpaid=True)["broken_claim"] > 0.1
