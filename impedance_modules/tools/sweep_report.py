# SPDX-License-Identifier: BSD-3-Clause
"""A sweep's table and plots: every run a line, every result over what was varied."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.extras import installed
from impedance_modules.tools.sweep_runs import SweepRow

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


class TableFile:
    """A table of runs, written line by line as they end, in any order."""

    def __init__(self, path: Path, paths: Sequence[str]) -> None:
        """Takes where it is to stand, and the paths that are varied."""
        self._path, self._paths = path, tuple(paths)
        self._names: tuple[str, ...] = ()
        self._rows: list[SweepRow] = []

    def add(self, row: SweepRow) -> None:
        """Adds a run; the first one that was not refused defines the result columns."""
        self._rows.append(row)
        if row.results and not self._names:
            self._names = tuple(row.results)
            self.rewrite(self._rows)
            return
        self._write([row], "a" if len(self._rows) > 1 else "w", heading=len(self._rows) == 1)

    def rewrite(self, rows: Iterable[SweepRow]) -> None:
        """Writes the table anew, in the order given."""
        self._write(rows, "w", heading=True)

    def _write(self, rows: Iterable[SweepRow], mode: str, *, heading: bool) -> None:
        with self._path.open(mode, newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            if heading:
                writer.writerow(["run", *self._paths, "seed", "ending", *self._names, "reason"])
            for row in rows:
                values = [row.values[path] for path in self._paths]
                results = [row.results.get(name, "") for name in self._names]
                writer.writerow([row.number, *values, row.seed, row.ending, *results, row.reason])


def spread(rows: Sequence[SweepRow]) -> dict[str, tuple[float, float, float, float, float]]:
    """Gives each result's least, 5 %, median, 95 % and largest value over the runs that were not refused."""
    ran = [row for row in rows if row.results]
    if not ran:
        return {}
    found = {name: np.array([row.results[name] for row in ran]) for name in ran[0].results}
    return {
        name: tuple(map(float, np.quantile(values, (0.0, 0.05, 0.5, 0.95, 1.0))))  # type: ignore[misc]
        for name, values in found.items()
    }


def draw(rows: Sequence[SweepRow], paths: Sequence[str], folder: Path) -> list[Path]:
    """Draws every result over every varied number, one picture a number, and a map where two are varied.

    Nothing is drawn where matplotlib is not installed.
    """
    ran = [row for row in rows if row.results]
    if not ran or not installed("matplotlib"):
        return []
    names = [name for name in ran[0].results if len({row.results[name] for row in ran}) > 1]
    if not names:
        return []
    written = [_save(_over(ran, path, names), folder / f"over-{_file_name(path)}.png") for path in paths]
    if len(paths) == 2:
        written.append(_save(_map(ran, paths, names), folder / "map.png"))
    return written


def _over(rows: Sequence[SweepRow], path: str, names: Sequence[str]) -> Figure:
    from impedance_modules.plain_figures import plain_figure  # noqa: PLC0415 - an extra

    figure = plain_figure(figsize=(7.0, 1.9 * len(names)), layout="constrained")
    x = np.array([row.values[path] for row in rows])
    done = np.array([row.ending == "done" for row in rows])
    for axes, name in zip(np.atleast_1d(figure.subplots(len(names), 1, sharex=True)), names, strict=True):
        y = np.array([row.results[name] for row in rows])
        axes.plot(x[done], y[done], ".", color="C0", label="done")
        axes.plot(x[~done], y[~done], "x", color="C3", label="stopped")
        _middle(axes, x, y)
        axes.set_ylabel(name.replace(" [", "\n["), fontsize=8)
        axes.grid(alpha=0.3)
    figure.axes[-1].set_xlabel(path)
    if not done.all():
        figure.axes[0].legend(fontsize=8)
    return figure


def _middle(axes: Axes, x: Array, y: Array) -> None:
    """Joins the medians where there are several runs at one value."""
    places = np.unique(x)
    if 1 < places.size < x.size:
        axes.plot(places, [np.median(y[x == place]) for place in places], color="C0", alpha=0.5)


def _map(rows: Sequence[SweepRow], paths: Sequence[str], names: Sequence[str]) -> Figure:
    from impedance_modules.plain_figures import plain_figure  # noqa: PLC0415 - an extra

    figure = plain_figure(figsize=(6.0, 3.2 * len(names)), layout="constrained")
    x, y = (np.array([row.values[path] for row in rows]) for path in paths)
    for axes, name in zip(np.atleast_1d(figure.subplots(len(names), 1)), names, strict=True):
        dots = axes.scatter(x, y, c=[row.results[name] for row in rows], s=40)
        figure.colorbar(dots, ax=axes, label=name)
        axes.set(xlabel=paths[0], ylabel=paths[1])
    return figure


def _save(figure: Figure, path: Path) -> Path:
    figure.savefig(path, dpi=110)
    return path


def _file_name(path: str) -> str:
    return "".join(sign if sign.isalnum() else "-" for sign in path)
