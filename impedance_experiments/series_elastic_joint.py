# SPDX-License-Identifier: BSD-3-Clause
"""What the springs in the joints do: Bode plots, poles and zeros, and a blow (thesis 3.1, fig. 3-2 to 3-5)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from impedance_experiments.elastic_joint_model import RIGID_TOLERANCE, SeriesElasticJoint, rigid_up_to
from impedance_experiments.thesis_page import Cell, Page, Plot, ResultTable, Settings, ThesisValue, panels
from impedance_modules.arrays import Array
from impedance_modules.robot.kinematics import Kinematics
from impedance_modules.robot.model import Limb, RobotModel
from impedance_modules.spec.task_reader import read_task

TASK = "soft-hold"
"""Its posture is where the joints are studied: a palm in front of the chest."""
ELBOW = 3
"""The joint that is drawn, counted from the shoulder: the thesis's example of such a drive (fig. 2-2)."""
BLOW_FORCE, BLOW_TIME, BLOW_WIDTH = 56.52, 0.2, 0.01775
"""The thesis's fit of a measured blow (3.11): peak [N], time of the peak [s] (26.35 s in its log), width [s]."""
BLOW_END = 6.0
"""When the link has come to rest again [s]."""
PRINTED_LIMIT = 90.0
"""Up to which the rigid mode dominates, as the thesis reads its plot [rad/s]."""


def reproduce(settings: Settings) -> Page:
    """Studies every joint of one arm at a working posture and draws one of them."""
    model, limb, q = _arm_at_work()
    joints = _joints(model, limb, q)
    studied = limb.short_names[ELBOW]
    joint, lever = joints[studied], _lever(model, limb, q)
    settings.on_progress(0.5, "blow")
    blow = blow_response(joint, lever)
    omega = np.geomspace(1.0, 1000.0, settings.choose(300, 2000, 2000))
    limits = {name: rigid_up_to(joint, motor=True) for name, joint in joints.items()}
    return Page(
        summary=_summary(studied, joint, lever),
        comparisons=_comparisons(studied, joint, limits, blow),
        tables=(_joint_table(joints, limits),),
        plots=(
            draw_bode(joint, omega),
            draw_poles(joint),
            draw_blow(blow),
        ),
        differences="The thesis prints neither the inertias nor the damping behind its plots, and its damping was "
        '"arbitrarily assigned". Here they are those of robot.yaml and of the mass matrix at the posture of '
        f"`{TASK}`; the frequency up to which the joint is rigid therefore spreads over the joints around the "
        "thesis's single number. At the link the external torque's mobility has a zero where the rotor swings on "
        "its spring (the link is held still by it), so for a blow the departure comes earlier than for the motor.",
        facts=_facts(joint, limits, blow) | {"rigid limit of the drawn joint": limits[studied]},
    )


def _arm_at_work() -> tuple[RobotModel, Limb, Array]:
    """Reads the task, its robot, and the posture of its first arm."""
    task, robot = read_task(TASK)
    model = RobotModel(robot)
    arm = next(iter(task.arms.values()))
    postures = {name: other.posture for name, other in task.arms.items()}
    absent = {name: dict.fromkeys(limb.short_names, 0.0) for name, limb in model.limbs.items()}
    return model, model.limbs[arm.limb], model.position(absent | postures)


def _joints(model: RobotModel, limb: Limb, q: Array) -> dict[str, SeriesElasticJoint]:
    """Takes each joint with the links beyond it, the other joints held: the diagonal of M(q)."""
    links = np.diag(model.mass_matrix(q)) - model.reflected_inertia
    compliance, motor, spring = (
        model.spring_compliance(),
        model.column("motor_damping"),
        model.column("spring_damping"),
    )
    return {
        short: SeriesElasticJoint(
            link_inertia=float(links[i]),
            reflected_inertia=float(model.reflected_inertia[i]),
            spring_stiffness=float(1.0 / compliance[i]),
            motor_damping=float(motor[i]),
            spring_damping=float(spring[i]),
        )
        for short, i in zip(limb.short_names, limb.joints, strict=True)
    }


