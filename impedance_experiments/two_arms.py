# SPDX-License-Identifier: BSD-3-Clause
"""Two seven-joint arms on one welded box: their inertia, damping and stiffness add up at it (thesis 4.5, 6.2.4)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from impedance_experiments.page import Cell, Comparison, Page, Plot, Table, table_of
from impedance_experiments.pushing import Trace, first_pushes, trace_pushed
from impedance_experiments.settings import Settings
from impedance_experiments.two_arms_measured import (
    Measured,
    Predictor,
    Sum,
    inertia_of,
    ratios,
    rest_places,
    steady_speeds,
)
from impedance_modules.control.assembly import Assembly, assemble
from impedance_modules.plant.ground_truth import OBJECT

Array = NDArray[np.float64]

AXES = ("x", "y", "z", "rx", "ry", "rz")


@dataclass(frozen=True)
class _Found:
    """All three runs, and what came out.

    Attributes:
        predicted: At the start posture: of the tasks with springs, with dampers, with neither.
        traces: Of the runs with springs, with dampers, with neither.
        rest, speed: Answers to pushes.
        joints: (k, m) joints' moves under the pushes of ``rest``; predicted and measured.
        inertia: (6, 6) measured.
    """

    predicted: tuple[Sum, Sum, Sum]
    traces: tuple[Trace, Trace, Trace]
    rest: Measured
    speed: Measured
    joints: tuple[Array, Array]
    inertia: Array


def reproduce(settings: Settings) -> Page:
    """Pushes a box in both hands and lays what it answers beside the arms' sum."""
    axes = settings.choose(1, 6, 6)
    found = _push_all(settings, axes)
    settings.on_progress(1.0, "done")
    return Page(
        summary=_summary(found),
        comparisons=_comparisons(found),
        tables=_tables(found),
        plots=(_picture(found),),
        differences="The thesis asks for this experiment (6.2.4) and prints no number. Left over: the robot rounds "
        "joint angles (0.4 mrad) and estimates speeds with 13.5 ms of lag; the inertia is fitted from the first "
        "0.9 s after a push, in which the motors' friction takes a third of the momentum away.",
        facts=_facts(found),
    )


def _task(name: str) -> Assembly:
    return assemble(name, effects=None, rate=None, scale=1.0, arm=None)


def _push_all(settings: Settings, axes: int) -> _Found:
    springs, dampers, free = (_task(f"two-arms-{kind}") for kind in ("stiffness", "damping", "inertia"))
    springs, dampers = (first_pushes(task, 2 * axes, 0.3) for task in (springs, dampers))
    traces = []
    for index, task in enumerate((springs, dampers, free)):
        settings.on_progress(0.3 * index, task.task.name)
        traces.append(trace_pushed(task, OBJECT, seed=settings.seed, noise=True))
    predictor, damped, loose = Predictor(springs), Predictor(dampers), Predictor(free)
    predicted = predictor.at(predictor.posture)
    rest, moved = rest_places(springs, traces[0], predicted)
    if predicted.joints is None:
        raise ValueError("the springs' task has no springs")
    return _Found(
        predicted=(predicted, damped.at(damped.posture), loose.at(loose.posture)),
        traces=(traces[0], traces[1], traces[2]),
        rest=rest,
        speed=steady_speeds(dampers, traces[1], damped),
        joints=(predicted.joints @ rest.wrench, moved[predictor.joints]),
        inertia=inertia_of(free, traces[2]),
    )


def _errors(found: _Found) -> tuple[Array, Array, Array]:
    """Gives the relative error of every rest place, every speed, and the eigenvalue ratios of the inertia."""
    springs, dampers, free = found.predicted
    if springs.stiffness is None:
        raise ValueError("the springs' task has no springs")
    at_rest = found.rest.errors(springs.stiffness)
    return at_rest, found.speed.errors(dampers.damping), ratios(found.inertia, free.inertia)


def _joint_errors(found: _Found) -> tuple[Array, Array]:
    """Gives the joints' relative error per push, and which share of their move left the box where it was."""
    expected, measured = found.joints
    size = np.linalg.norm(expected, axis=0)
    within = np.linalg.norm(found.predicted[0].self_motion.T @ expected, axis=0)
    return np.linalg.norm(measured - expected, axis=0) / size, within / size


def _facts(found: _Found) -> dict[str, float]:
    at_rest, speed, inertia = _errors(found)
    joints, within = _joint_errors(found)
    return {
        "stiffness_error": float(at_rest.max()),
        "damping_error": float(speed.max()),
        "inertia_error": float(np.abs(inertia - 1.0).max()),
        "joint_error": float(joints.max()),
        "self_motion": float(within.max()),
        "done": float(all(trace.ending == "done" for trace in found.traces)),
    }


