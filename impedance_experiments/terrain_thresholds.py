# SPDX-License-Identifier: BSD-3-Clause
"""What a playback would have come to with other thresholds than the ones that were fixed."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from impedance_experiments.thesis_page import Cell, ResultTable, table_of
from impedance_experiments.settings import Settings
from impedance_experiments.terrain_slides import SlideJob, Slide, deviation_along_y, slide_all
from impedance_modules.control.assembly import assemble
from impedance_modules.spec.robot_spec import PlaybackSpec

SENSITIVITIES = (0.5, 1.0, 2.0, math.inf)
"""Collision thresholds over those of the robot file; with infinity nothing is a collision."""

TOLERANCES = (0.05, 0.1, 0.2, 0.35, 0.7)
"""Of position mode [rad]."""

NO_TOLERANCE = 6.0
"""Never reached [rad]."""


def threshold_tables(flat: Slide, settings: Settings) -> list[ResultTable]:
    """Plays the path back in both modes, with collisions found more or less easily, and never giving up by distance.

    Where position mode would have given up with a tolerance is read from the distance of such a run: up to that moment
    both are the same.
    """
    robot = assemble("slide-over-position", effects=None, rate=None, scale=1.0, arm=None).robot
    if robot.playback is None:
        raise TypeError(f"robot '{robot.name}' plays nothing back")
    spec, path = robot.playback, flat.joint_path()
    jobs = {
        (mode, factor): SlideJob(
            f"slide-over-{mode}", path=path, playback=scaled_collisions(spec, factor), seed=settings.seed
        )
        for mode in ("position", "velocity")
        for factor in SENSITIVITIES
    }
    done = slide_all(list(jobs.values()), settings, (0.3, 0.4), "other thresholds")
    runs = dict(zip(jobs, done, strict=True))
    return [_position_table(runs, spec), _velocity_table(runs, flat)]


def scaled_collisions(spec: PlaybackSpec, factor: float) -> PlaybackSpec:
    """Returns a playback without tolerance whose collision thresholds are multiplied."""

    def times(table: Mapping[str, float]) -> dict[str, float]:
        return {joint: factor * value for joint, value in table.items()}

    return replace(
        spec, position_tolerance=NO_TOLERANCE, impact=times(spec.impact), squish=times(spec.squish)
    )


def stopped_at(run: Slide, tolerance: float) -> int | None:
    """Returns the sample at which a joint is first as far from its path as a tolerance [rad]; None for never."""
    beyond = np.flatnonzero(run.away >= tolerance)
    return int(beyond[0]) if beyond.size else None


def _position_table(runs: Mapping[tuple[str, float], Slide], spec: PlaybackSpec) -> ResultTable:
    rows: list[list[Cell]] = []
    for factor in SENSITIVITIES:
        run = runs["position", factor]
        row: list[Cell] = [_threshold_label(factor)]
        for tolerance in TOLERANCES:
            sample = stopped_at(run, tolerance)
            row.append(
                "-" if sample is None else f"y = {run.place[sample, 1]:.2f} m at {run.time[sample]:.1f} s"
            )
        rows.append([*row, float(run.away.max()), run.peak])
    columns = (f"{tolerance:g} rad" for tolerance in TOLERANCES)
    return table_of(
        f"Position playback: where it gives up, by tolerance (fixed: {spec.position_tolerance:g} rad) and collision "
        "thresholds; - plays to the end",
        ("collision thresholds", *columns, "largest distance [rad]", "peak force [N]"),
        rows,
    )


def _velocity_table(runs: Mapping[tuple[str, float], Slide], flat: Slide) -> ResultTable:
    rows: list[list[Cell]] = [
        [
            _threshold_label(factor),
            deviation_along_y(flat, runs["velocity", factor]),
            round(100.0 * runs["velocity", factor].contact, 1),
            runs["velocity", factor].peak,
            len(runs["velocity", factor].collisions),
            float(runs["velocity", factor].place[:, 1].max()),
        ]
        for factor in SENSITIVITIES
    ]
    return table_of(
        "Velocity playback by collision thresholds; deviation from the taught slide",
        (
            "collision thresholds",
            "RMS dev. of y [m]",
            "in contact [%]",
            "peak force [N]",
            "pauses",
            "furthest left y [m]",
        ),
        rows,
    )


def _threshold_label(factor: float) -> str:
    return "none" if math.isinf(factor) else "as fixed" if factor == 1.0 else f"times {factor:g}"