def _lever(model: RobotModel, limb: Limb, q: Array) -> float:
    """Distance of the hand from the studied joint's axis [m]: how far the hand moves per radian."""
    kinematics = Kinematics(model, (limb.hand,))
    kinematics.update(q, np.zeros(model.n))
    jacobian = kinematics.jacobian_of(limb.hand)
    return float(np.linalg.norm(jacobian[:3, limb.joints[ELBOW]]))


def _summary(name: str, joint: SeriesElasticJoint, lever: float) -> str:
    gain = joint.highest_damping_gain(sensed_at_link=True)
    return (
        f"Joint {name} with the links beyond it: M = {joint.link_inertia:.3f} kg.m^2 and "
        f"I_r = {joint.reflected_inertia:.3f} kg.m^2 on a spring of {joint.spring_stiffness:.0f} N.m/rad. "
        f"Link and rotor swing against each other at {joint.elastic_frequency:.1f} rad/s; below, they move as one "
        "body and the reduced model (3.12) holds.\n\n"
        "**Why the non-collocated transfer is not passive.** From the motor's torque to the link's velocity there are "
        "four poles and no zero near the axis in between: beyond the elastic mode the phase lags by more than a "
        "quarter turn, towards three quarters, the real part of the mobility is negative, and a damper that reads the "
        "link and pulls at the motor pumps energy into the mode. Here that happens for b above "
        f"{gain:.3g} N.m.s/rad. Reading and pulling at the same side, motor or link, the real part is never negative, "
        "whatever the spring, and any damper is passive. (The dampers of this project's controller therefore act on "
        "the motor side; docs/control-law.md.)\n\n"
        f"**A blow** of {BLOW_FORCE} N on the hand, {lever:.2f} m from the axis, lasts "
        f"{4e3 * BLOW_WIDTH:.0f} ms (3.11). The thesis drops the second mode after looking at such a blow. For the "
        "angle it may; the velocity, and so the force of an impact, is at first that of the link alone."
    )


def _least_real_part(joint: SeriesElasticJoint, output: int, torque: int) -> float:
    """Smallest real part of a mobility over all frequencies [rad/s per N.m]."""
    omega = np.geomspace(1e-2, 100.0 * joint.elastic_frequency, 20_000)
    return float(np.min(joint.mobility(omega)[:, output, torque].real))


def _comparisons(
    studied: str, joint: SeriesElasticJoint, limits: dict[str, float], blow: Blow
) -> tuple[ThesisValue, ...]:
    values = list(limits.values())
    return (
        ThesisValue(
            "rigid mode dominates up to",
            f"about {PRINTED_LIMIT:g}",
            limits[studied],
            "rad/s",
            f"{studied}, the joint that is drawn; within {_decibels(RIGID_TOLERANCE):.0f} dB of the reduced model, "
            "motor torque to link velocity. The thesis prints neither inertias nor damping; the table has all joints",
            f"{min(values):.0f} to {max(values):.0f} over the joints",
        ),
        ThesisValue("poles of one joint", 4, len(joint.poles), "", "fourth order; 28 for an arm of seven"),
        ThesisValue(
            "motor torque to link velocity passive",
            "no",
            "no" if _least_real_part(joint, 0, 1) < 0.0 else "yes",
            "",
            f"smallest real part {_least_real_part(joint, 0, 1):.2g} rad/s per N.m",
        ),
        ThesisValue(
            "motor torque to motor velocity passive",
            "yes",
            "yes" if _least_real_part(joint, 1, 1) >= 0.0 else "no",
            "",
            "collocated; smallest real part not below 0",
        ),
        ThesisValue(
            "blow: largest departure of the angle from the reduced model",
            "slightest oscillation",
            100.0 * float(blow.departure[0]),
            "% of the way moved",
            "on the scale of the whole motion the second mode is hardly seen: the thesis is right",
        ),
        ThesisValue(
            "blow: the same for the velocity",
            None,
            100.0 * float(blow.departure[1]),
            "% of the peak",
            "the blow is shorter than a swing of the spring: at first the link is struck without its rotor",
        ),
    )


