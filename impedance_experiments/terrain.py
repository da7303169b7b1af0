# SPDX-License-Identifier: BSD-3-Clause
"""Task 1 of the thesis (5.1): one slide over a surface that the map does not know, controlled in three ways.

The springs control the hand, or the robot's own velocity or position mode plays a taught path back.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from impedance_experiments.terrain_prose import (
    PRINTED_IMPEDANCE,
    PRINTED_VELOCITY,
    bar_flank,
    differences_of,
    highest_hill,
    playback_of,
    sheet_at_rest,
    spring_depth,
    summary_of,
)
from impedance_experiments.terrain_slides import LEANT, Slide, SlideJob, deviation_along_y, slide, slide_all
from impedance_experiments.terrain_variations import (
    COEFFICIENTS,
    FLAT,
    OVER,
    Robustness,
    friction_table,
    how_robust,
    robustness_table,
    threshold_tables,
)
from impedance_experiments.thesis_page import Cell, Page, Plot, ResultTable, Settings, ThesisValue, panels
from impedance_modules.control.assembly import assemble

MODES = ("velocity", "position")
ALL_PHASES, TO_THE_LEFT = 5, 3
"""Phases of the task: the whole slide to and fro, and the half of it that the short form makes."""
MODE_COLOURS = {"impedance": "C0", "velocity": "C1", "position": "C4"}
MILLIMETRES = 1000.0


def reproduce(settings: Settings) -> Page:
    """Slides over the flat table and over bar and block, then over wrong maps at random."""
    phases = TO_THE_LEFT if settings.short else ALL_PHASES
    settings.on_progress(0.0, "springs on the flat table")
    flat = slide(SlideJob(FLAT, phases=phases, seed=settings.seed))
    found = _slides(settings, flat, phases)
    tables = [_table_of_slides(found)]
    plots = [picture_of_slides(found)]
    facts = _facts(found)
    robust: Robustness | None = None
    unhindered: Slide | None = None
    rubbed: dict[float, float] = {}
    if not settings.short:
        table, rubbed = friction_table(settings)
        tables += [table]
        more, unhindered = threshold_tables(flat, settings)
        tables += more
        robust = how_robust(flat, settings)
        tables.append(robustness_table(robust))
        plots.append(picture_of_errors(robust))
        facts |= {f"kept contact, {name}": robust.kept(name) for name in robust.slides}
    return Page(
        summary=summary_of(found),
        comparisons=_comparisons(found, robust, rubbed),
        tables=tuple(tables),
        plots=tuple(plots),
        differences=differences_of(found, robust, unhindered),
        facts=facts,
    )


def _slides(settings: Settings, flat: Slide, phases: int) -> dict[tuple[str, str], Slide]:
    """Makes the slides of all three ways, (way, surface); the flat one of the springs is given."""
    path = flat.joint_path()
    surfaces = assemble(FLAT, effects=None, rate=None, scale=1.0, arm=None).task.environment
    jobs = {("impedance", "over"): SlideJob(OVER, phases=phases, seed=settings.seed)}
    for mode in MODES if not settings.short else ("position",):
        played = SlideJob(f"{OVER}-{mode}", path=path, seed=settings.seed)
        jobs[mode, "over"] = played
        if not settings.short:
            jobs[mode, "flat"] = replace(played, surfaces=surfaces)
    done = slide_all(list(jobs.values()), settings, (0.0, 0.2), "three ways over bar and block")
    return {("impedance", "flat"): flat, **dict(zip(jobs, done, strict=True))}


def _deviation(found: dict[tuple[str, str], Slide], way: str) -> float:
    """RMS of y over bar and block against the flat table [m]; in the short form against the taught path."""
    return deviation_along_y(found.get((way, "flat"), found["impedance", "flat"]), found[way, "over"])


def _facts(found: dict[tuple[str, str], Slide]) -> dict[str, float]:
    facts = {}
    for way in {way for way, _ in found}:
        over = found[way, "over"]
        facts[f"deviation, {way}"] = _deviation(found, way)
        facts[f"contact, {way}"] = over.contact
        facts[f"peak, {way}"] = over.peak
        facts[f"stopped, {way}"] = float(bool(over.stopped))
        facts[f"stopped at y, {way}"] = float(over.place[-1, 1])
    return facts


def _outcome(run: Slide) -> str:
    if run.stopped:
        return f"stops: {run.stopped}"
    pauses = len(run.collisions)
    return f"to the end, {pauses} pauses after collisions" if pauses else "to the end"


def _table_of_slides(found: dict[tuple[str, str], Slide]) -> ResultTable:
    rows: list[list[Cell]] = []
    for (way, surface), run in sorted(found.items()):
        deviation = _deviation(found, way) if surface == "over" else None
        rows.append([way, surface, round(100.0 * run.contact, 1), deviation, run.peak, _outcome(run)])
    return ResultTable(
        "The same slide, controlled in three ways, over the flat table and over bar and block under the sheet",
        ("controlled by", "surface", "in contact [%]", "RMS dev. of y [m]", "peak force [N]", "how it ends"),
        rows,
    )


def _comparisons(
    found: dict[tuple[str, str], Slide], robust: Robustness | None, rubbed: dict[float, float]
) -> tuple[ThesisValue, ...]:
    impedance, position = found["impedance", "over"], found["position", "over"]
    rows = [
        ThesisValue(
            "impedance: RMS deviation of y, flat against curved",
            PRINTED_IMPEDANCE,
            _deviation(found, "impedance"),
            "m",
            "the surface's friction, which the thesis does not print, decides: table of frictions",
            ", ".join(f"{rubbed[mu]:.3f} at a friction of {mu:g}" for mu in COEFFICIENTS[1:] if rubbed),
        ),
        ThesisValue(
            "impedance: keeps contact",
            "throughout",
            f"{100.0 * impedance.contact:.1f} %",
            "",
            f"the spring reaches {100.0 * spring_depth():.0f} cm below the table, the hills are "
            f"{100.0 * highest_hill():.0f} cm high",
        ),
    ]
    if ("velocity", "over") in found:
        velocity = found["velocity", "over"]
        rows += [
            ThesisValue(
                "velocity playback: RMS deviation of y",
                PRINTED_VELOCITY,
                _deviation(found, "velocity"),
                "m",
                f"it hangs at the bar; the thesis's slid back with its path. Pauses of {playback_of().pause:g} s after "
                "collisions decide",
            ),
            ThesisValue(
                "velocity playback: contact",
                "lost at the bar",
                f"{100.0 * velocity.contact:.1f} % of the slide",
                "",
                "thrown off at every collision; when the pause is over it runs after its path and hits again",
            ),
        ]
    rows.append(
        ThesisValue(
            "position playback",
            "shuts down at the bar",
            f"shuts down at y = {position.place[-1, 1]:.3f} m" if position.stopped else "does not shut down",
            "",
            f"the bar's flank begins at y = {bar_flank()[0]:.2f} m, its top at {bar_flank()[1]:.2f} m; a collision "
            "holds "
            "the arm, the path runs away",
        )
    )
    rows += [
        ThesisValue(
            f"{way}: peak force",
            None,
            found[way, "over"].peak,
            "N",
            "the same surface; on the flat table "
            + (f"{found[way, 'flat'].peak:.1f} N" if (way, "flat") in found else "not run"),
        )
        for way in ("impedance", *MODES)
        if (way, "over") in found
    ]
    if robust is not None:
        rows += [
            ThesisValue(
                f"wrong maps: {name} keeps contact in",
                None,
                f"{100.0 * robust.kept(name):.0f} % of {len(robust.slides[name])}",
                "",
                "height, tilt and stiffness of the table drawn at random; the thesis has one surface",
                robust.interval(name),
            )
            for name in robust.slides
        ]
    return tuple(rows)


def picture_of_slides(found: Mapping[tuple[str, str], Slide]) -> Plot:
    """Draws the hands' paths over the surface, y and the force over time."""
    figure, (path, along, force) = panels((7.0, 7.0), 3, 1)
    surface_y, surface_z = (MILLIMETRES * values for values in sheet_at_rest())
    path.fill_between(surface_y, surface_z, -320.0, color="0.85")
    for (way, surface), run in found.items():
        colour, dashed = MODE_COLOURS[way], "--" if surface == "flat" else "-"
        here = run.sliding
        if surface == "over":
            path.plot(
                MILLIMETRES * run.place[here, 1], MILLIMETRES * run.place[here, 2], color=colour, label=way
            )
            force.plot(run.time, np.linalg.norm(run.force, axis=1), color=colour, lw=0.8)
        along.plot(run.time, MILLIMETRES * run.place[:, 1], dashed, color=colour)
        if run.stopped:
            along.plot(run.time[-1], MILLIMETRES * run.place[-1, 1], "x", color=colour, ms=9)
            path.plot(*(MILLIMETRES * run.place[-1, 1:]), "x", color=colour, ms=9)
    path.set(xlabel="y [mm]", ylabel="z [mm]", xlim=(-400.0, -30.0), ylim=(-312.0, -240.0))
    along.set(xlabel="time [s]", ylabel="y [mm]")
    force.set(xlabel="time [s]", ylabel="force on the hand [N]")
    last = max(float(run.time[-1]) for run in found.values())
    for axes in (along, force):
        axes.set_xlim(LEANT - 1.0, last)
    for axes in (path, along, force):
        axes.grid(alpha=0.3)
    figure.legend(loc="outside upper center", ncols=len(MODE_COLOURS))
    caption = (
        "Above: the hand's path over the sheet, which lies over bar and block and is drawn at rest (figure 5-3); "
        "middle: its way along y on the flat table (dashed) and over bar and block (figure 5-4); below: the force of "
        "the surface. A cross: the robot stopped."
    )
    return Plot("slides", caption, figure)


