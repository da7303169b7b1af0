# SPDX-License-Identifier: BSD-3-Clause
"""``impedance sweep``: many runs of one task with some of its numbers varied."""

from __future__ import annotations

import os
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING

import click

from impedance_modules.cli.shared_options import effects_option, rate_option, task_argument
from impedance_modules.errors import BadInput
from impedance_modules.worker_processes import refuse_counts

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from rich.console import Console

    from impedance_modules.tools.sweep_plan import SweepJob
    from impedance_modules.tools.sweep_runs import SweepRow

TABLE = "sweep.csv"


@click.command("sweep")
@task_argument
@click.option(
    "--vary", multiple=True, required=True, metavar="PATH=LO:HI[:N]", help="A number of the task, N values."
)
@effects_option
@rate_option
@click.option("--duration", type=float, metavar="S", help="End every run after this time.")
@click.option(
    "--random", "draws", type=int, metavar="M", help="M random draws in all ranges instead of the grid."
)
@click.option(
    "--seeds", type=int, default=1, show_default=True, metavar="K", help="K noise seeds at every point."
)
@click.option(
    "--seed", type=int, default=0, show_default=True, metavar="N", help="First seed of noise and draws."
)
@click.option("--jobs", type=int, metavar="J", help="Local cores  [default: all].")
@click.option("--scheduler", metavar="ADDRESS", help="Use an existing Dask cluster instead of local cores.")
@click.option("--keep", is_flag=True, help="Keep every run's recording in DIR/runs.")
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    metavar="DIR",
    help="Folder of table and plots  [default: out/sweep-TASK].",
)
def sweep_command(
    task: str,
    vary: tuple[str, ...],
    effects: Path | None,
    rate: float | None,
    duration: float | None,
    draws: int | None,
    seeds: int,
    seed: int,
    jobs: int | None,
    scheduler: str | None,
    keep: bool,
    out: Path | None,
) -> int:
    """Run TASK many times with numbers of its file varied, and tabulate the results.

    PATH is a number's place in the task file, e.g. environment.0.height or arms.right.springs.hand.stiffness.x; one
    that begins with effects. is a number of the patch. Writes DIR/sweep.csv, a line for every run as it ends, and a
    plot over every PATH. A run that is refused or stops is a result, too. Exit: 0 done, 2 bad input, or every run was
    refused.
    """
    from impedance_modules.cli.terminal import Terminal
    from impedance_modules.tools.sweep_plan import SweepPlan, make_jobs, read_range
    from impedance_modules.tools.sweep_runs import REFUSED

    _refuse_counts(draws=draws, seeds=seeds, duration=duration)
    refuse_counts(jobs, scheduler)
    ranges = tuple(map(read_range, vary))
    folder = out if out is not None else Path("out") / f"sweep-{Path(task).stem}"
    plan = SweepPlan(
        task, ranges, effects, draws, seeds, seed, rate, duration, folder / "runs" if keep else None
    )
    todo = make_jobs(plan)
    if (folder / TABLE).exists():
        raise BadInput(f"{folder} holds a sweep already (valid: another --out, or remove it)")
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise BadInput(f"{folder}: cannot be written: {error.strerror} (valid: a writable folder)") from error
    console = Terminal()
    rows = _collect(
        _running(todo, jobs, scheduler), len(todo), [found.path for found in ranges], folder, console
    )
    _print(rows, console)
    return 2 if all(row.ending == REFUSED for row in rows) else 0


def _refuse_counts(*, draws: int | None, seeds: int, duration: float | None) -> None:
    for option, count in (("--random", draws), ("--seeds", seeds)):
        if count is not None and count < 1:
            raise BadInput(f"{option} {count}: not a number of runs (valid: 1 or more)")
    if duration is not None and not duration > 0.0:
        raise BadInput(f"--duration {duration:g} s: nothing would run (valid: above 0)")


def _running(todo: Sequence[SweepJob], jobs: int | None, scheduler: str | None) -> Iterator[SweepRow]:
    from impedance_modules.tools.sweep_runs import run_here, run_on_cluster

    if scheduler is not None:
        return run_on_cluster(todo, scheduler)
    return run_here(todo, jobs if jobs is not None else os.cpu_count() or 1)


def _collect(
    running: Iterator[SweepRow], count: int, paths: list[str], folder: Path, console: Console
) -> list[SweepRow]:
    """Takes the rows as they come, then writes them in order with the plots."""
    from rich.progress import Progress

    from impedance_modules.extras import how_to_install, installed
    from impedance_modules.tools.sweep_report import TableFile, draw

    table = TableFile(folder / TABLE, paths)
    rows: list[SweepRow] = []
    with Progress(console=console, transient=True) as progress:
        bar = progress.add_task("running", total=count)
        for row in running:
            rows.append(row)
            table.add(row)
            progress.advance(bar)
    rows.sort(key=lambda row: row.number)
    table.rewrite(rows)
    written = [folder / TABLE, *draw(rows, paths, folder)]
    console.print("\n".join(map(str, written)), highlight=False, soft_wrap=True)
    if not installed("matplotlib"):
        console.print(f"no plots: they need matplotlib ({how_to_install('matplotlib')})", markup=False)
    return rows


def _print(rows: Sequence[SweepRow], console: Console) -> None:
    """Prints how the runs ended and each result's spread."""
    from rich.table import Table
    from rich.text import Text

    from impedance_modules.tools.sweep_report import spread

    endings = Counter(row.ending for row in rows)
    console.print(", ".join(f"{count} {ending}" for ending, count in endings.most_common()), highlight=False)
    refused = next((row for row in rows if row.ending == "refused"), None)
    if refused is not None:
        console.print(
            f"first refused, run {refused.number}: {refused.reason}", highlight=False, soft_wrap=True
        )
    table = Table(title="over all runs that ran", title_justify="left")
    for name in ("result", "least", "5 %", "median", "95 %", "largest"):
        table.add_column(name, justify="left" if name == "result" else "right")
    for name, values in spread(rows).items():
        table.add_row(Text(name), *(f"{value:.4g}" for value in values))
    if table.row_count:
        console.print(table)
