# SPDX-License-Identifier: BSD-3-Clause
"""Runs everything there is to run, and goes on where it was stopped: ``make verify``.

    python -m tests.verify [--jobs N] [--match TEXT]

Lint, types, the reference, every test file in a process of its own with all of its tests, all mutants, every verb
with every option, all experiments of the thesis. Each has a result in ``out/verify/TREE/``, where TREE is a digest
of all files that git knows or does not ignore. What has passed on the same tree is not run again; what failed or was
interrupted is. Exit 1 if anything failed.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import re
import subprocess
import sys
import time
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path

from impedance_experiments.thesis_experiments import EXPERIMENTS
from tests.support.paths import CHECKOUT

PYTHON = sys.executable
NOTHING_TO_RUN = 5
"""Exit code of pytest where no test was chosen."""
LAST_LINES = 15
"""Of the output of what failed."""


@dataclass(frozen=True)
class Job:
    """One thing to run.

    Attributes:
        name: In the table; its result's file is called after it.
        command: From the checkout's root.
        alone: It needs all processors, or real time.
        passes: Exit codes that are no failure.
    """

    name: str
    command: tuple[str, ...]
    alone: bool = False
    passes: tuple[int, ...] = (0,)


@dataclass(frozen=True)
class Outcome:
    """How a job ended: whether it passed, wall and processor time [s], when (UTC), and in which try."""

    name: str
    passed: bool
    exit_code: int
    wall_time: float
    processor_time: float
    at: str
    tries: int


def digest(root: Path) -> str:
    """Names a tree by the content of all files that git knows or does not ignore, and by the version of Python."""
    command = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    listed = subprocess.run(command, cwd=root, check=True, capture_output=True).stdout
    summed = hashlib.sha256(sys.version.encode())
    for name in sorted(filter(None, listed.split(b"\0"))):
        path = root / os.fsdecode(name)
        if path.is_file():
            summed.update(name + b"\0" + hashlib.sha256(path.read_bytes()).digest())
    return summed.hexdigest()[:16]


def all_jobs(folder: Path) -> list[Job]:
    """Lists everything, what needs all processors last."""
    lint = [
        Job("ruff check", (PYTHON, "-m", "ruff", "check", ".")),
        Job("ruff format", (PYTHON, "-m", "ruff", "format", "--check", ".")),
        Job("mypy", (PYTHON, "-m", "mypy")),
        Job("reference", ("make", "docs")),
    ]
    mutants = [
        Job(f"mutants of {area.stem}", (PYTHON, "-m", "tests.mutants", "--only", area.stem))
        for area in sorted((CHECKOUT / "tests" / "mutants").glob("*.py"))
        if not area.stem.startswith(("_", "test_"))
    ]
    pages, kept = str(folder / "thesis"), str(folder / "recordings")
    chance = Job("random mutants", (PYTHON, "-m", "tests.random_mutants", "--count", "24", "--seed", "2"))
    experiments = [
        Job(
            f"reproduce {name}",
            (PYTHON, "-m", "impedance_modules", "reproduce", name, "--out", pages, "--keep", kept),
            alone=True,
        )
        for name in EXPERIMENTS
    ]
    seen = Job("functions that commands call", (PYTHON, "-m", "tests.seen_functions"), alone=True)
    return [*lint, *_tests(), *mutants, chance, seen, *experiments]


def _tests() -> list[Job]:
    """Lists the test files; tests in real time have a job of their own."""
    jobs = []
    for path in sorted((CHECKOUT / "tests").rglob("test_*.py")):
        name = str(path.relative_to(CHECKOUT))
        pytest = (PYTHON, "-m", "pytest", "-q", "-p", "no:cacheprovider", "--durations=5", name)
        jobs.append(Job(name, (*pytest, "-m", "not ros and not realtime"), passes=(0, NOTHING_TO_RUN)))
        if re.search(r"mark\.(ros|realtime)\b", path.read_text()):
            jobs.append(Job(f"{name} (ros)", (*pytest, "-m", "ros or realtime"), alone=True))
    return jobs


def kept_in(folder: Path, name: str) -> Path:
    """Path of a job's result; its output stands beside it, as ``.log``."""
    return folder / ("".join(letter if letter.isalnum() else "-" for letter in name) + ".json")


