# SPDX-License-Identifier: BSD-3-Clause
"""A robot that secures itself to an unprepared surface: flat, cylindrical, saddle-shaped, fouled (thesis 1.2)."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from impedance_experiments.securing_runs import (
    GENTLE,
    GROWTH,
    PIPE_RADIUS,
    SETTLED,
    TASK,
    Hold,
    gently,
    given_way,
    held_task,
    hold,
    pipe,
    smooth,
    surfaces_to_hold,
)
from impedance_experiments.task_run import only_arm
from impedance_experiments.thesis_page import Cell, Page, Plot, ResultTable, Settings, ThesisValue, panels
from impedance_modules.arrays import Array
from impedance_modules.control.assembly import Assembly
from impedance_modules.prediction.analysis import analyse_task

CURVATURES = (0.0, 5.0, 8.0, 10.0, 12.0, 15.0)
"""1/R of the smooth pipes [1/m]; the first is flat."""

HOLLOW = "hollow"
X, Y, Z = 0, 1, 2
MILLIMETRES = 1000.0


def reproduce(settings: Settings) -> Page:
    """Holds on every surface, then on smooth ones of several curvatures."""
    assembly = held_task()
    surfaces = surfaces_to_hold(assembly, settings.choose(1, 3, 3))
    curvatures = CURVATURES[::3] if settings.short else CURVATURES
    holds: dict[str, Hold] = {}
    steps = len(surfaces) + len(curvatures) + 1
    for name, surface in surfaces.items():
        settings.on_progress(len(holds) / steps, f"hold: {name}")
        holds[name] = hold(assembly, surface, settings.seed)
    smooth_holds = _smooth_holds(assembly, curvatures, settings, len(surfaces) / steps)
    net = net_stiffness(assembly)
    return Page(
        summary=_summary(holds, smooth_holds, net),
        comparisons=_comparisons(holds, smooth_holds, net),
        tables=(_table(holds), _curvature_table(smooth_holds, net)),
        plots=(_picture(holds, smooth_holds, net),),
        differences=_differences(holds),
        facts=_facts(holds, smooth_holds, net),
    )


def _smooth_holds(
    assembly: Assembly, curvatures: tuple[float, ...], settings: Settings, before: float
) -> dict[float, Hold]:
    """Pushes the hand gently across smooth pipes, and along the saddle's hollow; by curvature, that one's negative."""
    saddle = assembly.task.environment[0]
    up = 0.0 if saddle.radii is None else saddle.radii[0]
    flat = surfaces_to_hold(assembly, 0)["flat"]
    found = {}
    for number, curvature in enumerate(curvatures):
        share = before + (1.0 - before) * number / (len(curvatures) + 1)
        settings.on_progress(share, f"smooth, curvature {curvature:g}/m")
        surface = pipe(saddle, 1.0 / curvature) if curvature > 0.0 else flat
        found[curvature] = hold(gently(assembly, "y"), smooth(surface), settings.seed)
    found[-1.0 / up] = hold(gently(assembly, "x"), smooth(saddle), settings.seed)
    return found


def net_stiffness(assembly: Assembly) -> Array:
    """Gives the hand's net stiffness at the start posture, (6, 6)."""
    net = analyse_task(assembly, None).arms[only_arm(assembly)].stiffness
    if net is None:
        raise ValueError(f"task '{assembly.task.name}' has no net stiffness at its start")
    return net


def _pressed(run: Hold) -> float:
    """Mean normal force before the push [N]."""
    before = (run.time >= run.push.start - SETTLED) & (run.time < run.push.start)
    return float(np.mean(run.normal_force[before]))


def _by_law(run: Hold, curvature: float, net: Array) -> float:
    """Where the law has the hand under the gentle push [m]."""
    way = X if curvature < 0.0 else Y
    return given_way(float(net[way, way]), _pressed(run), GENTLE, curvature)


def _kept(run: Hold) -> bool:
    return run.contact == 1.0


def _push(run: Hold) -> float:
    return float(np.linalg.norm(run.push.wrench[:3]))


def _fouled(holds: Mapping[str, Hold]) -> list[Hold]:
    return [run for name, run in holds.items() if name.startswith("fouled")]


