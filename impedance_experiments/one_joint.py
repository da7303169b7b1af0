# SPDX-License-Identifier: BSD-3-Clause
r"""The one-degree-of-freedom example of impedance control, on the plant and by its equation (thesis 4.1).

m \ddot x = -(B_d + b - b^) \dot x + K_d (x_d - x) + F_external        (eq. 4.8; b^ is the model's b)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp

from impedance_experiments.task_run import PushTrace, only_arm, trace_pushed
from impedance_experiments.thesis_page import Page, Plot, Settings, ThesisValue, panels
from impedance_modules.arrays import Array
from impedance_modules.control.assembly import Assembly, assemble
from impedance_modules.plant.pushes import push_wrench

TASK = "one-joint"
TURN = 5
"""Of the six coordinates the one that can move: about the upright axis."""


_DIFFERENCES = (
    "The thesis's mass slides and has no numbers; here it turns, because the joints of a limb do, and the numbers are "
    "invented. Printed, eq. 4.8 has the damping B_d + b^ - b; from 4.7 it follows with b and b^ exchanged, "
    "and with b^ = b, as both take it, the two agree."
)


def _summary(assembly: Assembly) -> str:
    push = assembly.task.pushes[0]
    return (
        "A wheel on an upright axis, driven by a motor with damping b of its own, is made to react like an inertia on "
        f"a spring and a damper (robot `{assembly.robot.name}`, task `{TASK}`): the whole path of task, spring, "
        f"filter, tank and plant with one joint. Its equilibrium jumps by {_rest(assembly):g} rad, then an external "
        f"torque of {abs(push.wrench[TURN]):g} N.m turns it and is removed. The inertia is not shaped (M_d = m), and "
        "the motor's damping counts towards B_d, both as in the thesis."
    )


@dataclass(frozen=True)
class WheelNumbers:
    """Eq. 4.8's m [kg.m^2], whole damping [N.m.s/rad] and stiffness [N.m/rad], from task and robot."""

    inertia: float
    damping: float
    stiffness: float


def reproduce(settings: Settings) -> Page:
    """Runs the task once and compares it with eq. 4.8."""
    assembly = assemble(TASK, effects=None, rate=None, scale=1.0, arm=None)
    settings.on_progress(0.1, "wheel moved and pushed")
    trace = trace_pushed(assembly, only_arm(assembly), seed=settings.seed, noise=True)
    numbers = numbers_of(assembly)
    predicted = equation(assembly, numbers, trace.time)
    angle = trace.place[:, TURN]
    push = assembly.task.pushes[0]
    end = push.start + push.rise + push.hold
    held = trace.over(end - 0.2, end)
    before = trace.over(push.start - 0.2, push.start)
    given_way = float(np.mean(angle[before]) - np.mean(angle[held]))
    measured = -push.wrench[TURN] / given_way
    over, over_predicted = (float(np.max(x[trace.over(0.0, push.start)])) for x in (angle, predicted))
    rest = _rest(assembly)
    worst = float(np.max(np.abs(angle - predicted)))
    damped = f"damping ratio {numbers.damping / (2.0 * np.sqrt(numbers.stiffness * numbers.inertia)):.2f}"
    late = (
        f"the command's delay of {1e3 * assembly.robot.timing.command_delay:g} ms, the reported velocity's lag of "
        f"{1e3 * assembly.robot.sensors.velocity_filter:g} ms"
    )
    return Page(
        summary=_summary(assembly),
        comparisons=(
            ThesisValue(
                "stiffness that a push meets", "K_d", round(measured, 3), "N.m/rad", f"K_d is {numbers.stiffness:g}"
            ),
            ThesisValue(
                "overshoot after the jump; the thesis's column is its eq. 4.8 solved",
                round(100.0 * (over_predicted / rest - 1.0), 1),
                round(100.0 * (over / rest - 1.0), 2), "%", f"{damped}; {late}",
            ),
            ThesisValue(
                "largest departure from eq. 4.8", 0, round(100.0 * worst / rest, 3), "% of the jump",
                late,
            ),
        ),
        plots=(_drawn(trace, predicted, angle),),
        differences=_DIFFERENCES,
        facts={
            "measured": measured, "stiffness": numbers.stiffness, "departure": worst / rest,
            "overshoot": over / rest - 1.0,
        },
    )  # fmt: skip


def numbers_of(assembly: Assembly) -> WheelNumbers:
    """Collects inertia, damping and stiffness about the joint from robot and task."""
    arm = assembly.task.arms[only_arm(assembly)]
    joint = assembly.model.joint_names[0]
    spring = arm.springs[0]
    damping = 0.0 if spring.damping is None else float(spring.damping[TURN, TURN])
    return WheelNumbers(
        inertia=float(assembly.model.mass_matrix(assembly.modules.posture)[0, 0]),
        damping=damping + assembly.robot.joints[joint].motor_damping,
        stiffness=float(spring.stiffness[TURN, TURN]),
    )


def equation(assembly: Assembly, numbers: WheelNumbers, time: Array) -> Array:
    """Solves eq. 4.8 at given times (N,) [s] for the task's moving equilibrium and push; returns (N,) [rad]."""
    task, arm = assembly.task, only_arm(assembly)
    rest, moved = task.phases[:2]

    def rate(t: float, x: Array) -> Array:
        u = float(np.clip((t - rest.duration) / moved.duration, 0.0, 1.0))
        wanted = _rest(assembly) * u**3 * (10.0 + u * (6.0 * u - 15.0))
        push = push_wrench(task.pushes, arm, t)[TURN]
        torque = numbers.stiffness * (wanted - x[0]) - numbers.damping * x[1] + push
        return np.array([x[1], torque / numbers.inertia])

    found = solve_ivp(rate, (0.0, float(time[-1])), [0.0, 0.0], t_eval=time, max_step=0.01, rtol=1e-8)
    return np.asarray(found.y[0])


def _rest(assembly: Assembly) -> float:
    """Gives where the equilibrium goes [rad]."""
    coordinates = next(iter(assembly.task.phases[1].equilibrium.values()))
    rest = coordinates["rz"]
    if not isinstance(rest, float):
        raise TypeError(f"task '{assembly.task.name}': its equilibrium must move to one angle, not oscillate")
    return rest


def _drawn(trace: PushTrace, predicted: Array, angle: Array) -> Plot:
    figure, axes = panels((5.5, 3.2))
    axes.plot(trace.time, angle, color="C3", label="plant")
    axes.plot(trace.time, predicted, "k--", linewidth=1.0, label="eq. 4.8")
    axes.plot(
        trace.time, 0.1 * trace.push[:, TURN], color="C0", linewidth=1.0, label="a tenth of the push [N.m]"
    )
    axes.set(xlabel="time [s]", ylabel="angle [rad]")
    axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=3, frameon=False)
    axes.grid(alpha=0.3)
    return Plot("swing", "A jump of the equilibrium and a push: the plant beside eq. 4.8", figure)
