# SPDX-License-Identifier: BSD-3-Clause
"""What `impedance diagnose --jobs J` gains: wall time and processor time on sets that it makes itself.

    python -m benchmarks.diagnosis.workers six-of-18 --jobs 2 --runs 3

One core and J cores take turns, each run in a process of its own with one thread for numpy. Printed are medians and,
in brackets, least and greatest. ``wall`` is from the first recording read to the answer, the start of the workers
included; ``main`` is the processor time of the process that was started, and ``all`` that of its workers with it. On a
machine that has other work to do, wall times are of little worth, and ``main`` says what is left to be waited for where
workers are many. The answers must be equal in every number.
"""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click

from benchmarks.diagnosis.recorded_sets import SETS, compared_with, make_set

FIGURES = ("wall", "main", "all")


def diagnose_once(folder: Path, jobs: int) -> None:
    """Diagnoses a set; prints seconds and the answer."""
    from impedance_modules.diagnosis.compared_recordings import diagnosed
    from impedance_modules.diagnosis.report.diagnosis_files import diagnosis_object

    given = compared_with(folder)
    wall, before = time.perf_counter(), os.times()
    found = diagnosed(given.pop("logs"), [], jobs=jobs, **given)
    wall, after = time.perf_counter() - wall, os.times()
    main = after.user + after.system - before.user - before.system
    others = after.children_user + after.children_system
    answer = {"wall": wall, "main": main, "all": main + others, "answer": diagnosis_object(found)}
    click.echo(json.dumps(answer))


def run_apart(folder: Path, jobs: int) -> dict[str, Any]:
    """Diagnoses a set in a process of its own; its workers do not import this file."""
    code = (
        "from pathlib import Path; from benchmarks.diagnosis.workers import diagnose_once;"
        f" diagnose_once(Path({str(folder)!r}), {jobs})"
    )
    done = subprocess.run(
        [sys.executable, "-c", code],
        stdout=subprocess.PIPE,
        env={**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"},
        check=True,
        text=True,
    )
    found: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return found


def line(name: str, found: Sequence[dict[str, Any]]) -> str:
    """Median, least and greatest of each figure."""
    parts = []
    for figure in FIGURES:
        each = [one[figure] for one in found]
        parts.append(f"{figure} {statistics.median(each):6.1f} s ({min(each):.1f} to {max(each):.1f})")
    return f"{name:12} {', '.join(parts)}"


@click.command()
@click.argument("names", nargs=-1, type=click.Choice(tuple(SETS)))
@click.option("--jobs", type=click.IntRange(1), default=2, show_default=True)
@click.option("--runs", type=click.IntRange(1), default=3, show_default=True)
@click.option("--sets", type=click.Path(path_type=Path), default=Path("out/diagnose-sets"), show_default=True)
def main(names: tuple[str, ...], jobs: int, runs: int, sets: Path) -> None:
    """Times the diagnosis of some sets with one core and with J; ends with 1 where the answers differ."""
    for name in names or ("five-of-12", "six-of-18"):
        folder = make_set(name, sets)
        both = [(run_apart(folder, 1), run_apart(folder, jobs)) for _ in range(runs)]
        alone, spread = zip(*both, strict=True)
        click.echo(line(name, alone))
        click.echo(line(f"  {jobs} jobs", spread))
        ratios = [one["wall"] / other["wall"] for one, other in both]
        click.echo(
            f"  wall time is divided by {statistics.median(ratios):.2f} ({min(ratios):.2f} to {max(ratios):.2f})"
        )
        if any(one["answer"] != other["answer"] for one, other in both):
            click.echo("  the answers differ")
            raise SystemExit(1)


if __name__ == "__main__":
    main()
