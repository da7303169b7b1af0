# SPDX-License-Identifier: BSD-3-Clause
"""Carries out a long dual-arm run with all its files and prints the process's largest memory.

Usage: python -m benchmarks.runs.long_run [MINUTES]

The task is the shipped mirrored-arms with its figure of eight drawn out to MINUTES (10) and a tank that pays for it.
The bound is 600 MB for the whole process: compiled code, plant, control, recording, 3D recording, merging, picture.
"""

from __future__ import annotations

import re
import resource
import sys
import tempfile
import time
from pathlib import Path

from impedance_modules.control.assembly import Assembly, assemble
from impedance_modules.prediction.energy_need import forecast_tank
from impedance_modules.prediction.mechanism import Mechanism
from impedance_modules.prediction.quasi_static import predict_motion
from impedance_modules.runs.execution import RunOptions, carry_out
from impedance_modules.runs.run_backends import make_backend

TASK = Path(__file__).parents[2] / "tasks" / "mirrored-arms.yaml"
DRAWN_OUT = "duration: 8\n"
TANK = re.compile(r"tank: \{initial: [\d.]+, max: [\d.]+,")
AMPLE = 800.0
"""Energy of the tank with which the need is looked for [J]."""
BOUND = 600.0


def memory() -> float:
    """Returns the largest resident memory of this process so far [MB]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3


def assembled(folder: Path, text: str, energy: float) -> Assembly:
    """Assembles the task with so much energy in its tank [J]."""
    path = folder / "long.yaml"
    path.write_text(TANK.sub(f"tank: {{initial: {energy:.2f}, max: {1.2 * energy:.2f},", text))
    return assemble(str(path), effects=None, rate=None, scale=1.0, arm=None)


def long_task(folder: Path, minutes: float) -> Assembly:
    """Writes and assembles the task."""
    text = TASK.read_text()
    if DRAWN_OUT not in text or not TANK.search(text):
        raise SystemExit(f"{TASK.name} is no longer written as this benchmark expects")
    text = text.replace(DRAWN_OUT, f"duration: {60.0 * minutes - 4.0}\n")
    ample = assembled(folder, text, AMPLE)
    need = forecast_tank(ample, Mechanism(ample), predict_motion(ample)).need
    return assembled(folder, text, 1.1 * need)


def main() -> None:
    """Runs and prints."""
    minutes = float(sys.argv[1]) if len(sys.argv) > 1 else 10.0
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        assembly = long_task(folder, minutes)
        backend = make_backend(assembly, backend="sim", log=None, seed=0)
        options = RunOptions(
            out=folder / "run", seed=0, duration=None, live=False, read_only=False, backend="sim"
        )
        shown = [60.0]
        before, began, worked = memory(), time.perf_counter(), time.process_time()

        def on_progress(now: float, _phase: str) -> None:
            if now >= shown[0]:
                print(f"  after {now / 60.0:.0f} min: {memory():.0f} MB", flush=True)
                shown[0] += 60.0

        result = carry_out(assembly, backend, options, on_progress)
        wall, worked = time.perf_counter() - began, time.process_time() - worked
        size = sum(path.stat().st_size for path in options.out.iterdir()) / 1e6
    simulated, cycles = result.summary["duration"], result.summary["cycles"]
    print(f"{simulated:.1f} s in {cycles} cycles, ended {result.summary['ending']}; {size:.0f} MB of files")
    print(f"wall {wall:.0f} s, processor {worked:.0f} s, all threads, compiling included")
    print(f"largest memory: {before:.0f} MB before the run, {memory():.0f} MB at its end, picture included")
    if memory() > BOUND:
        raise SystemExit(f"more than {BOUND:.0f} MB")


if __name__ == "__main__":
    main()
