# SPDX-License-Identifier: BSD-3-Clause
"""The same hand in air and under water: where it rests, how stiff, heavy and damped it is (thesis 6.2.5)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from impedance_experiments.task_run import PushTrace, first_pushes, only_arm, patch_of, trace_pushed
from impedance_experiments.thesis_page import Cell, Page, Plot, ResultTable, Settings, ThesisValue, panels
from impedance_modules.arrays import Array
from impedance_modules.control.assembly import Assembly, assemble
from impedance_modules.effects.apply import apply_to_plant
from impedance_modules.effects.water import BuoyancyTorque
from impedance_modules.modules.damping import phase_damping
from impedance_modules.modules.equilibrium import start_equilibrium
from impedance_modules.plant.links import link_model, link_table, water_inertia
from impedance_modules.prediction.mechanism import Mechanism, Setting
from impedance_modules.prediction.statics import analyse_state
from impedance_modules.spec.task import PushSpec

TASK, PATCH = "under-water", "under-water"
PERIOD = 0.85
"""Over which a rest is averaged: one swing along z [s]."""
SWING = 1.2
"""How long a swing is fitted after the hand is released [s]."""


@dataclass(frozen=True)
class PushResponse:
    """What one push and the swing after it show, along its axis.

    Attributes:
        axis: 0, 1 or 2.
        stiffness: Force over way while it is held aside [N/m].
        back: From letting go until the hand is back at its rest for the first time [s].
    """

    axis: int
    stiffness: float
    back: float


@dataclass(frozen=True)
class LinearPrediction:
    """Prediction of linear statics and dynamics at the start posture.

    Attributes:
        shift: (3,) of the hand by buoyancy, J H^-1 J_b^T m g [m].
        stiffness: (3,) of the hand along each axis, 1 / diag(J H^-1 J^T) [N/m].
        mass: (3,) apparent mass along each axis, rotors included [kg].
        back: (3,) from letting go along an axis until the hand is back [s].
    """

    shift: Array
    stiffness: Array
    mass: Array
    back: Array


def reproduce(settings: Settings) -> Page:
    """Displaces the hand and releases it, in air and under water."""
    pushes = settings.choose(1, 2, 2)
    worlds = {"air": None, "water": patch_of(TASK, PATCH)}
    traces: dict[str, PushTrace] = {}
    measured: dict[str, list[PushResponse]] = {}
    linear: dict[str, LinearPrediction] = {}
    for step, (name, effects) in enumerate(worlds.items()):
        settings.on_progress(step / 2.0, name)
        assembly = assemble(TASK, effects=effects, rate=None, scale=1.0, arm=None)
        linear[name] = predict_linear(assembly)
        assembly = first_pushes(assembly, pushes, SWING + 0.3)
        traces[name] = trace_pushed(assembly, only_arm(assembly), seed=settings.seed, noise=True)
        measured[name] = [_measured(traces[name], push) for push in assembly.task.pushes]
    start = assembly.task.pushes[0].start
    shift = _rest(traces["water"], start) - _rest(traces["air"], start)
    return Page(
        summary=_summary(assembly),
        comparisons=_comparisons(measured, linear, shift),
        tables=(_table(measured, linear),),
        plots=(_picture(traces),),
        differences=(
            "The thesis names the ocean as future work and prints no numbers; the sizes of what is immersed are "
            "assumed. A seven-joint arm swings in several modes at once, so the swing is predicted by the whole linear "
            "joint-space model, links and rotors as one body, and not by one mass on one spring. The water is still "
            "and without bound: no waves, no current, no wall nearby, no lift across a flow."
        ),
        facts=_facts(measured, linear, shift),
    )


def _summary(assembly: Assembly) -> str:
    spring = assembly.task.arms[only_arm(assembly)].springs[0]
    push = max(np.abs(assembly.task.pushes[0].wrench))
    return (
        f"A hand on springs of {spring.stiffness[0, 0]:g} N/m is slowly displaced by {push:g} N and released, once in "
        "air and once with the forearm's outer half and the wrist in sea water "
        f"(`--effects robots/baxter/patches/{PATCH}.yaml`: buoyancy, added mass, quadratic drag). The springs do not "
        "depend on the medium: the hand is about as stiff under water as in air. But it rests higher, because the "
        "robot goes on carrying the dry weight, and it swings slower, as if it were heavier across the forearm."
    )


def predict_linear(assembly: Assembly) -> LinearPrediction:
    """Computes rest, stiffness, apparent mass and swing at the start posture, water included if it is applied."""
    model, modules, q = assembly.model, assembly.modules, assembly.modules.posture
    mechanism = Mechanism(assembly)
    mechanism.update(q, np.zeros_like(q))
    setting = Setting(modules, start_equilibrium(modules), phase_damping(modules, mechanism.kinematics))
    arm = analyse_state(mechanism, setting, q).arms[only_arm(assembly)]
    joints = model.limbs[only_arm(assembly)].joints
    lift, inertia = np.zeros(model.n), model.mass_matrix(q)
    if assembly.patch is not None:
        applied = apply_to_plant(model, assembly.patch)
        lift = sum((t.lift(q) for t in applied.torques if isinstance(t, BuoyancyTorque)), lift)
        links = link_model(model, np.zeros(3))
        inertia = inertia + water_inertia(links, link_table(links, applied.added_mass), q)
    inertia = inertia[np.ix_(joints, joints)]
    J, hessian = arm.jacobian[:3], arm.system.stiffness
    damping = arm.system.damping + np.diag(model.column("motor_damping")[joints])
    return LinearPrediction(
        shift=J @ np.linalg.solve(hessian, lift[joints]),
        stiffness=1.0 / np.diag(J @ np.linalg.solve(hessian, J.T)),
        mass=1.0 / np.diag(J @ np.linalg.solve(inertia, J.T)),
        back=np.array([_swing_back(inertia, damping, hessian, row) for row in J]),
    )


def _swing_back(inertia: Array, damping: Array, stiffness: Array, row: Array) -> float:
    """Releases M q'' + D q' + H q = 0 from H^-1 row and finds when row . q changes sign [s]."""
    n = row.size
    free = np.hstack([np.zeros((n, n)), np.eye(n)])
    pulled = -np.linalg.solve(inertia, np.hstack([stiffness, damping]))
    rates, modes = np.linalg.eig(np.vstack([free, pulled]))
    start = np.linalg.solve(modes, np.concatenate([np.linalg.solve(stiffness, row), np.zeros(n)]))
    time = np.arange(0.0, SWING, 1e-3)
    way = np.real((row @ modes[:n] * start) @ np.exp(np.outer(rates, time)))
    return float(time[int(np.argmax(way < 0.0))])


