# SPDX-License-Identifier: BSD-3-Clause
"""How much faster than real time a whole simulated run is, and where its time goes.

Usage: python -m benchmarks.runs.run_speed [TASK] [RATE]

A short run goes first, so that everything is compiled. Wall time counts from the first cycle until all files but the
picture are whole; the picture stands apart. On a busy machine the time that the loop's thread was ready to run and had
no processor is told apart, and processor times are given, which other jobs do not stretch as much.
"""

from __future__ import annotations

import functools
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path

from impedance_modules.backends.sim_backend import SimBackend
from impedance_modules.control.assembly import assemble
from impedance_modules.control.controller import Controller
from impedance_modules.control.supervisor import Supervisor
from impedance_modules.plant.plant import Plant
from impedance_modules.runs import execution as run
from impedance_modules.runs.execution import RunOptions, RunResult, carry_out
from impedance_modules.runs.recorder import Recorder
from impedance_modules.runs.run_backends import make_backend
from impedance_modules.runs.run_summary import Summary
from impedance_modules.runs.scene_view import SceneView

TIMED = (
    ("robot: one period of the plant", Plant, "advance"),
    ("robot: its sensors", Plant, "sense"),
    ("controller and supervisor", Supervisor, "step"),
    ("  of which the controller", Controller, "tick"),
    ("recording a row", Recorder, "add"),
    ("3D view", SceneView, "add"),
    ("summary", Summary, "add"),
)


def timed(seconds: dict[str, float], name: str, function: Callable[..., object]) -> Callable[..., object]:
    """Wraps a method so that its processor time is added up: other jobs on the machine do not count."""

    @functools.wraps(function)
    def wrapper(*args: object, **kwargs: object) -> object:
        began = time.thread_time()
        try:
            return function(*args, **kwargs)
        finally:
            seconds[name] += time.thread_time() - began

    return wrapper


def carried_out(task: str, rate: float | None, duration: float | None) -> RunResult:
    """Runs a task into a temporary folder."""
    assembly = assemble(task, effects=None, rate=rate, scale=1.0, arm=None)
    robot = make_backend(assembly, backend="sim", log=None, seed=0)
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "run"
        options = RunOptions(out=out, seed=0, duration=duration, live=False, read_only=False, backend="sim")
        return carry_out(assembly, robot, options, lambda *_: None)


class Stopwatch:
    """Instants of a run [s]: wall clock, processor time of all threads, this thread's time in the queue for one."""

    def __init__(self) -> None:
        self.at: dict[str, tuple[float, float, float]] = {}

    def mark(self, name: str) -> None:
        """Notes when something happened for the first time."""
        # Linux: nanoseconds run, nanoseconds runnable but without a processor, time slices.
        queued = 1e-9 * int(Path("/proc/thread-self/schedstat").read_text().split()[1])
        self.at.setdefault(name, (time.perf_counter(), time.process_time(), queued))

    def between(self, first: str, last: str) -> tuple[float, float, float]:
        """Returns wall time, processor time and time in the queue from one mark to another."""
        before, after = self.at[first], self.at[last]
        return after[0] - before[0], after[1] - before[1], after[2] - before[2]


def watched(seconds: dict[str, float]) -> Stopwatch:
    """Marks the first cycle, before which the timed pieces count nothing, and begin and end of the picture."""
    watch, read, draw = Stopwatch(), SimBackend.read, run.write_picture

    def marked_read(backend: SimBackend) -> object:
        if not watch.at:
            seconds.clear()
            watch.mark("first cycle")
        return read(backend)

    def marked_picture(*arguments: object) -> object:
        watch.mark("picture")
        drawn = draw(*arguments)
        watch.mark("drawn")
        return drawn

    SimBackend.read, run.write_picture = marked_read, marked_picture
    return watch


def main() -> None:
    """Prints times and shares."""
    task = sys.argv[1] if len(sys.argv) > 1 else "press-and-slide"
    rate = float(sys.argv[2]) if len(sys.argv) > 2 else None
    carried_out(task, rate, 0.5)
    seconds: dict[str, float] = defaultdict(float)
    for name, owner, method in TIMED:
        setattr(owner, method, timed(seconds, name, getattr(owner, method)))
    watch = watched(seconds)
    result = carried_out(task, rate, None)
    simulated, cycles = float(result.summary["duration"]), int(result.summary["cycles"])
    wall, processor, queued = watch.between("first cycle", "picture")
    inside = sum(value for name, value in seconds.items() if not name.startswith(" "))
    print(f"{task}: {simulated:.2f} s simulated, ended {result.summary['ending']} {result.reason}")
    drawing, *_ = watch.between("picture", "drawn")
    print(f"  wall {wall:.2f} s = {simulated / wall:.2f} x real time, and {drawing:.2f} s for the picture")
    alone = wall - queued
    print(f"  without the wait for a processor {alone:.2f} s = {simulated / alone:.2f} x real time")
    print(f"  processor, all threads {processor:.2f} s = {simulated / processor:.2f} x real time")
    print(f"  processor, the cycles' own {inside:.2f} s = {simulated / inside:.2f} x real time, of which")
    for name, _, _ in TIMED:
        spent, each = seconds[name], 1e6 * seconds[name] / cycles
        print(f"    {name:32s} {spent:6.2f} s  {100 * spent / inside:5.1f} %  {each:6.1f} us a cycle")


if __name__ == "__main__":
    main()
