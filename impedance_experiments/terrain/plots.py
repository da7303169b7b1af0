# SPDX-License-Identifier: BSD-3-Clause
"""Pictures of the slides: figures 5-3 and 5-4 of the thesis, and the distribution over wrong maps."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure

from impedance_experiments.page import Plot
from impedance_experiments.terrain.robustness import Robustness
from impedance_experiments.terrain.runs import LEANT, Slide
from impedance_modules.control.assembly import assemble
from impedance_modules.prediction.contact_geometry import place_surface

COLOURS = {"impedance": "C0", "velocity": "C1", "position": "C3"}
MILLIMETRES = 1000.0


def picture_of_slides(found: Mapping[tuple[str, str], Slide]) -> Plot:
    """Draws the hands' paths over the surface, y and the force over time."""
    figure = Figure(figsize=(8.0, 8.5), layout="constrained")
    path, along, force = figure.subplots(3, 1)
    surface_y, surface_z = _surface()
    path.fill_between(surface_y, surface_z, -320.0, color="0.85", label="sheet at rest over bar and block")
    for (way, surface), run in found.items():
        colour, dashed = COLOURS[way], "--" if surface == "flat" else "-"
        here = run.sliding
        label = f"{way}, {'flat table' if surface == 'flat' else 'bar and block'}"
        if surface == "over":
            path.plot(
                MILLIMETRES * run.place[here, 1], MILLIMETRES * run.place[here, 2], color=colour, label=way
            )
            force.plot(run.time, np.linalg.norm(run.force, axis=1), color=colour, lw=0.8, label=way)
        along.plot(run.time, MILLIMETRES * run.place[:, 1], dashed, color=colour, label=label)
        if run.stopped:
            along.plot(run.time[-1], MILLIMETRES * run.place[-1, 1], "x", color=colour, ms=9)
            path.plot(*(MILLIMETRES * run.place[-1, 1:]), "x", color=colour, ms=9)
    path.set(xlabel="y [mm]", ylabel="z [mm]", ylim=(-312.0, -235.0))
    along.set(xlabel="time [s]", ylabel="y [mm]", xlim=(LEANT - 1.0, None))
    force.set(xlabel="time [s]", ylabel="force on the hand [N]", xlim=(LEANT - 1.0, None))
    for axes in (path, along, force):
        axes.grid(alpha=0.3)
        axes.legend(fontsize=7, loc="upper left")
    caption = (
        "Above: the hand's path over the surface (figure 5-3); middle: its way along y on the flat table (dashed) "
        "and over bar and block (figure 5-4); below: the force of the surface. A cross: the robot gave up."
    )
    return Plot("slides", caption, figure)


def _surface() -> tuple[list[float], list[float]]:
    """Gives y and height of the sheet at rest [mm]."""
    surfaces = assemble("slide-over", effects=None, rate=None, scale=1.0, arm=None).task.environment
    placed = [place_surface(surface) for surface in surfaces if surface.sheet is not None]
    y, z = [], []
    for surface in placed:
        if surface.sheet is None:
            continue
        for x in np.linspace(surface.sheet.spans[0, 0] + 0.05, 0.47, 200):
            point = surface.sheet.point(float(x))
            if point is not None:
                world = surface.origin + surface.rotation @ np.array([x, 0.0, point.height])
                y.append(MILLIMETRES * float(world[1]))
                z.append(MILLIMETRES * float(world[2]))
    return y, z


def picture_of_errors(found: Robustness) -> Plot:
    """Draws contact against the errors of the map, and how deviations and forces are distributed."""
    figure = Figure(figsize=(8.0, 5.6), layout="constrained")
    (height, slope), (deviation, peak) = figure.subplots(2, 2)
    for way, runs in found.slides.items():
        colour, errors = COLOURS[way], found.errors[: len(runs)]
        contact = [100.0 * run.contact for run in runs]
        marks = ["x" if run.stopped else "o" for run in runs]
        for mark in ("o", "x"):
            chosen = [i for i, shape in enumerate(marks) if shape == mark]
            for axes, values in ((height, MILLIMETRES * errors[:, 0]), (slope, np.degrees(errors[:, 1]))):
                axes.plot(values[chosen], np.array(contact)[chosen], mark, color=colour, ms=4, alpha=0.7)
        share = np.arange(1, len(runs) + 1) / len(runs)
        deviation.step(np.sort(found.deviations(way)), share, color=colour, where="post", label=way)
        peak.step(np.sort([run.peak for run in runs]), share, color=colour, where="post", label=way)
    height.set(xlabel="table higher than the map [mm]", ylabel="in contact [%]")
    slope.set(xlabel="tilt about x: rising along y [degrees]", ylabel="in contact [%]")
    deviation.set(xlabel="RMS deviation of y [m]", ylabel="share of runs")
    peak.set(xlabel="peak force [N]", ylabel="share of runs")
    for axes in (height, slope, deviation, peak):
        axes.grid(alpha=0.3)
    deviation.legend(fontsize=8)
    caption = (
        "Wrong maps. Above: contact against the map's errors (a cross: the robot gave up); below: distributions of the "
        "deviation along y and of the peak force."
    )
    return Plot("maps", caption, figure)
