# SPDX-License-Identifier: BSD-3-Clause
"""How soft may joints be that carry a force before the links fold? (thesis 5.1.2 and 6.2.2)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from impedance_experiments.task_run import only_arm, watch_task
from impedance_experiments.thesis_page import Cell, Page, Plot, ResultTable, Settings, ThesisValue, panels
from impedance_modules.arrays import Array
from impedance_modules.control.assembly import Assembly, assemble
from impedance_modules.control.supervisor import Supervisor
from impedance_modules.plant.plant import Plant
from impedance_modules.robot.state import RobotState
from impedance_modules.tools.spring_tuning import (
    Posture,
    TunedPosture,
    TuningRequest,
    TuningResult,
    folding_share,
    tune,
    unloaded_arm,
    unloading,
)
from impedance_modules.tools.tuned_task import RAMP_TIME, trial_task

TASK = "net-stiffness"
"""The posture of eq. 5.1, with the thesis's springs at joints and hand."""
FORCE = 25.0
"""What the thesis pressed with [N]."""
REACH = 0.75
"""How far a spring's rest may lie from the posture, as in ``impedance tune --reach`` [rad]."""
SHARES = (1.0, 0.95, 0.8)


def reproduce(settings: Settings) -> Page:
    """Tunes the thesis's arm for its 25 N, and tries the answer on the plant."""
    assembly = assemble(TASK, effects=None, rate=None, scale=1.0, arm=None)
    down = np.array([0.0, 0.0, -1.0])
    request = TuningRequest(
        only_arm(assembly), down, 0.0, FORCE, postures=1, reach=REACH, softest=0.5, alone=False
    )
    own = tune(assembly, request).best
    settings.on_progress(0.1, "elbows")
    elbows = tune(assembly, replace(request, postures=settings.choose(3, 15, 15)))
    borne = thesis_bears(assembly, request)
    shares = SHARES[: settings.choose(0, 3, 3)]
    runs = {}
    for step, share in enumerate(shares):
        settings.on_progress(0.2 + 0.8 * step / len(shares), f"{share:g} of the springs")
        runs[share] = trial(settings, assembly, request, own, share)
    growth = {share: _growth(time, away) for share, (time, away) in runs.items()}
    return Page(
        summary=(
            "Joint springs that carry a force at the hand must exceed what the force takes from them as its moment "
            f"arms turn, K_j + J^T K_end J - Gamma positive definite (docs/tune.md). `impedance tune {TASK} "
            f"--force 0:{FORCE:g} --direction=-z --reach {REACH:g}` finds the springs of the smallest sum at the "
            f"thesis's posture for the {FORCE:g} N of its first task. On the plant, springs and load are increased "
            f"together, so that the posture is an equilibrium throughout: {_outcomes(growth)}."
        ),
        comparisons=_comparisons(assembly, own, elbows, borne, growth),
        tables=(_joints(assembly, request, own), _elbows(elbows)),
        plots=(_picture(elbows, runs),),
        differences=(
            f"The thesis's joint springs, {thesis_sum(assembly):.4g} N.m/rad in all and found by trial, belong to "
            "another load case and are no number to compare with: it pressed with the springs at the hand, whose force "
            "turns with the Jacobian and does not load the joint springs at all. By statics alone any positive joint "
            "stiffness then holds; what folded there most likely were the hand's free rotations, under a contact that "
            "is not at the hand's origin. Ours carry the whole force by the joints, the case of Rancourt & Hogan "
            "(2001) and the worst one, in which the thesis's springs, three of them next to nothing, bear only "
            f"{borne:.2g} N. The best elbow saves {100.0 * (1.0 - elbows.best.total / own.total):.1f} % of the sum at "
            "this place of the hand; docs/tune.md has another place."
        ),
        facts={
            "sum": own.total,
            "best_sum": elbows.best.total,
            "borne": borne,
            **{f"growth_{share:g}": factor for share, factor in growth.items()},
        },
    )


def thesis_bears(assembly: Assembly, request: TuningRequest) -> float:
    """Finds the largest force that the thesis's own joint springs carry without folding [N]."""
    bias = assembly.modules.arm(request.arm).bias
    springs = np.zeros(0) if bias is None else np.asarray(bias.stiffness)
    jacobian, others = unloaded_arm(assembly, request, Posture(0.0, assembly.modules.posture))

    def folds(force: float) -> bool:
        wrench = np.append(-force * request.direction, np.zeros(3))
        return folding_share(springs, unloading(jacobian, others, [wrench])) > 1.0

    low, high = 0.0, FORCE
    for _ in range(40):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if folds(middle) else (middle, high)
    return low


def trial(
    settings: Settings, assembly: Assembly, request: TuningRequest, tuned: TunedPosture, share: float
) -> tuple[Array, Array]:
    """Increases springs and load together; returns time [s] and how far the joints are from their posture [rad]."""
    path = settings.work / f"folding-{share:g}.yaml"
    path.write_text(trial_task(TASK, assembly.model, request, tuned, share), encoding="utf-8")
    loaded = assemble(str(path), effects=None, rate=None, scale=1.0, arm=None)
    joints = loaded.model.limbs[request.arm].joints
    log: list[tuple[float, float]] = []

    def observe(_state: RobotState, plant: Plant, _supervisor: Supervisor) -> None:
        away = plant.position[joints] - loaded.modules.posture[joints]
        log.append((plant.time, float(np.linalg.norm(away))))

    watch_task(loaded, observe, seed=settings.seed)
    time, away = np.array(log).T
    return time, away


