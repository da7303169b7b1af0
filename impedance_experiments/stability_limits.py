# SPDX-License-Identifier: BSD-3-Clause
"""How stiff and how soft a hand can be: the sampled loop's limit, and what is left of gravity (thesis 5.1.3)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from impedance_experiments.stability_search import (
    Knock,
    finely_sensed,
    hand_drift,
    hand_stiffness,
    knocked,
    predicted_limit,
    simulated_limit,
    stiffened,
    unknown_weight,
)
from impedance_experiments.task_run import patch_of
from impedance_experiments.thesis_page import Cell, Page, Plot, ResultTable, Settings, ThesisValue, panels
from impedance_modules.control.assembly import Assembly, assemble
from impedance_modules.plain_figures import plain_powers

TASK, SOFT_TASK = "stiff-hand", "drifting-hand"
PATCH = "unknown-payload"
LARGE_TANK = 50.0
"""The loop is to decide, not the tank [J]."""


@dataclass(frozen=True)
class Loop:
    """One way to close the loop: control rate [Hz] and damping ratio of the hand's spring."""

    rate: float
    ratio: float


PRINTED_HIGHEST, PRINTED_LOWEST = 900.0, 10.0
"""About the highest and the lowest endpoint stiffness of the thesis [N/m]."""
LOOPS = (
    Loop(1000.0, 0.7),
    Loop(1000.0, 0.3),
    Loop(1000.0, 1.0),
    Loop(500.0, 0.7),
    Loop(250.0, 0.7),
    Loop(200.0, 0.7),
)
APART, AVERAGED = 0.1, 0.25
"""In the picture: how far from the limit the stiffness is, and time of a root mean square [s]."""
QUICK = (Loop(250.0, 0.7),)
STIFFNESSES = (100.0, 30.0, 10.0, 5.0)
"""Of the drifting hand [N/m]."""


@dataclass(frozen=True)
class Limit:
    """What was found for one loop [N/m]: by ``check``, and on the plant between the last stable and first unstable."""

    loop: Loop
    predicted: float
    stable: Knock
    unstable: Knock

    @property
    def simulated(self) -> float:
        """The limit on the plant [N/m]."""
        return float(np.sqrt(self.stable.stiffness * self.unstable.stiffness))

    @property
    def error(self) -> float:
        """Of the prediction."""
        return self.predicted / self.simulated - 1.0


def reproduce(settings: Settings) -> Page:
    """Looks for both limits of the endpoint stiffness."""
    loops = QUICK if settings.short else LOOPS
    soft = STIFFNESSES[::2] if settings.short else STIFFNESSES
    limits = []
    for index, loop in enumerate(loops):
        settings.on_progress(0.8 * index / len(loops), f"{loop.rate:g} Hz, ratio {loop.ratio:g}")
        limits.append(_limit(loop, settings.choose(1, 3, 5)))
    settings.on_progress(0.8, "gravity")
    drifts = [(k, *_drift(k, settings.seed)) for k in soft]
    return Page(
        summary=_summary(limits),
        comparisons=_comparisons(limits, drifts),
        tables=(_limit_table(limits), _drift_table(drifts)),
        plots=(_knocks(limits[0], settings.choose(2, 6, 6)), _drifts(drifts)),
        differences=_differences(limits),
        facts={
            "worst_error": max(abs(limit.error) for limit in limits),
            "limit": limits[0].simulated,
            **{f"drift_{k:g}": found for k, found, _ in drifts},
            **{f"drift_predicted_{k:g}": predicted for k, _, predicted in drifts},
        },
    )


def loop_task(loop: Loop) -> Assembly:
    """Assembles the knocked hand with one way to close its loop, a tank that does not matter, and fine sensors."""
    assembly = assemble(TASK, effects=None, rate=loop.rate, scale=1.0, arm=None)
    task = assembly.task
    arms = {
        name: replace(arm, springs=tuple(replace(s, damping_ratio=loop.ratio) for s in arm.springs))
        for name, arm in task.arms.items()
    }
    tank = replace(assembly.tank, initial=LARGE_TANK, max=2.0 * LARGE_TANK)
    return stiffened(finely_sensed(replace(assembly, task=replace(task, arms=arms), tank=tank)), 1.0)


