# SPDX-License-Identifier: BSD-3-Clause
"""What the terrain page says, from the slides that were made and from the task and the robot behind them."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from impedance_experiments.terrain_slides import Slide
from impedance_experiments.terrain_variations import FLAT, OVER, Robustness
from impedance_modules.arrays import Array
from impedance_modules.control.assembly import Assembly, assemble
from impedance_modules.prediction.contact_geometry import place_surface
from impedance_modules.spec.robot_spec import PlaybackSpec

PRINTED_FORCE, PRINTED_IMPEDANCE, PRINTED_VELOCITY = 25.0, 0.024, 0.119
"""Of 5.1: the static force [N], and the RMS deviations of y with springs and in velocity mode [m]."""
Z = 2
RISEN = 1e-3
"""Where the sheet is so much higher than at its end a hill begins [m]."""


def _task(name: str) -> Assembly:
    return assemble(name, effects=None, rate=None, scale=1.0, arm=None)


def playback_of() -> PlaybackSpec:
    """Gives how the robot plays a path back.

    Raises:
        TypeError: It plays nothing back.
    """
    robot = _task(f"{OVER}-position").robot
    if robot.playback is None:
        raise TypeError(f"robot '{robot.name}' plays nothing back")
    return robot.playback


def sheet_at_rest() -> tuple[Array, Array]:
    """Gives y and height of the sheet at rest, (m,) each [m]."""
    y, z = [], []
    for surface in (place_surface(one) for one in _task(OVER).task.environment if one.sheet is not None):
        if surface.sheet is None:
            continue
        first, last = surface.sheet.spans[0, 0] + 0.05, 0.47
        for x in np.linspace(first, last, 200):
            point = surface.sheet.point(float(x))
            if point is not None:
                world = surface.origin + surface.rotation @ np.array([x, 0.0, point.height])
                y.append(float(world[1]))
                z.append(float(world[2]))
    return np.array(y), np.array(z)


def bar_flank() -> tuple[float, float]:
    """Gives the y at which the sheet begins to rise over the bar, and at which the bar holds it up [m]."""
    y, z = sheet_at_rest()
    spec = next(one for one in _task(OVER).task.environment if one.sheet is not None)
    supports = () if spec.sheet is None else spec.sheet.supports
    along = next(at for at, height in supports if height > 0.0)
    placed = place_surface(spec)
    top = placed.origin + placed.rotation @ np.array([along, 0.0, 0.0])
    return float(y[int(np.argmax(z > z[0] + RISEN))]), float(top[1])


def highest_hill() -> float:
    """Gives how high the sheet stands over its lowest place [m]."""
    _, z = sheet_at_rest()
    return float(np.ptp(z))


def spring_depth() -> float:
    """Gives how far the hand's equilibrium lies below the table while it slides [m]."""
    task = _task(FLAT).task
    heights = [place["z"] for phase in task.phases for place in phase.equilibrium.values() if "z" in place]
    table = task.environment[0].height
    last = heights[-1]
    if table is None or not isinstance(last, float):
        raise TypeError(f"task '{FLAT}': its equilibrium must rest at one height below a plane")
    return table - last


def summary_of(found: Mapping[tuple[str, str], Slide]) -> str:
    """Says what was done and how each way of control ended; Markdown."""
    flat = found["impedance", "flat"]
    way = float(np.ptp(flat.place[flat.sliding, 1]))
    endings = "; ".join(
        f"{name}: {_ending(run)}" for (name, surface), run in found.items() if surface == "over"
    )
    return (
        f"A hand leans on a table and slides {100.0 * way:.0f} cm to the left, over the flat table that its map shows, "
        "then over a bar and a block under a flexible sheet that it does not show. It is controlled by the springs of "
        "the thesis's tables 5.1 and 5.2, or by the robot's own velocity or position mode, which plays back what the "
        "joints did on the flat table. The tasks are `slide-flat`, `slide-over`, `slide-over-velocity` and "
        f"`slide-over-position` in tasks/thesis. Over bar and block: {endings}. What ends or pauses a playback stands "
        "in robots/baxter/robot.yaml and was fixed before anything was played back; other values are tried below."
    )


