# SPDX-License-Identifier: BSD-3-Clause
"""A drive's nonlinear damping, excited by its own motor and by an external force (thesis 6.2.1)."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from impedance_experiments.drive_fit import DriveFit, fit_drive, swinging_joint
from impedance_experiments.task_run import TaskRun, patch_of, record_task, task_with
from impedance_experiments.thesis_page import Cell, Page, Plot, ResultTable, Settings, ThesisValue, panels
from impedance_modules.arrays import Array
from impedance_modules.effects.joint_motion import sign
from impedance_modules.spec.patch_file import EffectSpec
from impedance_modules.spec.task_text import task_document

PATCH = "nonlinear-damping"
FORWARD, INTERACTIVE = "forward-path", "interactive"
BY_SPEED = ("reflected_inertia", "viscous_friction", "coulomb_friction", "quadratic_drag")
BY_LOAD = (*BY_SPEED, "load_dependent_friction")
NAMES = {
    ("viscous_friction", "fv"): "viscous D [N.m.s/rad]",
    ("coulomb_friction", "fc"): "dry fc [N.m]",
    ("quadratic_drag", "c"): "quadratic c [N.m.s^2/rad^2]",
    ("load_dependent_friction", "kl"): "dry per load kl [1]",
    ("reflected_inertia", "Ia"): "I_r [kg.m^2]",
}

_SUMMARY = (
    "The drive of w1 has friction that is not linear (patch `nonlinear-damping`): dry, dry in proportion to "
    "the torque that the gear passes on, and a drag with the square of the speed, beside the robot file's "
    "viscous one. It is excited twice: along the **forward path**, its motor swinging the links (task "
    "`forward-path`), and **interactively**, an external force turning the hand to and fro (task `interactive`). The "
    "diagnosis' residual between commanded torque and joint sensor is fitted by the catalogue's laws."
)


def reproduce(settings: Settings) -> Page:
    """Runs both excitations on a plant with nonlinear friction, and fits each without and with the load."""
    runs = {}
    for number, task in enumerate((FORWARD, INTERACTIVE)):
        settings.on_progress(0.45 * number, f"excitation {task}")
        out = settings.work / task
        name = _shortened(task, settings.work) if settings.short else task
        runs[task] = record_task(name, out, effects=patch_of(task, PATCH), seed=settings.seed + number)
    settings.on_progress(0.9, "fits")
    joint = swinging_joint(FORWARD)
    plain = {task: fit_drive([run], joint, BY_SPEED) for task, run in runs.items()}
    loaded = {task: fit_drive([run], joint, BY_LOAD) for task, run in runs.items()}
    both = fit_drive(list(runs.values()), joint, BY_LOAD)
    swapped = {name: _accounts(loaded[name], loaded[other]) for name, other in _PAIRS}
    swapped_plain = {name: _accounts(plain[name], plain[other]) for name, other in _PAIRS}
    truth = _truth(runs[FORWARD], joint)
    ratio = (
        plain[INTERACTIVE].values["coulomb_friction"]["fc"] / plain[FORWARD].values["coulomb_friction"]["fc"]
    )
    return Page(
        summary=_SUMMARY,
        comparisons=(
            ThesisValue(
                "dry friction by speed alone, interactive over forward path", "most likely differ",
                round(ratio, 2), "1",
                "pushed from outside, the gear carries the whole push; driven from inside, only the links' inertia",
            ),
            *_explained("friction by speed alone", swapped_plain),
            *_explained("friction by speed and load", swapped),
            ThesisValue(
                "dry friction per load, both excitations together", None,
                round(both.values["load_dependent_friction"]["kl"], 4), "1",
                f"the plant's own is {truth[('load_dependent_friction', 'kl')]:g}",
            ),
        ),
        tables=(_table(plain, loaded, both, truth),),
        plots=(_drawn(plain, loaded),),
        differences=_differences(plain, truth),
        facts={
            "dry, forward": plain[FORWARD].values["coulomb_friction"]["fc"],
            "dry, interactive": plain[INTERACTIVE].values["coulomb_friction"]["fc"],
            "load, forward": loaded[FORWARD].values["load_dependent_friction"]["kl"],
            "load, interactive": loaded[INTERACTIVE].values["load_dependent_friction"]["kl"],
            "quadratic": both.values["quadratic_drag"]["c"],
            "truth, load": truth[("load_dependent_friction", "kl")],
            "truth, quadratic": truth[("quadratic_drag", "c")],
            "swapped by speed": min(swapped_plain.values()),
            "swapped by load": min(swapped.values()),
        },
    )  # fmt: skip


def _differences(plain: Mapping[str, DriveFit], truth: Mapping[tuple[str, str], float]) -> str:
    excess = {
        symbol: max(fit.values[law][symbol] / truth[law, symbol] for fit in plain.values())
        for law, symbol in (("coulomb_friction", "fc"), ("viscous_friction", "fv"))
    }
    return (
        "The thesis proposes the experiment and reports none; it expects that nonlinear friction parameters differ "
        "between the two excitations. They do, as long as friction is taken for a law of speed alone: its dry and "
        "viscous numbers then stand for the load that happened to be on the gear, here up to "
        f"{excess['fc']:.2g} and {excess['fv']:.2g} times the plant's own. With the load among the laws each "
        "excitation finds the plant's own numbers, and predicts the other. The sizes of the friction are assumed."
    )


_PAIRS = ((FORWARD, INTERACTIVE), (INTERACTIVE, FORWARD))


def _shortened(task: str, folder: Path) -> str:
    """Writes a task's first five swings, or its first four pushes."""
    data = task_document(task).data
    values: dict[str, Any] = {"phases": data["phases"][:5]}
    if "pushes" in data:
        pushes = data["pushes"][:4]
        last = pushes[-1]
        end = last["start"] + last["rise"] + last["hold"] + last["fall"]
        values = {"pushes": pushes, "phases": [{**data["phases"][0], "duration": round(end, 3)}]}
    return str(task_with(task, values, folder, "short"))