def _limit(loop: Loop, halvings: int) -> Limit:
    assembly = loop_task(loop)
    predicted = predicted_limit(assembly)
    stable, unstable = simulated_limit(assembly, predicted, halvings)
    return Limit(loop, predicted, stable, unstable)


def _drift(stiffness: float, seed: int) -> tuple[float, float]:
    return hand_drift(_soft(), stiffness, seed)


def _differences(limits: list[Limit]) -> str:
    assembly, slowest = assemble(TASK, effects=None, rate=None, scale=1.0, arm=None), limits[-1]
    weight, lag = unknown_weight(_soft()), assembly.robot.sensors.velocity_filter
    return (
        "**Above.** The thesis names neither the rate of its loop nor the damping of its springs, and both decide. Its "
        "controller was a Python program beside the robot, certainly slower than the robot's own "
        f"{assembly.robot.timing.rate_max:g} Hz: a longer period lowers the limit, and at {slowest.loop.rate:g} Hz it "
        f"is {slowest.simulated:.0f} N/m beside the thesis's {PRINTED_HIGHEST:g}. The limit comes from a stiff spring "
        "whose torque is late, around joints in which rotor and link swing against each other with little damping of "
        "their own: the controller's damping hardly reaches this mode, for the robot reports speeds "
        f"{1e3 * lag:g} ms late. The plant's sensors do not round here and the knock is a small part of the task's: "
        "rounded angles keep a loop oscillating slightly, and the robot's bound on the rate of torque keeps a large "
        "oscillation small.\n\n"
        f"**Below.** Nothing special happens at {PRINTED_LOWEST:g} N/m: a hand sinks by the uncompensated weight over "
        f"the stiffness. The thesis does not print its robot's error; {weight:.2g} N is assumed."
    )


def _soft() -> Assembly:
    return assemble(SOFT_TASK, effects=patch_of(SOFT_TASK, PATCH), rate=None, scale=1.0, arm=None)


def _summary(limits: list[Limit]) -> str:
    first = limits[0]
    return (
        f"The thesis's hand springs at the posture of its eq. 5.1 are made stiffer (task `{TASK}`), their damping "
        "ratio kept, the hand is hit lightly, and the motion of the plant's motors is measured: does the "
        f"oscillation decay or grow? Bisection finds the limit, {first.simulated:.0f} N/m at {first.loop.rate:g} Hz "
        f"and ratio {first.loop.ratio:g}; "
        f"`impedance check` predicts {first.predicted:.0f} N/m before anything moves, from elastic joints, delay, "
        "sampling and the robot's velocity filter. At the other end a very soft hand "
        f"(`{SOFT_TASK}`) holds {unknown_weight(_soft()):.2g} N that the robot does not compensate "
        f"(`--effects {PATCH}.yaml`)."
    )


def _comparisons(limits: list[Limit], drifts: list[tuple[float, float, float]]) -> tuple[ThesisValue, ...]:
    rows = [
        ThesisValue(
            f"highest stable endpoint stiffness, {limit.loop.rate:g} Hz, ratio {limit.loop.ratio:g}",
            f"about {PRINTED_HIGHEST:g}",
            round(limit.simulated),
            "N/m",
            f"`check` predicts {limit.predicted:.0f} ({100 * limit.error:+.1f} %); see below",
            f"{limit.stable.stiffness:.0f} to {limit.unstable.stiffness:.0f}",
        )
        for limit in limits
    ]
    weight = unknown_weight(_soft())
    for stiffness, found, predicted in drifts:
        printed = f"drifts below about {PRINTED_LOWEST:g} N/m" if stiffness <= PRINTED_LOWEST else None
        reason = f"statics predict {1e3 * predicted:.0f}; {weight:.2g} N that the robot does not carry"
        rows.append(
            ThesisValue(f"hand sinks at {stiffness:g} N/m by", printed, round(1e3 * found), "mm", reason)
        )
    return tuple(rows)


