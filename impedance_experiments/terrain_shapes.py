# SPDX-License-Identifier: BSD-3-Clause
"""Wrong maps with shape (thesis 5.1.4, "many different spline configurations"): hills and hollows drawn at random.

The map shows a flat table. What is there is the sheet of aluminium of ``slide-over`` on supports that are spread
evenly and whose heights are drawn,

    h(s) = sum_k a_k exp(-(s - c_k)^2 / (2 w_k^2)),    cut down to a largest height where it exceeds it,

a_k the height of a hill or depth of a hollow, c_k its place, w_k its width. Between its supports the sheet rests as a
natural cubic spline.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from impedance_experiments.terrain_slides import LEAST_CONTACT_FORCE, Slide, SlideJob, slide
from impedance_experiments.terrain_variations import (
    CLEARANCE,
    FLAT,
    KEPT,
    OVER,
    QUANTILES,
    ROBUSTNESS_COLUMNS,
    Robustness,
    keeps,
    robustness_rows,
    slide_over_maps,
)
from impedance_experiments.thesis_page import Cell, Page, Plot, ResultTable, Settings, ThesisValue, panels
from impedance_modules.arrays import Array
from impedance_modules.control.assembly import assemble
from impedance_modules.prediction.contact_geometry import PlacedSurface, place_surface
from impedance_modules.spec.task import SurfaceSpec

SUPPORTS = 17
"""As many as a sheet may have."""
MOST_SHAPES = 5
"""Hills and hollows of one sheet: one to so many."""
HIGHEST = 0.0508
"""Largest height and depth, that of the thesis's block (2 inches) [m]."""
WIDTHS = (0.03, 0.08)
"""Of a hill or hollow, its standard deviation [m]; the slide is 0.32 m long."""
EDGE = 0.05
"""Nearest a hill's middle comes to the end of the sheet [m]."""
UNDER = 0.01
"""A floor lies so far under the lowest support [m]: a hand that slides off the sheet's side falls no further."""
SHOWN = 6
"""Shapes in the picture."""
STEEP = (0.25, 0.5)
"""Bounds between gentle, middling and steep sheets: largest slope from support to support."""
COLOURS = {"impedance": "C0", "velocity": "C1", "position": "C4"}
MILLIMETRES = 1000.0


@dataclass(frozen=True)
class Sheets:
    """Sheets that were drawn.

    Attributes:
        heights: (N, 17) of their supports over the table of the map [m].
        maps: What is there, the sheet and a floor beneath.
        redrawn: How many stood over where the hand starts, and were drawn again.
    """

    heights: Array
    maps: tuple[tuple[SurfaceSpec, ...], ...]
    redrawn: int


def reproduce(settings: Settings) -> Page:
    """Slides over sheets of random shape in all three ways of control."""
    count, played = settings.choose(3, 25, 500), settings.choose(1, 25, 200)
    flat = slide(SlideJob(FLAT, seed=settings.seed))
    sheets = draw_sheets(np.random.default_rng(settings.seed), count, flat.place[0])
    slides = slide_over_maps(flat, sheets.maps, played, settings, (0.01, 1.0))
    found = Robustness(flat, sheets.heights, sheets.redrawn, slides)
    return Page(
        summary=_summary(found),
        comparisons=tuple(_comparisons(found)),
        tables=(_whole_table(found), _steepness_table(found)),
        plots=(_picture_of_shapes(found), _picture_of_rates(found)),
        differences=_differences(found),
        facts={
            **{f"kept contact, {way}": found.kept(way) for way in found.slides},
            **{f"deviation, {way}": float(np.median(found.deviations(way))) for way in found.slides},
            "highest": float(np.abs(sheets.heights).max()),
        },
    )


def support_places() -> Array:
    """Gives where the supports are along the sheet (17,) [m]: evenly from end to end of the sheet of ``slide-over``."""
    spec = _sheet_of_task().sheet
    if spec is None:
        raise TypeError(f"task '{OVER}': its sheet has no supports")
    return np.linspace(spec.supports[0][0], spec.supports[-1][0], SUPPORTS)