def _summary(found: _Found) -> str:
    _, within = _joint_errors(found)
    return (
        "Both arms of the robot hold one box of 1.2 kg, welded to the palms, and somebody pushes the box on the "
        "simulated plant: slowly against springs (`two-arms-stiffness`), steadily against dampers "
        "(`two-arms-damping`), shortly against nothing but inertia (`two-arms-inertia`), along and about every axis. "
        "The predictions are sums: each arm's 6x6 matrix carried to the box's centre, plus the box's own inertia. No "
        "closed chain is computed for them; the plant knows only two arms, a box and two stiff couplings.\n\n"
        "**Redundancy.** The fourteen joints have eight ways to move with the box in both hands: six move the box, two "
        "turn an elbow and leave the box alone. Nobody projects anything; under a push the elbows go where the joint "
        f"springs let them: up to {100.0 * float(within.max()):.0f} % of the joints' move is such self-motion. The "
        "sums contain it, and the joints' moves agree, too."
    )


def _comparisons(found: _Found) -> tuple[Comparison, ...]:
    at_rest, speed, inertia = _errors(found)
    joints, _ = _joint_errors(found)
    pushes = "largest difference of measured and predicted answer to a push, in the norm of the matrix itself"
    rows = (
        ("K at the box: rest place under a push", at_rest, pushes),
        ("B at the box: speed under a steady push, motors' friction included", speed, pushes),
        ("joints' moves under the same pushes as K", joints, "14 joints, self-motions included"),
    )
    found_rows = [
        Comparison(
            name, None, round(100.0 * float(values.max()), 2), "%", reason, f"mean {100 * values.mean():.2f}"
        )
        for name, values, reason in rows
    ]
    worst = 100.0 * float(np.abs(inertia - 1.0).max())
    spread = f"ratios {inertia[0]:.3f} to {inertia[-1]:.3f}"
    reason = "eigenvalues of predicted^-1 measured, reflected inertia included: 1 in every direction if equal"
    found_rows.append(
        Comparison("Lambda at the box: impulse over speed", None, round(worst, 2), "%", reason, spread)
    )
    return tuple(found_rows)


def _tables(found: _Found) -> tuple[Table, ...]:
    free = found.predicted[2]
    tables = [_matrix("Lambda predicted [kg, kg.m, kg.m^2]", free.inertia)]
    tables.append(_matrix("Lambda measured", found.inertia))
    for name, answer in (("K [N/m, N, N.m/rad]", found.rest), ("B [N.s/m, N.s, N.m.s/rad]", found.speed)):
        if answer.wrench.shape[1] >= len(AXES):
            shown = answer.wrench @ np.linalg.pinv(answer.predicted)
            tables += [_matrix(f"{name} predicted", shown), _matrix(f"{name} measured", answer.matrix())]
    return tuple(tables)


def _matrix(name: str, matrix: Array) -> Table:
    rows: list[list[Cell]] = [
        [AXES[i], *(round(float(value), 3) + 0.0 for value in row)] for i, row in enumerate(matrix)
    ]
    return table_of(name, ("", *AXES), rows)


def _picture(found: _Found) -> Plot:
    """Draws what the box did under the pushes, and where the sums say it should have come."""
    figure = Figure(figsize=(9.0, 8.0), layout="constrained")
    top, middle, bottom = figure.subplots(3, 1)
    springs, dampers, free = found.traces
    expected = _expected(found, springs)
    for axis in range(3):
        top.plot(springs.time, 1e3 * springs.place[:, axis], color=f"C{axis}", label=AXES[axis])
        top.plot(springs.time, 1e3 * expected[:, axis], "--", color=f"C{axis}", linewidth=0.8)
        middle.plot(dampers.time, 1e3 * dampers.twist[:, axis], color=f"C{axis}", linewidth=0.8)
    wanted = np.linalg.solve(found.predicted[1].damping, dampers.push.T).T
    for axis in range(3):
        middle.plot(dampers.time, 1e3 * wanted[:, axis], "--", color=f"C{axis}", linewidth=0.8)
    impulse = np.cumsum(free.push * np.diff(free.time, prepend=0.0)[:, None], axis=0)
    momentum = free.twist @ found.predicted[2].inertia.T
    for axis in range(3):
        bottom.plot(free.time, momentum[:, axis], color=f"C{axis}")
        bottom.plot(free.time, impulse[:, axis], "--", color=f"C{axis}", linewidth=0.8)
    top.set(ylabel="place [mm]", title="against springs; dashed: K^-1 F of the sum")
    middle.set(ylabel="speed [mm/s]", title="against dampers; dashed: B^-1 F of the sum")
    bottom.set(
        ylabel="momentum [N.s]",
        xlabel="time [s]",
        title="floating: Lambda v of the sum; dashed: impulse given",
    )
    top.legend(loc="upper right", ncols=3, fontsize=8)
    return Plot("answers", "What the box did (lines) and what the arms' sums say (dashed)", figure)


def _expected(found: _Found, trace: Trace) -> Array:
    stiffness = found.predicted[0].stiffness
    if stiffness is None:
        raise ValueError("the springs' task has no springs")
    return np.asarray(np.linalg.solve(stiffness, trace.push.T).T)
