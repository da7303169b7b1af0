# SPDX-License-Identifier: BSD-3-Clause
"""Many runs in one process leave next to nothing behind; ``python -m benchmarks.runs.long_use`` does a thousand."""

import pytest

from benchmarks.runs.long_use import CycleTimes, Watch
from tests.support.commands import python

GROWTH = "from benchmarks.runs.long_use import short_runs; print(short_runs({runs}).growth())"


FEW, SOME = 16, 60
"""Runs in whose later half the heap still grows in steps of 2 to 3 MB; after about 150 it no longer does."""


@pytest.mark.parametrize(("runs", "bound"), [(FEW, 3.0), pytest.param(SOME, 1.0, marks=pytest.mark.long)])
def test_memory_does_not_grow_with_every_run(runs: int, bound: float) -> None:
    """What it is about left 2 MB per run, in every run."""
    done = python("-c", GROWTH.format(runs=runs))
    assert done.returncode == 0, done.stderr
    assert float(done.stdout.split()[-1]) < bound


def test_the_growth_is_that_of_the_later_half(monkeypatch: pytest.MonkeyPatch) -> None:
    """What the first runs load and compile is no growth."""
    watch = Watch()
    for run in range(1, 41):
        used = 100.0 + 30.0 * min(run, 10) + 0.5 * max(run - 20, 0)
        monkeypatch.setattr("benchmarks.runs.long_use.memory", lambda used=used: used)
        watch.add(run, 200.0 + run)
    assert watch.growth() == pytest.approx(0.5)
    rows = watch.rows()
    assert len(rows) == 10 and rows[0][:2] == (4, 220.0) and rows[-1] == (40, 410.0, 238.5)


def test_a_cycles_time_is_the_wall_time_between_looks_over_its_cycles(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    times, clock = CycleTimes(period=0.001), iter([10.0, 10.02, 10.05])
    monkeypatch.setattr("benchmarks.runs.long_use.time.perf_counter", lambda: next(clock))
    for now in (0.0, 0.1, 0.2):
        times(now, "hold")
    assert times.found == pytest.approx([200.0, 300.0])
