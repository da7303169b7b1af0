# SPDX-License-Identifier: BSD-3-Clause
"""How probabilities that were said compare with what was true: bins with Wilson intervals, Brier score, diagram."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from benchmarks.blind.figures import Rate

EDGES = (0.0, 0.2, 0.4, 0.6, 0.8, 0.9, 1.0)
"""Between bins of probability."""


@dataclass(frozen=True)
class Bin:
    """Causes that were said with a probability in [low, high): their number that is true, and the mean said."""

    low: float
    high: float
    rate: Rate
    mean: float

    def __str__(self) -> str:
        """A row of a table."""
        said = f"{100 * self.mean:.0f} %" if self.rate.total else ""
        return f"| {100 * self.low:.0f} to {100 * self.high:.0f} % | {said} | {self.rate} |"


def bins_of(said: Sequence[float], true: Sequence[bool], edges: Sequence[float] = EDGES) -> list[Bin]:
    """Counts the true causes in each bin of probability; the last one includes its end."""
    found = []
    for low, high in pairwise(edges):
        inside = [i for i, p in enumerate(said) if low <= p < high or (p == high == edges[-1])]
        mean = float(np.mean([said[i] for i in inside])) if inside else float("nan")
        found.append(Bin(low, high, Rate.of([bool(true[i]) for i in inside]), mean))
    return found


def table_of(said: Sequence[float], true: Sequence[bool]) -> list[str]:
    """Returns one row per bin: what was said, on average, and how many are true."""
    return ["| said | mean | true |", "|---|---|---|", *map(str, bins_of(said, true))]


def brier_score(said: Sequence[float], true: Sequence[bool]) -> float:
    """Mean squared difference of probability and truth: 0 is perfect, 0.25 is a coin."""
    return float(np.mean((np.asarray(said) - np.asarray(true, dtype=float)) ** 2))


def draw(said: Sequence[float], true: Sequence[bool], path: Path) -> None:
    """Draws the reliability diagram with Wilson's 95 % intervals as SVG; the number of causes stands at each point."""
    figure = Figure(figsize=(5.0, 4.6), layout="constrained")
    axes = figure.subplots()
    axes.plot([0, 100], [0, 100], color="#8a8a8a", linewidth=1, label="calibrated")
    for part in bins_of(said, true):
        if part.rate.total:
            share, (low, high) = part.rate.hits / part.rate.total, part.rate.interval
            reach = [[100 * max(share - low, 0.0)], [100 * max(high - share, 0.0)]]
            axes.errorbar(100 * part.mean, 100 * share, reach, fmt="o", color="#0072b2", capsize=3)
            axes.annotate(
                str(part.rate.total), (100 * part.mean, 100 * share), (6, -12), textcoords="offset points"
            )
    axes.set(xlim=(0, 100), ylim=(0, 103), xlabel="probability said [%]", ylabel="causes that are true [%]")
    axes.legend(loc="upper left", frameon=False)
    # Text stays text, and the same numbers give the same file.
    with mpl.rc_context({"svg.fonttype": "none", "svg.hashsalt": "impedance_modules"}):
        figure.savefig(path, format="svg", metadata={"Date": None})