def _ending(run: Slide) -> str:
    contact = f"in contact for {100.0 * run.contact:.0f} % of the slide"
    return (
        f"{contact}, then it stops at y = {run.place[-1, 1]:.2f} m"
        if run.stopped
        else f"{contact}, to the end"
    )


def differences_of(
    found: Mapping[tuple[str, str], Slide], robust: Robustness | None, unhindered: Slide | None
) -> str:
    """Says why ours differ from the thesis's; Markdown.

    Args:
        found: (way of control, surface) -> slide.
        robust: The slides over wrong maps; None where they were not made.
        unhindered: The position playback in which nothing is a collision; None where it was not made.
    """
    return "\n".join(
        (
            _about_force(found),
            "- **The surface** is ours: the thesis has a drawing without measures (`slide-over.yaml` has them).",
            "- **The springs' dampers** are chosen here; the thesis prints none. The joints without a printed "
            "stiffness "
            f"have {_softest():g} N.m/rad as in appendix C.",
            _about_playback(unhindered),
            "- **The RMS of y** with the springs grows with the friction of the surface: uphill it holds the hand "
            "back, "
            "downhill it lets go. The thesis names neither the friction of its aluminium nor the tool; the table of "
            f"frictions shows where its {PRINTED_IMPEDANCE:g} m lies.",
            _about_maps(robust),
            "- **One hand touches with one point**; the flange of the real arm can catch on an edge, which this one "
            "cannot.",
        )
    )


def _softest() -> float:
    bias = _task(FLAT).modules.arms[0].bias
    return 0.0 if bias is None else float(np.min(bias.stiffness))


def _about_force(found: Mapping[tuple[str, str], Slide]) -> str:
    stiffness, depth = float(_task(FLAT).modules.arms[0].springs[0].stiffness[Z, Z]), spring_depth()
    flat, over = found["impedance", "flat"], found["impedance", "over"]
    table = float(np.mean(np.linalg.norm(flat.force[flat.sliding], axis=1)))
    return (
        f"- **Force.** The thesis states {PRINTED_FORCE:g} N. On the plant {table:.0f} N act on the table on average, "
        f"at most {over.peak:.0f} N on bar and block: with K_z = {stiffness:g} N/m, {100.0 * depth:.0f} cm deep, the "
        f"spring at the hand gives {stiffness * depth:.0f} N, and the joint springs, which rest at the posture above "
        "the table, take some of it back. [press-25-newton](press-25-newton.md) looks for the rest: the thesis's "
        "stiffnesses come near its force where the joint springs, too, rest with the hand below the table and the hand "
        "lies flat."
    )


def _about_playback(unhindered: Slide | None) -> str:
    spec = playback_of()
    text = (
        f"- **Playback.** The trajectory server's numbers ({spec.position_tolerance:g} rad, gain "
        f"{spec.velocity_gain:g}, "
        f"{spec.rate:g} Hz) are Rethink's published defaults; the collision thresholds are the parameter server's, but "
        "their unit (N.m) and times are assumed, as is the joints' servo. A collision is judged from the true contact "
        f"torque, not from sensors. It holds the arm for {spec.pause:g} s, in which it falls behind its path."
    )
    if unhindered is None:
        return text
    furthest = float(unhindered.away.max())
    ending = "would play to the end" if furthest < spec.position_tolerance else "would stop"
    return (
        f"{text} Were nothing a collision, the joint furthest from its path would be {furthest:.3f} rad from it; "
        "position "
        f"playback {ending}, with forces up to {unhindered.peak:.0f} N."
    )


def _about_maps(robust: Robustness | None) -> str:
    text = (
        "- **Wrong maps.** Tables more than some millimetres below the map are never touched by a playback. A robot "
        "cannot start inside a table: maps whose table stands over where the hand starts are drawn again."
    )
    if robust is None:
        return text
    counts = {way: len(runs) for way, runs in robust.slides.items()}
    played = max(count for way, count in counts.items() if way != "impedance")
    springs = counts["impedance"]
    return f"{text} The springs slide over {springs} maps and the playbacks over the first {played} of them."
