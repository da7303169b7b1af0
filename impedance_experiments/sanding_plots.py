# SPDX-License-Identifier: BSD-3-Clause
"""Drawings of the sanding experiment: stuck and free again, spectra, both arms, the rule."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from scipy.signal import detrend

from impedance_experiments.sanding_rule import RocCurve
from impedance_experiments.sanding_runs import DepthRuns, Sanding, numbers, spectrum
from impedance_experiments.thesis_page import Plot, panels
from impedance_modules.control.roughness_detection import BAND, LENGTH, SAMPLE_RATE, Window

CASE_COLOURS = ("C3", "C0", "C2")
SHOWN = 0.2
"""Share of rough pieces up to which the rule's curves are drawn."""


def stuck_plot(run: Sanding, until: float) -> Plot:
    """Draws position and tangential force around the time in which splinters held the hand (fig. 5-8)."""
    figure, (place, force, work) = panels((7.0, 5.2), 3, 1, sharex=True)
    part = run.time <= until
    time = run.time[part]
    place.plot(time, 1e3 * run.target[part, 0], color="0.6", label="equilibrium")
    place.plot(time, 1e3 * run.place[part, 0], color="C0", label="hand")
    force.plot(time, run.touched.force[part, 0], color="C0", linewidth=0.7, label="estimated from efforts")
    force.plot(time, run.force[part, 0], color="C1", linewidth=0.9, label="true")
    work.plot(time, run.work[part], color="C2")
    if run.stuck is not None:
        for axes in (place, force, work):
            axes.axvspan(*run.stuck, color="C3", alpha=0.15)
    place.set_ylabel("x [mm]")
    force.set_ylabel("tangential force [N]")
    work.set(ylabel="work on wood [J]", xlabel="time [s]", xlim=(0.0, until))
    for axes in (place, force):
        axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2, frameon=False)
    return Plot(
        "stuck",
        "First contact and attempt to sand: while splinters hold the hand (shaded), the spring loads it to and fro "
        "until they break (thesis fig. 5-8)",
        figure,
    )


def stroke_plot(schemes: Mapping[str, DepthRuns], seconds: float = 7.0) -> Plot:
    """Draws place, velocity and force of some strokes at both depths, judged windows shaded (fig. 5-10, 5-12)."""
    figure, rows = panels((7.0, 6.4), 4, len(schemes), sharex="col", sharey="row", squeeze=False)
    labels = ("x [mm]", "velocity [m/s]", "tangential [N]", "normal [N]")
    for column, (name, scheme) in zip(rows.T, schemes.items(), strict=True):
        run = scheme.rough
        first = scheme.start[0].start - 1.8
        part = (run.time >= first) & (run.time <= first + seconds)
        force = run.touched.force[part]
        lines = (1e3 * run.place[part, 0], run.velocity[part, 0], force[:, 0], force[:, 2])
        for axes, values in zip(column, lines, strict=True):
            axes.plot(run.time[part], values, color="C0", linewidth=0.8)
            axes.grid(alpha=0.3)
            for window in run.windows:
                if first <= window.start <= first + seconds - LENGTH:
                    axes.axvspan(window.start, window.start + LENGTH, color="C3", alpha=0.15)
        column[0].set_title(name)
        column[-1].set(xlabel="time [s]", xlim=(first, first + seconds))
    for axes, label in zip(rows[:, 0], labels, strict=True):
        axes.set_ylabel(label)
    return Plot(
        "strokes",
        "First free strokes on rough wood; shaded: the windows of strokes towards the robot that are judged, from "
        "where the hand breaks away (thesis fig. 5-10 and 5-12); forces as estimated from joint efforts",
        figure,
    )


def _mean_in_time(axes: Axes, run: Sanding, windows: Sequence[Window], colour: str) -> None:
    """Draws mean and deviation of the detrended tangential force over a window."""
    count = round(LENGTH * SAMPLE_RATE)
    firsts = [int(np.searchsorted(run.time, window.start - 1e-9)) for window in windows]
    force = np.array([detrend(run.touched.force[first : first + count, 0]) for first in firsts])
    since = np.arange(count) / SAMPLE_RATE
    mean, deviation = force.mean(axis=0), force.std(axis=0)
    axes.plot(since, mean, color=colour, linewidth=0.9)
    axes.fill_between(since, mean - deviation, mean + deviation, color=colour, alpha=0.2)


