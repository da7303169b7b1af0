# SPDX-License-Identifier: BSD-3-Clause
"""Random tasks that are accepted keep their joints' speeds; ``benchmarks.runs.speed_and_place`` does a thousand."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks.runs.speed_and_place import ALLOWED, ROBOTS, Robots, judged

SEED = 3
"""One that no threshold was chosen by."""

FAST = (1, 778)
"""Seed and number of a task that only the trial on the plant refuses."""


@pytest.fixture(scope="module")
def robots() -> Robots:
    return Robots(ROBOTS)


@pytest.mark.parametrize("count", [8, pytest.param(60, marks=pytest.mark.long)])
def test_no_accepted_task_is_too_fast(robots: Robots, count: int, tmp_path: Path) -> None:
    lines = [judged(robots, SEED, number, tmp_path) for number in range(count)]
    ran = [line for line in lines if "refused" not in line]
    assert len(ran) > 0.3 * count
    assert not [line for line in ran if not line["speed"] <= ALLOWED]


def test_the_look_sees_what_is_too_fast(robots: Robots, tmp_path: Path) -> None:
    """Without the trial this one would have been accepted, and the test above would have failed."""
    line = judged(robots, *FAST, tmp_path)
    assert line["refused"].startswith("on the plant") and line["would"]["speed"] > ALLOWED
