# SPDX-License-Identifier: BSD-3-Clause
"""Runs one tool on every case, in processes of its own, and keeps its answer, time and memory.

A tool sees copies of a case's logs in a folder of their own, nothing else.
"""

from __future__ import annotations

import json
import math
import os
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.blind.blocks import CASES, COUNTS, SEALED
from benchmarks.blind.three_names import FOLDER

ANSWERS = "answers"
WALL_TIME_FACTOR = 10.0
"""Wall time allowed per second of processor time."""
ROBOTS = {"arm5": str(FOLDER)}
"""Robots that are not the package's own, by their folders."""
TOOLS = ("impedance", "least-squares", "sysid")


@dataclass(frozen=True)
class Selection:
    """Which cases to run with which tool, and how.

    Attributes:
        tool: One of `TOOLS`.
        blocks: All where empty.
        cases: Names; all of the blocks where empty.
        again: Whether cases that have an answer are asked again.
        timeout: Processor time per case [s].
        jobs: Cases side by side.
        tolerance: Of `impedance diagnose`; None for its default.
    """

    tool: str
    blocks: tuple[str, ...] = ()
    cases: tuple[str, ...] = ()
    again: bool = False
    timeout: float = 180.0
    jobs: int = 2
    tolerance: float | None = None


def run_all(out: Path, answers: Path, selection: Selection, tell: Callable[[str], None]) -> None:
    """Diagnoses all wanted cases that have no answer yet; stopped and started again it goes on."""
    folder = answers / selection.tool
    folder.mkdir(parents=True, exist_ok=True)
    blocks = selection.blocks or tuple(
        block for block in COUNTS if block != "N" or selection.tool == TOOLS[0]
    )
    names = [name for name in names_of(out, blocks) if not selection.cases or name in selection.cases]

    def one(name: str) -> str:
        record = run_case(out / CASES / name, selection, folder / f"{name}.json")
        (folder / f"{name}.run.json").write_text(json.dumps(record) + "\n")
        return f"{name} exit {record['exit']} {record['seconds']:.1f} s {record['memory_mb']:.0f} MB"

    told = f"{selection.tool} "
    again, jobs = selection.again, selection.jobs
    ask_waiting(names, folder, one, lambda line: tell(told + line), again=again, jobs=jobs)


def ask_waiting(
    names: Sequence[str],
    folder: Path,
    one: Callable[[str], str],
    tell: Callable[[str], None],
    *,
    again: bool,
    jobs: int,
) -> None:
    """Asks about cases that have no record in a folder yet; ``one`` writes it and says how it went."""
    waiting = [name for name in names if again or not (folder / f"{name}.run.json").exists()]

    def ask(name: str) -> str:
        (folder / f"{name}.json").unlink(missing_ok=True)
        return one(name)

    with ThreadPoolExecutor(jobs) as pool:
        for i, line in enumerate(pool.map(ask, waiting)):
            tell(f"{i + 1}/{len(waiting)} {line}")


def names_of(out: Path, blocks: Sequence[str]) -> list[str]:
    """Returns the case names of some blocks, in alphabetic order, which says nothing about the truth."""
    found: list[str] = []
    for sealed in sorted((out / SEALED).glob("*.json")):
        if not blocks or sealed.stem in blocks:
            found += list(json.loads(sealed.read_text())["cases"])
    return sorted(found)


def run_case(case: Path, selection: Selection, answer: Path) -> dict[str, Any]:
    """Runs a tool on one case.

    Returns:
        exit (negative where the time was up), seconds on the wall and of the processor, peak memory [MB] and the end of
        what it printed as errors.
    """
    shown = json.loads((case / "case.json").read_text())
    with tempfile.TemporaryDirectory(prefix="blind-") as room:
        for name in (*shown["logs"], *shown["holdout"]):
            shutil.copy(case / name, room)
        command = _command(selection, shown, answer.resolve())
        return measured(["nice", "-n", "5", *command], Path(room), selection.timeout)


def measured(command: Sequence[str], room: Path, timeout: float) -> dict[str, Any]:
    """Runs a command in a folder, its processor time limited [s]; the record that ``run_case`` returns."""
    errors, start = room / "errors.txt", time.monotonic()
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    environment["PYTHONPATH"] = os.pathsep.join([os.getcwd(), environment.get("PYTHONPATH", "")])
    with errors.open("wb") as sink:
        process = subprocess.Popen(command, cwd=room, stdout=subprocess.DEVNULL, stderr=sink, env=environment)
        limit = math.ceil(timeout)
        resource.prlimit(process.pid, resource.RLIMIT_CPU, (limit, limit))
        status, used, memory = wait_for(process, WALL_TIME_FACTOR * timeout)
    seconds = time.monotonic() - start
    said = errors.read_text(errors="replace")[-2000:]
    times = {"seconds": seconds, "processor_seconds": used}
    return {"exit": status, **times, "memory_mb": memory, "errors": said}


def wait_for(process: subprocess.Popen[bytes], timeout: float) -> tuple[int | None, float, float]:
    """Waits for a child; kills it when it takes much too long.

    Returns:
        Exit status (None when killed here), processor time [s] and peak memory [MB].
    """
    end = time.monotonic() + timeout
    while time.monotonic() < end:
        pid, status, usage = os.wait4(process.pid, os.WNOHANG)
        if pid:
            process.returncode = os.waitstatus_to_exitcode(status)
            return process.returncode, usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024
        time.sleep(0.05)
    process.kill()
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    return None, usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024


def _command(selection: Selection, shown: dict[str, Any], answer: Path) -> list[str]:
    tool = selection.tool
    held = [word for name in shown["holdout"] for word in ("--holdout", name)]
    if tool == "impedance":
        without = [word for name in shown["without"] for word in ("--without", name)]
        words = [
            "diagnose",
            *shown["logs"],
            *held,
            "--robot",
            ROBOTS.get(shown["robot"], shown["robot"]),
            "--json",
            str(answer),
            *without,
            *([] if selection.tolerance is None else ["--tolerance", str(selection.tolerance)]),
        ]
        return [sys.executable, "-m", "impedance_modules", *words]
    module = {"least-squares": "baseline_least_squares", "sysid": "baseline_sysid"}[tool]
    return [sys.executable, "-m", f"benchmarks.blind.{module}", str(answer), *shown["logs"], *held]