def spectrum_plot(schemes: Mapping[str, DepthRuns]) -> Plot:
    """Draws force over time, mean spectra and the two measures of every case, a column per depth (fig. 5-11, 5-13)."""
    figure, rows = panels((7.0, 8.2), 4, len(schemes), sharex="row", sharey="row", squeeze=False)
    for (name, scheme), (course, lines, bands, frictions) in zip(schemes.items(), rows.T, strict=True):
        for colour, (case, windows) in zip(CASE_COLOURS, scheme.cases.items(), strict=True):
            _mean_in_time(course, scheme.smooth if windows is scheme.plain else scheme.rough, windows, colour)
            nu, amplitude = spectrum(windows)
            lines.semilogy(nu[1:], amplitude[1:], color=colour, label=case)
        lines.axvspan(*BAND, color="0.9")
        course.set(title=name, xlabel="since the hand broke away [s]", xlim=(0.0, LENGTH))
        lines.set(xlim=(0, 40), xlabel="frequency [Hz]")
        for axes, measure in ((bands, "band"), (frictions, "friction")):
            values = [numbers(windows, measure) for windows in scheme.cases.values()]
            axes.bar(
                ("start", "end", "smooth"),
                [value.mean() for value in values],
                yerr=[value.std() for value in values],
                color=CASE_COLOURS,
            )
    rows[1, 0].set_ylim(bottom=5e-3)
    labels = (
        "tangential, detrended [N]",
        "amplitude [N]",
        f"{BAND[0]:g} to {BAND[1]:g} Hz [N rms]",
        "coefficient of friction",
    )
    for axes, label in zip(rows[:, 0], labels, strict=True):
        axes.set_ylabel(label)
    figure.legend(
        *rows[1, 0].get_legend_handles_labels(), loc="outside upper center", ncols=len(CASE_COLOURS)
    )
    return Plot(
        "spectra",
        f"Tangential force in windows of {LENGTH:g} s, at both depths: its course (mean and deviation of the windows), "
        "mean spectra (grey: the band that is judged), and both measures with their deviations (thesis fig. 5-11 and "
        "5-13)",
        figure,
    )


def orientation_plot(upright: Sanding, slanted: Sanding, last: float) -> Plot:
    """Draws height and normal force of both arms over the last seconds of their common time."""
    figure, (height, force) = panels((7.0, 4.0), 2, 1, sharex=True)
    end = min(float(upright.time[-1]), float(slanted.time[-1]))
    for colour, name, run in (("C0", "forearm upright", upright), ("C1", "forearm slanting", slanted)):
        part = (run.time > end - last) & (run.time <= end)
        height.plot(run.time[part], 1e3 * (run.place[part, 2] + 0.02), color=colour, label=name)
        force.plot(run.time[part], run.force[part, 2], color=colour, linewidth=0.8)
    height.set_ylabel("above the wood [mm]")
    force.set(ylabel="normal force [N]", xlabel="time [s]", xlim=(end - last, end))
    figure.legend(loc="outside upper center", ncols=2)
    return Plot(
        "orientations", "Two ways to hold the arm: slanting, it lifts off when it pushes away", figure
    )


def rule_plot(curves: Mapping[str, RocCurve], chosen: tuple[float, float]) -> Plot:
    """Draws the rules' operating characteristics."""
    figure, axes = panels((4.6, 4.0))
    for style, (name, curve) in zip(("-", "--", "-."), curves.items(), strict=False):
        axes.step(curve.false, curve.true, style, where="post", label=f"{name}, area {curve.area:.3f}")
    axes.plot(*chosen, "o", color="C3", label="bound set on other pieces")
    axes.set(
        xlabel="fires on rough wood", ylabel="fires on smooth wood", xlim=(-0.01, SHOWN), ylim=(-0.02, 1.04)
    )
    axes.grid(alpha=0.3)
    axes.legend(loc="lower right")
    return Plot(
        "rule",
        f"The rule 'finished' over its bounds, on pieces that it has not been set on, up to a share of {SHOWN:g} of "
        "the rough pieces",
        figure,
    )
