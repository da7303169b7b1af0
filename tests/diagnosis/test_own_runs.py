# SPDX-License-Identifier: BSD-3-Clause
"""What a new user tries first: runs of the shipped tasks, with nothing wrong, are diagnosed against their own robot."""

import json
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from tests.support.commands import invoke

LOST = slice(2400, 2415)
"""Rows of a run that its logger lost."""


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two runs of one motion, and one of another."""
    folder = tmp_path_factory.mktemp("runs")
    for task, seed, name in (
        ("elbow-swing", 1, "one"),
        ("elbow-swing", 2, "two"),
        ("reach-and-return", 3, "three"),
    ):
        invoke("run", task, "--seed", seed, "--out", folder / name)
    return folder


def verdict(folder: Path, *words: object) -> tuple[str, str]:
    """Verdict of a diagnosis against the shipped Baxter, and what it says of the remainder."""
    answer = folder / "answer.json"
    invoke("diagnose", *words, "--robot", "baxter", "--json", answer)
    found = json.loads(answer.read_text())
    return found["verdict"], found["remainder"]["structure"]


def test_a_motion_on_which_nothing_was_fitted_shows_noise_only(runs: Path, tmp_path: Path) -> None:
    """Inertias fitted to accelerations' noise in the first motion would miss the second by twelve times its noise."""
    found, left = verdict(tmp_path, runs / "one", runs / "two", "--holdout", runs / "three")
    assert found == "no_gap", left


@pytest.mark.long
def test_fifteen_rows_that_were_lost_at_1_khz_are_no_gap_of_the_robot(runs: Path, tmp_path: Path) -> None:
    """Filled in, velocities and positions differ by more than noise, of which reported velocities have none."""
    table = pq.read_table(runs / "one" / "episode.parquet")
    kept = np.delete(np.arange(table.num_rows), LOST)
    pq.write_table(table.take(kept), tmp_path / "one.parquet")
    found, left = verdict(tmp_path, tmp_path / "one.parquet", runs / "two", "--holdout", runs / "three")
    assert found == "no_gap", left