def picture_of_errors(found: Robustness) -> Plot:
    """Draws contact against the errors of the map, and how deviations and forces are distributed."""
    figure, ((height, slope), (deviation, peak)) = panels((7.0, 5.2), 2, 2)
    for way, runs in found.slides.items():
        colour, errors = MODE_COLOURS[way], found.errors[: len(runs)]
        contact = [100.0 * run.contact for run in runs]
        marks = ["x" if run.stopped else "o" for run in runs]
        for mark in ("o", "x"):
            chosen = [i for i, shape in enumerate(marks) if shape == mark]
            for axes, values in ((height, MILLIMETRES * errors[:, 0]), (slope, np.degrees(errors[:, 1]))):
                axes.plot(values[chosen], np.array(contact)[chosen], mark, color=colour, ms=3, alpha=0.6)
        share = np.arange(1, len(runs) + 1) / len(runs)
        along = MILLIMETRES * np.sort(found.deviations(way))
        deviation.step(along, share, color=colour, where="post", label=way)
        peak.step(np.sort([run.peak for run in runs]), share, color=colour, where="post")
    height.set(xlabel="table higher than the map [mm]", ylabel="in contact [%]")
    slope.set(xlabel="tilt about x: rising along y [degrees]", ylabel="in contact [%]")
    deviation.set(xlabel="RMS deviation of y [mm]", ylabel="share of runs")
    peak.set(xlabel="peak force [N]", ylabel="share of runs")
    for axes in (height, slope, deviation, peak):
        axes.grid(alpha=0.3)
    figure.legend(loc="outside upper center", ncols=len(found.slides))
    caption = (
        "Wrong maps. Above: contact against the map's errors (a cross: the robot stopped); below: distributions of the "
        "deviation along y and of the peak force."
    )
    return Plot("maps", caption, figure)
