# SPDX-License-Identifier: BSD-3-Clause
"""Reflected inertia identified: torque steps against a real torsion spring, blows on a virtual one (thesis 3.2.1).

The torque steps also give damping and the dry friction of either direction.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from impedance_experiments.drive_fit import DriveFit, FreeSwing, fit_drive, strike
from impedance_experiments.thesis_page import Cell, Page, Plot, ResultTable, Settings, ThesisValue, panels
from impedance_experiments.torque_steps import (
    LAWS,
    STEP_PATCH,
    STEP_TASK,
    StepsFit,
    diagnose_steps,
    read_steps,
    step_against,
    step_down,
    step_friction,
    stepped_joint,
)
from impedance_modules.diagnosis.result import Diagnosis

WRIST, ELBOW = "W1", "E1"
BOTH = (WRIST, ELBOW)
"""As the thesis calls the joints."""
PRINTED_REAL = "0.047"
PRINTED_VIRTUAL = {WRIST: "0.044 +- 0.003", ELBOW: "0.60 +- 0.039"}
"""Of 3.2.2, by either method [kg.m^2]."""
SPRINGS = (15.0, 10.0, 25.0)
"""Torsion springs of the bench; the first is the patch's own [N.m/rad]."""
BLOWS = (
    ("blow-wrist", "clamped-forearm", (10.0, 15.0, 20.0, 25.0)),
    ("blow-elbow", "clamped-upper-arm", (30.0, 45.0, 60.0)),
)
"""Task, patch, and virtual springs [N.m/rad]."""
SHORT_PHASES = 5
"""Two steps and the returns from them."""


def reproduce(settings: Settings) -> Page:
    """Runs both methods on w1, the second on e1, and diagnoses the first spring's recordings."""
    quick = settings.short
    work = settings.work
    springs = SPRINGS[: settings.choose(1, 3, 3)]
    joint = stepped_joint()
    runs = []
    for number, stiffness in enumerate(springs):
        settings.on_progress(0.12 * number, f"torque steps against {stiffness:g} N.m/rad")
        phases = SHORT_PHASES if quick else None
        runs.append(step_against(stiffness, joint, work, seed=settings.seed + number, phases=phases))
    steps = [read_steps(run, joint, k) for run, k in zip(runs, springs, strict=True)]
    struck, fits, truth = _all_blows(settings)
    answer = None
    if not quick:
        settings.on_progress(0.8, "diagnosis")
        again = step_against(springs[0], joint, work, seed=settings.seed + 100)
        other = step_down(springs[0], joint, work, seed=settings.seed + 200)
        answer = diagnose_steps([runs[0], again, other], joint)
    damping = runs[0].assembly.robot.joints[joint].motor_damping
    return _page(_Found(joint, steps, struck, fits, answer, truth, damping, step_friction(runs[0], joint)))


def _all_blows(
    settings: Settings,
) -> tuple[dict[str, list[FreeSwing]], dict[str, list[DriveFit]], dict[str, float]]:
    """Strikes wrist and elbow on all virtual springs; gives the swings, the fits and the plant's own I_r."""
    struck: dict[str, list[FreeSwing]] = {}
    fits: dict[str, list[DriveFit]] = {}
    truth = {}
    for share, (task, patch, stiffnesses), name in zip((0.5, 0.65), BLOWS, BOTH, strict=True):
        settings.on_progress(share, f"blows on {name}")
        chosen = stiffnesses[: settings.choose(1, 9, 9)]
        found = [strike(task, patch, k, settings.work, settings.seed) for k in chosen]
        struck[name] = [swing for _, swing in found]
        fits[name] = [fit_drive([run], swing.joint, LAWS[:2]) for run, swing in found]
        truth[name] = found[0][0].assembly.robot.joints[struck[name][0].joint].reflected_inertia
    return struck, fits, truth


