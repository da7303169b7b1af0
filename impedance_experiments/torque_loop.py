# SPDX-License-Identifier: BSD-3-Clause
"""Feedback of torque inside the joints: how light it makes an arm, and up to which gain (thesis 3.2, 4)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import groupby

import numpy as np

from impedance_experiments.apparent_mass import Impact, assembled, first_contact
from impedance_experiments.stability_limits import TASK, Loop, loop_task
from impedance_experiments.stability_search import Knock, predicted_limit, simulated_limit
from impedance_experiments.thesis_page import Cell, Page, Plot, ResultTable, Settings, ThesisValue, panels
from impedance_experiments.torque_loop_joint import (
    PassiveLoad,
    Swing,
    loop_timing,
    measured_inertia,
    swung,
    wheel_inertia,
    worst_load,
)
from impedance_modules.control.assembly import Assembly
from impedance_modules.modules.arms import build_modules
from impedance_modules.robot.inner_torque_loop import PassiveGain, admittance, highest_passive_gain
from impedance_modules.robot.model import RobotModel
from impedance_modules.spec.robot_spec import InnerTorqueLoopSpec, JointSpec
from impedance_modules.spec.task_reader import read_task

PRINTED_LIMIT = 2.0
"""Loop gain above which force feedback loses passivity, as the thesis quotes Colgate & Hogan (1989)."""
DELAYS = (0.0, 0.001, 0.002)
"""By which the measured torque is late beyond the loop's own sampling [s]."""
BELOW, ABOVE = 0.9, 1.1
"""Times the highest passive gain."""
GAINS = (0.0, 0.5, 1.0, 2.0)
LOOP = Loop(1000.0, 0.7)
"""How the hand's loop is closed around the joints'."""


@dataclass(frozen=True)
class Drive:
    """Joints of the robot with the same drive.

    Attributes:
        names: Their short names.
        joint: One of them.
    """

    names: str
    joint: JointSpec


@dataclass(frozen=True)
class DriveLimit:
    """How far the inner loop of one drive can be turned up, and what happens there on the plant.

    Attributes:
        drive: The joints.
        delay: Of the measured torque [s].
        found: The highest passive gain.
        load: The passive load that oscillates with it for ever.
        below, above: Swings of that load with less gain and with more.
    """

    drive: Drive
    delay: float
    found: PassiveGain
    load: PassiveLoad
    below: Swing
    above: Swing


@dataclass(frozen=True)
class Lightness:
    """What one gain does.

    Attributes:
        gain: Of all inner loops.
        rotors: Names of joints -> reflected inertia measured at a joint [kg.m^2].
        impact: A hand that hits a surface.
        predicted: Highest stable stiffness of a hand, by ``check`` [N/m].
        stable, unstable: The same on the plant.
    """

    gain: float
    rotors: dict[str, float]
    impact: Impact
    predicted: float
    stable: Knock
    unstable: Knock

    @property
    def simulated(self) -> float:
        """Highest stable stiffness on the plant [N/m]."""
        return float(np.sqrt(self.stable.stiffness * self.unstable.stiffness))


def reproduce(settings: Settings) -> Page:
    """Finds the passive gains, tries them on the plant, and runs tasks with lighter rotors."""
    drives = _drives()
    delays = DELAYS[1:2] if settings.short else DELAYS
    limits = [_limit(drive, delay) for delay in delays for drive in drives]
    gains = GAINS[:3:2] if settings.short else GAINS
    found = []
    for number, gain in enumerate(gains):
        settings.on_progress(0.2 + 0.8 * number / len(gains), f"gain {gain:g}")
        found.append(_lightness(drives, gain, settings))
    return Page(
        summary=_summary(limits, found),
        comparisons=(*_limit_rows(limits), *_end_rows(), *_light_rows(drives, found)),
        tables=(_limit_table(limits), _light_table(drives, found)),
        plots=(_swings(limits), _dissipation(drives)),
        differences=_differences(limits, found),
        facts={
            **{f"limit_{limit.drive.names}_{1e3 * limit.delay:g}": limit.found.gain for limit in limits},
            "worst_below": max(limit.below.grown for limit in limits),
            "worst_above": min(limit.above.grown for limit in limits),
            **{f"mass_{one.gain:g}": one.impact.measured_mass / one.impact.mass for one in found},
            **{f"stiffness_{one.gain:g}": one.predicted / one.simulated for one in found},
        },
    )


def _drives() -> list[Drive]:
    """Groups the joints of one arm by their drives."""
    _, robot = read_task(TASK)
    joints = next(iter(robot.limbs.values())).joints

    def numbers(short: str) -> tuple[float, ...]:
        own = robot.joints[joints[short]]
        return own.spring_stiffness or 0.0, own.spring_damping, own.reflected_inertia, own.motor_damping

    return [
        Drive(", ".join(names), robot.joints[joints[names[0]]])
        for names in ([*group] for _, group in groupby(joints, key=numbers))
    ]