def draw_heights(random: np.random.Generator, places: Array) -> Array:
    """Draws heights (m,) [m] of supports at ``places`` (m,) [m]: the sum of one to five hills and hollows."""
    count = int(random.integers(1, MOST_SHAPES + 1))
    middle = random.uniform(places[0] + EDGE, places[-1] - EDGE, count)
    width = random.uniform(*WIDTHS, count)
    height = random.uniform(-HIGHEST, HIGHEST, count)
    total = np.exp(-0.5 * ((places[:, None] - middle) / width) ** 2) @ height
    return np.asarray(total * min(1.0, HIGHEST / max(float(np.abs(total).max()), 1e-12)))


def draw_sheets(random: np.random.Generator, count: int, hand: Array) -> Sheets:
    """Draws sheets under which the hand (3,) [m] starts free."""
    places, sheet = support_places(), _sheet_of_task()
    table = assemble(FLAT, effects=None, rate=None, scale=1.0, arm=None).task.environment[0]
    heights: list[Array] = []
    maps: list[tuple[SurfaceSpec, ...]] = []
    drawn = 0
    while len(maps) < count:
        row = draw_heights(random, places)
        drawn += 1
        shaped = shaped_sheet(sheet, places, row)
        if height_over(place_surface(shaped), hand) >= CLEARANCE:
            heights.append(row)
            maps.append((_floor(table, row), shaped))
    return Sheets(np.array(heights), tuple(maps), drawn - count)


def height_over(surface: PlacedSurface, point: Array) -> float:
    """Gives how high a point (3,) [m] is above a sheet at rest [m]; infinite beside it."""
    local = surface.rotation.T @ (point - surface.origin)
    here = None if surface.sheet is None else surface.sheet.point(float(local[0]))
    return float("inf") if here is None else float(local[2]) - here.height


def shaped_sheet(sheet: SurfaceSpec, places: Array, heights: Array) -> SurfaceSpec:
    """Returns a sheet with other supports, at ``places`` (m,) [m] with ``heights`` (m,) over its origin [m]."""
    if sheet.sheet is None:
        raise TypeError("only a sheet has supports")
    supports = tuple(zip(places.tolist(), heights.tolist(), strict=True))
    return replace(sheet, sheet=replace(sheet.sheet, supports=supports))


def _sheet_of_task() -> SurfaceSpec:
    task = assemble(OVER, effects=None, rate=None, scale=1.0, arm=None).task
    return next(surface for surface in task.environment if surface.sheet is not None)


def _floor(table: SurfaceSpec, heights: Array) -> SurfaceSpec:
    """Puts the table under the lowest support."""
    height = 0.0 if table.height is None else table.height
    return replace(table, height=height + min(float(heights.min()), 0.0) - UNDER)


def steepness(heights: Array) -> Array:
    """Gives the largest slope from support to support (N,) of sheets (N, 17) [m]."""
    return np.asarray(np.abs(np.diff(heights, axis=1) / np.diff(support_places())).max(axis=1))


def _summary(found: Robustness) -> str:
    outcomes = "; ".join(
        f"{way}: {100.0 * found.kept(way):.0f} % of {len(runs)}" for way, runs in found.slides.items()
    )
    return (
        "The slide of [terrain](terrain.md) to the left, over sheets of aluminium whose shape the map does not know: "
        f"each lies on {SUPPORTS} supports, one to {MOST_SHAPES} hills and hollows of up to {100.0 * HIGHEST:.1f} cm "
        f"whose number, places, widths and heights are drawn at random; the map shows a flat table. Shares that go to "
        f"the end and are in contact for at least {100.0 * KEPT:.0f} % of the slide: {outcomes}. The springs, their "
        "equilibrium and the paths that are played back are the same on every sheet."
    )


def _comparisons(found: Robustness) -> Iterator[ThesisValue]:
    printed = {"impedance": "throughout", "velocity": "lost at the bar", "position": "shuts down at the bar"}
    for way, runs in found.slides.items():
        yield ThesisValue(
            f"sheets of random shape: {way} keeps contact in",
            printed[way],
            f"{100.0 * found.kept(way):.0f} % of {len(runs)}",
            "",
            "the thesis tested many different splines and describes one; our shapes are drawn at random",
            found.interval(way),
        )
    for way in found.slides:
        deviations = found.deviations(way)
        yield ThesisValue(
            f"sheets of random shape: {way}, RMS deviation of y from the flat table, median",
            None,
            float(np.median(deviations)),
            "m",
            "the thesis's numbers, beside ours on terrain's page, are of one spline",
            f"at most {deviations.max():.3f}",
        )