def _page(found: _Found) -> Page:
    rows = [
        _inertia(
            "I_r of W1, torque steps on a real spring",
            PRINTED_REAL,
            found.real,
            found.truth[WRIST],
            "least squares",
        )
    ]
    rows.append(
        _accounted("variance of the angle accounted for, real spring", [one.accounted for one in found.steps])
    )
    for joint in BOTH:
        swings, fits = found.struck[joint], found.fits[joint]
        for label, values, how in (
            ("virtual spring, frequency", [one.plain for one in swings], "links and rotor as one, as there"),
            ("same, the joint's own spring known", [one.inertia for one in swings], "fourth order"),
            ("same recordings, torque residual", [_rotor(fit) for fit in fits], "no inertia of links enters"),
        ):
            quantity = f"I_r of {joint}, {label}"
            rows.append(_inertia(quantity, PRINTED_VIRTUAL[joint], values, found.truth[joint], how))
    shares = [one.accounted for each in found.struck.values() for one in each]
    rows.append(_accounted("variance of the angle accounted for, blows", shares))
    if found.answer is not None:
        rows += _named(found.answer, found)
    return Page(
        summary=_summary(found.joint),
        comparisons=tuple(rows),
        tables=(_step_table(found), _blow_table(found)),
        plots=(_drawn_steps(found.steps), _drawn_blows(found.struck)),
        differences=_differences(found),
        facts=_facts(found, shares),
    )


def _facts(found: _Found, shares: Sequence[float]) -> dict[str, float]:
    first = found.steps[0].fit.values
    return {
        "real": float(np.mean(found.real)),
        "wrist": float(np.mean([one.inertia for one in found.struck[WRIST]])),
        "elbow": float(np.mean([one.inertia for one in found.struck[ELBOW]])),
        "wrist, plain": float(np.mean([one.plain for one in found.struck[WRIST]])),
        "elbow, plain": float(np.mean([one.plain for one in found.struck[ELBOW]])),
        "truth, wrist": found.truth[WRIST],
        "truth, elbow": found.truth[ELBOW],
        "accounted": min([one.accounted for one in found.steps] + list(shares)),
        "ahead": first["asymmetric_friction"]["fc"],
        "difference": first["asymmetric_friction"]["da"],
        "damping": first["viscous_friction"]["fv"],
    }


@dataclass(frozen=True)
class _Found:
    """What all runs gave, and what the plant really has.

    Attributes:
        joint: That was stepped, as the URDF calls it.
        steps: One per torsion spring.
        struck, fits: Joint -> one per virtual spring.
        answer: The diagnosis; None where it was not asked.
        truth: Joint -> the plant's I_r [kg.m^2].
        damping: The stepped motor's [N.m.s/rad].
        friction: Dry friction of the stepped joint: fc, da [N.m].
    """

    joint: str
    steps: Sequence[StepsFit]
    struck: dict[str, list[FreeSwing]]
    fits: dict[str, list[DriveFit]]
    answer: Diagnosis | None
    truth: dict[str, float]
    damping: float
    friction: tuple[float, float]

    @property
    def real(self) -> list[float]:
        """I_r by torque steps [kg.m^2]."""
        return [_rotor(one.fit) for one in self.steps]


def _summary(joint: str) -> str:
    return (
        "Two ways on the plant, as on the robot, with the limb in a clamp (effect `bench_spring`, which neither the "
        "robot nor its gravity compensation knows).\n\n"
        f"**Torque steps on a real spring.** {joint}, its axis upright, drives a torsion spring with steps of torque "
        f"(`impedance run {STEP_TASK} --effects robots/baxter/patches/{STEP_PATCH}.yaml`). The diagnosis' residual "
        "between commanded torque and joint sensor is fitted by the catalogue's laws: rotor inertia, damping, dry "
        "friction of either direction.\n\n"
        "**Blows on a virtual spring.** The joint's spring is virtual, its rest stands still, and the hand is "
        "struck (`blow-wrist`, `blow-elbow`). The frequency of the free swing gives the total inertia, the URDF the "
        "links' share."
    )


