# SPDX-License-Identifier: BSD-3-Clause
"""The same slide over tables that are not where, how and as stiff as the map says, drawn at random."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from impedance_experiments.page import Cell, Table, table_of
from impedance_experiments.settings import Settings
from impedance_experiments.terrain.runs import Job, Slide, deviation_along_y, slide_all
from impedance_modules.control.assembly import assemble
from impedance_modules.prediction.contact_geometry import place_surface, surface_distance
from impedance_modules.robot.rotation import exp3
from impedance_modules.spec.task import SurfaceSpec

Array = NDArray[np.float64]

HEIGHT, TILT = 0.03, np.radians(6.0)
"""Errors of the map are drawn evenly up to this, either way: height under the slide's middle [m], about x and y."""

STIFFNESS = (1e3, 1e5)
"""Stiffness is drawn evenly in its logarithm [N/m]; the map says 2e4."""

MIDDLE = np.array([0.634, -0.22])
"""Of the slide on the ground [m]."""

KEPT = 0.99
"""A slide keeps contact that is in contact for at least this share."""

PLAYED = 200
"""Maps of the full size that are played back; the springs slide over all 500. A playback takes as long as a slide."""

LEFTWARDS = 3
"""Phases that are carried out: down, lean, to the left."""

LASTING = 11.0
"""And how long they take [s]."""

CLEARANCE = 0.001
"""A hand starts at least so high over the table [m]: no robot starts inside one."""


@dataclass(frozen=True)
class Robustness:
    """Slides over wrong maps.

    Attributes:
        flat: Over the map itself.
        errors: (N, 4) height [m], tilt about x and y [rad], stiffness [N/m].
        redrawn: How many tables stood over where the hand starts, and were drawn again.
        slides: Way -> slides over the first rows of ``errors``.
    """

    flat: Slide
    errors: Array
    redrawn: int
    slides: Mapping[str, tuple[Slide, ...]]

    def kept(self, way: str) -> float:
        """Share of the slides that came to their end in contact."""
        return float(np.mean([_keeps(run) for run in self.slides[way]]))

    def interval(self, way: str) -> str:
        """Wilson's 95 % interval of that share, as text."""
        count, share, z = len(self.slides[way]), self.kept(way), 1.96
        middle = (share + z**2 / (2.0 * count)) / (1.0 + z**2 / count)
        half = z * np.sqrt(share * (1.0 - share) / count + z**2 / (4.0 * count**2)) / (1.0 + z**2 / count)
        return f"{100.0 * (middle - half):.0f} to {100.0 * (middle + half):.0f} %"

    def deviations(self, way: str) -> Array:
        """RMS deviations of y from the slide over the map [m]."""
        return np.array([deviation_along_y(self.flat, run) for run in self.slides[way]])


def _keeps(run: Slide) -> bool:
    return not run.stopped and run.contact >= KEPT


def how_robust(flat: Slide, settings: Settings) -> Robustness:
    """Slides over wrong maps, in all three ways over the same ones (in the full size the playbacks over the first)."""
    count, played = settings.choose(4, 50, 500), settings.choose(2, 50, PLAYED)
    table = assemble("slide-flat", effects=None, rate=None, scale=1.0, arm=None).task.environment[0]
    errors, redrawn = draw_maps(np.random.default_rng(settings.seed), count, table, flat.place[0])
    early = flat.time < LASTING
    path = replace(flat, time=flat.time[early], path=flat.path[early]).joint_path()
    sizes = {"impedance": count, "velocity": played, "position": played}
    jobs = [
        _job(way, wrong_table(table, row), settings.seed + i, None if way == "impedance" else path)
        for way, size in sizes.items()
        for i, row in enumerate(errors[:size])
    ]
    done = slide_all(jobs, settings, (0.4, 1.0), "over wrong maps")
    slides, start = {}, 0
    for way, size in sizes.items():
        slides[way] = tuple(done[start : start + size])
        start += size
    return Robustness(flat, errors, redrawn, slides)


def _job(way: str, table: SurfaceSpec, seed: int, path: object) -> Job:
    if path is None:
        return Job("slide-flat", surfaces=(table,), phases=LEFTWARDS, seed=seed)
    return Job(f"slide-over-{way}", surfaces=(table,), path=path, seed=seed)  # type: ignore[arg-type]


def draw_maps(random: np.random.Generator, count: int, table: SurfaceSpec, hand: Array) -> tuple[Array, int]:
    """Draws errors (count, 4) of maps under which the hand (3,) [m] starts free, and how many were drawn again."""
    kept: list[Array] = []
    drawn = 0
    while len(kept) < count:
        row = draw_errors(random, 1)[0]
        drawn += 1
        if surface_distance(place_surface(wrong_table(table, row)), hand)[0] >= CLEARANCE:
            kept.append(row)
    return np.array(kept), drawn - count


def draw_errors(random: np.random.Generator, count: int) -> Array:
    """Draws (count, 4) heights [m], tilts [rad], [rad] and stiffnesses [N/m]."""
    height = random.uniform(-HEIGHT, HEIGHT, count)
    tilts = random.uniform(-TILT, TILT, (count, 2))
    stiffness = np.exp(random.uniform(float(np.log(STIFFNESS[0])), float(np.log(STIFFNESS[1])), count))
    return np.column_stack([height, tilts, stiffness])


def wrong_table(table: SurfaceSpec, errors: Array) -> SurfaceSpec:
    """Returns a plane that is off by (4,) errors under the middle of the slide."""
    height, about_x, about_y, stiffness = (float(value) for value in errors)
    normal = exp3(np.array([about_x, about_y, 0.0]))[:, 2]
    # A plane's height is said at the world's origin.
    at_origin = (
        (0.0 if table.height is None else table.height) + height + float(normal[:2] @ MIDDLE) / normal[2]
    )
    return replace(table, height=at_origin, rotation=(about_x, about_y, 0.0), stiffness=stiffness)


def robustness_table(found: Robustness) -> Table:
    """Tabulates the distributions."""
    rows: list[list[Cell]] = []
    for way, runs in found.slides.items():
        deviations, peaks = found.deviations(way), np.array([run.peak for run in runs])
        rows.append(
            [
                way,
                len(runs),
                f"{100.0 * found.kept(way):.0f} % ({found.interval(way)})",
                sum(bool(run.stopped) for run in runs),
                _quantiles([100.0 * run.contact for run in runs], "{:.0f}"),
                _quantiles(deviations, "{:.3f}"),
                _quantiles(peaks, "{:.0f}"),
            ]
        )
    return table_of(
        f"Wrong maps: height up to {1000 * HEIGHT:.0f} mm, tilts up to {np.degrees(TILT):.0f} degrees about x "
        f"and y, stiffness {STIFFNESS[0]:g} to {STIFFNESS[1]:g} N/m; 32 cm to the left. {found.redrawn} tables stood "
        "over where the hand starts and were drawn again. Median (10 % to 90 %)",
        (
            "led by",
            "runs",
            "keeps contact",
            "shut down",
            "in contact [%]",
            "RMS dev. of y [m]",
            "peak force [N]",
        ),
        rows,
    )


def _quantiles(values: object, form: str) -> str:
    low, middle, high = np.quantile(np.asarray(values, dtype=float), (0.1, 0.5, 0.9))
    return f"{form.format(middle)} ({form.format(low)} to {form.format(high)})"
