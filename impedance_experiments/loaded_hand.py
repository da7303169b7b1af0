# SPDX-License-Identifier: BSD-3-Clause
"""A hand under load: displaced slowly (thesis Table 5.3), or pressing until its support goes (fig. 4-8).

The displacement along every axis gives slope and intercept of force over displacement. After the loss of its support
the hand is the thesis's example of one degree of freedom (4.8) along the spring, as long as it has not gone far:

    m x'' = -(B_d + b) x' + K (x_d - x)
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from impedance_experiments.task_run import PushTrace, first_pushes, only_arm, trace_pushed
from impedance_modules.arrays import Array
from impedance_modules.control.assembly import Assembly, assemble
from impedance_modules.modules.damping import phase_damping
from impedance_modules.modules.equilibrium import start_equilibrium
from impedance_modules.prediction.analysis import analyse_task
from impedance_modules.prediction.feasibility import refuse_infeasible
from impedance_modules.prediction.mechanism import Mechanism, Setting
from impedance_modules.prediction.statics import analyse_state

TASK = "net-stiffness"
SHARE = (0.15, 0.98)
"""Part of the full push between which the lines are fitted; at the ends the hand reverses."""
Z = 2
BEFORE, LOST = 3.9, 4.0
"""When the press is measured, and when the support is removed [s]; as in the tasks' pushes."""
WAY = 0.04
"""How far K_net says that a push displaces the hand along its axis [m]; as in the task's pushes."""
LARGE_TANK = 50.0
"""A tank that never limits the run [J]."""


@dataclass(frozen=True)
class FittedLine:
    """Force over way, fitted by a line.

    Attributes:
        slope: [N/m].
        intercept: [N]; positive where friction resists the outward way.
    """

    slope: float
    intercept: float


@dataclass(frozen=True)
class Displacement:
    """One push and its return.

    Attributes:
        axis: 0, 1 or 2.
        sign: Of the push along it.
        out, back: The lines while the force grows and while it falls, both counted along the push.
        turned: Largest turn of the hand [rad].
    """

    axis: int
    sign: float
    out: FittedLine
    back: FittedLine
    turned: float


@dataclass(frozen=True)
class Displaced:
    """A whole run: the predicted K_net, and the measured motion."""

    stiffness: Array
    trace: PushTrace
    found: tuple[Displacement, ...]


def displace(effects: Path | None, pushes: int, seed: int) -> Displaced:
    """Runs the task, on a plant with ``effects``, with its first pushes."""
    assembly = first_pushes(assemble(TASK, effects=effects, rate=None, scale=1.0, arm=None), pushes, 0.2)
    stiffness = analyse_task(assembly, None).arms[only_arm(assembly)].stiffness
    if stiffness is None:
        raise ValueError("the displaced hand has no net stiffness at its posture")
    trace = trace_pushed(assembly, only_arm(assembly), seed=seed, noise=True)
    return Displaced(stiffness, trace, _displacements(assembly, trace))


def _displacements(assembly: Assembly, trace: PushTrace) -> tuple[Displacement, ...]:
    found = []
    for push in assembly.task.pushes:
        wrench = np.array(push.wrench)
        axis = int(np.argmax(np.abs(wrench[:3])))
        sign = float(np.sign(wrench[axis]))
        full = push.start + push.rise
        out = trace.over(push.start, full)
        back = trace.over(full + push.hold, full + push.hold + push.fall)
        lines = [_line(trace, part, axis, sign, abs(float(wrench[axis]))) for part in (out, back)]
        first = int(np.argmax(out))
        turned = np.linalg.norm(trace.place[out | back, 3:] - trace.place[first, 3:], axis=1).max()
        found.append(Displacement(axis, sign, lines[0], lines[1], float(turned)))
    return tuple(found)


def _line(trace: PushTrace, part: NDArray[np.bool_], axis: int, sign: float, full: float) -> FittedLine:
    force, way = sign * trace.push[part, axis], sign * trace.place[part, axis]
    fitted = (force > SHARE[0] * full) & (force < SHARE[1] * full)
    slope, intercept = np.polyfit(way[fitted], force[fitted], 1)
    return FittedLine(float(slope), float(intercept))