def run_job(job: Job, folder: Path) -> Outcome:
    """Runs a job, unless it has passed before, and keeps its result and its output."""
    result = kept_in(folder, job.name)
    output = result.with_suffix(".log")
    before = Outcome(**json.loads(result.read_text())) if result.is_file() else None
    if before is not None and before.passed:
        return before
    began = time.perf_counter()
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1", "MPLBACKEND": "Agg", "EVERY_TASK": "1"}
    with output.open("wb") as log:
        process = subprocess.Popen(
            job.command, cwd=CHECKOUT, stdout=log, stderr=subprocess.STDOUT, env=environment
        )
        _, status, used = os.wait4(process.pid, 0)
        process.returncode = code = os.waitstatus_to_exitcode(status)
    outcome = Outcome(
        name=job.name,
        passed=code in job.passes,
        exit_code=code,
        wall_time=round(time.perf_counter() - began, 1),
        processor_time=round(used.ru_utime + used.ru_stime, 1),
        at=time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
        tries=1 if before is None else before.tries + 1,
    )
    partial = result.with_suffix(".part")
    partial.write_text(json.dumps(asdict(outcome), indent=1))
    partial.replace(result)
    return outcome


def run_all(
    jobs: Iterable[Job], folder: Path, workers: int, tell: Callable[[Outcome], None]
) -> list[Outcome]:
    """Runs jobs side by side, then one by one those that need the machine for themselves."""
    folder.mkdir(parents=True, exist_ok=True)
    jobs = list(jobs)
    outcomes = []
    for several, part in (
        (workers, [job for job in jobs if not job.alone]),
        (1, [job for job in jobs if job.alone]),
    ):
        with ThreadPoolExecutor(several) as pool:
            try:
                for outcome in pool.map(lambda job: run_job(job, folder), part):
                    outcomes.append(outcome)
                    tell(outcome)
            except KeyboardInterrupt:
                pool.shutdown(cancel_futures=True)
                raise
    return outcomes


def line_of(outcome: Outcome) -> str:
    """Writes a row of the table."""
    how = "passed" if outcome.passed else f"FAILED (exit {outcome.exit_code})"
    again = "" if outcome.tries == 1 else f"  in try {outcome.tries}"
    return f"{outcome.wall_time:8.1f} {outcome.processor_time:8.1f}  {how:<9} {outcome.name}{again}"


def main() -> int:
    """Runs what is missing on this tree and prints all results; returns the exit code."""
    parser = argparse.ArgumentParser(prog="python -m tests.verify", description=__doc__)
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="how many run at the same time")
    parser.add_argument("--match", default="", help="only what has this in its name")
    options = parser.parse_args()
    tree = digest(CHECKOUT)
    folder = CHECKOUT / "out" / "verify" / tree
    jobs = [job for job in all_jobs(folder) if options.match in job.name]
    print(
        f"tree {tree}, {len(jobs)} jobs; results and output in {folder.relative_to(CHECKOUT)}\n  wall [s]  cpu [s]"
    )
    outcomes = run_all(jobs, folder, options.jobs, lambda outcome: print(line_of(outcome), flush=True))
    failed = [outcome for outcome in outcomes if not outcome.passed]
    wall, used = (
        sum(getattr(outcome, time) for outcome in outcomes) for time in ("wall_time", "processor_time")
    )
    print(f"{wall:8.1f} {used:8.1f}  {len(outcomes) - len(failed)} passed, {len(failed)} failed")
    for outcome in failed:
        output = kept_in(folder, outcome.name).with_suffix(".log")
        print(f"\n{line_of(outcome)}\n{output.relative_to(CHECKOUT)} ends with")
        print("\n".join(output.read_text(errors="replace").splitlines()[-LAST_LINES:]))
    if digest(CHECKOUT) != tree:
        print("the tree changed while this ran: these results are of several trees; run it again")
        return 1
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
