# SPDX-License-Identifier: BSD-3-Clause
"""The same slide with something changed: wrong maps drawn at random, other frictions, other playback thresholds.

Friction asks how far y trails its equilibrium for that reason alone (the thesis's 0.024 m); the thresholds ask what a
playback would have come to with others than those that were fixed.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path

import numpy as np

from impedance_experiments.terrain_slides import Slide, SlideJob, deviation_along_y, slide_all
from impedance_experiments.thesis_page import Cell, ResultTable, Settings
from impedance_modules.arrays import Array
from impedance_modules.control.assembly import assemble
from impedance_modules.plant.playback import JointPath
from impedance_modules.prediction.contact_geometry import place_surface, surface_distance
from impedance_modules.robot.rotation import exp3
from impedance_modules.spec.robot_spec import PlaybackSpec
from impedance_modules.spec.task import SurfaceSpec

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
FLAT, OVER = "slide-flat", "slide-over"
COEFFICIENTS = (0.2, 0.4, 0.5, 0.6)
"""Of the surface; the task's is the first."""
LARGE_TANK = 15.0
"""A tank that is enough for higher friction, too [J]; the task's own holds 5.4 J."""
PATCH = Path("patches", "dry-friction.yaml")
SENSITIVITIES = (0.5, 1.0, 2.0, math.inf)
"""Collision thresholds over those of the robot file; with infinity nothing is a collision."""
TOLERANCES = (0.05, 0.1, 0.2, 0.35, 0.7)
"""Of position mode [rad]."""
OUTER = (0.1, 0.9)
"""Quantiles that are given beside the median."""
QUANTILES = f"Median ({100.0 * OUTER[0]:g} % to {100.0 * OUTER[1]:g} %)"
ROBUSTNESS_COLUMNS = (
    "controlled by",
    "runs",
    "keeps contact",
    "shut down",
    "in contact [%]",
    "RMS dev. of y [m]",
    "peak force [N]",
)
NO_TOLERANCE = 6.0
"""Never reached [rad]."""


@dataclass(frozen=True)
class Robustness:
    """Slides over wrong maps.

    Attributes:
        flat: Over the map itself.
        errors: (N, m) what was drawn: (N, 4) height [m], tilt about x and y [rad], stiffness [N/m] of a table, or
            (N, 17) heights of a sheet's supports [m].
        redrawn: How many surfaces stood over where the hand starts, and were drawn again.
        slides: Way of control -> slides over the first rows of ``errors``.
    """

    flat: Slide
    errors: Array
    redrawn: int
    slides: Mapping[str, tuple[Slide, ...]]

    def kept(self, way: str) -> float:
        """Share of the slides that ended in contact."""
        return float(np.mean([keeps(run) for run in self.slides[way]]))

    def interval(self, way: str) -> str:
        """Wilson's 95 % interval of that share, as text."""
        count, share, z = len(self.slides[way]), self.kept(way), 1.96
        middle = (share + z**2 / (2.0 * count)) / (1.0 + z**2 / count)
        half = z * np.sqrt(share * (1.0 - share) / count + z**2 / (4.0 * count**2)) / (1.0 + z**2 / count)
        return f"{100.0 * (middle - half):.0f} to {100.0 * (middle + half):.0f} %"

    def deviations(self, way: str) -> Array:
        """RMS deviations of y from the slide over the map [m]."""
        return np.array([deviation_along_y(self.flat, run) for run in self.slides[way]])


def keeps(run: Slide) -> bool:
    """Whether a slide went to the end in contact."""
    return not run.stopped and run.contact >= KEPT


def how_robust(flat: Slide, settings: Settings) -> Robustness:
    """Slides over wrong maps, in all three ways over the same ones (in the full size the playbacks over the first)."""
    count = settings.choose(4, 50, 500)
    table = assemble(FLAT, effects=None, rate=None, scale=1.0, arm=None).task.environment[0]
    errors, redrawn = draw_maps(np.random.default_rng(settings.seed), count, table, flat.place[0])
    maps = [(wrong_table(table, row),) for row in errors]
    played = settings.choose(2, 50, PLAYED)
    slides = slide_over_maps(flat, maps, played, settings, (0.4, 1.0))
    return Robustness(flat, errors, redrawn, slides)


