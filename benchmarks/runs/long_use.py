# SPDX-License-Identifier: BSD-3-Clause
"""Hours of use in one process: memory and time of a cycle, in tenths of one long run and of many short ones.

Usage: python -m benchmarks.runs.long_use [--minutes 60] [--runs 1000]

The long run is the shipped mirrored-arms, drawn out to so many simulated minutes, as fast as it goes, with all its
files. A short run is 0.2 s of the same task: assembled, carried out with all its files, thrown away. Memory is what the
process has at that moment [MB], not its peak. A cycle's time is wall time over a tenth of a simulated second, divided
by its cycles: plant, controller and recording [us]; the table has the median.
"""

from __future__ import annotations

import argparse
import resource
import shutil
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from benchmarks.runs.long_run import long_task
from impedance_modules.control.assembly import Assembly, assemble
from impedance_modules.runs.execution import RunOptions, carry_out
from impedance_modules.runs.run_backends import make_backend

TASK = Path(__file__).parents[2] / "tasks" / "mirrored-arms.yaml"
SHORT = 0.2
"""Of a short run [s]."""

PARTS = 10
"""Rows of a table."""

LARGEST_GROWTH = 0.25
"""What a short run may leave behind in the process, once the first are over [MB]."""


def memory() -> float:
    """Resident memory of this process now [MB]."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * resource.getpagesize() / 1e6


@dataclass
class Watch:
    """What was seen of a run, or of many: how far it was [s or runs], memory then [MB], and times of cycles [us]."""

    along: list[float] = field(default_factory=list)
    memory: list[float] = field(default_factory=list)
    cycle: list[float] = field(default_factory=list)

    def add(self, along: float, cycle: float) -> None:
        """Takes a look."""
        self.along.append(along)
        self.memory.append(memory())
        self.cycle.append(cycle)

    def rows(self, parts: int = PARTS) -> list[tuple[float, float, float]]:
        """How far, memory there [MB] and median time of a cycle [us], at the end of each part."""
        chunks = [chunk for chunk in np.array_split(np.arange(len(self.along)), parts) if chunk.size]
        return [
            (self.along[chunk[-1]], self.memory[chunk[-1]], float(np.median(np.array(self.cycle)[chunk])))
            for chunk in chunks
        ]

    def growth(self) -> float:
        """Memory that the later half gained for each step along, from a straight line through it [MB]."""
        half = len(self.along) // 2
        return float(np.polyfit(self.along[half:], self.memory[half:], 1)[0])


class CycleTimes:
    """Is told of a run's progress about ten times a second of its time."""

    def __init__(self, period: float) -> None:
        self._period = period
        self._before: tuple[float, float] | None = None
        self.found: list[float] = []

    def __call__(self, now: float, _phase: str) -> None:
        """Takes the run's time [s]."""
        wall = time.perf_counter()
        if self._before is not None:
            cycles = round((now - self._before[0]) / self._period)
            self.found.append(1e6 * (wall - self._before[1]) / max(cycles, 1))
        self._before = now, wall


def long_work(minutes: float) -> Watch:
    """Carries out one long run."""
    watch = Watch()
    with tempfile.TemporaryDirectory() as name:
        assembly = long_task(Path(name), minutes)
        times = CycleTimes(assembly.period)
        shown = [0.0]

        def on_progress(now: float, phase: str) -> None:
            times(now, phase)
            if now >= shown[0] and times.found:
                watch.add(now, float(np.median(times.found)))
                times.found.clear()
                shown[0] = now + 60.0 * minutes / (10 * PARTS)

        run(assembly, Path(name) / "run", None, on_progress)
    return watch


def short_runs(count: int) -> Watch:
    """Carries out many short runs, one after the other."""
    watch = Watch()
    for number in range(1, count + 1):
        with tempfile.TemporaryDirectory() as name:
            assembly = assemble(str(TASK), effects=None, rate=None, scale=1.0, arm=None)
            times = CycleTimes(assembly.period)
            run(assembly, Path(name) / "run", SHORT, times)
        watch.add(number, float(np.median(times.found)))
    return watch


def run(assembly: Assembly, out: Path, duration: float | None, on_progress: CycleTimes) -> None:
    """Carries out one run with its files.

    Raises:
        SystemExit: It stopped.
    """
    options = RunOptions(out=out, seed=0, duration=duration, live=False, read_only=False, backend="sim")
    backend = make_backend(assembly, backend="sim", log=None, seed=0)
    result = carry_out(assembly, backend, options, on_progress)
    shutil.rmtree(out)
    if result.ending is None or result.summary["ending"] not in ("done", "interrupted"):
        raise SystemExit(f"the run stopped: {result.reason}")


def show(title: str, unit: str, rows: Sequence[tuple[float, float, float]]) -> None:
    """Prints a table."""
    print(f"\n{title}\n| {unit} | memory [MB] | median cycle [us] |\n|---|---|---|")
    for along, used, cycle in rows:
        print(f"| {along:.0f} | {used:.0f} | {cycle:.0f} |")


def main() -> None:
    """Runs and prints."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.runs.long_use", description=__doc__)
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--runs", type=int, default=1000)
    options = parser.parse_args()
    if options.minutes > 0.0:
        began = time.perf_counter()
        watch = long_work(options.minutes)
        show(f"one run of {options.minutes:.0f} simulated minutes", "second", watch.rows())
        print(f"{60.0 * watch.growth():.3f} MB per simulated minute in its later half")
        print(f"{time.perf_counter() - began:.0f} s", flush=True)
    if options.runs > 0:
        began = time.perf_counter()
        watch = short_runs(options.runs)
        show(f"{options.runs} runs of {SHORT} s in one process, with all files", "run", watch.rows())
        print(f"{watch.growth():.4f} MB per run in the later half, bound {LARGEST_GROWTH} MB")
        print(f"{time.perf_counter() - began:.0f} s", flush=True)


if __name__ == "__main__":
    main()