def _whole_table(found: Robustness) -> ResultTable:
    return ResultTable(
        f"Sheets of random shape, to the left. {found.redrawn} sheets stood over where the hand starts and were drawn "
        f"again. {QUANTILES}",
        ROBUSTNESS_COLUMNS,
        robustness_rows(found),
    )


def _steepness_table(found: Robustness) -> ResultTable:
    """Tabulates how many slides keep contact, by the largest slope of the sheet."""
    bounds = (0.0, *STEEP, np.inf)
    names = (f"below {STEEP[0]:g}", f"{STEEP[0]:g} to {STEEP[1]:g}", f"above {STEEP[1]:g}")
    slopes = steepness(found.errors)
    rows: list[list[Cell]] = []
    for name, low, high in zip(names, bounds[:-1], bounds[1:], strict=True):
        row: list[Cell] = [name]
        for runs in found.slides.values():
            kept = [keeps(run) for run, slope in zip(runs, slopes, strict=False) if low <= slope < high]
            row.append(f"{sum(kept)} of {len(kept)}")
        rows.append(row)
    columns = ("largest slope", *(f"{way} keeps contact" for way in found.slides))
    return ResultTable(
        "Slides that keep contact, by the largest slope from support to support", columns, rows
    )


def _chosen(found: Robustness) -> list[int]:
    """Picks sheets for the picture that all ways slid over: from the gentlest to the steepest, evenly."""
    common = min(len(runs) for runs in found.slides.values())
    order = np.argsort(steepness(found.errors[:common]))
    places = np.unique(np.linspace(0, common - 1, min(SHOWN, common)).round().astype(int))
    return [int(order[place]) for place in places]


def _picture_of_shapes(found: Robustness) -> Plot:
    """Draws some sheets at rest, and the three hands' paths over them."""
    figure, grid = panels((7.0, 6.2), 3, 2, sharex=True, sharey=True)
    slopes = steepness(found.errors)
    for axes, number in zip(grid.flat, _chosen(found), strict=False):
        surface = place_surface(shaped_sheet(_sheet_of_task(), support_places(), found.errors[number]))
        y, z = _sheet_line(surface)
        axes.fill_between(MILLIMETRES * y, MILLIMETRES * z, -380.0, color="0.85")
        axes.axhline(MILLIMETRES * float(surface.origin[2]), color="0.4", lw=0.8, ls=":")
        for way, runs in found.slides.items():
            run = runs[number]
            place = MILLIMETRES * run.place[run.sliding, 1:]
            axes.plot(place[:, 0], place[:, 1], color=COLOURS[way], lw=1.3, label=way)
            if run.stopped:
                axes.plot(*place[-1], "x", color=COLOURS[way], ms=7)
        axes.set_title(f"largest slope {slopes[number]:.2f}")
        axes.set(xlim=(-410.0, -20.0), ylim=(-365.0, -225.0))
    for axes in grid[-1]:
        axes.set_xlabel("y [mm]")
    for axes in grid[:, 0]:
        axes.set_ylabel("z [mm]")
    handles, labels = grid[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=len(labels))
    caption = (
        "Some of the sheets at rest (grey), from the gentlest to the steepest, the table of the map (dotted), and the "
        "hand's path over them in the three ways of control. A cross: the robot stopped. Heights are drawn larger "
        "than lengths."
    )
    return Plot("shapes", caption, figure)


def _sheet_line(surface: PlacedSurface) -> tuple[Array, Array]:
    """Gives y and z of a placed sheet at rest, (m,) each [m]."""
    along = np.linspace(support_places()[0], support_places()[-1], 300)
    level = surface.origin + along[:, None] * surface.rotation[:, 0]
    return level[:, 1], level[:, 2] - np.array([height_over(surface, point) for point in level])


def _picture_of_rates(found: Robustness) -> Plot:
    """Draws contact against the largest slope, and the distributions of deviation and peak force."""
    figure, (contact, deviation, peak) = panels((7.0, 2.9), 1, 3)
    slopes = steepness(found.errors)
    for way, runs in found.slides.items():
        colour = COLOURS[way]
        for mark, stopped in (("o", False), ("x", True)):
            chosen = [i for i, run in enumerate(runs) if bool(run.stopped) == stopped]
            share = [100.0 * runs[i].contact for i in chosen]
            contact.plot(slopes[chosen], share, mark, color=colour, ms=3, alpha=0.6)
        below = np.arange(1, len(runs) + 1) / len(runs)
        deviation.step(
            MILLIMETRES * np.sort(found.deviations(way)), below, color=colour, where="post", label=way
        )
        peak.step(np.sort([run.peak for run in runs]), below, color=colour, where="post")
    contact.set(xlabel="largest slope", ylabel="in contact [%]")
    deviation.set(xlabel="RMS deviation of y [mm]", ylabel="share of runs")
    peak.set(xlabel="peak force [N]", ylabel="share of runs")
    for axes in (contact, deviation, peak):
        axes.grid(alpha=0.3)
    figure.legend(loc="outside upper center", ncols=len(found.slides))
    caption = (
        "Sheets of random shape. Left: contact against the largest slope of the sheet (a cross: the robot stopped); "
        "middle and right: distributions of the deviation along y and of the peak force."
    )
    return Plot("rates", caption, figure)


