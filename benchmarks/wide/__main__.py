# SPDX-License-Identifier: BSD-3-Clause
"""Command line of the wide benchmark: generate, run, score, calibrate."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

BLOCKS = ("A", "B", "C", "D", "E")
FROZEN = ("robot", "stamps", "controller", "friction", "noise")


@click.group()
def main() -> None:
    """Wide benchmark: recordings of many arms, controllers, clocks and sensors; diagnosed; compared with the truth."""


@main.command()
@click.option("--block", "blocks", multiple=True, type=click.Choice(BLOCKS), help="All when left out.")
@click.option("--seeds", type=click.Choice(["dev", "smoke", "frozen"]), default="dev", show_default=True)
@click.option("--count", type=click.IntRange(1), help="Cases per block; its full number when left out.")
@click.option(
    "--first", type=click.IntRange(0), default=0, show_default=True, help="Number of the first case."
)
@click.option(
    "--frozen", "frozen", multiple=True, type=click.Choice(FROZEN), help="Only with this frozen variety."
)
@click.option("--out", type=click.Path(path_type=Path, file_okay=False), required=True)
@click.option("--jobs", type=click.IntRange(1), default=1, show_default=True)
def generate(
    blocks: tuple[str, ...],
    seeds: str,
    count: int | None,
    first: int,
    frozen: tuple[str, ...],
    out: Path,
    jobs: int,
) -> None:
    """Makes cases that are not there yet, and seals their truth."""
    from benchmarks.wide.blocks import generate as make_block
    from benchmarks.wide.blocks import seal_of
    from benchmarks.wide.cases import COUNTS

    for variety in frozen or (None,):
        for block in blocks or BLOCKS:
            sealed = make_block(
                block,
                seeds,
                first,
                count or COUNTS[block],
                out,
                jobs,
                lambda text: click.echo(text, err=True),
                variety,
            )
            click.echo(f"{seal_of(sealed)}  {sealed}")


@main.command()
@click.option("--out", type=click.Path(path_type=Path, exists=True), required=True)
@click.option("--block", "blocks", multiple=True, type=click.Choice(BLOCKS), help="All when left out.")
@click.option("--case", "cases", multiple=True, metavar="NAME", help="All of the blocks when left out.")
@click.option("--again", is_flag=True, help="Ask again where an answer is kept.")
@click.option("--answers", type=click.Path(path_type=Path), help="Kept here; OUT/answers when left out.")
@click.option("--timeout", type=float, default=240.0, show_default=True, help="Processor time per case [s].")
@click.option("--jobs", type=click.IntRange(1), default=1, show_default=True)
@click.option("--tolerance", type=float, help="Of `impedance diagnose`; its default when left out.")
@click.option(
    "--change", "changes", multiple=True, metavar="NAME=VALUE", help="Another value for a hand-set number."
)
def run(out: Path, answers: Path | None, **selection: Any) -> None:
    """Diagnoses the cases that have no answer yet."""
    from benchmarks.wide.run import ANSWERS, Selection, run_all

    if selection["changes"] and answers is None:
        raise click.UsageError(
            "--change needs --answers FOLDER of its own, so that no kept answer is taken for one"
        )
    try:
        run_all(
            out, answers or out / ANSWERS, Selection(**selection), lambda text: click.echo(text, err=True)
        )
    except ValueError as error:
        raise click.UsageError(str(error)) from error


@main.command()
def thresholds() -> None:
    """Lists the hand-set numbers of the diagnosis: file:line, name, value, what it decides."""
    from benchmarks.wide.thresholds import thresholds as every

    for item in every():
        click.echo(str(item))


@main.command()
@click.argument("out", type=click.Path(path_type=Path, exists=True))
@click.option("--answers", type=click.Path(path_type=Path), help="Where they are; OUT/answers when left out.")
@click.option("--case", metavar="NAME", help="Only print truth and answer of this one.")
def score(out: Path, answers: Path | None, case: str | None) -> None:
    """Opens the seals, prints the tables, writes them beside the answers, and lists what was wrong."""
    from benchmarks.wide.run import ANSWERS
    from benchmarks.wide.score import score_all, show_case

    folder = answers or out / ANSWERS
    try:
        click.echo(score_all(out, folder) if case is None else show_case(out, folder, case))
    except ValueError as error:
        raise click.UsageError(str(error)) from error


@main.command()
@click.argument("out", type=click.Path(path_type=Path, exists=True), nargs=-1, required=True)
@click.option(
    "--answers",
    type=click.Path(path_type=Path),
    help="Where they are; OUT/answers when left out. Of several OUT, the folder of folders with their names.",
)
@click.option("--write", is_flag=True, help="Put the law into the diagnosis.")
@click.option(
    "--diagram", type=click.Path(path_type=Path, dir_okay=False), metavar="F.svg", help="Draw reliability."
)
def calibrate(out: tuple[Path, ...], answers: Path | None, write: bool, diagram: Path | None) -> None:
    """Fits how likely a cause is true, and compares what was said of unseen varieties with the truth."""
    from benchmarks.wide.calibrate import calibrate as fitted
    from benchmarks.wide.run import ANSWERS

    several = len(out) > 1
    folders = {
        one: one / ANSWERS if answers is None else answers / one.name if several else answers for one in out
    }
    try:
        click.echo(fitted(folders, write=write, diagram=diagram), nl=False)
    except ValueError as error:
        raise click.UsageError(str(error)) from error


@main.command()
@click.argument("out", type=click.Path(path_type=Path, exists=True))
@click.option(
    "--answers",
    type=click.Path(path_type=Path),
    required=True,
    help="A folder of its own, where they are kept.",
)
@click.option("--block", "blocks", multiple=True, type=click.Choice(BLOCKS), default=["A"], show_default=True)
@click.option("--jobs", type=click.IntRange(1), default=1, show_default=True)
def promise(out: Path, answers: Path, blocks: tuple[str, ...], jobs: int) -> None:
    """Withholds a recording of each case, and compares the promised shrink with what the patch does to it."""
    from benchmarks.wide.promise import keep_promises

    click.echo(keep_promises(out, answers, blocks, jobs, lambda text: click.echo(text, err=True)), nl=False)


@main.command()
@click.argument("out", type=click.Path(path_type=Path, exists=True), nargs=-1, required=True)
@click.option(
    "--answers", type=click.Path(path_type=Path), required=True, help="Kept here, in a folder for each OUT."
)
@click.option("--block", "blocks", multiple=True, type=click.Choice(BLOCKS), help="All when left out.")
@click.option("--rule", "names", multiple=True, metavar="NAME[,NAME]", help="All, one by one, when left out.")
@click.option("--jobs", type=click.IntRange(1), default=1, show_default=True)
def ablate(
    out: tuple[Path, ...], answers: Path, blocks: tuple[str, ...], names: tuple[str, ...], jobs: int
) -> None:
    """Asks the cases with all rules and without each one that mattered there; prints what changes.

    Rules joined by commas are left out at once.
    """
    from benchmarks.wide.ablation import ask_all, ask_without, watch_all
    from benchmarks.wide.ablation_table import ablation_table
    from benchmarks.wide.rules import rules_named

    def tell(text: str) -> None:
        click.echo(text, err=True)

    folders = {one: answers / one.name for one in out}
    try:
        rules = rules_named(names)
        ask = watch_all if any(len(left.rules) == 1 for left in rules) else ask_all
        for one, kept in folders.items():
            ask(one, kept, blocks, jobs, tell)
            ask_without(rules, one, kept, blocks, jobs, tell)
        click.echo(ablation_table(folders, rules), nl=False)
    except ValueError as error:
        raise click.UsageError(str(error)) from error


if __name__ == "__main__":
    main()
