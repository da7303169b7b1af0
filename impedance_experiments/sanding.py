# SPDX-License-Identifier: BSD-3-Clause
"""Sanding splintered wood (thesis 5.2): stuck and free again, work done, roughness felt, and when to stop."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from impedance_experiments.parallel_runs import carry_out_all
from impedance_experiments.thesis_page import Page
from impedance_experiments.sanding_cases import (
    DEEP,
    SHALLOW,
    SLANTED,
    DepthRuns,
    contact_shares,
    numbers,
    run_depth,
    smooth_board,
)
from impedance_experiments.sanding_plots import (
    orientation_plot,
    rule_plot,
    spectrum_plot,
    stroke_plot,
    stuck_plot,
)
from impedance_experiments.sanding_rule import smooth_statistics, roc_curve, score, set_bound
from impedance_experiments.sanding_runs import Sanding, board_of, sand, sanding_task
from impedance_experiments.sanding_woods import WoodKind, draw_wood
from impedance_experiments.sanding_words import (
    BOTH,
    DIFFERENCES,
    FREE,
    MEASURES,
    UNTIL_SMOOTH,
    RuleEvaluation,
    case_table,
    comparisons_of,
    rule_table,
    summary_of,
)
from impedance_experiments.settings import Settings, Size
from impedance_modules.control.assembly import Assembly

Array = NDArray[np.float64]

SET_ON, JUDGED_ON = 1000, 6000
"""First seeds of the pieces of wood that the rule is set on, and (less the settings' seed) of those it is judged on."""
LOWERING = 3.0
"""Time before sanding begins, in all tasks [s]."""
STROKES = 0.3
"""Strokes towards the robot in a second [Hz]; the equilibrium's frequency."""


def reproduce(settings: Settings) -> Page:
    """Sands at two depths and in two postures, draws pieces of wood by seed, and judges the rule on them."""
    long, plain, slant = (settings.choose(*times) for times in ((15, 60, 60), (5, 29, 29), (6, 20, 20)))
    press = settings.choose(9, 60, 60)
    settings.on_progress(0.0, "nearly at the surface")
    schemes = {"equilibrium 3 cm below the wood": run_depth(SHALLOW, settings.seed, long, plain)}
    settings.on_progress(0.15, "deep below the surface")
    schemes["equilibrium 12 cm below the wood"] = run_depth(DEEP, settings.seed, press, plain)
    settings.on_progress(0.3, "forearm slanting")
    slanted = sand(sanding_task(SLANTED, seconds=slant), settings.seed)
    finished = sand(_until_smooth(settings), settings.seed)
    judged = _judge(settings)
    settings.on_progress(1.0, "done")
    shallow, deep = schemes.values()
    return Page(
        summary=summary_of(shallow, judged, finished),
        comparisons=tuple(comparisons_of(shallow, deep, slanted, judged)),
        tables=(case_table(schemes), rule_table(judged)),
        plots=(
            stuck_plot(shallow.rough, min(25.0, LOWERING + long)),
            stroke_plot(schemes),
            spectrum_plot(schemes),
            orientation_plot(deep.rough, slanted, 7.0),
            rule_plot(judged.curves, (judged.alarms, judged.hits)),
        ),
        differences=DIFFERENCES,
        facts=_facts(shallow, deep, slanted, judged, finished),
    )


def _until_smooth(settings: Settings) -> Assembly:
    """Assembles the task that ends by itself; at the shortest size on wood that is smooth from the start."""
    if settings.size is not Size.SHORT:
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
    feel = smooth_statistics({measure: values[:set_on] for measure, values in smooth.items()})
    worst = feel.worst(smooth), feel.worst(rough)
    bound = set_bound(*(values[:set_on] for values in worst))
    curves = {name: roc_curve(smooth[m][set_on:], rough[m][set_on:]) for m, name in MEASURES.items()}
    curves[BOTH] = roc_curve(*(values[set_on:] for values in worst))
    fires = [values[set_on:] < bound for values in worst]
    return RuleEvaluation(
        bounds=feel.bounds(bound),
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
    windows = sand(sanding_task(SHALLOW, board=board, seconds=count / STROKES + 1.0), seed).windows
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