def _differences(found: Robustness) -> str:
    return "\n".join(
        (
            _about_lost(found),
            f"- **Shapes.** The thesis tested many different spline configurations and shows one. Ours are drawn "
            f"evenly: number, place, width ({100.0 * WIDTHS[0]:.0f} to {100.0 * WIDTHS[1]:.0f} cm, a bell's standard "
            f"deviation) and height up to {100.0 * HIGHEST:.1f} cm, hills and hollows alike; the thesis could lay "
            "objects under its sheet and so had hills alone. The sheet, its width, thickness and friction are those "
            f"of `{OVER}`; supports every {100.0 * float(np.diff(support_places())[0]):.1f} cm make it stiffer "
            "between them than over a bar and a block.",
            "- **Playback.** A played-back hand keeps the heights of the flat table: it stands in the air over "
            "hollows and runs into hills. Where nothing touches it, nothing stops it, and its deviation along y is "
            "that of its servo.",
        )
    )


def _about_lost(found: Robustness) -> str:
    """Says when the springs lost contact."""
    runs = found.slides["impedance"]
    lost = [i for i, run in enumerate(runs) if not keeps(run)]
    if not lost:
        return "- **The springs** kept contact on every sheet that was drawn."
    slopes = steepness(found.errors)
    away = [1.0 - runs[i].contact for i in lost]
    flights = [_flight(runs[i], found.errors[i]) for i in lost]
    falling = np.concatenate([flight.falling for flight in flights])
    speed = np.concatenate([flight.speed for flight in flights])
    flat = float(np.abs(np.gradient(found.flat.place[:, 1], found.flat.time)).max())
    again = sum(_touches_at_end(runs[i]) for i in lost)
    return (
        f"- **The springs** lost contact on {len(lost)} of {len(runs)} sheets, for {100.0 * min(away):.0f} to "
        f"{100.0 * max(away):.0f} % of the slide, all with slopes of at least {slopes[lost].min():.2f}. Uphill the "
        "sheet holds the hand back and draws the spring along y out; over the top it runs ahead "
        f"({np.median(speed):.2f} m/s in the middle of all lost samples, at most {flat:.2f} m/s on the flat table) and "
        f"flies: {100.0 * falling.mean():.0f} % of the time without contact is over falling ground, until the soft "
        f"vertical spring brings the hand down. The longest flight takes {max(f.longest for f in flights):.1f} s. In "
        f"contact at the end of the slide: {again} of these {len(lost)}."
    )


@dataclass(frozen=True)
class _Flight:
    """The samples of a slide without contact.

    Attributes:
        falling: (m,) whether the sheet beneath falls in the direction of motion.
        speed: (m,) along y [m/s].
        longest: The longest of them in a row [s].
    """

    falling: Array
    speed: Array
    longest: float


def _flight(run: Slide, heights: Array) -> _Flight:
    surface = place_surface(shaped_sheet(_sheet_of_task(), support_places(), heights))
    time, place = run.time[run.sliding], run.place[run.sliding]
    lost = np.linalg.norm(run.force[run.sliding], axis=1) <= LEAST_CONTACT_FORCE
    ground = place[:, 2] - np.array([height_over(surface, point) for point in place])
    speed = np.gradient(place[:, 1], time)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], lost.astype(int), [0]])))
    longest = max((time[last - 1] - time[first] for first, last in edges.reshape(-1, 2)), default=0.0)
    return _Flight((np.gradient(ground, time) < 0.0)[lost], speed[lost], float(longest))


def _touches_at_end(run: Slide) -> bool:
    return bool(np.linalg.norm(run.force[-1]) > LEAST_CONTACT_FORCE)