def slide_over_maps(
    flat: Slide,
    maps: Sequence[tuple[SurfaceSpec, ...]],
    played: int,
    settings: Settings,
    share: tuple[float, float],
) -> dict[str, tuple[Slide, ...]]:
    """Slides to the left over what is really there, in all three ways.

    Args:
        flat: Over the map itself; a playback plays its joints back.
        maps: The surfaces of every slide.
        played: Over how many of them, the first ones, the playbacks slide.
        settings: Of the experiment.
        share: Of the experiment that is done before and after, for its progress.

    Returns:
        Way of control -> slides, in the order of the maps.
    """
    early = flat.time < LASTING
    path = replace(flat, time=flat.time[early], path=flat.path[early]).joint_path()
    sizes = {"impedance": len(maps), "velocity": played, "position": played}
    jobs = [
        _wrong_map_job(way, surfaces, settings.seed + i, None if way == "impedance" else path)
        for way, size in sizes.items()
        for i, surfaces in enumerate(maps[:size])
    ]
    done = iter(slide_all(jobs, settings, share, "over wrong maps"))
    return {way: tuple(islice(done, size)) for way, size in sizes.items()}


def _wrong_map_job(
    way: str, surfaces: tuple[SurfaceSpec, ...], seed: int, path: JointPath | None
) -> SlideJob:
    if path is None:
        return SlideJob(FLAT, surfaces=surfaces, phases=LEFTWARDS, seed=seed)
    return SlideJob(f"{OVER}-{way}", surfaces=surfaces, path=path, seed=seed)


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
    # A plane's height is given at the world's origin.
    at_origin = (
        (0.0 if table.height is None else table.height) + height + float(normal[:2] @ MIDDLE) / normal[2]
    )
    return replace(table, height=at_origin, rotation=(about_x, about_y, 0.0), stiffness=stiffness)


def robustness_table(found: Robustness) -> ResultTable:
    """Tabulates the distributions."""
    return ResultTable(
        f"Wrong maps: height up to {1000 * HEIGHT:.0f} mm, tilts up to {np.degrees(TILT):.0f} degrees about x "
        f"and y, stiffness {STIFFNESS[0]:g} to {STIFFNESS[1]:g} N/m; to the left. {found.redrawn} tables stood over "
        f"where the hand starts and were drawn again. {QUANTILES}",
        ROBUSTNESS_COLUMNS,
        robustness_rows(found),
    )


def robustness_rows(found: Robustness) -> list[list[Cell]]:
    """Gives a row per way of control, for ``ROBUSTNESS_COLUMNS``."""
    return [
        [
            way,
            len(runs),
            f"{100.0 * found.kept(way):.0f} % ({found.interval(way)})",
            sum(bool(run.stopped) for run in runs),
            _quantiles([100.0 * run.contact for run in runs], "{:.0f}"),
            _quantiles(found.deviations(way), "{:.3f}"),
            _quantiles([run.peak for run in runs], "{:.0f}"),
        ]
        for way, runs in found.slides.items()
    ]


def _quantiles(values: object, form: str) -> str:
    low, middle, high = np.quantile(np.asarray(values, dtype=float), (OUTER[0], 0.5, OUTER[1]))
    return f"{form.format(middle)} ({form.format(low)} to {form.format(high)})"


def friction_table(settings: Settings) -> tuple[ResultTable, dict[float, float]]:
    """Slides with the springs over both surfaces, with rougher ones and with dry friction in the joints.

    Returns:
        The table, and coefficient -> RMS deviation of y [m] without friction in the joints.
    """
    friction_patch = assemble(FLAT, effects=None, rate=None, scale=1.0, arm=None).robot.folder / PATCH
    ways: list[tuple[float, Path | None]] = [(mu, None) for mu in COEFFICIENTS]
    ways += [(mu, friction_patch) for mu in COEFFICIENTS[:3]]
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
    caption = f"Controlled by the springs over bar and block: what friction does (tank of {LARGE_TANK:g} J)"
    return ResultTable(caption, columns, rows), found


def _friction_job(task: str, friction: float, patch: Path | None, seed: int) -> SlideJob:
    surfaces = assemble(task, effects=None, rate=None, scale=1.0, arm=None).task.environment
    rubbed = tuple(replace(surface, friction=friction) for surface in surfaces)
    return SlideJob(task, surfaces=rubbed, tank=LARGE_TANK, effects=patch, seed=seed)


def _whole(over: Slide) -> tuple[float, float]:
    """Share in contact [%] and peak force [N]."""
    return round(100.0 * over.contact, 1), over.peak


def threshold_tables(flat: Slide, settings: Settings) -> tuple[list[ResultTable], Slide]:
    """Plays the path back in both modes, with collisions found more or less easily, and never stopping by distance.

    Where position mode would have stopped with a tolerance is read from the distance of such a run: up to that moment
    both are the same.

    Returns:
        Both tables, and the slide in position mode in which nothing is a collision.
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
    return [_position_table(runs, spec), _velocity_table(runs, flat)], runs["position", math.inf]


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
    return ResultTable(
        f"Position playback: where it stops, by tolerance (fixed: {spec.position_tolerance:g} rad) and collision "
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
    return ResultTable(
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