def _limit(drive: Drive, delay: float) -> DriveLimit:
    loop = InnerTorqueLoopSpec(1.0, delay)
    timing = loop_timing(loop)
    found = highest_passive_gain([drive.joint], timing)
    load = worst_load(drive.joint, found, timing, wheel_inertia())
    swings = [swung(drive.joint, replace(loop, gain=f * found.gain), load) for f in (BELOW, ABOVE)]
    return DriveLimit(drive, delay, found, load, *swings)


def with_inner_loop(assembly: Assembly, gain: float) -> Assembly:
    """Gives an assembly's robot an inner torque loop; 0 is none."""
    loop = InnerTorqueLoopSpec(gain, 0.0) if gain > 0.0 else None
    robot = replace(assembly.robot, inner_torque_loop=loop)
    model = RobotModel(robot)
    return replace(assembly, robot=robot, model=model, modules=build_modules(assembly.task, model))


def _lightness(drives: list[Drive], gain: float, settings: Settings) -> Lightness:
    loop = InnerTorqueLoopSpec(gain, 0.0) if gain > 0.0 else None
    hand = with_inner_loop(loop_task(LOOP), gain)
    predicted = predicted_limit(hand)
    stable, unstable = simulated_limit(hand, predicted, settings.choose(0, 3, 5))
    return Lightness(
        gain=gain,
        rotors={drive.names: measured_inertia(drive.joint, loop) for drive in drives},
        impact=first_contact(with_inner_loop(assembled(rotors=True), gain), settings.seed),
        predicted=predicted,
        stable=stable,
        unstable=unstable,
    )


def _summary(limits: list[DriveLimit], found: list[Lightness]) -> str:
    first, none, most = limits[0], found[0], found[-1]
    return (
        "A robot may feed the torque in its joints' springs back to the motors (`inner_torque_loop` in robot.yaml): "
        "the motor gets the commanded torque and, times a gain, what the spring lacks of it. To the command and to "
        "the link the rotor then is lighter by one plus the gain. The loop is sampled, its measured torque may be "
        "late, and from some gain on the joint can give energy: there is a passive load, a mass and a spring, with "
        f"which it oscillates more and more. For {first.drive.names} that gain is {first.found.gain:.2f} when the "
        f"loop is only sampled, at {1e3 * loop_timing(InnerTorqueLoopSpec(1.0, 0.0)).period:g} ms; `impedance check` "
        "prints it and refuses more. On the plant the worst passive load swings less and less at "
        f"{BELOW:g} of the limit and more and more at {ABOVE:g} of it, for every drive and delay below.\n\n"
        f"With a gain of {most.gain:g} a surface that is hit measures {most.impact.measured_mass:.1f} kg at the hand "
        f"where it measured {none.impact.measured_mass:.1f} kg without. The hand of `stiff-hand` can be made "
        f"{_by_gain(found)}."
    )


def _by_gain(found: list[Lightness]) -> str:
    return ", ".join(f"{one.simulated:.0f} N/m stiff at {one.gain:g}" for one in found)


def _limit_rows(limits: list[DriveLimit]) -> list[ThesisValue]:
    return [
        ThesisValue(
            f"highest passive loop gain, {limit.drive.names}, torque {1e3 * limit.delay:g} ms late",
            f"{PRINTED_LIMIT:g}",
            round(limit.found.gain, 2),
            "1",
            "the spring's own damping, which decides with delay and motor damping, is assumed; see below",
        )
        for limit in limits
    ]


def _end_rows() -> list[ThesisValue]:
    """A sensor at the link's end instead of in the joint: passive up to I_r over the link's inertia."""
    model = RobotModel(read_task(TASK)[1])
    limb = next(iter(model.limbs.values()))
    links = np.diag(model.mass_matrix(np.zeros(model.n))) - model.reflected_inertia
    ratio = dict(zip(limb.short_names, (model.reflected_inertia / links)[limb.joints], strict=True))
    return [
        ThesisValue(
            "the same with the sensor behind the link, without delay or damping",
            f"{PRINTED_LIMIT:g}",
            round(min(ratio.values()), 3),
            "1",
            "I_r over the link's inertia, each joint alone, the arm stretched out: a hand never appears lighter than"
            " its links",
            f"{min(ratio.values()):.2g} to {max(ratio.values()):.2g} over the joints",
        )
    ]


def _light_rows(drives: list[Drive], found: list[Lightness]) -> list[ThesisValue]:
    rows = []
    for one in found:
        for drive in drives:
            expected = drive.joint.reflected_inertia / (1.0 + one.gain)
            reason = f"I_r / (1 + gain) is {expected:.4g}"
            quantity = f"reflected inertia met at {drive.names}, gain {one.gain:g}"
            rows.append(ThesisValue(quantity, None, round(one.rotors[drive.names], 4), "kg.m^2", reason))
        mass = one.impact.mass
        reason = f"J (M + I_r / (1 + gain))^-1 J^T gives {mass:.2f}; the hand's own springs press, too"
        quantity = f"mass that a surface measures, gain {one.gain:g}"
        rows.append(ThesisValue(quantity, None, round(one.impact.measured_mass, 2), "kg", reason))
    return rows


