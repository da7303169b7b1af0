# SPDX-License-Identifier: BSD-3-Clause
"""Plots of the torque gap: rms by joint, residuals over time, regimes and frequencies."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from impedance_modules.diagnosis.report.markup import drawing, gallery, new_figure
from impedance_modules.diagnosis.report.style import AFTER, BEFORE, NOISE
from impedance_modules.diagnosis.result import Series

Array = NDArray[np.float64]

MOST_POINTS = 700
"""A curve is drawn by the lowest and highest of as many stretches as a screen can show."""


def bars(gaps: Sequence[dict[str, Any]]) -> str:
    """Rms before, after and of the noise for every residual, on a logarithmic scale."""
    figure = new_figure(7.0, 0.8 + 0.32 * len(gaps))
    axes = figure.subplots()
    place = np.arange(len(gaps))
    for key, colour, shift, label in (
        ("before", BEFORE, -0.2, "before"),
        ("after", AFTER, 0.2, "after"),
    ):
        axes.barh(place + shift, [gap[key] for gap in gaps], 0.38, color=colour, label=label)
    for row, gap in enumerate(gaps):
        axes.plot([gap["noise_floor"]] * 2, [row - 0.42, row + 0.42], color="black", linewidth=1.2)
    axes.plot([], [], color="black", linewidth=1.2, label="noise floor")
    axes.set_xscale("log")
    axes.set_yticks(place, [f"{gap['joint']}, {gap['residual']} [{gap['unit']}]" for gap in gaps])
    axes.invert_yaxis()
    axes.set_xlabel("rms of the held-out residual")
    axes.legend(fontsize=7, loc="best")
    return drawing(figure, "How large the gap is, held out: before and after, and the noise.")


def over_time(series: Sequence[Series]) -> str:
    """One figure per joint: its residuals before and after in the first held-out recording."""
    first = [item for item in series if item.episode == series[0].episode]
    figures = []
    for joint in dict.fromkeys(item.joint for item in first):
        own = [item for item in first if item.joint == joint]
        figure = new_figure(5.5, 0.5 + 1.15 * len(own))
        for axes, item in zip(np.atleast_1d(figure.subplots(len(own), 1, sharex=True)), own, strict=True):
            _draw(axes, item)
        figure.axes[0].legend(loc="upper right", fontsize=7)
        figure.axes[-1].set_xlabel(f"time in {item.episode} [s]")
        figures.append(drawing(figure, f"{joint}: residual before and after."))
    return gallery(figures)


def _draw(axes: Axes, item: Series) -> None:
    for values, colour, label in ((item.before, BEFORE, "before"), (item.after, AFTER, "after")):
        time, drawn = thinned(item.time, values)
        axes.plot(time, drawn, color=colour, linewidth=0.8, label=label)
    axes.axhline(0.0, color=NOISE, linewidth=0.5)
    axes.set_ylabel(f"{item.residual}\n[{item.unit}]", fontsize=8)


def thinned(time: Array, values: Array) -> tuple[Array, Array]:
    """Keeps the lowest and highest value of each stretch, so that no peak gets lost."""
    size = -(-len(values) // MOST_POINTS)
    if size < 3:
        return time, values
    whole = len(values) // size * size
    blocks = values[:whole].reshape(-1, size)
    places = np.sort(np.stack([blocks.argmin(axis=1), blocks.argmax(axis=1)], axis=1), axis=1)
    index = (places + size * np.arange(len(blocks))[:, None]).ravel()
    return time[index], values[index]


def regime_map(where: Sequence[dict[str, Any]]) -> str:
    """Share of the excess power by joint, port and regime; nothing where nothing stands out."""
    rows = list(dict.fromkeys(f"{place['joint']}, {place['port']}" for place in where))
    columns = list(dict.fromkeys(place["regime"] for place in where))
    if not rows:
        return ""
    share = np.zeros((len(rows), len(columns)))
    for place in where:
        share[rows.index(f"{place['joint']}, {place['port']}"), columns.index(place["regime"])] += place[
            "share"
        ]
    labels = [[f"{100 * value:.0f} %" if value >= 0.01 else "" for value in row] for row in share]
    return _heat(
        share, rows, [name.replace("_", " ") for name in columns], labels, "share of the excess power"
    )


def frequency_map(spectrum: dict[str, Any], gaps: Sequence[dict[str, Any]], side: str) -> str:
    """Rms by octave over the noise floor, one side (before or after)."""
    ports, edges = spectrum["per_port"], spectrum["edges_hz"]
    if not ports:
        return ""
    floor = {(gap["joint"], gap["residual"]): gap["noise_floor"] for gap in gaps}
    ratio = np.array([np.array(port[side]) / floor[port["joint"], port["residual"]] for port in ports])
    octaves = [f"{low:g} to {high:g}" for low, high in pairwise(edges)]
    rows = [f"{port['joint']}, {port['residual']}" for port in ports]
    labels = [[f"{value:.2g}" for value in row] for row in ratio]
    what = f"{side}: log10 of rms over the noise floor, by octave [Hz]"
    return _heat(np.log10(np.maximum(ratio, 0.1)), rows, octaves, labels, what)


def _heat(
    values: Array, rows: Sequence[str], columns: Sequence[str], labels: Sequence[Sequence[str]], what: str
) -> str:
    figure = new_figure(1.8 + 0.75 * len(columns), 1.1 + 0.28 * len(rows))
    axes = figure.subplots()
    top = max(float(values.max()), float(values.min()) + 1e-9)
    image = axes.imshow(values, cmap="YlOrBr", aspect="auto", vmax=top)
    axes.set_xticks(range(len(columns)), columns, rotation=30, ha="right", fontsize=8)
    axes.set_yticks(range(len(rows)), rows, fontsize=8)
    middle = 0.5 * (float(values.min()) + top)
    for i, row in enumerate(labels):
        for j, label in enumerate(row):
            colour = "white" if values[i, j] > middle else "black"
            axes.text(j, i, label, ha="center", va="center", fontsize=7, color=colour)
    figure.colorbar(image, fraction=0.05)
    return drawing(figure, what.capitalize() + ".")
