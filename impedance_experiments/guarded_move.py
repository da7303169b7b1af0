# SPDX-License-Identifier: BSD-3-Clause
"""How hard does a guarded move strike? Its peak force over closing speed, on several surfaces (thesis 1.3)."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from impedance_experiments.guarded_touch import Touch, approaching, guarded_move
from impedance_experiments.thesis_page import Cell, Page, Plot, ResultTable, Settings, ThesisValue, panels

SECONDS = (1.1, 2.2, 4.4, 8.8, 22.0)
"""Durations of the approach, from fast to slow [s]."""
SURFACES = (5000.0, 15000.0, 50000.0)
"""Stiffness of the table [N/m]."""
MIDDLE = SURFACES[1]
"""The one that the rows are about; it is the task's."""
HERE = f"on {MIDDLE / 1000:g} kN/m"
Touches = dict[float, list[Touch]]


def reproduce(settings: Settings) -> Page:
    """Lets one hand come down with several speeds on several surfaces until it notices them."""
    seconds = SECONDS[: settings.choose(2, 5, 5)]
    surfaces = SURFACES[-settings.choose(2, 3, 3) :]
    touches: Touches = {}
    for number, stiffness in enumerate(surfaces):
        settings.on_progress(number / len(surfaces), f"surface of {stiffness:g} N/m")
        touches[stiffness] = [guarded_move(duration, stiffness, settings) for duration in seconds]
    threshold = approaching(seconds[0], settings).robot.contact_detection.force
    return Page(
        summary=_summary(touches[MIDDLE], threshold),
        comparisons=(*_law_rows(touches), *_guard_rows(touches[MIDDLE], threshold)),
        tables=(_table(touches),),
        plots=(_peaks(touches), _course(touches[MIDDLE], threshold)),
        differences=_differences(touches),
        facts=_facts(touches, threshold),
    )


def _exponent(x: Sequence[float], y: Sequence[float]) -> float:
    """Fits p of y ~ x^p."""
    return float(np.polyfit(np.log(x), np.log(y), 1)[0])


def _over_speed(touches: Touches) -> list[float]:
    """Gives the exponent of the peak over the closing speed, one per surface."""
    return [_exponent([t.speed for t in found], [t.peak for t in found]) for found in touches.values()]


def _per_speed(found: list[Touch]) -> list[float]:
    """Gives the peak for each m/s of closing speed [N.s/m]."""
    return [touch.peak / touch.speed for touch in found]


def _over_stiffness(touches: Touches) -> float:
    """Gives the exponent of the peak per speed over the surface's stiffness."""
    return _exponent(list(touches), [float(np.mean(_per_speed(found))) for found in touches.values()])


def _over_elastic(touches: Touches) -> list[float]:
    """Gives measured peaks over those of links and rotors on the springs of their joints."""
    return [touch.peak / touch.predicted for found in touches.values() for touch in found]


def _harmless(found: list[Touch], threshold: float) -> float:
    """Gives the closing speed from which the blow is harder than the guard's own threshold [m/s]."""
    return threshold / float(np.mean(_per_speed(found)))


def _summary(found: list[Touch], threshold: float) -> str:
    slowest, fastest = found[-1], found[0]
    return (
        "`guarded-move` is Mason's guarded move as a task of this project: a soft hand sinks until it has judged from "
        f"its measured efforts that something pushes back with {threshold:g} N, and stays there. It is run on the "
        "plant with several durations of its approach, on surfaces of several stiffnesses without friction and "
        "damping, with true forces and speeds taken from the plant.\n\n"
        f"On {MIDDLE / 1000:g} kN/m the hand strikes with {fastest.peak:.1f} N at "
        f"{1e3 * fastest.speed:.0f} mm/s and with {slowest.peak:.1f} N at {1e3 * slowest.speed:.0f} mm/s: the peak is "
        f"proportional to the closing speed and never zero. It comes {1e3 * fastest.peak_time:.0f} ms after the touch; "
        f"the guard ends the approach {1e3 * fastest.noticed:.0f} ms after it at the earliest. So no guard softens the "
        "blow; only the closing speed does, and the mass and the stiffness that meet. From "
        f"{1e3 * _harmless(found, threshold):.0f} mm/s it is harder than the force that the guard waits for."
    )