def _differences(found: _Found) -> str:
    real, virtual = (_leading(text) for text in (PRINTED_REAL, PRINTED_VIRTUAL[WRIST]))
    ours = np.mean([_rotor(one.fit) for one in found.steps]) / np.mean(
        [s.inertia for s in found.struck[WRIST]]
    )
    left = {name: np.mean([s.inertia for s in found.struck[name]]) / found.truth[name] - 1.0 for name in BOTH}
    text = (
        f"**{real:g} and {virtual:g}.** On the robot the first method gave {100.0 * (real / virtual - 1.0):.0f} % more "
        f"than the second; the plant has one rotor, and here the two differ by {100.0 * (ours - 1.0):+.1f} %. The "
        "thesis names no reason; its bench brought a friction of its own (6.2.1).\n\n"
        "**Which reading.** Links and rotor taken as one body, as the thesis does, leave out that the links swing "
        "behind the joint's spring, by 1 / (1 - M w^2 / K_s) further than the rotor. What then looks like I_r is "
        "I_r (1 - M w^2 / K_s), the less the stiffer the virtual spring. With the joint's own spring and the delay in "
        f"the equation {100.0 * left[WRIST]:+.1f} % remain of the plant's number for {WRIST}, and "
        f"{100.0 * left[ELBOW]:+.1f} % for {ELBOW}, where the wrists behind it give way."
    )
    return text if found.answer is None else f"{text}\n\n{_about_diagnosis(found, found.answer)}"


def _about_diagnosis(found: _Found, answer: Diagnosis) -> str:
    strange = [
        c.effect for c in answer.causes if c.effect not in ("reflected_inertia", "asymmetric_friction")
    ]
    beside = (
        f"it names {', '.join(strange)}, which the plant does not have,"
        if strange
        else "it names nothing else"
    )
    return (
        f"**The diagnosis** is given the test fixture and the motor's damping ({found.damping:g} N.m.s/rad, as in the "
        "URDF), and neither of the rotor nor of the friction. Causes join one at a time; the least squares above need "
        f"no such order, because they are given which laws act. Beside rotor and friction {beside} and its verdict is "
        f"{answer.verdict.replace('_', ' ')}. The sizes of spring, friction and clamp are assumed."
    )


def _leading(printed: str) -> float:
    """Reads the number before its uncertainty."""
    return float(printed.split(maxsplit=1)[0])


def _rotor(fit: DriveFit) -> float:
    return fit.values["reflected_inertia"]["Ia"]


def _inertia(quantity: str, printed: str, values: Sequence[float], truth: float, how: str) -> ThesisValue:
    mean = float(np.mean(values))
    reason = f"{how}; this plant's own is {truth:g}: {100.0 * (mean / truth - 1.0):+.1f} %"
    return ThesisValue(quantity, printed, round(mean, 5), "kg.m^2", reason, _range(values, 4))


def _range(values: Sequence[float], digits: int) -> str:
    return (
        ""
        if len(values) == 1
        else f"{min(values):.{digits}f} to {max(values):.{digits}f} over {len(values)} springs"
    )


def _accounted(quantity: str, shares: Sequence[float]) -> ThesisValue:
    percent = [100.0 * share for share in shares]
    return ThesisValue(
        quantity,
        96,
        round(min(percent), 2),
        "%",
        "the worst spring; the plant has less that the second-order model leaves out",
        _range(percent, 2),
    )


def _named(answer: Diagnosis, found: _Found) -> list[ThesisValue]:
    rows = []
    for cause in answer.causes:
        for joint, symbols in cause.parameters.items():
            numbers = ", ".join(f"{symbol} {e.value:.4g} +- {e.std:.2g}" for symbol, e in symbols.items())
            known = (
                f"the plant's own is {found.truth[WRIST]:g}" if cause.effect == "reflected_inertia" else ""
            )
            if cause.effect == "asymmetric_friction":
                known = f"the patch's are fc {found.friction[0]:g}, da {found.friction[1]:g}"
            rows.append(
                ThesisValue(
                    f"named by the diagnosis: {cause.effect} on {joint}",
                    None,
                    numbers,
                    "SI",
                    known or "not in the plant",
                )
            )
    return rows