def _summary(holds: dict[str, Hold], smooth_holds: dict[float, Hold], net: Array) -> str:
    flat = holds["flat"]
    kept = sum(_kept(run) for run in holds.values())
    lost = [curvature for curvature, run in smooth_holds.items() if not _kept(run)]
    falls = (
        f"On a pipe of {MILLIMETRES / min(lost):.0f} mm radius and on smaller ones it slips off."
        if lost
        else "It slips off none of those that were tried."
    )
    return (
        f"One and the same task (`{TASK}`: a palm presses with {flat.asked:.0f} N by a force, and is a spring of "
        f"{net[X, X]:.0f} and {net[Y, Y]:.0f} N/m along the surface) holds on surfaces that it does not know: a flat "
        f"one, a pipe of {MILLIMETRES * PIPE_RADIUS:.0f} mm radius, a saddle as where two pipes meet, and pipes with "
        f"up to {MILLIMETRES * GROWTH:.0f} mm of random growth, meshes. On each it is pushed sideways with "
        f"{_push(flat):.0f} N and slides along. Contact is kept throughout on {kept} of {len(holds)}; the least "
        f"share is {100.0 * min(run.contact for run in holds.values()):.1f} %. Without friction the hand gives way "
        f"across a pipe as if N/R were taken from its stiffness. {falls}"
    )


def _comparisons(
    holds: dict[str, Hold], smooth_holds: dict[float, Hold], net: Array
) -> tuple[ThesisValue, ...]:
    rows = []
    for name in ("flat", "pipe", "saddle"):
        run = holds[name]
        rows.append(
            ThesisValue(
                f"share of the time in contact, {name}",
                "to be secured",
                round(run.contact, 4),
                "1",
                f"normal force within {run.force_error:.1f} N (RMS) of the asked {run.asked:.0f} N",
            )
        )
    fouled = _fouled(holds)
    errors = [run.force_error for run in fouled]
    rows.append(
        ThesisValue(
            "share of the time in contact, fouled pipes, the least",
            "to be secured",
            round(min(run.contact for run in fouled), 4),
            "1",
            f"normal force within {max(errors):.1f} N (RMS) of the asked {holds['flat'].asked:.0f} N",
            f"{len(fouled)} random pipes",
        )
    )
    for curvature, run in smooth_holds.items():
        if not _kept(run):
            continue
        law = _by_law(run, curvature, net)
        name = "flat" if curvature == 0.0 else f"1/R = {curvature:.3g}/m"
        rows.append(
            ThesisValue(
                f"smooth, {name}: gives way under {GENTLE:g} N by",
                None,
                round(MILLIMETRES * run.moved, 2),
                "mm",
                f"the law has {MILLIMETRES * law:.2f}; N/R is {_pressed(run) * curvature:.0f} N/m",
            )
        )
    return tuple(rows)


def _table(holds: dict[str, Hold]) -> ResultTable:
    rows: list[list[Cell]] = []
    for name, run in holds.items():
        numbers = (100.0 * run.contact, run.force_error, MILLIMETRES * run.moved, MILLIMETRES * run.slipped)
        rows.append([name, *(round(value, 2) for value in (*numbers, run.paid)), run.ending])
    columns = (
        "surface", "in contact [%]", "RMS error of the normal force [N]", "moved by the push [mm]",
        "left of it afterwards [mm]", "paid by the tank [J]", "ending",
    )  # fmt: skip
    return ResultTable("The same hold on surfaces of several shapes", columns, rows)


def _curvature_table(smooth_holds: dict[float, Hold], net: Array) -> ResultTable:
    rows: list[list[Cell]] = []
    for curvature, run in sorted(smooth_holds.items()):
        way = X if curvature < 0.0 else Y
        law = _by_law(run, curvature, net)
        rows.append(
            [
                round(curvature, 3),
                round(float(net[way, way]), 1),
                round(_pressed(run) * curvature, 1),
                round(MILLIMETRES * law, 2) if np.isfinite(law) else "nothing holds",
                round(MILLIMETRES * run.moved, 2) if _kept(run) else "slips off",
            ]
        )
    columns = ("1/R [1/m]", "K along the push [N/m]", "N/R [N/m]", "moved, by the law [mm]", "moved [mm]")
    return ResultTable(
        "A gentle push on smooth surfaces; a hollow has a negative 1/R (the saddle, along x)", columns, rows
    )