def _accounts(measured: DriveFit, other: DriveFit) -> float:
    """Returns the share of one excitation's friction torque that the numbers of the other excitation account for."""
    friction = measured.torque - measured.rotor
    predicted = friction_torque(other.values, measured.speed, measured.load)
    return 1.0 - float(np.var(friction - predicted) / np.var(friction))


def friction_torque(values: Mapping[str, Mapping[str, float]], speed: Array, load: Array) -> Array:
    """Evaluates the fitted laws at speeds [rad/s] and loads [N.m] of the gear [N.m]."""
    way = sign.python(speed)
    dry = values["coulomb_friction"]["fc"]
    per_load = values["load_dependent_friction"]["kl"] if "load_dependent_friction" in values else 0.0
    smooth = values["viscous_friction"]["fv"] * speed + values["quadratic_drag"]["c"] * speed * np.abs(speed)
    return np.asarray((dry + per_load * np.abs(load)) * way + smooth)


def _truth(run: TaskRun, joint: str) -> dict[tuple[str, str], float]:
    """Collects the effects that the plant has on a joint, and the robot file's own damping and inertia."""
    patch = run.assembly.patch
    applied: tuple[EffectSpec, ...] = () if patch is None else patch.effects
    found = {
        (spec.effect, symbol): quantity.value
        for spec in applied
        for symbol, quantity in spec.parameters.get(joint, {}).items()
    }
    drive = run.assembly.robot.joints[joint]
    found["viscous_friction", "fv"] = drive.motor_damping
    found["reflected_inertia", "Ia"] = drive.reflected_inertia
    return found


def _explained(law: str, shares: Mapping[str, float]) -> list[ThesisValue]:
    return [
        ThesisValue(
            f"{law}: fitted by the other excitation, accounts for the friction of {task}",
            None,
            round(100.0 * share, 2),
            "% of its variance",
            "worse than no law at all where negative" if share < 0.0 else "",
        )
        for task, share in shares.items()
    ]


def _table(
    plain: Mapping[str, DriveFit],
    loaded: Mapping[str, DriveFit],
    both: DriveFit,
    truth: dict[tuple[str, str], float],
) -> ResultTable:
    fits = (plain[FORWARD], plain[INTERACTIVE], loaded[FORWARD], loaded[INTERACTIVE], both)
    rows: list[list[Cell]] = []
    for (law, symbol), name in NAMES.items():
        numbers = [round(fit.values[law][symbol], 4) if law in fit.values else None for fit in fits]
        rows.append([name, *numbers, truth[law, symbol]])
    rows.append(["torque accounted for [%]", *(round(100.0 * fit.accounted, 2) for fit in fits), None])
    columns = (
        "number",
        "by speed: forward",
        "by speed: interactive",
        "and load: forward",
        "and load: interactive",
        "and load: both",
        "the plant's own",
    )
    return ResultTable("Friction of one drive, identified by two excitations", columns, rows)


def _drawn(plain: Mapping[str, DriveFit], loaded: Mapping[str, DriveFit]) -> Plot:
    figure, columns = panels((7.0, 3.4), 1, 2, sharex=True, sharey=True)
    for axes, fits, title in zip(
        columns,
        (plain, loaded),
        ("by speed alone", "by speed, load taken off"),
        strict=True,
    ):
        for colour, (task, fit) in zip(("C0", "C3"), fits.items(), strict=True):
            friction = fit.torque - fit.rotor
            if fits is loaded:
                per_load = fit.values["load_dependent_friction"]["kl"]
                friction -= per_load * np.abs(fit.load) * sign.python(fit.speed)
            axes.plot(fit.speed, friction, ".", ms=2, color=colour, alpha=0.5)
            speeds = np.linspace(fit.speed.min(), fit.speed.max(), 300)
            axes.plot(speeds, friction_torque(fit.values, speeds, np.zeros(300)), color=colour, label=task)
        axes.set(xlabel="motor speed [rad/s]", title=title)
        axes.legend(loc="upper left")
        axes.grid(alpha=0.3)
    columns[0].set_ylabel("friction torque [N.m]")
    return Plot(
        "friction", "Friction of one drive over its speed, by both excitations; lines: fitted laws", figure
    )