def _law_rows(touches: Touches) -> tuple[ThesisValue, ...]:
    found, over_speed, ratios = touches[MIDDLE], _over_speed(touches), _over_elastic(touches)
    slowest, per_speed = found[-1], _per_speed(found)
    most, least = (math.sqrt(MIDDLE * mass) for mass in (found[0].mass, found[0].links))
    return (
        ThesisValue(
            f"peak at the slowest approach, {1e3 * slowest.speed:.1f} mm/s, {HERE}",
            "always an initial impact, no matter how slowly",
            round(slowest.peak, 3),
            "N",
            "proportional to the speed, so never zero",
        ),
        ThesisValue(
            "exponent of the peak over the closing speed",
            None,
            round(float(np.mean(over_speed)), 3),
            "",
            "law: 1; arm, joints and surface are linear during the blow",
            f"{min(over_speed):.3f} to {max(over_speed):.3f} over {len(over_speed)} surfaces",
        ),
        ThesisValue(
            f"peak over closing speed, {HERE}",
            None,
            round(float(np.mean(per_speed)), 1),
            "N.s/m",
            f"law: sqrt(k m), {least:.0f} with the links' mass alone, {most:.0f} with the rotors'",
            f"{min(per_speed):.1f} to {max(per_speed):.1f} over {len(per_speed)} speeds",
        ),
        ThesisValue(
            "peak over that of links and rotors on the springs of their joints",
            None,
            round(float(np.mean(ratios)), 3),
            "",
            "law: 1; the controller, which the law leaves out, goes on leading the hand down",
            f"{min(ratios):.3f} to {max(ratios):.3f} over all runs",
        ),
        ThesisValue(
            "exponent of the peak over the surface's stiffness",
            None,
            round(_over_stiffness(touches), 3),
            "",
            "law: one half; the stiffer the surface, the less of the rotors' mass is in the blow",
        ),
    )


def _guard_rows(found: list[Touch], threshold: float) -> tuple[ThesisValue, ...]:
    fastest, noticed = found[0], [touch.noticed for touch in found]
    return (
        ThesisValue(
            f"from touch to peak, {HERE}",
            None,
            round(1e3 * fastest.peak_time, 1),
            "ms",
            f"a quarter of a swing of the mass in the blow is {1e3 * fastest.quarter_swing:.0f} ms",
        ),
        ThesisValue(
            f"from touch to the end of the approach, {HERE}",
            None,
            round(1e3 * min(noticed), 1),
            "ms",
            "contact is judged over time, and the peak is over by then",
            f"up to {max(noticed):.2g} s, where the blow is too short or too soft to be noticed",
        ),
        ThesisValue(
            f"closing speed from which the blow exceeds the guard's {threshold:g} N, {HERE}",
            None,
            round(1e3 * _harmless(found, threshold), 1),
            "mm/s",
            "where the impact becomes important",
        ),
    )


def _table(touches: Touches) -> ResultTable:
    rows: list[list[Cell]] = [
        [
            stiffness,
            1e3 * touch.speed,
            touch.peak,
            touch.predicted,
            touch.peak / touch.speed,
            *(touch.struck_mass, touch.links, touch.mass),
            *(1e3 * touch.peak_time, 1e3 * touch.noticed, 1e3 * touch.off),
        ]
        for stiffness, found in touches.items()
        for touch in found
    ]
    columns = (
        "surface [N/m]", "closing speed [mm/s]", "peak [N]", "on elastic joints [N]", "peak over speed [N.s/m]",
        "mass in the blow [kg]", "links [kg]", "with rotors [kg]", "peak after [ms]", "noticed after [ms]",
        "off the surface [ms]",
    )  # fmt: skip
    return ResultTable("The first touch of every run", columns, rows)


