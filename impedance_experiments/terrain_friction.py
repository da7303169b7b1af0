# SPDX-License-Identifier: BSD-3-Clause
"""How far friction alone makes y trail its equilibrium over bar and block: the thesis's 0.024 m asked of the plant."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from impedance_experiments.thesis_page import Cell, ResultTable, table_of
from impedance_experiments.settings import Settings
from impedance_experiments.terrain_slides import SlideJob, Slide, deviation_along_y, slide_all
from impedance_modules.control.assembly import assemble

FLAT, OVER = "slide-flat", "slide-over"
COEFFICIENTS = (0.2, 0.4, 0.5, 0.6)
"""Of the surface; the task's is the first."""
AMPLE = 15.0
"""A tank that pays for the harder way, too [J]; the task's own holds 5.4 J."""
PATCH = Path("patches", "dry-friction.yaml")


def friction_table(settings: Settings) -> tuple[ResultTable, dict[float, float]]:
    """Slides with the springs over both surfaces, with rougher ones and with dry friction in the joints.

    Returns:
        The table, and coefficient -> RMS deviation of y [m] without friction in the joints.
    """
    worn = assemble(FLAT, effects=None, rate=None, scale=1.0, arm=None).robot.folder / PATCH
    ways: list[tuple[float, Path | None]] = [(mu, None) for mu in COEFFICIENTS]
    ways += [(mu, worn) for mu in COEFFICIENTS[:3]]
    jobs = [_friction_job(task, mu, patch, settings.seed) for mu, patch in ways for task in (FLAT, OVER)]
    done = slide_all(jobs, settings, (0.2, 0.3), "other frictions")
    rows: list[list[Cell]] = []
    found: dict[float, float] = {}
    for (mu, patch), flat, over in zip(ways, done[::2], done[1::2], strict=True):
        deviation = deviation_along_y(flat, over)
        if patch is None:
            found[mu] = deviation
        rows.append([mu, "dry-friction.yaml" if patch else "none", deviation, *_whole(over)])
    columns = (
        "friction of the surface",
        "in the joints",
        "RMS dev. of y [m]",
        "in contact [%]",
        "peak force [N]",
    )
    caption = f"Led by the springs over bar and block: what friction does (tank of {AMPLE:g} J)"
    return table_of(caption, columns, rows), found


def _friction_job(task: str, friction: float, patch: Path | None, seed: int) -> SlideJob:
    surfaces = assemble(task, effects=None, rate=None, scale=1.0, arm=None).task.environment
    rubbed = tuple(replace(surface, friction=friction) for surface in surfaces)
    return SlideJob(task, surfaces=rubbed, tank=AMPLE, effects=patch, seed=seed)


def _whole(over: Slide) -> tuple[float, float]:
    """Share in contact [%] and peak force [N]."""
    return round(100.0 * over.contact, 1), over.peak
