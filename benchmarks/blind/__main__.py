# SPDX-License-Identifier: BSD-3-Clause
"""Command line of the blind benchmark: generate, run, score."""

from __future__ import annotations

import os
from pathlib import Path

import click

from benchmarks.blind.blocks import COUNTS, SEEDS


@click.group()
def main() -> None:
    """Blind benchmark: make logs whose cause is sealed, diagnose them, open the seal and count."""


@main.command()
@click.option("--block", "blocks", multiple=True, type=click.Choice(list(COUNTS)), help="All when left out.")
@click.option("--seeds", type=click.Choice(list(SEEDS)), required=True)
@click.option(
    "--count", type=click.IntRange(1), help="Cases per block; the block's full number when left out."
)
@click.option("--out", type=click.Path(path_type=Path, file_okay=False), required=True)
@click.option("--jobs", type=click.IntRange(1), default=os.cpu_count, show_default="cores")
def generate(blocks: tuple[str, ...], seeds: str, count: int | None, out: Path, jobs: int) -> None:
    """Makes cases and seals their truth."""
    from benchmarks.blind.generate import generate as make_block
    from benchmarks.blind.generate import seal_of

    for block in blocks or tuple(COUNTS):
        sealed = make_block(block, seeds, count, out, jobs, lambda text: click.echo(text, err=True))
        click.echo(f"{seal_of(sealed)}  {sealed}")


@main.command()
@click.option("--out", type=click.Path(path_type=Path, exists=True), required=True)
@click.option("--tool", type=click.Choice(["impedance", "least-squares", "sysid"]), default="impedance")
@click.option("--block", "blocks", multiple=True, type=click.Choice(list(COUNTS)), help="All when left out.")
@click.option("--timeout", type=float, default=180.0, show_default=True, help="Per case [s].")
@click.option("--jobs", type=click.IntRange(1), default=os.cpu_count, show_default="cores")
def run(out: Path, tool: str, blocks: tuple[str, ...], timeout: float, jobs: int) -> None:
    """Diagnoses every case with one tool; answers go to OUT/answers/TOOL."""
    from benchmarks.blind.run import run_all

    run_all(out, tool, blocks, timeout, jobs, lambda text: click.echo(text, err=True))


@main.command()
@click.argument("out", type=click.Path(path_type=Path, exists=True))
def score(out: Path) -> None:
    """Opens the seals, prints the tables and writes OUT/score.md and OUT/score.json."""
    from benchmarks.blind.score import score_all

    click.echo(score_all(out))


if __name__ == "__main__":
    main()
