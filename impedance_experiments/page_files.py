# SPDX-License-Identifier: BSD-3-Clause
"""Pages of results as Markdown with their plots beside them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from matplotlib.backends.backend_agg import FigureCanvasAgg

from impedance_experiments.thesis_experiments import Experiment
from impedance_experiments.thesis_page import Cell, ThesisValue, Page
from impedance_experiments.settings import Size

RESOLUTION = 110
"""Dots per inch."""
COMPARISON_COLUMNS = ("quantity", "thesis", "ours", "spread", "unit", "why")
COMPARISONS = "## Thesis against ours"
MADE_BY = "Made by"
"""Heading and words by which the index finds what it takes from a page."""
FLAGS = {Size.SHORT: " --short", Size.NORMAL: "", Size.FULL: " --full"}


def command_of(name: str, size: Size, seed: int) -> str:
    """Returns the command line that makes a page."""
    return f"impedance reproduce {name}{FLAGS[size]}" + (f" --seed {seed}" if seed else "")


def write_page(experiment: Experiment, page: Page, command: str, seconds: float, folder: Path) -> Path:
    """Writes ``NAME.md`` and ``NAME-PLOT.png`` into a folder and returns the former's path.

    Args:
        experiment: Which.
        page: What it found.
        command: That made it.
        seconds: Of processor time that took, all processes together [s].
        folder: Made if it is not there.
    """
    folder.mkdir(parents=True, exist_ok=True)
    made = f"{MADE_BY} `{command}` in {seconds:.0f} s of processor time."
    lines = [f"# {experiment.question}", "", f"Thesis section {experiment.section}. {made}", ""]
    lines += [page.summary.strip(), ""]
    if page.comparisons:
        lines += [COMPARISONS, "", *comparison_lines(page.comparisons), ""]
    for plot in page.plots:
        file = f"{experiment.name}-{plot.name}.png"
        FigureCanvasAgg(plot.figure)
        plot.figure.savefig(folder / file, dpi=RESOLUTION)
        lines += [f"![{plot.caption}]({file})", "", f"*{plot.caption}*", ""]
    for table in page.tables:
        lines += [f"**{table.caption}**", "", *table_lines(table.columns, table.rows), ""]
    if page.differences:
        lines += ["## What differs, and why", "", page.differences.strip(), ""]
    path = folder / f"{experiment.name}.md"
    path.write_text("\n".join(lines).rstrip() + "\n")
    return path


def comparison_lines(comparisons: Sequence[ThesisValue]) -> list[str]:
    """Returns the rows of thesis against ours as a Markdown table."""
    rows = [
        (row.quantity, "-" if row.thesis is None else row.thesis, row.ours, row.spread, row.unit, row.reason)
        for row in comparisons
    ]
    return table_lines(COMPARISON_COLUMNS, rows)


def table_lines(columns: Sequence[str], rows: Sequence[Sequence[Cell]]) -> list[str]:
    """Returns a Markdown table."""
    lines = ["| " + " | ".join(columns) + " |", "|" + "---|" * len(columns)]
    return lines + ["| " + " | ".join(cell_text(cell) for cell in row) + " |" for row in rows]


def cell_text(cell: Cell) -> str:
    """Writes a cell: numbers to four digits, nothing as a dash."""
    if cell is None:
        return "-"
    if isinstance(cell, float):
        return f"{cell:.4g}"
    return str(cell).replace("|", "/")
