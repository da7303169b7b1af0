# SPDX-License-Identifier: BSD-3-Clause
r"""A hand, or two, test a valve: what joint efforts and positions tell of its torque, beside what the plant knows.

The test turns the hinge's target a little to one side, then to the other. Where the measured angle follows it, the mean
torque of the way forth less that of the way back is twice the friction, whatever weight or spring adds to both; where
it does not follow, the largest torque is the least that the valve resists. From means of measured positions q and
efforts \tau_s over a short time, the hands exert about the axis (``modules.hinge``)

    \tau = -\sum_i a . (t_i + (p_i - P) x f_i) - I \phi'',      J_i^T (f_i, t_i) = g(q) - \tau_s

I is the summed inertia of the arms' own links about the axis: the sensors sit between rotor and link.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from impedance_experiments.task_run import task_with, watch_task
from impedance_modules.arrays import Array
from impedance_modules.control.assembly import Assembly, assemble
from impedance_modules.control.contact_detection import REGULARISATION
from impedance_modules.control.hinge_reading import HingeReading, hinge_reading, read_hinge
from impedance_modules.control.supervisor import Supervisor
from impedance_modules.plant.plant import Plant
from impedance_modules.prediction.analysis import analyse_task
from impedance_modules.robot.kinematics import Kinematics
from impedance_modules.robot.state import RobotState
from impedance_modules.spec.task import PushSpec

TASKS = {"one arm": "turn-lever", "two arms": "turn-wheel"}
ANGLE = 0.2
"""To which the test turns the target, and then as far to the other side [rad]: it bounds the springs' torque."""
SECONDS = {"hold": 0.5, "turn": 2.5, "wait": 0.5, "back": 3.5, "rest": 0.5}
"""Of the test's phases [s]."""
BLOCK = 0.02
"""Over which positions and efforts are averaged before the model is asked [s]."""
WINDOW = 0.2
"""Over which the torque is averaged then [s]."""
MOVED = 0.01
"""Measured angle from which a valve counts as turning [rad]; ten times the noise of its measurement."""
STUCK = 100.0
"""Friction of a valve that does not turn [N.m]."""


@dataclass(frozen=True)
class ValveTest:
    """One test of one valve; N means over ``WINDOW``.

    Attributes:
        friction: Its Coulomb friction [N.m].
        angle, torque: (N,) as the arms measured them [rad], [N.m].
        true_torque: (N,) what the valve resisted in the plant [N.m].
        moved: Largest measured angle [rad].
        needed: Half the difference of the mean torques forth and back [N.m]; of a valve that did not turn, the largest.
        true_needed: The same of the plant's torques.
        error: Root mean square of measured less true torque [N.m].
        bearing: Largest true force on the bearing [N].
    """

    friction: float
    angle: Array
    torque: Array
    true_torque: Array
    moved: float
    needed: float
    true_needed: float
    error: float
    bearing: float

    @property
    def turned(self) -> bool:
        """Whether the valve turned at all, as measured."""
        return self.moved > MOVED


def operable(test: ValveTest, bound: float) -> bool:
    """Judges a valve by the measurement alone: it turned, with a torque of at most ``bound`` [N.m]."""
    return test.turned and test.needed <= bound


@dataclass(frozen=True)
class _Course:
    """A whole test, M means over ``BLOCK``: phase, joints [rad], [N.m], true torque [N.m], force on the bearing [N]."""

    phase: Array
    position: Array
    effort: Array
    true_torque: Array
    bearing: Array


