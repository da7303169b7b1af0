# SPDX-License-Identifier: BSD-3-Clause
"""Many runs of an experiment: kept in a folder, and not done again by the same program."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from impedance_experiments import parallel_runs as many
from impedance_experiments.parallel_runs import carry_out_all


@dataclass(frozen=True)
class Job:
    """A number to square; a file notes that it was done."""

    value: float
    weights: NDArray[np.float64]
    note: Path


def square(job: Job) -> float:
    job.note.write_text(job.note.read_text() + f"{job.value:g} " if job.note.exists() else f"{job.value:g} ")
    return float(job.value**2 * job.weights.sum())


def test_only_what_is_missing_is_done_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    note, kept = tmp_path / "note", tmp_path / "kept"
    kept.mkdir()
    jobs = [Job(float(i), np.array([1.0, float(i)]), note) for i in range(4)]
    said: list[int] = []
    assert carry_out_all(square, jobs[:2], kept, said.append) == [0.0, 2.0]
    assert carry_out_all(square, jobs, kept, said.append) == [0.0, 2.0, 12.0, 36.0]
    assert note.read_text() == "0 1 2 3 " and said == [1, 2, 3, 4]
    # Another weight is another job, though the value is the same; so is any job of another program.
    assert carry_out_all(square, [Job(3.0, np.array([1.0, 1.0]), note)], kept, said.append) == [18.0]
    many.program.cache_clear()
    monkeypatch.setattr(many, "program", lambda: "changed")
    assert carry_out_all(square, jobs[3:], kept, said.append) == [36.0]
    assert note.read_text() == "0 1 2 3 3 3 "


def test_many_are_done_by_several_processes_in_order(tmp_path: Path) -> None:
    found = carry_out_all(abs, [float(-i) for i in range(6)], tmp_path, lambda _count: None)
    assert found == [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]