def _peaks(touches: Touches) -> Plot:
    figure, axes = panels((5.0, 3.6))
    for number, (stiffness, found) in enumerate(touches.items()):
        speeds, colour = np.array([0.0, found[0].speed]), f"C{number}"
        for mass, style in ((found[0].mass, "--"), (found[0].links, ":")):
            axes.plot(1e3 * speeds, speeds * math.sqrt(stiffness * mass), style, color=colour, linewidth=1.0)
        arrived, peaks = [1e3 * touch.speed for touch in found], [touch.peak for touch in found]
        axes.plot(arrived, peaks, "o", color=colour, label=f"{stiffness / 1000:g} kN/m")
    axes.set(xlabel="closing speed [mm/s]", ylabel="peak force [N]")
    axes.legend()
    axes.grid(alpha=0.3)
    caption = (
        "Peak force over closing speed; v sqrt(k m) with rotors (dashed) and of the links alone (dotted)"
    )
    return Plot("peaks", caption, figure)


def _course(found: list[Touch], threshold: float) -> Plot:
    figure, axes = panels((5.0, 3.2))
    for number, touch in enumerate(found):
        shown, label = touch.time < 0.3, f"{1e3 * touch.speed:.0f} mm/s"
        axes.plot(1e3 * touch.time[shown], touch.force[shown], color=f"C{number}", label=label)
        axes.axvline(1e3 * touch.noticed, color=f"C{number}", linewidth=0.8, linestyle="--")
    axes.axhline(threshold, color="black", linewidth=0.8)
    axes.set(xlim=(0.0, 300.0), xlabel="since the touch [ms]", ylabel="normal force [N]")
    axes.legend()
    axes.grid(alpha=0.3)
    caption = f"Force {HERE}; dashed where the guard ends the approach, black the force that it waits for"
    return Plot("course", caption, figure)


def _differences(touches: Touches) -> str:
    shares = [
        f"{found[0].rotors_share:.2f} on {stiffness / 1000:g} kN/m" for stiffness, found in touches.items()
    ]
    return (
        "**The thesis** asks how fast a hand may come to make contact, and measures nothing there; the law is "
        "the textbook's.\n\n"
        "**Which mass** strikes depends on the surface: behind the springs of its joints the rotors arrive later than "
        "the links. The mass in the blow lies between the links' apparent mass and the whole arm's; the part of the "
        f"rotors' share that is in it is {', '.join(shares)}. So the peak grows more slowly with the stiffness than "
        "its root, and the law with rotors is the upper bound.\n\n"
        "**To make and maintain contact** at once is not possible on a surface without losses: the hand leaves it "
        "again after every blow, however slow, and how long it is off changes far less than the speed (table). Damping "
        "of the surface or of the hand has to take the energy.\n"
    )


def _facts(touches: Touches, threshold: float) -> dict[str, float]:
    over_speed, ratios = _over_speed(touches), _over_elastic(touches)
    every = [touch for found in touches.values() for touch in found]
    softest, stiffest = next(iter(touches.values())), touches[max(touches)]
    return {
        "least exponent over speed": min(over_speed),
        "largest exponent over speed": max(over_speed),
        "exponent over stiffness": _over_stiffness(touches),
        "least peak over predicted": min(ratios),
        "largest peak over predicted": max(ratios),
        "rotors' share on the softest": softest[0].rotors_share,
        "rotors' share on the stiffest": stiffest[0].rotors_share,
        "earliest notice over peak time": min(touch.noticed / touch.peak_time for touch in every),
        "peak time over a quarter swing": float(np.mean([t.peak_time / t.quarter_swing for t in every])),
        "harmless speed": _harmless(touches[MIDDLE], threshold),
    }