def _decibels(ratio: float) -> float:
    return 20.0 * math.log10(ratio)


def _joint_table(joints: dict[str, SeriesElasticJoint], limits: dict[str, float]) -> ResultTable:
    columns = (
        "joint",
        "M [kg.m^2]",
        "I_r [kg.m^2]",
        "K [N.m/rad]",
        "elastic mode [rad/s]",
        "zero at the link [rad/s]",
        "rigid for the motor up to [rad/s]",
        "rigid for a blow up to [rad/s]",
        "largest b at the link [N.m.s/rad]",
    )
    rows: list[list[Cell]] = [
        [
            name,
            joint.link_inertia,
            joint.reflected_inertia,
            joint.spring_stiffness,
            joint.elastic_frequency,
            joint.rotor_frequency,
            limits[name],
            rigid_up_to(joint, motor=False),
            joint.highest_damping_gain(sensed_at_link=True),
        ]
        for name, joint in joints.items()
    ]
    return ResultTable("Every joint of the arm, the others held", columns, rows)


def _facts(joint: SeriesElasticJoint, limits: dict[str, float], blow: Blow) -> dict[str, float]:
    return {
        "lowest rigid limit": min(limits.values()),
        "highest rigid limit": max(limits.values()),
        "elastic frequency": joint.elastic_frequency,
        "largest damping gain at the link": joint.highest_damping_gain(sensed_at_link=True),
        "least real part, collocated": _least_real_part(joint, 1, 1),
        "least real part, non-collocated": _least_real_part(joint, 0, 1),
        "departure of the angle": float(blow.departure[0]),
        "departure of the velocity": float(blow.departure[1]),
    }


@dataclass(frozen=True)
class Blow:
    """Answer to the blow: time (m,) [s], force [N]; link angle [rad] and velocity [rad/s], (2, m), of both models."""

    time: Array
    force: Array
    full: Array
    reduced: Array

    @property
    def departure(self) -> Array:
        """(2,) largest difference of the two angles, and velocities, over the largest of the reduced model."""
        worst = np.max(np.abs(self.full - self.reduced), axis=1)
        return np.asarray(worst / np.max(np.abs(self.reduced), axis=1))


def blow_response(joint: SeriesElasticJoint, lever: float) -> Blow:
    """Lets the thesis's blow act on the hand and integrates both models.

    Args:
        joint: At rest before the blow.
        lever: Of the hand about the joint's axis [m].
    """
    time = np.linspace(0.0, BLOW_END, 10_001)

    def force(t: Array | float) -> Array:
        return np.asarray(BLOW_FORCE * np.exp(-(((t - BLOW_TIME) / BLOW_WIDTH) ** 2)))

    inertia = joint.link_inertia + joint.reflected_inertia

    def rate(t: float, x: Array) -> Array:
        torque = lever * float(force(t))
        full = joint.system @ x[:4] + joint.inputs[:, 0] * torque
        return np.append(full, [x[5], (torque - joint.motor_damping * x[5]) / inertia])

    found = solve_ivp(rate, (0.0, time[-1]), np.zeros(6), t_eval=time, rtol=1e-8, atol=1e-11, max_step=5e-3)
    return Blow(time, force(time), found.y[[0, 2]], found.y[[4, 5]])


