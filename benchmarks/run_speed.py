# SPDX-License-Identifier: BSD-3-Clause
"""How much faster than real time a whole simulated run is, and where its time goes.

Usage: python benchmarks/run_speed.py [TASK] [RATE]
"""

from __future__ import annotations

import functools
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path

from impedance_modules.backends.sim import SimBackend
from impedance_modules.plant.plant import Plant
from impedance_modules.runtime.assembly import assemble
from impedance_modules.runtime.controller import Controller
from impedance_modules.runtime.prepare import make_backend
from impedance_modules.runtime.record import Recorder
from impedance_modules.runtime.run import RunOptions, carry_out
from impedance_modules.runtime.scene import SceneView
from impedance_modules.runtime.summary import Summary
from impedance_modules.runtime.supervisor import Supervisor

TIMED = (
    ("robot: one period of the plant", Plant, "advance"),
    ("robot: its sensors", Plant, "sense"),
    ("controller and supervisor", Supervisor, "step"),
    ("  of which the controller", Controller, "tick"),
    ("recording a row", Recorder, "add"),
    ("3D view, ten to fifty times a second", SceneView, "add"),
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


def main() -> None:
    """Runs one task into a temporary folder and prints the shares."""
    task = sys.argv[1] if len(sys.argv) > 1 else "press-and-slide"
    rate = float(sys.argv[2]) if len(sys.argv) > 2 else None
    seconds: dict[str, float] = defaultdict(float)
    for name, owner, method in TIMED:
        setattr(owner, method, timed(seconds, name, getattr(owner, method)))
    began = time.perf_counter()
    assembly = assemble(task, effects=None, rate=rate, scale=1.0, arm=None)
    robot = make_backend(assembly, backend="sim", log=None, seed=0)
    prepared = time.perf_counter() - began
    first_cycle: list[float] = []
    read = SimBackend.read

    def marked(backend: SimBackend) -> object:
        first_cycle.append(time.perf_counter()) if not first_cycle else None
        return read(backend)

    SimBackend.read = marked
    with tempfile.TemporaryDirectory() as folder:
        processor = time.process_time()
        options = RunOptions(
            out=Path(folder) / "run", seed=0, duration=None, live=False, read_only=False, backend="sim"
        )
        result = carry_out(assembly, robot, options, lambda *_: None)
        ended, processor = time.perf_counter(), time.process_time() - processor
    simulated = float(result.summary["duration"])
    whole = ended - first_cycle[0]
    inside = sum(value for name, value in seconds.items() if not name.startswith(" "))
    print(f"{task}: {simulated:.2f} s simulated, ended {result.summary['ending']} {result.reason}")
    print(
        f"  prepared in {prepared:.2f} s, ran and wrote in {whole:.2f} s = {simulated / whole:.2f} x real time"
    )
    print(f"  processor, all threads {processor:.2f} s = {simulated / processor:.2f} x real time")
    print(f"  processor, the cycles' own {inside:.2f} s = {simulated / inside:.2f} x real time, of which")
    for name, _, _ in TIMED:
        spent, each = seconds[name], 1e6 * seconds[name] / int(result.summary["cycles"])
        print(f"    {name:38s} {spent:6.2f} s  {100 * spent / inside:5.1f} %  {each:6.1f} us a cycle")


if __name__ == "__main__":
    main()
