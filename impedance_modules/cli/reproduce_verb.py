# SPDX-License-Identifier: BSD-3-Clause
"""``impedance reproduce``: runs the thesis's experiments and compares with what the thesis prints."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

import click

from impedance_modules.cli.plain_lines import say

if TYPE_CHECKING:
    from rich.console import Console

    from impedance_experiments.thesis_experiments import Experiment
    from impedance_experiments.thesis_page import Page, Size


@click.command("reproduce")
@click.argument("name", metavar="[NAME|all]", required=False)
@click.option("--list", "listed", is_flag=True, help="Print one experiment per line and exit.")
@click.option("--full", is_flag=True, help="The long form: all runs of the committed tables.")
@click.option("--short", is_flag=True, help="The shortest form that still measures something; tests run it.")
@click.option("--seed", type=click.IntRange(0), default=0, show_default=True, help="First seed.")
@click.option(
    "--out", type=click.Path(path_type=Path), default=Path("out/thesis"), show_default=True, help="Pages."
)
@click.option(
    "--keep",
    type=click.Path(path_type=Path),
    help="Keep recordings and single runs here; started again, the same program goes on from there.",
)
def reproduce_command(
    name: str | None, listed: bool, full: bool, short: bool, seed: int, out: Path, keep: Path | None
) -> int:
    """Run one experiment of the thesis, or all, and write pages with tables and plots.

    Exit: 0 done, 2 no such experiment.
    """
    from impedance_modules.extras import need

    need("matplotlib", "impedance reproduce")
    from impedance_experiments.thesis_experiments import EXPERIMENTS, find_experiment
    from impedance_modules.cli.terminal import Terminal
    from impedance_modules.errors import BadInput

    if listed or name is None:
        width = max(len(entry) for entry in EXPERIMENTS)
        for entry in EXPERIMENTS.values():
            say(f"{entry.name:<{width}}  {entry.section:<14}  {entry.question}")
        return 0
    if full and short:
        raise BadInput("--full and --short exclude each other")
    chosen = list(EXPERIMENTS.values()) if name == "all" else [find_experiment(name)]
    _carry_out(chosen, _size(full=full, short=short), seed, out, keep, Terminal())
    return 0


def _size(*, full: bool, short: bool) -> Size:
    from impedance_experiments.thesis_page import Size

    if full:
        return Size.FULL
    return Size.SHORT if short else Size.NORMAL


def _carry_out(
    chosen: list[Experiment], size: Size, seed: int, out: Path, keep: Path | None, console: Console
) -> None:
    from rich.progress import Progress

    from impedance_experiments.page_files import command_of, write_index, write_page

    done: list[tuple[Experiment, Page]] = []
    with tempfile.TemporaryDirectory() as temporary, Progress(console=console, transient=True) as bar:
        for number, experiment in enumerate(chosen):
            line = bar.add_task(experiment.name, total=1.0)
            work = (keep or Path(temporary)) / experiment.name
            work.mkdir(parents=True, exist_ok=True)
            before = _processor_time()
            page = _run(experiment, size, seed, work, bar, line)
            made = command_of(experiment.name, size, seed)
            path = write_page(experiment, page, made, _processor_time() - before, out)
            index = write_index(out)
            done.append((experiment, page))
            bar.console.print(f"{number + 1}/{len(chosen)}  {experiment.name}: {path}")
    _print_comparisons(done, console)
    console.print(f"thesis against ours, all pages there: {index}")


def _processor_time() -> float:
    """Processor time of this process and of those that it has waited for [s]."""
    used = os.times()
    return used.user + used.system + used.children_user + used.children_system


def _run(experiment: Experiment, size: Size, seed: int, work: Path, bar: object, line: object) -> Page:
    from impedance_experiments.thesis_page import Settings

    def on_progress(share: float, doing: str) -> None:
        bar.update(line, completed=share, description=f"{experiment.name}: {doing}")  # type: ignore[attr-defined]

    return experiment.run(Settings(size=size, seed=seed, work=work, on_progress=on_progress))


def _print_comparisons(done: list[tuple[Experiment, Page]], console: Console) -> None:
    """Prints what the thesis says beside what came out."""
    from rich.table import Table

    from impedance_experiments.page_files import cell_text

    table = Table(title="thesis against ours", title_justify="left")
    for column in ("experiment", "quantity", "thesis", "ours", "spread", "unit"):
        table.add_column(column)
    for experiment, page in done:
        for row in page.comparisons:
            cells = (row.quantity, row.thesis, row.ours, row.spread, row.unit)
            table.add_row(experiment.name, *(cell_text(cell) for cell in cells))
    console.print(table)