def draw_bode(joint: SeriesElasticJoint, omega: Array) -> Plot:
    """Draws the link's velocity per torque, in magnitude and phase, for both inputs."""
    figure, axes = panels((7.0, 4.8), 2, 2, sharex=True, sharey="row")
    mobility, rigid = joint.mobility(omega)[:, 0, :], joint.rigid_mobility(omega)
    for column, title in enumerate(("external torque (collocated)", "motor torque (non-collocated)")):
        magnitude, phase = axes[0, column], axes[1, column]
        for values, label, style in ((mobility[:, column], "with its spring", "-"), (rigid, "reduced", "--")):
            magnitude.loglog(omega, np.abs(values), style, label=label)
            phase.semilogx(omega, np.degrees(np.unwrap(np.angle(values))), style)
        magnitude.set_title(f"{title} to link velocity")
        magnitude.axvline(PRINTED_LIMIT, color="0.7", linewidth=0.8)
        phase.axvline(PRINTED_LIMIT, color="0.7", linewidth=0.8)
        phase.axhspan(-300.0, -90.0, color="C3", alpha=0.08)
        phase.set(xlabel="frequency [rad/s]", ylim=(-290.0, 100.0))
    axes[0, 0].set_ylabel("rad/s per N.m")
    axes[1, 0].set_ylabel("phase [deg]")
    axes[0, 0].legend(loc="lower left")
    return Plot(
        "bode",
        f"Fig. 3-2. Grey: the thesis's {PRINTED_LIMIT:g} rad/s. Shaded: phase below a lag of a quarter turn, where the "
        "port gives energy away",
        figure,
    )


def draw_poles(joint: SeriesElasticJoint) -> Plot:
    """Draws the poles, the link's zeros, and where a damper that reads the link drives the poles."""
    figure, axes = panels((5.5, 4.0))
    limit = joint.highest_damping_gain(sensed_at_link=True)
    for gain in np.linspace(0.0, 3.0 * limit, 40):
        loop = joint.system - gain * np.outer(joint.inputs[:, 1], [0.0, 0.0, 1.0, 0.0])
        values = np.linalg.eigvals(loop)
        axes.plot(values.real, values.imag, ".", color="C1", markersize=3, alpha=0.7)
    axes.plot(joint.poles.real, joint.poles.imag, "x", color="C0", markersize=9, label="poles")
    zeros = _zeros_at_the_link(joint)
    axes.plot(zeros.real, zeros.imag, "o", color="C0", fillstyle="none", label="zeros, external torque")
    axes.axvline(0.0, color="0.4", linewidth=0.8)
    axes.set(xlabel="real [rad/s]", ylabel="imaginary [rad/s]")
    axes.plot([], [], ".", color="C1", label=f"damper at the link, b up to {3.0 * limit:.3g} N.m.s/rad")
    axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2, frameon=False)
    return Plot(
        "poles",
        "Fig. 3-5. The elastic pair lies near the imaginary axis; modest gains push it across",
        figure,
    )


def _zeros_at_the_link(joint: SeriesElasticJoint) -> NDArray[np.complex128]:
    """Zeros from external torque to link velocity: the rotor on its spring, the link held."""
    damping = joint.spring_damping + joint.motor_damping
    return np.roots([joint.reflected_inertia, damping, joint.spring_stiffness]).astype(np.complex128)


def draw_blow(blow: Blow) -> Plot:
    """Draws angle and velocity after the blow, and the blow."""
    figure, (left, right) = panels((7.0, 3.0), 1, 2)
    for axes, row, label in ((left, 0, "link angle [rad]"), (right, 1, "link velocity [rad/s]")):
        axes.plot(blow.time, blow.full[row], label="with its spring")
        axes.plot(blow.time, blow.reduced[row], "--", label="reduced")
        axes.set(xlabel="time [s]", ylabel=label)
    left.legend(loc="lower right")
    right.set_xlim(BLOW_TIME - 0.1, BLOW_TIME + 0.6)
    force = right.twinx()
    force.plot(blow.time, blow.force, color="0.6", linewidth=0.8)
    force.set_ylabel("blow [N]", color="0.5")
    return Plot(
        "blow", "Fig. 3-4. The answer to the blow of fig. 3-3: the whole way, and the first moments", figure
    )