def _differences(holds: dict[str, Hold]) -> str:
    pushed, flat = holds["pipe"], holds["flat"]
    return (
        "The thesis names the shapes and asks for a hold; it prints no number for it. The hand touches with a point: "
        "nothing holds it but friction and its springs. The force axis stays vertical where the surface slants, so the "
        f"normal force errs by up to {max(run.force_error for run in holds.values()):.2f} N; on the flat one it is "
        f"{flat.force_error:.2f} N. Pushed with {_push(pushed):.0f} N, the hand moves "
        f"{pushed.moved / flat.moved:.1f} times as far across the pipe as on the flat surface, and friction keeps "
        f"{100.0 * pushed.slipped / pushed.moved:.0f} % of it: where the surface falls away, friction that sticks "
        "holds the hand where it was pushed. On fouled pipes a dent may hold it, or a peak may let it go on."
    )


def _facts(holds: dict[str, Hold], smooth_holds: dict[float, Hold], net: Array) -> dict[str, float]:
    facts: dict[str, float] = {}
    for name, run in holds.items():
        facts |= {
            f"{name}, contact": run.contact,
            f"{name}, force error": run.force_error,
            f"{name}, moved": run.moved,
            f"{name}, slipped": run.slipped,
            f"{name}, paid": run.paid,
            f"{name}, done": float(run.ending == "done"),
        }
    for curvature, run in smooth_holds.items():
        name = HOLLOW if curvature < 0.0 else f"{curvature:g}"
        facts |= {f"smooth {name}, moved": run.moved, f"smooth {name}, contact": run.contact}
        facts[f"smooth {name}, law"] = _by_law(run, curvature, net)
    return facts


def _picture(holds: dict[str, Hold], smooth_holds: dict[float, Hold], net: Array) -> Plot:
    """Draws how each hold is pushed aside, its normal force, and what curvature does to a smooth one."""
    figure, (across, force, law) = panels((12.0, 3.6), 1, 3)
    push = next(iter(holds.values())).push
    for number, (name, run) in enumerate(holds.items()):
        aside = run.place[:, Y] - run.place[run.time < push.start][-1, Y]
        look = {"color": f"C{number}", "linewidth": 1.0}
        across.plot(run.time, MILLIMETRES * aside, label=name, **look)
        force.plot(run.time, run.normal_force, **look)
    end = push.start + push.rise + push.hold + push.fall
    for axes in (across, force):
        axes.axvspan(push.start, end, color="0.9")
        axes.set(xlabel="time [s], pushed in the grey part", xlim=(push.start - 2.0, None))
    across.set(ylabel="moved across the surface [mm]")
    across.legend(fontsize=7)
    force.set(ylabel="normal force [N]", ylim=(0.0, None))
    kept = {curvature: run for curvature, run in smooth_holds.items() if _kept(run)}
    outward = [curvature for curvature in kept if curvature >= 0.0]
    pressed = _pressed(kept[0.0])
    lines = np.linspace(0.0, max(CURVATURES), 200)
    gave = np.array([given_way(float(net[Y, Y]), pressed, GENTLE, c) for c in lines])
    law.plot(lines[np.isfinite(gave)], MILLIMETRES * gave[np.isfinite(gave)], color="0.5", label="law")
    law.plot(outward, [MILLIMETRES * kept[c].moved for c in outward], "o", color="C3", label="plant")
    law.set(xlabel="1/R of a smooth pipe [1/m]", ylabel=f"moved by {GENTLE:g} N [mm]")
    law.legend(fontsize=8)
    for axes in (across, force, law):
        axes.grid(alpha=0.3)
    caption = (
        "Left: pushed aside; middle: the normal force, the slide at the end; right: how far a gentle push moves the "
        "hand across smooth pipes; where the line ends nothing holds."
    )
    return Plot("holds", caption, figure)