@dataclass(frozen=True)
class LostSupport:
    """One run.

    Attributes:
        task: Its name.
        tank: What the tank held at the start [J].
        trace: Of the hand.
        force: That pressed [N].
        stretch: Of the spring when the support went [m].
        energy: That the spring then held [J].
        speed: Largest downward speed afterwards [m/s]; 0 where the run was stopped before.
    """

    task: str
    tank: float
    trace: PushTrace
    force: float
    stretch: float
    energy: float
    speed: float


def press_and_lose(task_name: str, tank: float | None, seed: int) -> LostSupport:
    """Runs a task of fig. 4-8.

    Args:
        task_name: ``soft-deep`` or ``stiff-shallow``.
        tank: Initial energy [J]; None takes the task's.
        seed: Of the noise.
    """
    assembly = assemble(task_name, effects=None, rate=None, scale=1.0, arm=None)
    if tank is not None:
        settings = replace(assembly.tank, initial=tank, max=max(2.0 * tank, assembly.tank.max))
        assembly = replace(assembly, tank=settings)
    trace = trace_pushed(assembly, only_arm(assembly), seed=seed, noise=True)
    stiffness, rest = _spring(assembly)
    before = min(int(np.searchsorted(trace.time, BEFORE)), len(trace.time) - 1)
    start = assembly.model.pose(
        assembly.modules.posture, assembly.model.limbs[only_arm(assembly)].hand
    ).translation[Z]
    stretch = float(start + trace.place[before, Z] - rest)
    after = trace.time >= LOST
    speed = max(0.0, -float(trace.twist[after, Z].min())) if after.any() else 0.0
    force = float(trace.push[before, Z])
    return LostSupport(
        task_name, assembly.tank.initial, trace, force, stretch, 0.5 * stiffness * stretch**2, speed
    )


def _spring(assembly: Assembly) -> tuple[float, float]:
    """Gives the stiffness along z [N/m] and the height of its last equilibrium [m]."""
    spring = assembly.task.arms[only_arm(assembly)].springs[0]
    rest = assembly.task.phases[0].equilibrium[f"{only_arm(assembly)}.{spring.name}"]["z"]
    if not isinstance(rest, float):
        raise TypeError(f"task '{assembly.task.name}': its spring must move to one height, not oscillate")
    return float(spring.stiffness[Z, Z]), rest


def tank_need(task_name: str) -> float:
    """Gives the least energy that a task's tank must hold, as ``check`` prints it [J]."""
    return refuse_infeasible(assemble(task_name, effects=None, rate=None, scale=1.0, arm=None)).tank.need


def one_degree_of_freedom(run: LostSupport) -> tuple[float, Array, Array]:
    """Solves eq. 4.8 for the hand after the loss; returns the mass m [kg], times [s] and speeds [m/s]."""
    assembly = assemble(run.task, effects=None, rate=None, scale=1.0, arm=None)
    mechanism, modules = Mechanism(assembly), assembly.modules
    mechanism.update(modules.posture, np.zeros_like(modules.posture))
    setting = Setting(modules, start_equilibrium(modules), phase_damping(modules, mechanism.kinematics))
    arm = analyse_state(mechanism, setting, modules.posture).arms[only_arm(assembly)]
    mass = 1.0 / float(arm.inertia.mobility[Z, Z])
    friction = assembly.model.column("motor_damping")[assembly.model.limbs[only_arm(assembly)].joints]
    dampers = arm.system.damping + np.diag(friction)
    damping = 1.0 / float((arm.jacobian @ np.linalg.solve(dampers, arm.jacobian.T))[Z, Z])
    stiffness, _ = _spring(assembly)

    def rate(_: float, x: Array) -> Array:
        return np.array([x[1], (-damping * x[1] - stiffness * x[0]) / mass])

    times = np.linspace(0.0, 1.0, 200)
    found = solve_ivp(rate, (0.0, 1.0), [run.stretch, 0.0], t_eval=times, rtol=1e-8, atol=1e-10)
    return mass, LOST + times, found.y[1]
