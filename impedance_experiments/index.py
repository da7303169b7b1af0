# SPDX-License-Identifier: BSD-3-Clause
"""The index of a folder of pages: every row of thesis against ours, read back from the pages that are there.

The pages are the only record: an index made after one page keeps the rows of all others, whenever they were made.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from impedance_experiments.thesis_experiments import EXPERIMENTS, Experiment
from impedance_experiments.thesis_page import Cell
from impedance_experiments.page_files import COMPARISON_COLUMNS, COMPARISONS, MADE_BY, table_lines

INDEX = "README.md"
_MADE = re.compile(rf"{MADE_BY} `(?P<command>[^`]+)`(?: in (?P<seconds>[0-9.]+) s)?")


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
    lines = ["# The thesis, run here", "", *_INTRODUCTION, ""]
    lines += ["## Pages", "", *table_lines(PAGE_COLUMNS, [_page_row(page) for page in pages]), ""]
    lines += [COMPARISONS, "", *table_lines(ROW_COLUMNS, [row for page in pages for row in _rows(page)])]
    path = folder / INDEX
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


_INTRODUCTION = (
    "Every experiment of the thesis, run in this project: `impedance reproduce all` makes these pages, `impedance "
    "reproduce NAME --out docs/thesis` one of them, and this index with it. Why a number differs stands on its page.",
)
PAGE_COLUMNS = ("section", "page", "asks", "made by", "processor time [s]")
ROW_COLUMNS = ("section", "quantity", "thesis", "ours", "spread", "unit", "page", "made by")


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
    return [(page.experiment.section, *row[:-1], _link(page), made) for row in page.rows]