def thesis_sum(assembly: Assembly) -> float:
    """Adds up the thesis's own joint springs [N.m/rad]."""
    bias = assembly.modules.arm(only_arm(assembly)).bias
    return 0.0 if bias is None else float(np.sum(bias.stiffness))


def _softest(assembly: Assembly) -> float:
    bias = assembly.modules.arm(only_arm(assembly)).bias
    return 0.0 if bias is None else float(np.min(bias.stiffness))


def _outcomes(growth: dict[float, float]) -> str:
    """Says for each share of the springs whether the arm stays."""
    if not growth:
        return "not run in this size"
    parts = []
    for share, factor in growth.items():
        springs = "the springs found" if share == 1.0 else f"{100.0 * (1.0 - share):.0f} % less"
        ending = "returns to it" if factor < 1.0 else "leaves it"
        parts.append(f"with {springs} the arm {ending} ({factor:.3g} times as far away at the end)")
    return ", ".join(parts)


def _growth(time: Array, away: Array) -> float:
    """Gives how far the joints are at the end over how far they were when the load was complete."""
    return float(away[-1] / away[int(np.searchsorted(time, RAMP_TIME + 1.0))])


def _comparisons(
    assembly: Assembly, own: TunedPosture, elbows: TuningResult, borne: float, growth: dict[float, float]
) -> tuple[ThesisValue, ...]:
    unit = "N.m/rad"
    rows = [
        ThesisValue(
            f"sum of joint springs that carry {FORCE:g} N by themselves",
            None,
            round(own.total, 1),
            unit,
            f"the thesis's, {thesis_sum(assembly):.4g}, do not carry it: another load case, see below",
        ),
        ThesisValue(
            "the same, best elbow", None, round(elbows.best.total, 1), unit, "the hand in the same place"
        ),
        ThesisValue(
            "force that the thesis's joint springs carry",
            None,
            round(borne, 2),
            "N",
            f"{_softest(assembly):g} N.m/rad on its softest joints",
        ),
    ]
    for share, factor in growth.items():
        name = f"departure at the end over that at full load, {share:g} of the springs"
        outcome = "decays: holds" if factor < 1.0 else "grows: folds"
        rows.append(ThesisValue(name, None, round(factor, 2), "1", outcome))
    return tuple(rows)


def _joints(assembly: Assembly, request: TuningRequest, own: TunedPosture) -> ResultTable:
    limb = assembly.model.limbs[request.arm]
    bias = assembly.modules.arm(request.arm).bias
    springs = np.zeros(limb.joints.size) if bias is None else np.asarray(bias.stiffness)
    rows: list[list[Cell]] = [
        [name, float(k), float(found), round(float(torque), 6) + 0.0, float(rest)]
        for name, k, found, torque, rest in zip(
            limb.short_names, springs, own.stiffness, own.torque, own.rest, strict=True
        )
    ]
    columns = (
        "joint",
        "thesis [N.m/rad]",
        "ours [N.m/rad]",
        f"torque at {FORCE:g} N [N.m]",
        "rest of the spring [rad]",
    )
    return ResultTable("Joint springs at the thesis's posture", columns, rows)


def _elbows(elbows: TuningResult) -> ResultTable:
    rows: list[list[Cell]] = [
        [round(found.posture.along, 2), found.total, 100.0 * found.share, min(found.hand)]
        for found in elbows.found
    ]
    columns = (
        "along the self-motion [rad]",
        "sum of springs [N.m/rad]",
        "torque of limit [%]",
        f"hand at {FORCE:g} N [N/m]",
    )
    return ResultTable("Elbows with the hand in its place", columns, rows)


def _picture(elbows: TuningResult, runs: dict[float, tuple[Array, Array]]) -> Plot:
    figure, (left, right) = panels((7.0, 3.0), 1, 2)
    left.plot([f.posture.along for f in elbows.found], [f.total for f in elbows.found], "o-")
    left.set(
        xlabel="elbow, along the self-motion [rad]", ylabel="sum of joint springs [N.m/rad]", ylim=(0, None)
    )
    for (share, (time, away)), color in zip(runs.items(), ("C0", "C1", "C3"), strict=False):
        right.semilogy(time, np.maximum(away, 1e-5), color=color, label=f"{share:g} of the springs")
    right.axvline(RAMP_TIME, color="0.7", linewidth=1)
    right.set(xlabel="time [s], full load from the line on", ylabel="joints away from the posture [rad]")
    if runs:
        right.legend(loc="upper left")
    for axes in (left, right):
        axes.grid(alpha=0.3)
    return Plot("folding", "Least joint springs by elbow; what the plant does at and below them", figure)