def _step_table(found: _Found) -> ResultTable:
    rows: list[list[Cell]] = []
    for one in found.steps:
        values = one.fit.values
        friction = values["asymmetric_friction"]
        numbers = (
            values["reflected_inertia"]["Ia"], values["viscous_friction"]["fv"],
            friction["fc"] + friction["da"], friction["fc"] - friction["da"],
            100.0 * one.fit.accounted, 100.0 * one.accounted,
        )  # fmt: skip
        rows.append([one.stiffness, *(round(float(v), 4) for v in numbers)])
    columns = (
        "spring [N.m/rad]", "I_r [kg.m^2]", "D [N.m.s/rad]", "dry friction + [N.m]", "dry friction - [N.m]",
        "torque accounted for [%]", "angle accounted for [%]",
    )  # fmt: skip
    dry, half = found.friction
    own = f"{found.truth[WRIST]:g}, {found.damping:g}, {dry + half:g}, {dry - half:g}"
    return ResultTable(f"Torque steps on {WRIST}; the plant's own: {own}", columns, rows)


def _blow_table(found: _Found) -> ResultTable:
    rows: list[list[Cell]] = []
    for joint, swings in found.struck.items():
        for one in swings:
            numbers = (one.frequency, one.decay, one.links, one.plain, one.inertia, one.damping)
            rows.append([joint, one.stiffness, *(round(v, 4) for v in numbers)])
    columns = (
        "joint", "virtual spring [N.m/rad]", "frequency [rad/s]", "decay [1/s]", "links [kg.m^2]",
        "I_r, second order [kg.m^2]", "I_r, fourth order [kg.m^2]", "D, fourth order [N.m.s/rad]",
    )  # fmt: skip
    own = " and ".join(f"{found.truth[joint]:g} ({joint})" for joint in BOTH)
    return ResultTable(f"Free swings after a blow; the plant's own I_r: {own}", columns, rows)


def _drawn_steps(steps: Sequence[StepsFit]) -> Plot:
    figure, (angle, torque) = panels((7.0, 3.4), 1, 2)
    one = steps[0]
    angle.plot(one.time, one.angle, color="C3", label="measured")
    angle.plot(one.time, one.fitted, color="C0", linestyle="--", label="second-order model")
    angle.set(xlabel="time [s]", ylabel="angle [rad]", title=f"real spring of {one.stiffness:g} N.m/rad")
    torque.plot(one.fit.time, one.fit.torque, color="C3", label="commanded less measured")
    torque.plot(one.fit.time, one.fit.fitted, color="C0", linestyle="--", label="I_r, D, dry friction")
    torque.set(xlabel="time [s]", ylabel="torque [N.m]", title="torque of the drive itself")
    for axes in (angle, torque):
        axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.1), frameon=False)
        axes.grid(alpha=0.3)
    return Plot("steps", "Four steps of torque against a real spring, and the fit (as fig. 3-7)", figure)


def _drawn_blows(struck: dict[str, list[FreeSwing]]) -> Plot:
    figure, columns = panels((7.0, 3.6), 1, 2)
    for axes, (joint, swings) in zip(columns, struck.items(), strict=True):
        for index, one in enumerate(swings):
            axes.plot(one.time, 1e3 * one.angle, color=f"C{index}", label=f"{one.stiffness:g} N.m/rad")
            axes.plot(one.time, 1e3 * one.fitted, "k--", linewidth=0.7)
        axes.set(xlabel="since the blow [s]", ylabel="angle [mrad]", title=joint)
        axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.1), ncols=2, frameon=False)
        axes.grid(alpha=0.3)
    return Plot("blows", "Free swings after a blow on virtual springs; dashed: fitted decaying sines", figure)
