# SPDX-License-Identifier: BSD-3-Clause
"""Pages of results as Markdown with their plots beside them, and the index of a folder of pages.

The index is read back from the pages, which are the only record: made after one page, it keeps the rows of all
others, whenever they were made.
"""

from __future__ import annotations

import re
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from matplotlib.backends.backend_agg import FigureCanvasAgg

from impedance_experiments.thesis_experiments import EXPERIMENTS, Experiment
from impedance_experiments.thesis_page import Cell, Page, Size, ThesisValue

RESOLUTION = 150
"""Dots per inch."""
COMPARISON_COLUMNS = ("quantity", "thesis", "ours", "spread", "unit", "why")
COMPARISONS = "## Thesis against ours"
MADE_BY = "Made by"
"""Heading and words by which the index finds what it takes from a page."""
FLAGS = {Size.SHORT: " --short", Size.NORMAL: "", Size.FULL: " --full"}
INDEX = "README.md"
AS_PRINTED = "as printed"
"""What the index says where ours has the thesis's digits."""
PROSE_WIDTH = 118
"""Columns of a line of prose."""
_MADE = re.compile(rf"{MADE_BY}\s`(?P<command>[^`]+)`(?:\sin\s(?P<seconds>[0-9.]+)\ss)?")
_LINE_BREAK = re.compile(r"\n(?=\n|- )")
"""Where one paragraph or list item ends."""
_INTRODUCTION = (
    "Every experiment of the thesis, run in this project: `impedance reproduce all` makes these pages, `impedance "
    "reproduce NAME --out docs/thesis` one of them, and this index with it. How far ours is from the thesis is "
    "computed "
    "here from the two numbers (as printed: ours rounds to the thesis's digits); more on why stands on its page."
)
PAGE_COLUMNS = ("section", "page", "asks", "made by", "processor time [s]")
ROW_COLUMNS = (
    "section",
    "quantity",
    "thesis",
    "ours",
    "spread",
    "unit",
    "how far, and why",
    "page",
    "made by",
)
_NUMBER = r"[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?"
_PRINTED = re.compile(
    rf"(?:about |almost )?(?P<value>{_NUMBER})(?: \+- (?P<spread>{_NUMBER}))?(?: \(squared\))?"
)
"""A number of the thesis as a page has it, with its own spread."""


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
    lines = [f"# {experiment.question}", "", wrapped(f"Thesis section {experiment.section}. {made}"), ""]
    lines += [wrapped(page.summary), ""]
    if page.comparisons:
        lines += [COMPARISONS, "", *comparison_lines(page.comparisons), ""]
    for plot in page.plots:
        file = f"{experiment.name}-{plot.name}.png"
        FigureCanvasAgg(plot.figure)
        plot.figure.savefig(folder / file, dpi=RESOLUTION)
        lines += [f"![{plot.caption}]({file})", "", wrapped(f"*{plot.caption}*"), ""]
    for table in page.tables:
        lines += [wrapped(f"**{table.caption}**"), "", *table_lines(table.columns, table.rows), ""]
    if page.differences:
        lines += ["## What differs, and why", "", wrapped(page.differences), ""]
    path = folder / f"{experiment.name}.md"
    path.write_text("\n".join(lines).rstrip() + "\n")
    return path


def wrapped(markdown: str) -> str:
    """Breaks the lines of paragraphs and list items at ``PROSE_WIDTH``; code between backticks stays on one line."""
    return "\n".join(_filled(block) for block in _LINE_BREAK.split(markdown.strip()))


def _filled(block: str) -> str:
    """Fills one paragraph or list item; no line begins with a dash, which Markdown would take for an item.

    The empty line above a paragraph stays.
    """
    words = re.sub(
        r"`[^`]+`| (?=[-+*] )", lambda found: re.sub(r"\s", "\0", found[0]), " ".join(block.split())
    )
    indent, above = "  " if words.startswith("- ") else "", "\n" if block.startswith("\n") else ""
    lines = textwrap.wrap(
        words, PROSE_WIDTH, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False
    )
    return above + "\n".join(lines).replace("\0", " ")


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


