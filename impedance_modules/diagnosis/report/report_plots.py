# SPDX-License-Identifier: BSD-3-Clause
"""Plots of the HTML report: rms by joint, residuals over time, regimes, frequencies, and the rollouts."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from impedance_modules.arrays import Array
from impedance_modules.diagnosis.gap_result import ResidualSeries
from impedance_modules.diagnosis.report.html_elements import (
    AFTER,
    BEFORE,
    MEASURED,
    NOISE,
    REFITTED,
    bullets,
    drawing,
    gallery,
    new_figure,
    number,
    paragraph,
    percent,
    section,
    table,
)
from impedance_modules.diagnosis.rollout_result import RolloutTrace
from impedance_modules.plain_figures import plain_powers

MOST_POINTS = 700
"""A curve is drawn by the lowest and highest value in as many intervals as a screen can show."""


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
    axes.plot(
        [gap["refitted"] for gap in gaps], place + 0.2, "|", color=REFITTED, markersize=9, label="refitted"
    )
    for row, gap in enumerate(gaps):
        axes.plot([gap["noise_floor"]] * 2, [row - 0.42, row + 0.42], color="black", linewidth=1.2)
    axes.plot([], [], color="black", linewidth=1.2, label="noise floor")
    axes.set_xscale("log")
    plain_powers(axes.xaxis)
    axes.set_yticks(place, [f"{gap['joint']}, {gap['residual']} [{gap['unit']}]" for gap in gaps])
    axes.invert_yaxis()
    axes.set_xlabel("rms of the held-out residual")
    axes.legend(fontsize=7, loc="best")
    return drawing(figure, "How large the gap is, held out: before, after, refitted, and the noise.")


def over_time(series: Sequence[ResidualSeries]) -> str:
    """One figure per joint: its residuals before, after and refitted in the first held-out recording."""
    first = [item for item in series if item.episode == series[0].episode]
    figures = []
    for joint in dict.fromkeys(item.joint for item in first):
        own = [item for item in first if item.joint == joint]
        figure = new_figure(5.5, 0.5 + 1.15 * len(own))
        for axes, item in zip(np.atleast_1d(figure.subplots(len(own), 1, sharex=True)), own, strict=True):
            _draw(axes, item)
        figure.axes[0].legend(loc="upper right", fontsize=7)
        figure.axes[-1].set_xlabel(f"time in {item.episode} [s]")
        figures.append(drawing(figure, f"{joint}: residual before, after and refitted."))
    return gallery(figures)


def _draw(axes: Axes, item: ResidualSeries) -> None:
    curves = (
        (item.before, BEFORE, "before"),
        (item.after, AFTER, "after"),
        (item.refitted, REFITTED, "refitted"),
    )
    for values, colour, label in curves:
        time, drawn = thinned(item.time, values)
        axes.plot(time, drawn, color=colour, linewidth=0.8, label=label)
    axes.axhline(0.0, color=NOISE, linewidth=0.5)
    axes.set_ylabel(f"{item.residual}\n[{item.unit}]", fontsize=8)


def thinned(time: Array, values: Array) -> tuple[Array, Array]:
    """Keeps the lowest and highest value of each interval, so that no peak is lost."""
    size = -(-len(values) // MOST_POINTS)
    if size < 3:
        return time, values
    whole = len(values) // size * size
    blocks = values[:whole].reshape(-1, size)
    places = np.sort(np.stack([blocks.argmin(axis=1), blocks.argmax(axis=1)], axis=1), axis=1)
    index = (places + size * np.arange(len(blocks))[:, None]).ravel()
    return time[index], values[index]


def regime_map(where: Sequence[dict[str, Any]]) -> str:
    """Share of the excess power by joint, port and regime; empty where nothing exceeds the noise."""
    rows = list(dict.fromkeys(f"{place['joint']}, {place['port']}" for place in where))
    columns = list(dict.fromkeys(place["regime"] for place in where))
    if not rows:
        return ""
    share = np.zeros((len(rows), len(columns)))
    for place in where:
        share[rows.index(f"{place['joint']}, {place['port']}"), columns.index(place["regime"])] += place[
            "share"
        ]
    labels = [[f"{100 * value:.0f} %" if value else "" for value in row] for row in share]
    figure = new_figure(1.8 + 0.8 * len(columns), 1.0 + 0.28 * len(rows))
    axes = figure.subplots()
    _heat(axes, share, labels, float(share.max()))
    axes.set_xticks(
        range(len(columns)), [name.replace("_", " ") for name in columns], rotation=30, ha="right"
    )
    axes.set_yticks(range(len(rows)), rows)
    axes.tick_params(labelsize=8)
    return drawing(figure, "Regimes: share of the excess residual power, by what the joint does.")


def frequency_map(spectrum: dict[str, Any], gaps: Sequence[dict[str, Any]]) -> str:
    """Excess by octave, before beside after on one scale."""
    ports, edges = spectrum["per_port"], spectrum["edges_hz"]
    if not ports:
        return ""
    floor = {(gap["joint"], gap["residual"]): gap["noise_floor"] for gap in gaps}
    figure = new_figure(9.5, 1.1 + 0.26 * len(ports))
    maps = {
        side: np.array([np.array(port[side]) / floor[port["joint"], port["residual"]] for port in ports])
        for side in ("before", "after")
    }
    top = max(1.0, *(float(np.log10(ratio.max())) for ratio in maps.values()))
    for axes, (side, ratio) in zip(figure.subplots(1, 2, sharey=True), maps.items(), strict=True):
        labels = [[f"{value:.2g}" for value in row] for row in ratio]
        _heat(axes, np.log10(np.maximum(ratio, 1.0)), labels, top)
        axes.set_title(side, fontsize=9)
        octaves = [f"{low:g}-{high:g}" for low, high in pairwise(edges)]
        axes.set_xticks(range(len(octaves)), octaves, rotation=45, ha="right")
        axes.set_yticks(range(len(ports)), [f"{port['joint']}, {port['residual']}" for port in ports])
        axes.set_xlabel("octave [Hz]", fontsize=8)
        axes.tick_params(labelsize=8)
    return drawing(
        figure, "Frequencies: rms in each octave over the residual's whole noise floor; shaded above 1."
    )


def _heat(axes: Axes, values: Array, labels: Sequence[Sequence[str]], top: float) -> None:
    axes.imshow(values, cmap="YlOrBr", aspect="auto", vmin=0.0, vmax=top)
    for i, row in enumerate(labels):
        for j, label in enumerate(row):
            colour = "white" if values[i, j] > 0.6 * top else "black"
            axes.text(j, i, label, ha="center", va="center", fontsize=7, color=colour)


DRIVEN = {
    "command": "the recorded command",
    "effort": "the effort measured at the link",
    "motor": "the measured motor torque",
}


def rollout_section(rollout: dict[str, Any], traces: Sequence[RolloutTrace]) -> str:
    """The whole section; it says so where nothing was rolled out."""
    left_out = bullets([f"{item['what']}: {item['why']}" for item in rollout["left_out"]])
    head = "Simulated again"
    if not rollout["windows"]:
        return section(head, paragraph("The plant was not simulated."), left_out)
    floor = (
        "repeats"
        if rollout["noise_floor_from"] == "repeats"
        else "the noise of the initial states alone (weak)"
    )
    words = (
        f"{rollout['windows']} windows of {number(rollout['window_s'])} s, cut from {', '.join(rollout['episodes'])}."
        f" Each starts from the measured state; {DRIVEN[rollout['driven_by']]} drives the plant."
        f" Noise floor from {floor}."
        f" The gap shrinks by {percent(rollout['shrink'])}."
    )
    missing = f"<h3>Not rolled out</h3>{left_out}" if left_out else ""
    return section(head, paragraph(words), _errors(rollout), gallery(_figures(rollout, traces)), missing)


def _errors(rollout: dict[str, Any]) -> str:
    rows = [
        [joint, quantity, *(number(found[key]) for key in ("before", "after", "refitted", "noise_floor")),
         found["unit"], percent(found["shrink"])]
        for joint, both in rollout["per_joint"].items()
        for quantity, found in both.items()
    ]  # fmt: skip
    return table(
        ("joint", "of", "before", "after", "refitted", "noise", "unit", "shrink"),
        rows,
        numbers=(2, 3, 4, 5, 7),
    )


def _figures(rollout: dict[str, Any], traces: Sequence[RolloutTrace]) -> list[str]:
    growth, figures = rollout["growth"], []
    for trace in traces:
        figure = new_figure(5.5, 2.0)
        over, grown = figure.subplots(1, 2, width_ratios=[3, 2])
        over.plot(trace.time, trace.measured, color=MEASURED, linewidth=2.2, label="measured", alpha=0.6)
        over.plot(trace.time, trace.before, color=BEFORE, linewidth=1.0, label="before")
        over.plot(trace.time, trace.after, color=AFTER, linewidth=1.0, label="after")
        over.set_xlabel(f"time in {trace.episode} [s]", fontsize=8)
        unit = rollout["per_joint"][trace.joint]["position"]["unit"]
        over.set_ylabel(f"position [{unit}]", fontsize=8)
        over.legend(fontsize=7)
        for side, colour in (("before", BEFORE), ("after", AFTER)):
            grown.semilogy(growth["time_s"], growth[side][trace.joint], "o-", color=colour, markersize=3)
        plain_powers(grown.yaxis)
        grown.set_xlabel("since the start [s]", fontsize=8)
        grown.set_ylabel(f"rms error [{unit}]", fontsize=8)
        figures.append(
            drawing(
                figure,
                f"{trace.joint}: the window with the largest error before, and the growth of errors over all windows.",
            )
        )
    return figures
