# SPDX-License-Identifier: BSD-3-Clause
"""What the springs in Baxter's joints do: Bode, poles and zeros, and a blow (thesis 3.1)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from impedance_experiments.blow import BLOW_FORCE, Blow, strike
from impedance_experiments.page import Cell, Comparison, Page, Table, table_of
from impedance_experiments.series_elastic_plots import draw_blow, draw_bode, draw_poles
from impedance_experiments.settings import Settings
from impedance_modules.robot.kinematics import Kinematics
from impedance_modules.robot.model import Limb, RobotModel
from impedance_modules.spec.task_reader import read_task
from impedance_experiments.series_elastic_joint import SeriesElasticJoint, rigid_up_to

Array = NDArray[np.float64]

TASK = "soft-hold"
"""Its posture is where the joints are looked at: a palm in front of the chest."""
ELBOW = 3
"""The joint that is drawn, counted from the shoulder: the thesis's example of such a drive (fig. 2-2)."""


def reproduce(settings: Settings) -> Page:
    """Studies every joint of one arm at a working posture and draws one of them."""
    model, limb, q = _arm_at_work()
    joints = _joints(model, limb, q)
    studied = limb.short_names[ELBOW]
    joint, lever = joints[studied], _lever(model, limb, q)
    settings.on_progress(0.5, "blow")
    blow = strike(joint, lever)
    omega = np.geomspace(1.0, 1000.0, settings.choose(300, 2000, 2000))
    limits = {name: rigid_up_to(joint, motor=True) for name, joint in joints.items()}
    settings.on_progress(1.0, "done")
    return Page(
        summary=_summary(studied, joint, lever),
        comparisons=_comparisons(joint, limits, blow),
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
        facts=_facts(joint, limits, blow),
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
        "four poles and no zero near the axis in between: beyond the elastic mode the phase falls past -90 degrees "
        "towards -270, the real part of the mobility is negative, and a damper that reads the link and pulls at the "
        f"motor pumps energy into the mode. Here that happens for b above {gain:.3g} N.m.s/rad. Reading and pulling "
        "at the same side, motor or link, the real part is never negative, whatever the spring, and any damper is "
        "passive. (The dampers of this project's controller therefore act on the motor side; docs/control-law.md.)\n\n"
        f"**A blow** of {BLOW_FORCE} N on the hand, {lever:.2f} m from the axis, lasts 0.07 s (3.11). The thesis drops "
        "the second mode after looking at such a blow. For the angle it may; the velocity, and so the force of an "
        "impact, is that of the link alone for the first hundredths of a second."
    )


def _least_real_part(joint: SeriesElasticJoint, output: int, torque: int) -> float:
    """Smallest real part of a mobility over all frequencies [rad/s per N.m]."""
    omega = np.geomspace(1e-2, 100.0 * joint.elastic_frequency, 20_000)
    return float(np.min(joint.mobility(omega)[:, output, torque].real))


def _comparisons(joint: SeriesElasticJoint, limits: dict[str, float], blow: Blow) -> tuple[Comparison, ...]:
    values = list(limits.values())
    return (
        Comparison(
            "rigid mode dominates up to",
            "about 90",
            limits[_nearest(limits, 90.0)],
            "rad/s",
            f"nearest joint, {_nearest(limits, 90.0)}; 3 dB from the reduced model, motor torque to link velocity",
            f"{min(values):.0f} to {max(values):.0f} over the joints",
        ),
        Comparison("poles of one joint", 4, len(joint.poles), "", "fourth order; 28 for an arm of seven"),
        Comparison(
            "motor torque to link velocity passive",
            "no",
            "no" if _least_real_part(joint, 0, 1) < 0.0 else "yes",
            "",
            f"smallest real part {_least_real_part(joint, 0, 1):.2g} rad/s per N.m",
        ),
        Comparison(
            "motor torque to motor velocity passive",
            "yes",
            "yes" if _least_real_part(joint, 1, 1) >= 0.0 else "no",
            "",
            "collocated; smallest real part not below 0",
        ),
        Comparison(
            "blow: largest departure of the angle from the reduced model",
            "slightest oscillation",
            100.0 * float(blow.departure[0]),
            "% of the way moved",
            "on the scale of the whole motion the second mode is hardly seen: the thesis is right",
        ),
        Comparison(
            "blow: the same for the velocity",
            None,
            100.0 * float(blow.departure[1]),
            "% of the peak",
            "the blow is shorter than a swing of the spring: at first the link is struck without its rotor",
        ),
    )


def _nearest(limits: dict[str, float], wanted: float) -> str:
    return min(limits, key=lambda name: abs(limits[name] - wanted))


def _joint_table(joints: dict[str, SeriesElasticJoint], limits: dict[str, float]) -> Table:
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
    return table_of("Every joint of the arm, the others held", columns, rows)


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
