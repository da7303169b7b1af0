# SPDX-License-Identifier: BSD-3-Clause
"""What the sanding page says, from the runs and from the tasks behind them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from impedance_experiments.sanding_course import WEAR, Course, task_wear
from impedance_experiments.sanding_rule import RocCurve
from impedance_experiments.sanding_runs import (
    DEEP,
    SHALLOW,
    SLANTED,
    DepthRuns,
    Sanding,
    board_of,
    numbers,
    sanding_task,
    spectrum,
    wear_values,
)
from impedance_modules.control.roughness_detection import BAND, LENGTH, Window
from impedance_modules.spec.task import Sine

UNTIL_SMOOTH = "sand-until-smooth"
TEXTURE = 12.0
"""Above this the spectrum is the texture's, below it the arm's [Hz]."""
BAND_NAME = f"{BAND[0]:g} to {BAND[1]:g} Hz"
TUNED = "(wood tuned)"
"""Marks rows whose number follows from sizes of the wood that were chosen to come near the thesis."""
PRINTED_STUCK, PRINTED_HALF, PRINTED_PEAK = 7.0, 0.5, 20.0
"""Of 5.2: time on splinters [s], fall of the force near the peak, and the peak [Hz]."""
PRINTED_TIME, PRINTED_CYCLES = 900.0, 270
"""Of 5.2: how long the thesis sands [s], in so many cycles."""


@dataclass(frozen=True)
class RuleEvaluation:
    """The rule on pieces that it has not been set on.

    Attributes:
        bounds: What each measure must stay below: the band [N], the coefficient of friction.
        hits, alarms: Shares of smooth and of rough pieces on which it fires.
        alarmed: Seeds of those rough pieces.
        curves: Of each measure, and of the worse of the two.
        pieces: How many of each kind, set on and judged on.
        seeds: First of each.
        windows: How many windows it averages.
    """

    bounds: dict[str, float]
    hits: float
    alarms: float
    alarmed: tuple[int, ...]
    curves: dict[str, RocCurve]
    pieces: tuple[int, int]
    seeds: tuple[int, int]
    windows: int


def lowering_time() -> float:
    """Gives the time before sanding begins [s]."""
    return float(sanding_task(SHALLOW).task.phases[0].duration)


def stroke_rate() -> float:
    """Gives the strokes towards the robot in a second [Hz]: the frequency of the equilibrium.

    Raises:
        TypeError: The equilibrium does not oscillate.
    """
    places = sanding_task(SHALLOW).task.phases[-1].equilibrium.values()
    for place in places:
        for target in place.values():
            if isinstance(target, Sine):
                return target.frequency
    raise TypeError(f"task '{SHALLOW}': its last phase must oscillate")


def equilibrium_depth(task: str) -> float:
    """Gives how far the hand's equilibrium lies below the wood's top face [m]."""
    assembly = sanding_task(task)
    board = board_of(assembly)
    place = next(iter(assembly.task.phases[0].equilibrium.values()))["z"]
    if board.position is None or board.size is None or not isinstance(place, float):
        raise TypeError(f"task '{task}': its equilibrium must rest at one height below a board")
    return board.position[2] + 0.5 * board.size[2] - place


def spectral_peaks(windows: Sequence[Window]) -> tuple[float, float]:
    """Gives the frequencies of the largest amplitudes below and above ``TEXTURE`` [Hz]."""
    nu, amplitude = spectrum(windows)
    low, high = (nu > 0.0) & (nu < TEXTURE), nu >= TEXTURE
    return float(nu[low][np.argmax(amplitude[low])]), float(nu[high][np.argmax(amplitude[high])])


def summary_of(shallow: DepthRuns, judged: RuleEvaluation, finished: Sanding) -> str:
    """Returns what was done and what came out; Markdown."""
    run = shallow.rough
    _, left = wear_values(run.wood)
    return (
        f"A point of sandpaper goes to and fro on a splintered board at {stroke_rate():g} Hz with the gains of Tables "
        f"B.3 and B.4 (tasks `{SHALLOW}`, `{DEEP}`, `{SLANTED}`). {_held(run)} No phase, condition or message "
        f"refers to it. In {run.time[-1]:.0f} s the hand did {run.work[-1]:.2f} J of work on the "
        f"wood, of which {run.wood.rubbed:.2f} J were rubbed and {1e3 * run.wood.broken_work:.0f} mJ broke "
        f"splinters; where it rubbed, {100 * left:.0f} % of the roughness is left on average.\n\n"
        f"{_about_rule(judged)} {_about_end(finished)}"
    )


def _about_rule(judged: RuleEvaluation) -> str:
    set_on, judged_on = judged.pieces
    return (
        f"Roughness is judged from joint efforts and positions alone, in windows of {LENGTH:g} s of the strokes "
        "towards "
        "the robot ([docs/roughness.md](../roughness.md)). The rule 'finished' requires the tangential force from "
        f"{BAND_NAME} below {judged.bounds['band']:.3f} N rms and the coefficient of friction below "
        f"{judged.bounds['friction']:.2f}, over {judged.windows} windows. It was set on {set_on} pieces of each kind "
        f"(seeds {judged.seeds[0]} on) and judged on {judged_on} others (seeds {judged.seeds[1]} on); the ranges that "
        "pieces are drawn from were committed before."
    )


def _about_end(finished: Sanding) -> str:
    most = sum(phase.duration for phase in sanding_task(UNTIL_SMOOTH).task.phases)
    least, mean = wear_values(finished.wood)
    return (
        f"As a phase's `until: {{smooth: ...}}` it ended `{UNTIL_SMOOTH}` after {finished.time[-1]:.1f} s of at most "
        f"{most:g} s ({finished.ending}), with {100 * least:.0f} % of the roughness left where it had rubbed most and "
        f"{100 * mean:.0f} % on average over all that it had touched."
    )


def _held(run: Sanding) -> str:
    if run.stuck is None:
        return "No splinter held the hand."
    first, last = run.stuck
    return (
        f"Splinters held the hand from {first:.1f} to {last:.1f} s while its spring went on loading them both ways, "
        "until they broke."
    )


def differences_of(shallow: DepthRuns, judged: RuleEvaluation, course: Course) -> str:
    """Returns what could not be matched and why; Markdown."""
    return "\n".join(
        (
            _about_wood(shallow, course),
            "- Splinters hold until the damage done by load over time breaks them; that is why a spring that never "
            "gets "
            "stronger frees the hand after a few cycles. In the thesis the force grows slowly; ours has the same "
            "height "
            "every time.",
            _about_spectrum(shallow),
            _about_scores(judged),
            _about_friction(shallow),
            "- The two orientations of fig. 5-9 are photographs that we do not have. Ours differ in the forearm: "
            "upright "
            "over the wood, or slanting towards it; the tool points down in both. Slanting, the stiff shoulder makes "
            "the hand rise on an arc when it pushes away. Only strokes towards the robot are judged.",
            "- A hand touches with one point: it wears a line into the board where a pad wears an area.",
        )
    )


def _about_wood(shallow: DepthRuns, course: Course) -> str:
    sanded = shallow.rough.time[-1] - lowering_time()
    return (
        "- The thesis describes its wood, sandpaper and tool in words only. Ours are assumptions (`sanding_rule.py`) "
        f"and tuned where a row says {TUNED[1:-1]}, so how long splinters hold, how far a spectrum falls and what a "
        "coefficient of friction is are properties of the wood chosen, and only the kinds of behaviour can agree.\n"
        f"- The thesis sands for {PRINTED_TIME / 60.0:g} minutes, {PRINTED_CYCLES} cycles. The long sanding here takes "
        f"{course.seconds / 60.0:g} minutes, {course.seconds * stroke_rate():.0f} cycles, on wood with a resistance to "
        f"wear of {1e-3 * WEAR:g} kJ/m^2, the one number that was tuned, near the surface. The tasks, the rule and the "
        f"other rows use {1e-3 * task_wear(SHALLOW):g} kJ/m^2, so that {sanded:.0f} s, "
        f"{sanded * stroke_rate():.0f} cycles, are enough to see wood become smoother."
    )


def _about_spectrum(shallow: DepthRuns) -> str:
    low, high = spectral_peaks(shallow.start)
    wood = board_of(sanding_task(SHALLOW)).wood
    texture = None if wood is None else wood.roughness
    apart = "" if texture is None else f", hills {1e3 * texture.wavelength:g} mm apart"
    fastest = float(np.abs(shallow.rough.velocity[:, 0]).max())
    return (
        f"- The thesis finds a local maximum at {PRINTED_PEAK:g} Hz and leaves its cause open. Here there are two: one "
        f"near {low:.0f} Hz, the arm's, and a broad one near {high:.0f} Hz, the texture's{apart} and crossed at up to "
        f"{fastest:.2f} m/s."
    )


def _about_scores(judged: RuleEvaluation) -> str:
    areas = ", ".join(f"{name} {curve.area:.3f}" for name, curve in judged.curves.items())
    return (
        "- The rule uses both measures because rough wood can be weak in one of them: hills far apart, a soft backing "
        "or "
        "low hills give little force in the band, slippery wood gives little friction. Areas under the curves: "
        f"{areas}. Seeds 0 to 9, 1000 to 1017 and 5000 to 5009 were looked at while the rule was made; those judged on "
        "here were not. What it may still fire on is rough wood that is weak in both."
    )


def _about_friction(shallow: DepthRuns) -> str:
    board = board_of(sanding_task(SHALLOW))
    texture = None if board.wood is None else board.wood.roughness
    own = board.friction + (0.0 if texture is None else texture.friction)
    normal, friction = numbers(shallow.start, "normal"), numbers(shallow.start, "friction")
    return (
        f"- Near the surface the normal force is {normal.min():.1f} to {normal.max():.1f} N in the first windows, and "
        "the "
        "links' own acceleration in the estimate biases the coefficient of friction (it is read as "
        f"{friction.mean():.2f} on average, where fresh wood has {own:.2f}); the differences between cases remain."
    )