@dataclass(frozen=True)
class PageRows:
    """What the index takes from a page.

    Attributes:
        experiment: Whose page it is.
        command: That made it.
        seconds: Of processor time it took, as text; empty where the page does not say.
        rows: Thesis against ours, cells as on the page, in the order of ``COMPARISON_COLUMNS``.
    """

    experiment: Experiment
    command: str
    seconds: str
    rows: tuple[tuple[str, ...], ...]


def read_page(experiment: Experiment, folder: Path) -> PageRows | None:
    """Reads the comparisons of a page back; None where the folder has no such page."""
    path = folder / f"{experiment.name}.md"
    if not path.is_file():
        return None
    text = path.read_text(encoding="utf-8")
    made = _MADE.search(text)
    command, seconds = ("", "") if made is None else (made["command"], made["seconds"] or "")
    _, _, after = text.partition(f"{COMPARISONS}\n\n")
    lines = after.split("\n\n", 1)[0].splitlines()[2:]
    rows = (tuple(cell.strip() for cell in line.strip().strip("|").split("|")) for line in lines)
    return PageRows(
        experiment, command, seconds, tuple(row for row in rows if len(row) == len(COMPARISON_COLUMNS))
    )


def write_index(folder: Path) -> Path:
    """Writes ``README.md`` of a folder: which pages there are, and all their comparisons in one table."""
    found = (read_page(experiment, folder) for experiment in EXPERIMENTS.values())
    pages = [page for page in found if page is not None]
    lines = ["# The thesis, run here", "", wrapped(_INTRODUCTION), ""]
    lines += ["## Pages", "", *table_lines(PAGE_COLUMNS, [_page_row(page) for page in pages]), ""]
    lines += [COMPARISONS, "", *table_lines(ROW_COLUMNS, [row for page in pages for row in _rows(page)])]
    path = folder / INDEX
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def _link(page: PageRows) -> str:
    return f"[{page.experiment.name}]({page.experiment.name}.md)"


def _page_row(page: PageRows) -> tuple[Cell, ...]:
    experiment = page.experiment
    return (
        experiment.section,
        _link(page),
        experiment.question,
        f"`{page.command}`",
        page.seconds or None,
    )


def _rows(page: PageRows) -> list[tuple[Cell, ...]]:
    made = f"`{page.command}`"
    return [
        (page.experiment.section, *row[:-1], how_far_and_why(row), _link(page), made) for row in page.rows
    ]


def how_far_and_why(row: Sequence[str]) -> str:
    """Says how far ours is from the thesis's number, in per cent of it, and why.

    Args:
        row: Cells of a page's comparison, in the order of ``COMPARISON_COLUMNS``.
    """
    _, thesis, ours, _, _, reason = row
    distance = difference(thesis, ours)
    if distance == AS_PRINTED:
        return distance
    return f"{distance}; {reason}" if reason else distance


def difference(thesis: str, ours: str) -> str:
    """Compares two cells: per cent of the thesis's number, ``AS_PRINTED`` where the digits are the same, or words."""
    if thesis == "-":
        return "not in the thesis"
    printed = _PRINTED.fullmatch(thesis)
    if printed is None or re.fullmatch(_NUMBER, ours) is None:
        return AS_PRINTED if thesis == ours else "in words"
    wanted, found = float(printed["value"]), float(ours)
    if round(found - wanted, _decimals(printed["value"])) == 0.0:
        return AS_PRINTED
    if wanted == 0.0:
        return f"{found:+.3g} from zero"
    within = printed["spread"] is not None and abs(found - wanted) <= float(printed["spread"])
    return f"{100.0 * (found / wanted - 1.0):+.1f} %" + (", within its spread" if within else "")


def _decimals(number: str) -> int:
    return len(number.partition(".")[2])
