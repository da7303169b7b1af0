# SPDX-License-Identifier: BSD-3-Clause
"""Command line of the blind benchmark: generate, run, score."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import click

from benchmarks.blind.blocks import COUNTS, SEEDS
from benchmarks.blind.run import TOOLS


@click.group()
def main() -> None:
    """Blind benchmark: make logs whose cause is sealed, diagnose them, open the seal and count."""


@main.command()
@click.option("--block", "blocks", multiple=True, type=click.Choice(list(COUNTS)), help="All when left out.")
@click.option("--seeds", type=click.Choice(list(SEEDS)), required=True)
@click.option(
    "--count", type=click.IntRange(1), help="Cases per block; the block's full number when left out."
)
@click.option(
    "--first",
    type=click.IntRange(0),
    default=0,
    show_default=True,
    help="Number of the first case: others than were looked at before.",
)
@click.option("--out", type=click.Path(path_type=Path, file_okay=False), required=True)
@click.option("--jobs", type=click.IntRange(1), default=os.cpu_count, show_default="cores")
def generate(
    blocks: tuple[str, ...], seeds: str, count: int | None, first: int, out: Path, jobs: int
) -> None:
    """Makes cases and seals their truth."""
    from benchmarks.blind.blocks import generate as make_block
    from benchmarks.blind.blocks import seal_of

    for block in blocks or tuple(COUNTS):
        sealed = make_block(block, seeds, count, out, jobs, lambda text: click.echo(text, err=True), first)
        click.echo(f"{seal_of(sealed)}  {sealed}")


@main.command()
@click.option("--out", type=click.Path(path_type=Path, exists=True), required=True)
@click.option("--tool", type=click.Choice(TOOLS), default=TOOLS[0], show_default=True)
@click.option("--block", "blocks", multiple=True, type=click.Choice(list(COUNTS)), help="All when left out.")
@click.option("--case", "cases", multiple=True, metavar="NAME", help="All of the blocks when left out.")
@click.option("--again", is_flag=True, help="Ask again where an answer is kept.")
@click.option("--answers", type=click.Path(path_type=Path), help="Kept here; OUT/answers when left out.")
@click.option("--timeout", type=float, default=180.0, show_default=True, help="Processor time per case [s].")
@click.option("--jobs", type=click.IntRange(1), default=2, show_default=True)
@click.option("--tolerance", type=float, help="Of `impedance diagnose`; its default when left out.")
def run(out: Path, answers: Path | None, **selection: Any) -> None:
    """Diagnoses the cases that have no answer yet; answers go to OUT/answers/TOOL."""
    from benchmarks.blind.run import ANSWERS, Selection, run_all

    run_all(out, answers or out / ANSWERS, Selection(**selection), lambda text: click.echo(text, err=True))


@main.command()
@click.argument("out", type=click.Path(path_type=Path, exists=True))
@click.option("--answers", type=click.Path(path_type=Path), help="OUT/answers when left out.")
@click.option("--tool", type=click.Choice(TOOLS), default=TOOLS[0], show_default=True)
@click.option("--jobs", type=click.IntRange(1), default=2, show_default=True)
def oracle(out: Path, answers: Path | None, tool: str, jobs: int) -> None:
    """Measures on the arm itself how far block A's answers close the held-out gap, beside an oracle."""
    from benchmarks.blind.oracle import measure_gaps
    from benchmarks.blind.run import ANSWERS

    measure_gaps(out, answers or out / ANSWERS, tool, jobs, lambda text: click.echo(text, err=True))


@main.command()
@click.argument("out", type=click.Path(path_type=Path, exists=True))
@click.option("--answers", type=click.Path(path_type=Path), help="Where they are; OUT/answers when left out.")
@click.option("--case", "case", metavar="NAME", help="Only print truth and answers of this one.")
def score(out: Path, answers: Path | None, case: str | None) -> None:
    """Opens the seals; prints the tables, writes them beside the answers, and lists what was wrong."""
    from benchmarks.blind.run import ANSWERS
    from benchmarks.blind.score import score_all, show_case

    folder = answers or out / ANSWERS
    click.echo(score_all(out, folder) if case is None else show_case(out, folder, case))


if __name__ == "__main__":
    main()
