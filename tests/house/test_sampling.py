# SPDX-License-Identifier: BSD-3-Clause
"""``--sample`` leaves out tests marked long, never all of a kind, and the same ones for the same seed."""

import subprocess

import pytest

from tests.support.commands import python
from tests.support.sampling import sample_of

NODES = [
    *(f"a/b.py::law[{i}]" for i in range(10)),
    *(f"a/b.py::rule[{way}]" for way in ("python", "machine code")),
    "a/b.py::one",
    "a/e.py::two",
    "c/d.py::alone",
]


@pytest.mark.parametrize("seed", range(5))
def test_every_group_keeps_its_share_and_at_least_one_test(seed: int) -> None:
    kept = sample_of(NODES, 0.2, seed)
    assert sum("law" in node for node in kept) == 2 and sum("rule" in node for node in kept) == 1
    assert sum(node in ("a/b.py::one", "a/e.py::two") for node in kept) == 1 and "c/d.py::alone" in kept


def test_the_seed_chooses() -> None:
    assert sample_of(NODES, 0.3, 1) == sample_of(reversed(NODES), 0.3, 1)
    assert len({frozenset(sample_of(NODES, 0.3, seed)) for seed in range(20)}) > 10
    assert sample_of(NODES, 1.0, 1) == set(NODES)


def run(*options: str) -> subprocess.CompletedProcess[str]:
    return python("-m", "pytest", "-p", "no:cacheprovider", "--collect-only", *options)


def test_pytest_runs_the_sample_and_says_which() -> None:
    fuzz = "tests/spec/test_task_fuzz.py"
    whole, part = run(fuzz), run(fuzz, "--sample", "0.1", "--sample-seed", "7", "--fail-on-skip")
    assert part.returncode == 0 and "--sample 0.1 --sample-seed 7" in part.stdout
    assert "deselected" in part.stdout and "deselected" not in whole.stdout
    assert "--sample 1.5" in run(fuzz, "--sample", "1.5").stderr
