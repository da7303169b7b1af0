# SPDX-License-Identifier: BSD-3-Clause
"""Runs both arms of the simulated Baxter for half an hour over its own ROS master; prints memory, commands and stops.

Usage: python -m benchmarks.backends.baxter_endurance
           [--minutes 30] [--rate 500] [--port 11411] [--transport T] [--first]

Needs ``rosmaster`` (apt-get install --no-install-recommends python3-roslaunch) and an otherwise idle machine, or two
cores of a busy one and the right to ``--first``: robot and controller then have real-time priority, as long as they
leave 5 % of every second: Linux suspends real-time processes that do not, for 50 ms, which ends the run. A machine that
is itself a guest can be stopped by its host; the last line says when it was, and whether that is what ended the run.
The task is the shipped mirrored-arms drawn out, its tank made ample: the loop is measured here, not the energy.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq

from benchmarks.backends.machine_pauses import PauseWatch, describe
from impedance_modules.runs.recorder import MISSED

TASK = Path(__file__).parents[2] / "tasks" / "mirrored-arms.yaml"
IMPEDANCE = [sys.executable, "-m", "impedance_modules"]


def drawn_out(seconds: float, folder: Path) -> Path:
    """Writes the task with its middle phase this long."""
    text = TASK.read_text()
    text = re.sub(r"duration: 8\n", f"duration: {seconds:g}\n", text)
    text = re.sub(r"tank: \{initial: [\d.]+, max: [\d.]+,", "tank: {initial: 400, max: 800,", text)
    path = folder / "endurance.yaml"
    path.write_text(text)
    return path


def memory(process: subprocess.Popen[bytes]) -> float:
    """Resident memory [MB]."""
    pages = int(Path(f"/proc/{process.pid}/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def missed(folder: Path) -> str:
    """Says how many cycles had no state, and the longest time between two rows."""
    table = pq.read_table(folder / "episode.parquet", columns=["time", MISSED])
    without, gaps = table[MISSED].to_numpy(), np.diff(table["time"].to_numpy())
    return f"without a state {without.sum():.0f}, longest time between two states {1e3 * gaps.max():.1f} ms"


def main() -> None:
    """Runs and prints."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=30.0)
    parser.add_argument("--rate", type=int, default=500)
    parser.add_argument("--port", type=int, default=11411)
    parser.add_argument("--transport", default="sockets")
    parser.add_argument("--first", action="store_true", help="robot and controller at real-time priority")
    options = parser.parse_args()
    os.environ.update(ROS_MASTER_URI=f"http://127.0.0.1:{options.port}", ROS_IP="127.0.0.1")
    started: list[subprocess.Popen[bytes]] = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        try:
            with PauseWatch() as watch:
                run(options, folder, started, watch)
        finally:
            for process in reversed(started):
                if process.poll() is None:
                    process.send_signal(signal.SIGTERM)
                    process.wait(30)


def go_first(process: subprocess.Popen[bytes]) -> None:
    """Gives a process that has just begun, with all threads it will have, real-time priority."""
    os.sched_setscheduler(process.pid, os.SCHED_FIFO, os.sched_param(5))


def run(
    options: argparse.Namespace, folder: Path, started: list[subprocess.Popen[bytes]], watch: PauseWatch
) -> None:
    """Starts master, simulator and task; prints the memory of both until the task is done."""
    task, log = drawn_out(60.0 * options.minutes, folder), folder / "log.jsonl"
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    started.append(subprocess.Popen(["rosmaster", "--core", "-p", str(options.port)], **quiet))
    time.sleep(2.0)
    simulator = subprocess.Popen(
        [*IMPEDANCE, "baxter", "fake", "--posture", "mirrored-arms", "--enabled", "--log", str(log)],
        stdout=subprocess.PIPE,
        start_new_session=True,
    )
    started.append(simulator)
    if options.first:
        go_first(simulator)
    print(simulator.stdout.readline().decode().rstrip())
    words = f"run {task} --backend baxter --rate {options.rate} --transport {options.transport}"
    controller = subprocess.Popen(
        [*IMPEDANCE, *words.split(), "--out", str(folder / "run")], start_new_session=True
    )
    started.append(controller)
    if options.first:
        go_first(controller)
    began, shown = time.monotonic(), 0.0
    while controller.poll() is None:
        time.sleep(1.0)
        if time.monotonic() - shown > 60.0 and controller.poll() is None:
            shown = time.monotonic()
            both = f"controller {memory(controller):.0f} MB, simulator {memory(simulator):.0f} MB"
            print(f"{(shown - began) / 60:6.1f} min: {both}", flush=True)
    ended = time.monotonic()
    lines = [json.loads(line) for line in log.read_text().splitlines()]
    events = [f"{line['time']:.1f} s {line['event']}" for line in lines if line["event"]]
    print(f"exit {controller.returncode}; {lines[-1]['commands']} commands; events: {events or 'none'}")
    summary = json.loads((folder / "run" / "summary.json").read_text())
    print(f"cycles {summary['cycles']}, late {summary['late_cycles']}, {missed(folder / 'run')}")
    pauses = [pause for pause in watch.pauses() if began <= pause.began <= ended]
    print(f"{describe(pauses, began)}; the run ended after {ended - began:.1f} s")


if __name__ == "__main__":
    main()