def examine(task: str, friction: float, seed: int, folder: Path) -> ValveTest:
    """Tests one valve with a task's hands."""
    assembly = _assembled(task, friction, folder)
    course = _carried_out(assembly, seed)
    window = round(WINDOW / BLOCK)
    angles, torques = measured(assembly, course.position, course.effort)
    moving = links_inertia(assembly) * _acceleration(angles, window, BLOCK)
    angle, torque = _means(angles, window), _means(torques, window) - moving
    true, phase = _means(course.true_torque, window), course.phase[window // 2 :][: len(angle)]
    names, start = list(SECONDS), float(np.mean(angle[phase == 0.0]))
    top = int(np.argmax(angle))
    forth = (phase == names.index("turn")) & (angle - start > MOVED)
    later = (np.arange(len(angle)) > top) & (phase == names.index("back"))
    back = later & (angle[top] - angle > MOVED)
    return ValveTest(
        friction=friction,
        angle=angle,
        torque=torque,
        true_torque=true,
        moved=float(angle[top] - start),
        needed=_needed(torque, forth, back),
        true_needed=_needed(true, forth, back),
        error=float(np.sqrt(np.mean((torque - true) ** 2))),
        bearing=float(course.bearing.max()),
    )


def _carried_out(assembly: Assembly, seed: int) -> _Course:
    """Runs a test; the last block that is not full is left out."""
    names, rows = list(SECONDS), list[Array]()

    def observe(state: RobotState, plant: Plant, supervisor: Supervisor) -> None:
        phase = float(names.index(supervisor.sequence.phase.name))
        force = float(np.linalg.norm(plant.hinge_wrench[:3]))
        known = [phase, -(plant.hinge_torque or 0.0), force]
        rows.append(np.concatenate([known, state.position, state.effort]))

    watch_task(assembly, observe, seed=seed)
    block, n = max(1, round(BLOCK * assembly.rate)), assembly.model.n
    whole = np.array(rows[: len(rows) // block * block]).reshape(-1, block, 3 + 2 * n)
    means = whole.mean(axis=1)
    return _Course(
        whole[:, 0, 0], means[:, 3 : 3 + n], means[:, 3 + n :], means[:, 1], whole[:, :, 2].max(axis=1)
    )


def measured(assembly: Assembly, position: Array, effort: Array) -> tuple[Array, Array]:
    """Gives the hinge's angle (M,) [rad] and the torque of resting hands (M,) [N.m].

    Args:
        assembly: The task.
        position: (M, n) measured [rad].
        effort: (M, n) measured [N.m].
    """
    kinematics = Kinematics(assembly.model, assembly.modules.frames)
    arms = assembly.modules.arms
    reading = _reading(assembly)
    wrench, still = np.zeros((len(arms), 6)), np.zeros(assembly.model.n)
    found = np.empty((len(position), 2))
    for row, (q, torque) in enumerate(zip(position, effort, strict=True)):
        kinematics.update(q, still)
        external = assembly.model.gravity(q) - torque
        for place, arm in enumerate(arms):
            J = kinematics.jacobian_of(arm.limb.hand)[:, arm.limb.joints]
            gram = J @ J.T + REGULARISATION * np.eye(6)
            wrench[place] = np.linalg.solve(gram, J @ external[arm.limb.joints])
        read_hinge(reading, kinematics.arms, wrench)
        found[row] = reading.angle, reading.torque
    return found[:, 0], found[:, 1]


def _reading(assembly: Assembly) -> HingeReading:
    found = hinge_reading(assembly.modules.held, tuple(arm.limb.hand for arm in assembly.modules.arms))
    if found is None:
        raise ValueError(f"task '{assembly.task.name}' has no hinge to be tested")
    return found


def _assembled(task: str, friction: float, folder: Path) -> Assembly:
    """Assembles the test of a valve: a task's phases, shorter, to a small angle on either side."""
    values: dict[str, float] = {f"phases.{name}.duration": seconds for name, seconds in SECONDS.items()}
    values |= {"phases.turn.equilibrium.hinge.angle": ANGLE, "phases.back.equilibrium.hinge.angle": -ANGLE}
    values |= {"object.hinge.friction": friction}
    path = task_with(task, values, folder, f"{friction:.6g}")
    return assemble(str(path), effects=None, rate=None, scale=1.0, arm=None)


def links_inertia(assembly: Assembly) -> float:
    """Sums the inertia of the holding arms' links, without their rotors, about the hinge's axis [kg.m^2]."""
    held, found = assembly.modules.held, analyse_task(assembly, None)
    if held is None or held.hinge is None or found.sum is None:
        raise ValueError(f"task '{assembly.task.name}' has no hinge to be tested")
    S = held.hinge.motion(held.start.translation)
    parts = found.sum.summands["inertia_without_reflected"].arms.values()
    return float(sum(S @ part @ S for part in parts if part is not None))


def _acceleration(values: Array, window: int, step: float) -> Array:
    """Gives the second derivative of the parabola through every window of samples ``step`` [s] apart."""
    time = step * (np.arange(window) - 0.5 * (window - 1))
    fit = np.linalg.pinv(np.vander(time, 3))[0]
    return np.asarray(2.0 * np.convolve(values, fit[::-1], mode="valid"))


def _means(values: Array, window: int) -> Array:
    """Averages over a sliding window; M - window + 1 values."""
    return np.convolve(values, np.full(window, 1.0 / window), mode="valid")


def _needed(torque: Array, forth: Array, back: Array) -> float:
    """Half of the mean torque forth less that back; the largest where there is no way forth and back."""
    if not (np.any(forth) and np.any(back)):
        return float(np.max(np.abs(torque)))
    return abs(0.5 * float(np.mean(torque[forth]) - np.mean(torque[back])))


def yields(task: str, torque: float, seed: int, folder: Path, seconds: float) -> float:
    """Pushes a valve without friction about its axis, and gives the true stiffness about it [N.m/rad].

    Args:
        task: Whose hands hold it still.
        torque: About the vertical [N.m].
        seed: Of the noise.
        folder: For the changed task.
        seconds: Until the angle is taken [s].
    """
    assembly = _assembled(task, 0.0, folder)
    push = PushSpec("object", (0.0, 0.0, 0.0, 0.0, 0.0, torque), 0.2, 1.0, seconds, 0.1)
    phase = replace(assembly.task.phases[0], duration=seconds)
    pushed = replace(assembly, task=replace(assembly.task, pushes=(push,), phases=(phase,)))
    angles: list[float] = []

    def observe(_state: RobotState, plant: Plant, _supervisor: Supervisor) -> None:
        if plant.time > seconds - 1.0:
            angles.append(plant.hinge_angle or 0.0)

    watch_task(pushed, observe, seed=seed)
    return abs(torque / float(np.mean(angles)))
