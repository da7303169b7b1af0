# SPDX-License-Identifier: BSD-3-Clause
"""Processor time of `impedance diagnose`, stage by stage, on sets that it makes itself (`recorded_sets`).

    python -m benchmarks.diagnosis.diagnose_speed --runs 3
    python -m benchmarks.diagnosis.diagnose_speed five-of-12 --answers out/before

Each run is a process of its own with one thread. Printed are medians and, in brackets, least and greatest. ``whole`` is
what the process used, starting Python and compiling included; the stages are what they say, and rollouts stand apart.
``--answers`` keeps each set's JSON, for `same_answers`.
"""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
import time
from collections import defaultdict
from collections.abc import Callable
from functools import wraps
from pathlib import Path
from types import ModuleType
from typing import Any

import click

from benchmarks.diagnosis.recorded_sets import SETS, compared_with, make_set

STAGES = (
    "start",
    "reading",
    "admission",
    "residuals",
    "columns",
    "floor",
    "search",
    "conclusion",
    "rollouts",
)


class Stages:
    """Processor time of functions by stage; one that runs inside another is not counted twice."""

    def __init__(self) -> None:
        """Begins with what the process has used so far."""
        self.used: dict[str, float] = defaultdict(float)
        self._running = ["start"]
        self._last = 0.0

    def _book(self) -> None:
        now = time.process_time()
        self.used[self._running[-1]] += now - self._last
        self._last = now

    def watch(self, module: ModuleType, name: str, stage: str) -> None:
        """Books a function of a module, as that module calls it, under a stage."""
        inner: Callable[..., Any] = getattr(module, name)

        @wraps(inner)
        def booked(*args: Any, **options: Any) -> Any:
            self._book()
            self._running.append(stage)
            try:
                return inner(*args, **options)
            finally:
                self._book()
                self._running.pop()

        setattr(module, name, booked)


def diagnose_once(folder: Path, answer: Path | None) -> dict[str, float]:
    """Diagnoses a set in this process; returns processor seconds by stage."""
    stages = Stages()
    from impedance_modules.diagnosis import compared_recordings, diagnose
    from impedance_modules.diagnosis.model_selection import cause_search, repeated_search
    from impedance_modules.diagnosis.report.diagnosis_files import diagnosis_object

    stages.watch(compared_recordings, "_read", "reading")
    stages.watch(diagnose, "admit", "admission")
    stages.watch(diagnose, "prepare", "residuals")
    for name in ("candidate_regressors", "generic_basis", "build_nuisance", "build_design", "_cleaned"):
        stages.watch(cause_search, name, "columns")
    stages.watch(cause_search, "_floor", "floor")
    stages.watch(repeated_search, "search_causes", "search")
    stages.watch(diagnose, "_concluded", "conclusion")
    stages.watch(diagnose, "with_rollouts", "rollouts")
    given = compared_with(folder)
    found = compared_recordings.diagnosed(given.pop("logs"), [], **given)
    if answer is not None:
        answer.write_text(json.dumps(diagnosis_object(found), indent=1) + "\n")
    return dict(stages.used)


def run_apart(folder: Path, answer: Path | None) -> dict[str, float]:
    """Diagnoses a set in a process of its own."""
    words = ["--once", str(folder)] + ([] if answer is None else ["--answer", str(answer)])
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    before = os.times()
    done = subprocess.run(
        [sys.executable, "-m", "benchmarks.diagnosis.diagnose_speed", *words],
        stdout=subprocess.PIPE,
        env=environment,
        check=True,
        text=True,
    )
    after = os.times()
    used: dict[str, float] = json.loads(done.stdout.splitlines()[-1])
    whole = after.children_user + after.children_system - before.children_user - before.children_system
    return {**used, "whole": whole}


@click.command()
@click.argument("names", nargs=-1, type=click.Choice(tuple(SETS)))
@click.option("--runs", type=click.IntRange(1), default=3, show_default=True)
@click.option("--sets", type=click.Path(path_type=Path), default=Path("out/diagnose-sets"), show_default=True)
@click.option("--answers", type=click.Path(path_type=Path), help="Keeps SET.json of the last run here.")
@click.option("--once", type=click.Path(path_type=Path), hidden=True)
@click.option("--answer", type=click.Path(path_type=Path), hidden=True)
def main(
    names: tuple[str, ...],
    runs: int,
    sets: Path,
    answers: Path | None,
    once: Path | None,
    answer: Path | None,
) -> None:
    """Times the diagnosis of some sets, or all; prints processor seconds."""
    if once is not None:
        click.echo(json.dumps(diagnose_once(once, answer)))
        return
    if answers is not None:
        answers.mkdir(parents=True, exist_ok=True)
    for name in names or tuple(SETS):
        folder = make_set(name, sets)
        kept = None if answers is None else answers / f"{name}.json"
        found = [run_apart(folder, kept) for _ in range(runs)]
        whole = [one["whole"] for one in found]
        click.echo(f"{name:13} {statistics.median(whole):6.2f} s ({min(whole):.2f} to {max(whole):.2f})")
        for stage in STAGES:
            each = [one.get(stage, 0.0) for one in found]
            click.echo(f"  {stage:11} {statistics.median(each):6.2f}   ({min(each):.2f} to {max(each):.2f})")


if __name__ == "__main__":
    main()
