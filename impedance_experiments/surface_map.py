# SPDX-License-Identifier: BSD-3-Clause
"""Tactile map (5.1.5) and impedance map (6.2.3): a sheet stroked at three forces, mapped by position and force."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from impedance_experiments.thesis_page import Cell, Page, Plot, ResultTable, Settings, ThesisValue
from impedance_modules.backends.sim_backend import SimBackend
from impedance_modules.control.assembly import Assembly, assemble
from impedance_modules.episode.data import Episode
from impedance_modules.episode.reader import read_episode
from impedance_modules.plant.plant import Plant
from impedance_modules.runs.execution import RunOptions, carry_out
from impedance_modules.runs.task_plant import sim_backend
from impedance_modules.tools.surface_fit import SurfaceMap, map_surface, touches_of
from impedance_modules.tools.surface_report import draw_map
from impedance_modules.tools.surface_truth import MapErrors, TrueSurface, map_errors, true_surface

TASK = "map-sheet"
CELL, LEAST_FORCE = 0.01, 2.0
"""The defaults of ``impedance map`` [m], [N]."""

TWO_STROKES = 5
"""Phases of the short form: down, lean, there, lean more, back."""

DURATION_SCALE = 0.6
"""And their durations over those of the task."""


def reproduce(settings: Settings) -> Page:
    """Strokes the sheet, maps it, and compares the map with what the plant really had."""
    assembly = assemble(TASK, effects=None, rate=None, scale=1.0, arm=None)
    if settings.short:
        phases = [
            replace(phase, duration=DURATION_SCALE * phase.duration)
            for phase in assembly.task.phases[:TWO_STROKES]
        ]
        assembly = replace(assembly, task=replace(assembly.task, phases=tuple(phases)))
    settings.on_progress(0.0, "stroking the sheet")
    episode = _record(assembly, sim_backend(assembly, settings.seed), settings)
    settings.on_progress(0.9, "mapping")
    touches = touches_of(episode, None, LEAST_FORCE)
    maps = {cell: map_surface(touches, cell) for cell in (CELL, 2.0 * CELL)}
    truths = {cell: true_surface(assembly.task.environment, found) for cell, found in maps.items()}
    errors = {cell: map_errors(found, truths[cell]) for cell, found in maps.items()}
    # Fast strokes leave too little in a narrow cell.
    wide = 2.0 * CELL if settings.short else CELL
    return Page(
        summary=SUMMARY,
        comparisons=_comparisons(errors[CELL], maps[CELL], truths[CELL]),
        tables=(_errors_table(errors),),
        plots=(Plot("map", CAPTION, draw_map(maps[CELL], truths[CELL])),),
        differences=DIFFERENCES,
        facts={
            "shape": errors[wide].shape,
            "pressed": errors[wide].pressed,
            "stiffness": errors[wide].stiffness,
            "cells": float(errors[wide].stiffness_cells),
        },
    )


def _record(assembly: Assembly, backend: SimBackend[Plant], settings: Settings) -> Episode:
    out: Path = settings.work / TASK
    options = RunOptions(out, settings.seed, None, live=False, read_only=False, backend="sim")
    lasts = sum(phase.duration for phase in assembly.task.phases)
    carry_out(
        assembly,
        backend,
        options,
        lambda time, _: settings.on_progress(min(0.9, 0.9 * time / lasts), "stroking the sheet"),
    )
    return read_episode(out, ("position", "pose", "wrench"))


def _comparisons(errors: MapErrors, found: SurfaceMap, truth: TrueSurface) -> tuple[ThesisValue, ...]:
    soft = int(np.nanargmax(np.where(np.isfinite(found.stiffness), found.compliance, np.nan)))
    return (
        ThesisValue(
            "tactile map: pressed height against the sheet at rest, RMS",
            "general shape and deflection",
            1000.0 * errors.pressed,
            "mm",
            "the thesis shows figure 5-5 without a reference; here the plant knows the sheet",
        ),
        ThesisValue(
            "shape at rest, RMS error",
            None,
            1000.0 * errors.shape,
            "mm",
            "several forces per place let the deflection be taken out",
            f"{errors.shape_cells} cells of {1000 * CELL:g} mm",
        ),
        ThesisValue(
            "impedance map: error of the stiffness, median",
            "deferred to future work",
            100.0 * errors.stiffness,
            "%",
            "slope of force over height at one place, friction taken out",
            f"worst {100 * errors.stiffness_worst:.0f} %, {errors.stiffness_cells} cells",
        ),
        ThesisValue(
            "softest place of the sheet",
            None,
            float(found.stiffness[soft]),
            "N/m",
            f"the plant's: {1.0 / truth.compliance[soft]:.0f} N/m",
            f"+- {200 * found.compliance_error[soft] / found.compliance[soft]:.0f} % (two standard errors)",
        ),
    )


def _errors_table(errors: dict[float, MapErrors]) -> ResultTable:
    rows: list[list[Cell]] = [
        [
            f"{1000 * cell:g}",
            1000.0 * found.pressed,
            1000.0 * found.shape,
            found.shape_cells,
            100.0 * found.stiffness,
            100.0 * found.stiffness_worst,
            found.stiffness_cells,
            100.0 * found.covered,
        ]
        for cell, found in errors.items()
    ]
    return ResultTable(
        "Errors against the plant, by width of the cells",
        (
            "cell [mm]",
            "pressed height, RMS [mm]",
            "height at rest, RMS [mm]",
            "cells",
            "stiffness, median [%]",
            "worst [%]",
            "cells",
            "compliance within two standard errors [%]",
        ),
        rows,
    )


SUMMARY = (
    "The task `map-sheet` strokes the sheet of `slide-over` several times, leaning on it a little more each "
    "time. `impedance map EPISODE --out DIR --truth` makes two maps of the recording "
    "from the hand's position and the force estimated from joint torques alone: where the hand was (the "
    "thesis's tactile map, figure 5-5), and, from how height and force go together at each place, the shape "
    "at rest and the local stiffness (the impedance map that the thesis proposes in 6.2.3)."
)

CAPTION = (
    "Above: the heights at which the hand was pressed, averaged over the strokes, and the shape at rest that "
    "follows; below: the stiffness. Lines: what the plant really had."
)

DIFFERENCES = """
- **One stroke is not enough** for stiffness: the thesis's single pass shows shape and deflection together. Where the
  force hardly varies, the map gives no stiffness and leaves the cell empty.
- **Stiff places** are measured less well than soft ones: there a force sinks in by little more than the joint
  encoders' steps at the hand. The standard errors count scatter, not the encoders' grid, and are too small
  there.
- **The flat part** has no one stiffness: the sheet bulges a little between supports, and where the
  hand reaches the table too, both carry. The line shows the sum where the mean pressed height reaches both.
- **Friction** is taken out by the slope of the touched path; a hand that reverses within a cell gives wrong values.
"""