def _rest(trace: PushTrace, start: float) -> Array:
    """Mean place (3,) of the hand just before an instant [m]."""
    return np.asarray(np.mean(trace.place[trace.over(start - PERIOD, start), :3], axis=0))


def _measured(trace: PushTrace, push: PushSpec) -> PushResponse:
    axis = int(np.argmax(np.abs(push.wrench)))
    released = push.start + push.rise + push.hold
    rest = _rest(trace, push.start)[axis]
    way = _rest(trace, released)[axis] - rest
    swing = trace.over(released, released + SWING)
    away = np.sign(push.wrench[axis]) * (trace.place[swing, axis] - rest)
    first = int(np.argmax(away < 0.0))
    share = away[first - 1] / (away[first - 1] - away[first])
    time = trace.time[swing]
    return PushResponse(
        axis,
        float(push.wrench[axis] / way),
        float(time[first - 1] + share * (time[first] - time[first - 1]) - released),
    )


def _comparisons(
    measured: dict[str, list[PushResponse]], linear: dict[str, LinearPrediction], shift: Array
) -> tuple[ThesisValue, ...]:
    rise = round(1e3 * float(linear["water"].shift[2]), 1)
    rows = [
        ThesisValue(
            "the hand floats up, predicted", None, rise, "mm", "J H^-1 J_b^T m g, at the start posture"
        ),
        ThesisValue(
            "the hand floats up, on the plant",
            None,
            round(1e3 * float(shift[2]), 1),
            "mm",
            "the arm turns as it rises",
        ),
    ]
    for air, water in zip(measured["air"], measured["water"], strict=True):
        name, axis = "xyz"[air.axis], air.axis
        stiffness = round(water.stiffness / air.stiffness, 3)
        mass = round(float(linear["water"].mass[axis] / linear["air"].mass[axis]), 3)
        slower = round(float(linear["water"].back[axis] / linear["air"].back[axis]), 3)
        rows += [
            ThesisValue(
                f"net stiffness along {name}, water over air",
                None,
                stiffness,
                "1",
                "water is no spring; another posture",
            ),
            ThesisValue(
                f"apparent mass along {name}, water over air", None, mass, "1", "J (M + I_r + A)^-1 J^T"
            ),
            ThesisValue(
                f"time to swing back along {name}, water over air, predicted",
                None,
                slower,
                "1",
                "linear, without drag",
            ),
            ThesisValue(
                f"time to swing back along {name}, water over air, on the plant",
                None,
                round(water.back / air.back, 3),
                "1",
                "drag, springs in the joints, and the posture that floats up",
            ),
        ]
    return tuple(rows)


def _table(measured: dict[str, list[PushResponse]], linear: dict[str, LinearPrediction]) -> ResultTable:
    rows: list[list[Cell]] = [
        [
            f"{name}, {'xyz'[f.axis]}",
            float(linear[name].stiffness[f.axis]),
            f.stiffness,
            float(linear[name].mass[f.axis]),
            float(linear[name].back[f.axis]),
            f.back,
        ]
        for name, found in measured.items()
        for f in found
    ]
    columns = (
        "",
        "stiffness, predicted [N/m]",
        "on the plant [N/m]",
        "apparent mass [kg]",
        "back after, predicted [s]",
        "on the plant [s]",
    )
    return ResultTable("Stiffness, apparent mass and return of the hand", columns, rows)


def _facts(
    measured: dict[str, list[PushResponse]], linear: dict[str, LinearPrediction], shift: Array
) -> dict[str, float]:
    facts = {"shift": float(shift[2]), "shift_predicted": float(linear["water"].shift[2])}
    for air, water in zip(measured["air"], measured["water"], strict=True):
        name, axis = "xyz"[air.axis], air.axis
        facts[f"stiffness_ratio_{name}"] = water.stiffness / air.stiffness
        facts[f"mass_ratio_{name}"] = float(linear["water"].mass[axis] / linear["air"].mass[axis])
        facts[f"slower_{name}"] = water.back / air.back
        facts[f"slower_predicted_{name}"] = float(linear["water"].back[axis] / linear["air"].back[axis])
    return facts


def _picture(traces: dict[str, PushTrace]) -> Plot:
    figure, rows = panels((7.0, 4.2), 2, 1, sharex=True)
    for axes, axis in zip(rows, (1, 2), strict=True):
        for (name, trace), style in zip(traces.items(), ("0.4", "C0"), strict=True):
            axes.plot(trace.time, 1e3 * trace.place[:, axis], color=style, label=name)
        axes.set_ylabel(f"{'xyz'[axis]} [mm]")
        axes.grid(alpha=0.3)
    rows[0].legend(loc="upper right")
    rows[1].set_xlabel("time [s]")
    return Plot("swings", "The hand displaced along y, then along z, and released", figure)