def _limit_table(limits: list[DriveLimit]) -> ResultTable:
    rows: list[list[Cell]] = [
        [
            limit.drive.names,
            1e3 * limit.delay,
            round(limit.found.gain, 3),
            round(limit.found.frequency, 1),
            round(limit.load.inertia, 3),
            round(limit.load.stiffness),
            round(limit.below.grown, 3),
            round(limit.above.grown, 3),
        ]
        for limit in limits
    ]
    columns = (
        "joints",
        "late by [ms]",
        "highest passive gain",
        "at [rad/s]",
        "load [kg.m^2]",
        "load [N.m/rad]",
        f"swing grows at {BELOW:g} by",
        f"at {ABOVE:g} by",
    )
    caption = "Highest passive gain, the passive load that it swings with, and by which factor it grows on the plant"
    return ResultTable(caption, columns, rows)


def _light_table(drives: list[Drive], found: list[Lightness]) -> ResultTable:
    rows: list[list[Cell]] = [
        [
            one.gain,
            *(round(one.rotors[drive.names], 4) for drive in drives),
            round(one.impact.mass, 2),
            round(one.impact.measured_mass, 2),
            round(one.impact.peak, 2),
            round(one.predicted),
            round(one.simulated),
        ]
        for one in found
    ]
    columns = (
        "gain",
        *(f"reflected inertia of {drive.names} [kg.m^2]" for drive in drives),
        "mass at the hand, predicted [kg]",
        "measured [kg]",
        "peak force [N]",
        "highest stable stiffness, check [N/m]",
        "plant [N/m]",
    )
    return ResultTable("What a gain of all inner loops does, the torque only sampled", columns, rows)


def _swings(limits: list[DriveLimit]) -> Plot:
    figure, axes = panels((8.0, 3.2), 1, 2, sharex=True, sharey=True)
    limit = limits[-1]
    for axis, swing, colour in zip(axes, (limit.below, limit.above), ("C0", "C3"), strict=True):
        axis.plot(swing.time, 1e3 * swing.angle, color=colour, linewidth=0.5)
        axis.set(title=f"gain {swing.gain:.2f}", xlabel="time [s]")
    axes[0].set(ylabel="angle [mrad]")
    caption = (
        f"{limit.drive.names}, torque {1e3 * limit.delay:g} ms late, on its worst passive load: below the highest "
        "passive gain it comes to rest, above it swings more and more"
    )
    return Plot("swings", caption, figure)


def _dissipation(drives: list[Drive]) -> Plot:
    figure, axes = panels((8.0, 3.2), 1, len(drives), squeeze=False)
    timing = loop_timing(InnerTorqueLoopSpec(1.0, 0.0))
    frequency = np.geomspace(1.0, np.pi / timing.period, 800)
    for axis, drive in zip(axes[0], drives, strict=True):
        limit = highest_passive_gain([drive.joint], timing)
        for gain, style in ((0.0, ":"), (limit.gain, "-"), (1.5 * limit.gain, "--")):
            taken = admittance(drive.joint, gain, timing, frequency).real
            axis.semilogx(frequency, taken, style, label=f"gain {gain:.2f}")
        axis.axhline(0.0, color="0.5", linewidth=0.6)
        least = float(np.min(admittance(drive.joint, 1.5 * limit.gain, timing, frequency).real))
        axis.set(title=drive.names, xlabel="frequency [rad/s]", ylim=(1.5 * least, -6.0 * least))
        axis.legend(loc="lower right")
    axes[0][0].set(ylabel="real part of the admittance [rad/s/(N.m)]")
    caption = "What a joint takes from its link per frequency: where it is below zero, the joint gives energy"
    return Plot("dissipation", caption, figure)


def _differences(limits: list[DriveLimit], found: list[Lightness]) -> str:
    joint = limits[0].drive.joint
    return (
        f"**The limit of {PRINTED_LIMIT:g}** is quoted without the model behind it. With a sensor in the joint's own "
        "spring and no delay a torque loop is passive at any gain; with a sensor behind the link it is passive up to "
        "the rotor's inertia over the link's (row above). What bounds the gain of the loop in the joint is lateness: "
        "half a sample, the delay, and the spring's own damping, whose torque the sensor does not see. Against it "
        "stands what motor and spring lose. For Baxter the springs' damping "
        f"({joint.spring_damping:g} N.m.s/rad for {limits[0].drive.names}) is assumed, nobody has published it: that "
        "the limit comes out near the thesis's is no proof of it.\n\n"
        "**The hand's own limit.** The inner loop takes inertia away, not lateness: the outer loop around the hand "
        f"keeps its delay. The hand can be made {_by_gain(found)}: a lighter rotor helps at first and harms later. "
        "`check` predicts this from the sampled inner loop; its column stands beside the plant's. The thesis's advice, "
        "to model the rotors rather than to fight them by gain, stands."
    )