def _limit_table(limits: list[Limit]) -> ResultTable:
    rows: list[list[Cell]] = [
        [
            limit.loop.rate,
            limit.loop.ratio,
            round(limit.predicted),
            round(limit.simulated),
            f"{100 * limit.error:+.1f} %",
            round(limit.stable.kept, 3),
            round(limit.unstable.kept, 3),
        ]
        for limit in limits
    ]
    columns = (
        "rate [Hz]",
        "ratio",
        "check [N/m]",
        "plant [N/m]",
        "error",
        "left just below",
        "left just above",
    )
    return ResultTable(
        "The limit; what is left of the oscillation after one more second, just below and above it",
        columns,
        rows,
    )


def _drift_table(drifts: list[tuple[float, float, float]]) -> ResultTable:
    rows: list[list[Cell]] = [
        [k, round(1e3 * found, 1), round(1e3 * predicted_drift, 1)] for k, found, predicted_drift in drifts
    ]
    return ResultTable(
        f"How far {unknown_weight(_soft()):.2g} N let a soft hand sink",
        ("stiffness [N/m]", "plant [mm]", "statics [mm]"),
        rows,
    )


def _knocks(limit: Limit, seconds: int) -> Plot:
    """Draws the ringing of the motors below and above the limit, and its root mean square over a short time."""
    figure, axes = panels((5.5, 3.4))
    assembly = loop_task(limit.loop)
    own, only = hand_stiffness(assembly), assembly.task.phases[0]
    hit = assembly.task.pushes[0].start
    phase = replace(only, duration=max(only.duration, float(seconds)))
    longer = replace(assembly, task=replace(assembly.task, phases=(phase,)))
    for factor, colour in ((1.0 + APART, "C3"), (1.0 / (1.0 + APART), "C0")):
        knock = knocked(stiffened(longer, factor * limit.simulated / own))
        after = knock.time > hit
        time, speed = knock.time[after], knock.speed[after]
        axes.semilogy(time, speed, color=colour, linewidth=0.5, alpha=0.5)
        count = round(AVERAGED * limit.loop.rate)
        power = np.convolve(speed**2, np.ones(count) / count, mode="valid")
        middle = time[count // 2 : count // 2 + power.size]
        axes.semilogy(middle, np.sqrt(power), color=colour, linewidth=1.8, label=f"{knock.stiffness:.0f} N/m")
    axes.set(xlabel="time [s]", ylabel="fast motion of the motors [rad/s]")
    axes.grid(alpha=0.3)
    axes.legend(loc="lower left")
    return Plot(
        "knock",
        f"Hit at {hit:g} s: {100 * APART:g} % below the limit the motors' oscillation decays, {100 * APART:g} % above "
        f"it it grows; thick: root mean square over {AVERAGED:g} s",
        figure,
    )


def _drifts(drifts: list[tuple[float, float, float]]) -> Plot:
    figure, axes = panels((4.6, 3.2))
    stiffness = [k for k, _, _ in drifts]
    axes.loglog(
        stiffness,
        [1e3 * predicted_drift for _, _, predicted_drift in drifts],
        "-",
        color="0.6",
        label="statics",
    )
    axes.loglog(stiffness, [1e3 * found for _, found, _ in drifts], "o", label="plant")
    axes.axvline(PRINTED_LOWEST, color="C3", linestyle=":", label="thesis: drifts below")
    axes.set(xlabel="endpoint stiffness [N/m]", ylabel="hand sinks by [mm]")
    for axis in (axes.xaxis, axes.yaxis):
        plain_powers(axis)
    axes.grid(alpha=0.3)
    axes.legend()
    return Plot("drift", "A hand sinks by the uncompensated weight", figure)
