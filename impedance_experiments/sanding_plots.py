# SPDX-License-Identifier: BSD-3-Clause
"""Drawings of the sanding experiment: stuck and free again, spectra, both arms, the rule."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.signal import detrend

from impedance_experiments.sanding_rule import RocCurve
from impedance_experiments.sanding_runs import DepthRuns, Sanding, numbers, spectrum
from impedance_experiments.thesis_page import Plot, panels
from impedance_modules.control.roughness_detection import BAND, LENGTH, SAMPLE_RATE, Window

CASE_COLOURS = ("C3", "C0", "C2")


def stuck_plot(run: Sanding, until: float) -> Plot:
    """Draws position and tangential force around the time in which splinters held the hand (fig. 5-8)."""
    figure, (place, force, work) = panels((8.5, 5.6), 3, 1, sharex=True)
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
    work.set(ylabel="work done on wood [J]", xlabel="time [s]")
    for axes in (place, force):
        axes.legend(fontsize=7, loc="lower right")
    return Plot(
        "stuck",
        "First contact and attempt to sand: while splinters hold the hand (red), the spring loads it to and fro "
        "until they break (thesis fig. 5-8)",
        figure,
    )


def stroke_plot(schemes: Mapping[str, DepthRuns], seconds: float = 7.0) -> Plot:
    """Draws place, velocity and force of some strokes at both depths, judged windows shaded (fig. 5-10, 5-12)."""
    figure, rows = panels((10.0, 6.4), 4, len(schemes), sharex="col", squeeze=False)
    for column, (name, scheme) in zip(rows.T, schemes.items(), strict=True):
        run = scheme.rough
        first = scheme.start[0].start - 1.8
        part = (run.time >= first) & (run.time <= first + seconds)
        time = run.time[part]
        lines = (
            (1e3 * run.place[part, 0], "x [mm]"),
            (run.velocity[part, 0], "velocity [m/s]"),
            (run.touched.force[part, 0], "tangential [N]"),
            (run.touched.force[part, 2], "normal [N]"),
        )
        for axes, (values, label) in zip(column, lines, strict=True):
            axes.plot(time, values, color="C0", linewidth=0.8)
            axes.set_ylabel(label)
            for window in run.windows:
                if first <= window.start <= first + seconds - LENGTH:
                    axes.axvspan(window.start, window.start + LENGTH, color="C3", alpha=0.15)
        column[0].set_title(name)
        column[-1].set_xlabel("time [s]")
    return Plot(
        "strokes",
        "First free strokes on rough wood; red: the windows of strokes towards the robot that are judged, from where "
        "the hand breaks away (thesis fig. 5-10 and 5-12); forces as estimated from joint efforts",
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
    """Draws the force in time, mean spectra and the two measures of every case, a row per depth (fig. 5-11, 5-13)."""
    figure = Figure(figsize=(12.0, 3.0 * len(schemes)), layout="constrained")
    rows = figure.subplots(len(schemes), 4, squeeze=False, width_ratios=(2, 2, 1, 1))
    for (name, scheme), (course, lines, bands, frictions) in zip(schemes.items(), rows, strict=True):
        for colour, (case, windows) in zip(CASE_COLOURS, scheme.cases.items(), strict=True):
            _mean_in_time(course, scheme.smooth if windows is scheme.plain else scheme.rough, windows, colour)
            nu, amplitude = spectrum(windows)
            lines.plot(nu[1:], amplitude[1:], color=colour, label=f"{case} ({len(windows)})")
        lines.axvspan(*BAND, color="0.9")
        course.set(title=name, xlabel="since the hand broke away [s]", ylabel="tangential, detrended [N]")
        lines.set(title="spectrum", xlim=(0, 40), xlabel="frequency [Hz]", ylabel="amplitude [N]")
        lines.legend(fontsize=7)
        for axes, measure, title in (
            (bands, "band", f"{BAND[0]:g}-{BAND[1]:g} Hz [N rms]"),
            (frictions, "friction", "friction"),
        ):
            values = [numbers(windows, measure) for windows in scheme.cases.values()]
            axes.bar(
                ("start", "end", "smooth"),
                [value.mean() for value in values],
                yerr=[value.std() for value in values],
                color=CASE_COLOURS,
            )
            axes.set_title(title, fontsize=9)
    return Plot(
        "spectra",
        f"Tangential force in windows of {LENGTH:g} s, at both depths: its course (mean and deviation of the windows), "
        "mean "
        "spectra, and both measures with their deviations (thesis fig. 5-11 and 5-13)",
        figure,
    )


def orientation_plot(upright: Sanding, slanted: Sanding, last: float) -> Plot:
    """Draws height and normal force of both arms over the last seconds of their common time."""
    figure, (height, force) = panels((8.5, 4.2), 2, 1, sharex=True)
    end = min(float(upright.time[-1]), float(slanted.time[-1]))
    for colour, name, run in (("C0", "forearm upright", upright), ("C1", "forearm slanting", slanted)):
        part = (run.time > end - last) & (run.time <= end)
        height.plot(run.time[part], 1e3 * (run.place[part, 2] + 0.02), color=colour, label=name)
        force.plot(run.time[part], run.force[part, 2], color=colour, linewidth=0.8)
    height.set_ylabel("above the wood [mm]")
    force.set(ylabel="normal force [N]", xlabel="time [s]")
    height.legend(fontsize=7)
    return Plot(
        "orientations", "Two ways to hold the arm: slanting, it lifts off when it pushes away", figure
    )


def rule_plot(curves: Mapping[str, RocCurve], chosen: tuple[float, float]) -> Plot:
    """Draws the rules' operating characteristics."""
    figure, axes = panels((4.6, 4.2))
    for name, curve in curves.items():
        axes.step(curve.false, curve.true, where="post", label=f"{name}, area {curve.area:.3f}")
    axes.plot(*chosen, "o", color="C3", label="bound set on other pieces")
    axes.plot((0, 1), (0, 1), color="0.8")
    axes.set(
        xlabel="fires on rough wood", ylabel="fires on smooth wood", xlim=(-0.02, 1.02), ylim=(-0.02, 1.02)
    )
    axes.legend(fontsize=7, loc="lower right")
    return Plot(
        "rule", "The rule 'finished' over all its bounds, on pieces that it has not been set on", figure
    )


def wear_values(run: Sanding) -> tuple[float, float]:
    """Gives the least and the mean roughness left where the hand has rubbed, 0 to 1."""
    rubbed = run.wood.remaining[run.wood.remaining < 1.0]
    return (float(rubbed.min()), float(np.mean(rubbed))) if rubbed.size else (1.0, 1.0)
