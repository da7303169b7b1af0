# SPDX-License-Identifier: BSD-3-Clause
"""What an experiment is given (size, seed, folder), and what it returns: a page of numbers, tables, plots and text."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.figure import Figure
from matplotlib.rcsetup import cycler

COLOURS = ("#0072B2", "#E69F00", "#009E73", "#D55E00", "#CC79A7", "#56B4E9", "#000000")
"""Okabe and Ito's colours, which the colour-blind tell apart: C0 blue, C1 orange, C2 green, C3 vermilion, C4 purple, C5
sky blue, C6 black.
"""
# Colours by number and sizes of letters are read when a drawing is written, so they hold for all drawings.
mpl.rcParams.update(
    {
        "axes.prop_cycle": cycler("color", COLOURS),
        "font.size": 9.0,
        "axes.titlesize": 9.0,
        "legend.fontsize": 8.0,
        "legend.handlelength": 1.6,
        "lines.linewidth": 1.2,
    }
)

Cell = str | float | int | None


@dataclass(frozen=True)
class ThesisValue:
    """One number of the thesis beside ours.

    Attributes:
        quantity: What is measured, with its symbol.
        thesis: The printed value, as printed; None where the thesis prints none.
        ours: What came out here.
        unit: Of both.
        spread: Of ours, as text (standard deviation, interval, range); empty for a deterministic number.
        reason: Why the two differ, or what makes them agree.
    """

    quantity: str
    thesis: Cell
    ours: Cell
    unit: str
    reason: str
    spread: str = ""


@dataclass(frozen=True)
class ResultTable:
    """A table of results; cells that are numbers are printed to four digits."""

    caption: str
    columns: Sequence[str]
    rows: Sequence[Sequence[Cell]]


@dataclass(frozen=True)
class Plot:
    """A drawing; ``name`` becomes part of its file's name."""

    name: str
    caption: str
    figure: Figure


@dataclass(frozen=True)
class Page:
    """An experiment's page.

    Attributes:
        summary: What was done and what came out, in plain sentences; Markdown.
        comparisons: Rows of thesis against ours.
        differences: What could not be matched and why; Markdown, empty when there is nothing to say.
        facts: Numbers for tests and for other programs, by name.
    """

    summary: str
    comparisons: tuple[ThesisValue, ...]
    tables: tuple[ResultTable, ...] = ()
    plots: tuple[Plot, ...] = ()
    differences: str = ""
    facts: Mapping[str, float] = field(default_factory=dict)


def panels(size: tuple[float, float], rows: int = 1, columns: int = 1, **options: Any) -> tuple[Figure, Any]:
    """Begins a drawing of some size [inches]; returns it and its axes, as ``Figure.subplots`` gives them."""
    # Figures of names (``plain_figure``) turn formulas off; the powers on a logarithmic axis are formulas.
    mpl.rcParams["text.parse_math"] = True
    figure = Figure(figsize=size, layout="constrained")
    return figure, figure.subplots(rows, columns, **options)


class Size(Enum):
    """How much of an experiment is run.

    ``SHORT`` is what tests run (seconds), ``NORMAL`` what ``impedance reproduce`` runs (a minute or two each),
    ``FULL`` the long tables that are committed (``--full``).
    """

    SHORT = "short"
    NORMAL = "normal"
    FULL = "full"


@dataclass(frozen=True)
class Settings:
    """What ``reproduce`` hands to an experiment.

    Attributes:
        size: How much is run.
        seed: First seed of everything random.
        work: Existing folder for recordings; the experiment names its own files in it.
        on_progress: Called with the share done, 0 to 1, and what is going on.
    """

    size: Size
    seed: int
    work: Path
    on_progress: Callable[[float, str], None]

    @property
    def short(self) -> bool:
        """Whether a test runs it, in seconds."""
        return self.size is Size.SHORT

    def choose(self, short: int, normal: int, full: int) -> int:
        """Returns the number of runs, samples or steps that belongs to the size."""
        return {Size.SHORT: short, Size.NORMAL: normal, Size.FULL: full}[self.size]
