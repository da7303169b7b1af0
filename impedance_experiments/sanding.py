# SPDX-License-Identifier: BSD-3-Clause
"""Sanding splintered wood (thesis 5.2): stuck and free again, work done, roughness measured, and when to stop."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from impedance_experiments.parallel_runs import carry_out_all
from impedance_experiments.sanding_course import (
    Course,
    course_comparisons,
    course_plot,
    course_rows,
    run_courses,
)
from impedance_experiments.sanding_plots import (
    orientation_plot,
    rule_plot,
    spectrum_plot,
    stroke_plot,
    stuck_plot,
)
from impedance_experiments.sanding_prose import (
    BAND_NAME,
    PRINTED_CYCLES,
    PRINTED_HALF,
    PRINTED_PEAK,
    PRINTED_STUCK,
    TEXTURE,
    TUNED,
    UNTIL_SMOOTH,
    RuleEvaluation,
    differences_of,
    equilibrium_depth,
    lowering_time,
    spectral_peaks,
    stroke_rate,
    summary_of,
)
from impedance_experiments.sanding_rule import (
    WoodKind,
    draw_wood,
    roc_curve,
    score,
    set_bound,
    smooth_statistics,
)
from impedance_experiments.sanding_runs import (
    DEEP,
    SHALLOW,
    SLANTED,
    DepthRuns,
    Sanding,
    board_of,
    contact_shares,
    numbers,
    run_depth,
    sand,
    sanding_task,
    separation,
    smooth_board,
)
from impedance_experiments.thesis_page import Cell, Page, ResultTable, Settings, ThesisValue
from impedance_modules.control.assembly import Assembly
from impedance_modules.control.roughness_detection import LENGTH

SET_ON, JUDGED_ON = 1000, 6000
"""First seeds of the pieces of wood that the rule is set on, and (less the settings' seed) of those it is judged on."""
MEASURES = {"band": f"spectrum, {BAND_NAME}", "friction": "coefficient of friction"}
BOTH = "both: the worse of the two"
_SEPARATIONS = {
    "shallow": "here both differ: rough wood is given more friction and more texture, and both wear together",
    "deep": "the first eight windows scatter because the wood wears under them; then only friction's mean is left",
}
FREE = 5.0
"""From here on the deep hand is free of its first splinter [s]."""


def reproduce(settings: Settings) -> Page:
    """Sands at two depths and in two postures, draws pieces of wood by seed, and judges the rule on them."""
    long, plain, slant = (settings.choose(*times) for times in ((15, 60, 60), (5, 29, 29), (6, 20, 20)))
    press = settings.choose(9, 60, 60)
    settings.on_progress(0.0, "long sanding")
    long_shallow, long_deep = run_courses(settings)
    courses = {_depth_name(SHALLOW): long_shallow, _depth_name(DEEP): long_deep}
    settings.on_progress(0.2, "nearly at the surface")
    schemes = {_depth_name(SHALLOW): run_depth(SHALLOW, settings.seed, long, plain)}
    settings.on_progress(0.25, "deep below the surface")
    schemes[_depth_name(DEEP)] = run_depth(DEEP, settings.seed, press, plain)
    settings.on_progress(0.3, "forearm slanting")
    slanted = sand(sanding_task(SLANTED, seconds=slant), settings.seed)
    finished = sand(_until_smooth(settings), settings.seed)
    judged = _judge(settings)
    shallow, deep = schemes.values()
    printed = (PRINTED_CYCLES, PRINTED_HALF)
    long_rows = course_comparisons(long_shallow, long_deep, stroke_rate(), printed, TUNED)
    return Page(
        summary=summary_of(shallow, judged, finished),
        comparisons=(*comparisons_of(shallow, deep, slanted, judged), *long_rows),
        tables=(case_table(schemes, courses), rule_table(judged)),
        plots=(
            stuck_plot(shallow.rough, min(25.0, lowering_time() + long)),
            stroke_plot(schemes),
            spectrum_plot(schemes),
            course_plot(courses, schemes),
            orientation_plot(deep.rough, slanted, 7.0),
            rule_plot(judged.curves, (judged.alarms, judged.hits)),
        ),
        differences=differences_of(shallow, judged, long_shallow),
        facts={
            **_facts(shallow, deep, slanted, judged, finished),
            "long_fall": long_shallow.fall,
            "long_work": float(long_shallow.work[-1, 1]),
        },
    )


def _depth_name(task: str) -> str:
    return f"equilibrium {100.0 * equilibrium_depth(task):.0f} cm below the wood"


def _until_smooth(settings: Settings) -> Assembly:
    """Assembles the task that ends by itself; at the shortest size on wood that is smooth from the start."""
    if not settings.short:
        return sanding_task(UNTIL_SMOOTH)
    return sanding_task(UNTIL_SMOOTH, board=smooth_board(board_of(sanding_task(UNTIL_SMOOTH))))


def _judge(settings: Settings) -> RuleEvaluation:
    """Sets the bound on some pieces of wood and counts on others."""
    set_on, judged_on = settings.choose(1, 10, 30), settings.choose(1, 10, 100)
    count = settings.choose(1, 4, 4)
    first = JUDGED_ON + settings.seed
    seeds = [*range(SET_ON, SET_ON + set_on), *range(first, first + judged_on)]
    jobs = [(seed, kind, count) for seed in seeds for kind in WoodKind]
    scores: dict[tuple[str, WoodKind], list[float]] = {(m, k): [] for m in MEASURES for k in WoodKind}

    def on_done(number: int) -> None:
        settings.on_progress(0.4 + 0.6 * number / len(jobs), f"piece of wood {number} of {len(jobs)}")

    for job, found in zip(jobs, carry_out_all(_judge_piece, jobs, settings.work, on_done), strict=True):
        for measure, value in found.items():
            scores[measure, job[1]].append(value)
    smooth, rough = (
        {m: np.array(scores[m, kind]) for m in MEASURES} for kind in (WoodKind.SMOOTH, WoodKind.ROUGH)
    )
    reference = smooth_statistics({measure: values[:set_on] for measure, values in smooth.items()})
    worst = reference.worst(smooth), reference.worst(rough)
    bound = set_bound(*(values[:set_on] for values in worst))
    curves = {name: roc_curve(smooth[m][set_on:], rough[m][set_on:]) for m, name in MEASURES.items()}
    curves[BOTH] = roc_curve(*(values[set_on:] for values in worst))
    fires = [values[set_on:] < bound for values in worst]
    return RuleEvaluation(
        bounds=reference.bounds(bound),
        hits=float(np.mean(fires[0])),
        alarms=float(np.mean(fires[1])),
        alarmed=tuple(first + int(i) for i in np.flatnonzero(fires[1])),
        curves=curves,
        pieces=(set_on, judged_on),
        seeds=(SET_ON, first),
        windows=count,
    )


def _judge_piece(job: tuple[int, WoodKind, int]) -> dict[str, float]:
    """Sands one piece of wood, given by its seed and kind, and scores its first windows by every measure."""
    seed, kind, count = job
    board = draw_wood(board_of(sanding_task(SHALLOW)), kind, seed)
    windows = sand(sanding_task(SHALLOW, board=board, seconds=count / stroke_rate() + 1.0), seed).windows
    return {measure: score(windows, measure, count) for measure in MEASURES}


def _facts(
    shallow: DepthRuns, deep: DepthRuns, slanted: Sanding, judged: RuleEvaluation, finished: Sanding
) -> dict[str, float]:
    first, last = shallow.rough.stuck or (0.0, 0.0)
    return {
        "stuck": last - first,
        "broken": float(shallow.rough.wood.broken),
        "work": float(deep.rough.work[-1]),
        "spent_on_wood": deep.rough.wood.rubbed + deep.rough.wood.broken_work,
        "band_smooth": float(numbers(shallow.plain, "band").mean()),
        "band_rough": float(numbers(deep.start, "band").mean()),
        "friction_smooth": float(numbers(deep.plain, "friction").mean()),
        "friction_rough": float(numbers(deep.start, "friction").mean()),
        "away_upright": contact_shares(deep.rough, FREE)[1],
        "away_slanted": contact_shares(slanted, FREE)[1],
        "bound": judged.bounds["band"],
        "bound_friction": judged.bounds["friction"],
        "hits": judged.hits,
        "alarms": judged.alarms,
        "area_band": judged.curves[MEASURES["band"]].area,
        "area_both": judged.curves[BOTH].area,
        "finished_at": float(finished.time[-1]),
    }


def comparisons_of(
    shallow: DepthRuns, deep: DepthRuns, slanted: Sanding, judged: RuleEvaluation
) -> Iterator[ThesisValue]:
    """Compares the thesis's words and numbers with ours."""
    first, last = shallow.rough.stuck or (0.0, 0.0)
    yield ThesisValue(
        f"stuck on splinters before breaking free {TUNED}",
        PRINTED_STUCK,
        last - first,
        "s",
        "the wood is ours: the splinters' strength is tuned to it",
    )
    yield ThesisValue(
        "net work done on the wood", "done", float(shallow.rough.work[-1]), "J", "printed as a fact"
    )
    ratio = float(numbers(shallow.end, "band").mean() / numbers(shallow.start, "band").mean())
    yield ThesisValue(
        f"tangential force near {PRINTED_PEAK:g} Hz, end over start of {shallow.rough.time[-1]:.0f} s on faster wood, "
        f"shallow {TUNED}",
        f"almost {PRINTED_HALF:g}",
        ratio,
        "1",
        "wood that wears fast, such that this time stands for the thesis's; the long sanding is further below",
    )
    low, peak = spectral_peaks(shallow.start)
    yield ThesisValue(
        f"local maximum of the spectrum above {TEXTURE:g} Hz, shallow",
        PRINTED_PEAK,
        peak,
        "Hz",
        f"texture crossed at top speed; one more at {low:.0f} Hz is the arm on compliant wood",
    )
    for name, scheme in (("shallow", shallow), ("deep", deep)):
        for measure, words in MEASURES.items():
            yield ThesisValue(
                f"start against smooth by {words}, {name}",
                "marked" if (name == "shallow") == (measure == "band") else "less",
                separation(scheme.start, scheme.plain, measure),
                "deviations",
                _SEPARATIONS[name],
            )
    for name, run, printed in (
        ("deep, forearm upright", deep.rough, "kept (a)"),
        ("deep, forearm slanting", slanted, "routinely lost (b)"),
        ("shallow, forearm upright", shallow.smooth, None),
    ):
        towards, away = contact_shares(run, FREE)
        reason = f"towards the robot: {towards:.2f}; slanting, the hand rises on an arc"
        yield ThesisValue(f"share of pushing away in contact, {name}", printed, away, "1", reason)
    named = f"seeds {', '.join(map(str, judged.alarmed))}" if judged.alarmed else ""
    pieces = f"{judged.pieces[1]} pieces that it was not set on"
    yield ThesisValue("rule fires on smooth wood", "differs from rough", judged.hits, "1", pieces)
    yield ThesisValue("rule fires on rough wood", "differs from smooth", judged.alarms, "1", pieces, named)


def case_table(schemes: dict[str, DepthRuns], courses: dict[str, Course]) -> ResultTable:
    """Tabulates both measures of every case at both depths, and of the long sanding."""
    rows: list[list[Cell]] = [
        [
            name,
            case,
            len(windows),
            *(
                f"{numbers(windows, measure).mean():.3f} ± {numbers(windows, measure).std():.3f}"
                for measure in ("band", "friction", "normal")
            ),
        ]
        for name, scheme in schemes.items()
        for case, windows in scheme.cases.items()
    ]
    columns = ("depth", "case", "windows", f"{BAND_NAME} [N rms]", "friction", "normal force [N]")
    caption = f"Windows of {LENGTH:g} s, mean and standard deviation {TUNED}"
    return ResultTable(caption, columns, [*rows, *course_rows(courses)])


def rule_table(judged: RuleEvaluation) -> ResultTable:
    """Tabulates how well each measure separates smooth from rough."""
    rows = [(name, curve.area) for name, curve in judged.curves.items()]
    return ResultTable(
        f"Separating smooth from rough wood, {judged.pieces[1]} pieces of each kind, shallow",
        ("by", "area"),
        rows,
    )
