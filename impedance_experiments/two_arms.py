# SPDX-License-Identifier: BSD-3-Clause
r"""Two seven-joint arms on one welded box: their inertia, damping and stiffness add up at it (thesis 4.5, 6.2.4).

Predicted by adding the arms' 6x6 matrices at the box, and measured by pushing the box on the plant:

    K:        x = K^-1 F at rest under a push
    B:        v = B^-1 F under a steady push, springs off
    \Lambda:  \int F dt = \Lambda v + B x + ... while short pushes start and stop it, springs off
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impedance_experiments.task_run import EVERY, PushTrace, first_pushes, full_strength, trace_pushed
from impedance_experiments.thesis_page import Cell, Page, Plot, ResultTable, Settings, ThesisValue, panels
from impedance_modules.arrays import Array
from impedance_modules.control.assembly import Assembly, assemble
from impedance_modules.modules.damping import phase_damping
from impedance_modules.modules.equilibrium import start_equilibrium
from impedance_modules.plant.ground_truth import OBJECT
from impedance_modules.prediction.mechanism import Mechanism, Setting
from impedance_modules.prediction.statics import Analysed, analyse_state
from impedance_modules.spec.task_reader import read_task
from impedance_modules.superposition.object_impedance import HeldImpedance
from impedance_modules.superposition.operational_inertia import carry_inertia

AXES = ("x", "y", "z", "rx", "ry", "rz")
AT_REST, STEADY = 0.5, 0.3
"""Last part of a push over which a place, or a speed, is averaged [s]."""
PUSHES_PER_AXIS = 4
"""Of ``two-arms-inertia``: it starts the object, stops it, sends it back and stops it."""
FIT_TIME = 0.9
"""How long after the first of them the answer is fitted [s]."""
NOTHING_HELD = "nothing is held in this task: there is no object to push"


@dataclass(frozen=True)
class _Found:
    """All three runs, and what came out.

    Attributes:
        predicted: At the start posture: of the tasks with springs, with dampers, with neither.
        traces: Of the runs with springs, with dampers, with neither.
        rest, speed: Answers to pushes.
        joints: (k, m) joints' moves under the pushes of ``rest``; predicted and measured.
        inertia: (6, 6) measured.
    """

    predicted: tuple[ArmsSum, ArmsSum, ArmsSum]
    traces: tuple[PushTrace, PushTrace, PushTrace]
    rest: PushAnswers
    speed: PushAnswers
    joints: tuple[Array, Array]
    inertia: Array


def reproduce(settings: Settings) -> Page:
    """Pushes a box in both hands and lays what it answers beside the arms' sum."""
    axes = settings.choose(1, 6, 6)
    found = _push_all(settings, axes)
    return Page(
        summary=_summary(found),
        comparisons=_comparisons(found),
        tables=_tables(found),
        plots=(_picture(found),),
        differences=_differences(),
        facts=_facts(found),
    )


def _differences() -> str:
    sensors = read_task("two-arms-inertia")[1].sensors
    return (
        "The thesis proposes this experiment (6.2.4) and prints no number. What remains: the robot rounds joint angles "
        f"({1e3 * sensors.position_resolution:.2g} mrad) and estimates speeds with a lag of "
        f"{1e3 * sensors.velocity_filter:g} ms; the inertia is fitted from the first {FIT_TIME:g} s after a push, in "
        "which the motors' friction takes momentum away."
    )


def _task(name: str) -> Assembly:
    return assemble(name, effects=None, rate=None, scale=1.0, arm=None)


def _push_all(settings: Settings, axes: int) -> _Found:
    springs, dampers, free = (_task(f"two-arms-{kind}") for kind in ("stiffness", "damping", "inertia"))
    springs, dampers = (first_pushes(task, 2 * axes, 0.3) for task in (springs, dampers))
    traces = []
    for index, task in enumerate((springs, dampers, free)):
        settings.on_progress(0.3 * index, task.task.name)
        traces.append(trace_pushed(task, OBJECT, seed=settings.seed, noise=True))
    predictor, damped, loose = SumPredictor(springs), SumPredictor(dampers), SumPredictor(free)
    predicted = predictor.at(predictor.posture)
    rest, moved = rest_places(springs, traces[0], predicted)
    if predicted.joints is None:
        raise ValueError("the springs' task has no springs")
    return _Found(
        predicted=(predicted, damped.at(damped.posture), loose.at(loose.posture)),
        traces=(traces[0], traces[1], traces[2]),
        rest=rest,
        speed=steady_speeds(dampers, traces[1], damped),
        joints=(predicted.joints @ rest.wrench, moved[predictor.joints]),
        inertia=inertia_of(free, traces[2]),
    )


def _errors(found: _Found) -> tuple[Array, Array, Array]:
    """Gives the relative error of every rest place, every speed, and the eigenvalue ratios of the inertia."""
    springs, dampers, free = found.predicted
    if springs.stiffness is None:
        raise ValueError("the springs' task has no springs")
    at_rest = found.rest.errors(springs.stiffness)
    return at_rest, found.speed.errors(dampers.damping), ratios(found.inertia, free.inertia)


def _joint_errors(found: _Found) -> tuple[Array, Array]:
    """Gives the joints' relative error per push, and which share of their move left the box where it was."""
    expected, measured = found.joints
    size = np.linalg.norm(expected, axis=0)
    within = np.linalg.norm(found.predicted[0].self_motion.T @ expected, axis=0)
    return np.linalg.norm(measured - expected, axis=0) / size, within / size


def _facts(found: _Found) -> dict[str, float]:
    at_rest, speed, inertia = _errors(found)
    joints, within = _joint_errors(found)
    return {
        "stiffness_error": float(at_rest.max()),
        "damping_error": float(speed.max()),
        "inertia_error": float(np.abs(inertia - 1.0).max()),
        "joint_error": float(joints.max()),
        "self_motion": float(within.max()),
        "done": float(all(trace.ending == "done" for trace in found.traces)),
    }


def _summary(found: _Found) -> str:
    _, within = _joint_errors(found)
    return (
        f"Both arms of the robot hold one box of {_box_mass():g} kg, welded to the palms, and the box is pushed on the "
        "simulated plant: slowly against springs (`two-arms-stiffness`), steadily against dampers "
        "(`two-arms-damping`), shortly against nothing but inertia (`two-arms-inertia`), along and about every axis. "
        "The predictions are sums: each arm's 6x6 matrix carried to the box's centre, plus the box's own inertia. No "
        "closed chain is computed for them; the plant knows only two arms, a box and two stiff couplings.\n\n"
        "**Redundancy.** The fourteen joints have eight ways to move with the box in both hands: six move the box, two "
        "turn an elbow and leave the box alone. Nothing is projected; under a push the elbows go where the joint "
        f"springs let them: up to {100.0 * float(within.max()):.0f} % of the joints' move is such self-motion. The "
        "sums contain it, and the joints' moves agree, too."
    )


def _box_mass() -> float:
    held = read_task("two-arms-stiffness")[0].object
    if held is None:
        raise ValueError(NOTHING_HELD)
    return held.mass


def _comparisons(found: _Found) -> tuple[ThesisValue, ...]:
    at_rest, speed, inertia = _errors(found)
    joints, _ = _joint_errors(found)
    pushes = "largest difference of measured and predicted answer to a push, in the norm of the matrix itself"
    rows = (
        ("K at the box: rest place under a push", at_rest, pushes),
        ("B at the box: speed under a steady push, motors' friction included", speed, pushes),
        ("joints' moves under the same pushes as K", joints, "14 joints, self-motions included"),
    )
    found_rows = [
        ThesisValue(
            name, None, round(100.0 * float(values.max()), 2), "%", reason, f"mean {100 * values.mean():.2f}"
        )
        for name, values, reason in rows
    ]
    worst = 100.0 * float(np.abs(inertia - 1.0).max())
    spread = f"ratios {inertia[0]:.3f} to {inertia[-1]:.3f}"
    reason = "eigenvalues of predicted^-1 measured, reflected inertia included: 1 in every direction if equal"
    found_rows.append(
        ThesisValue("Lambda at the box: impulse over speed", None, round(worst, 2), "%", reason, spread)
    )
    return tuple(found_rows)


def _tables(found: _Found) -> tuple[ResultTable, ...]:
    free = found.predicted[2]
    tables = [_matrix("Lambda predicted [kg, kg.m, kg.m^2]", free.inertia)]
    tables.append(_matrix("Lambda measured", found.inertia))
    for name, answer in (("K [N/m, N, N.m/rad]", found.rest), ("B [N.s/m, N.s, N.m.s/rad]", found.speed)):
        if answer.wrench.shape[1] >= len(AXES):
            shown = answer.wrench @ np.linalg.pinv(answer.predicted)
            tables += [_matrix(f"{name} predicted", shown), _matrix(f"{name} measured", answer.matrix())]
    return tuple(tables)


def _matrix(name: str, matrix: Array) -> ResultTable:
    rows: list[list[Cell]] = [
        [AXES[i], *(round(float(value), 3) + 0.0 for value in row)] for i, row in enumerate(matrix)
    ]
    return ResultTable(name, ("", *AXES), rows)


def _picture(found: _Found) -> Plot:
    """Draws what the box did under the pushes, and where the sums say it should have come."""
    figure, (top, middle, bottom) = panels((7.0, 7.0), 3, 1)
    springs, dampers, free = found.traces
    expected = _expected(found, springs)
    for axis in range(3):
        top.plot(springs.time, 1e3 * springs.place[:, axis], color=f"C{axis}", label=AXES[axis])
        top.plot(springs.time, 1e3 * expected[:, axis], "--", color=f"C{axis}", linewidth=0.8)
        middle.plot(dampers.time, 1e3 * dampers.twist[:, axis], color=f"C{axis}", linewidth=0.8)
    wanted = np.linalg.solve(found.predicted[1].damping, dampers.push.T).T
    for axis in range(3):
        middle.plot(dampers.time, 1e3 * wanted[:, axis], "--", color=f"C{axis}", linewidth=0.8)
    impulse = np.cumsum(free.push * np.diff(free.time, prepend=0.0)[:, None], axis=0)
    momentum = free.twist @ found.predicted[2].inertia.T
    for axis in range(3):
        bottom.plot(free.time, momentum[:, axis], color=f"C{axis}")
        bottom.plot(free.time, impulse[:, axis], "--", color=f"C{axis}", linewidth=0.8)
    top.set(ylabel="place [mm]", title="against springs; dashed: K^-1 F of the sum")
    middle.set(ylabel="speed [mm/s]", title="against dampers; dashed: B^-1 F of the sum")
    bottom.set(
        ylabel="momentum [N.s]",
        xlabel="time [s]",
        title="floating: Lambda v of the sum; dashed: impulse given",
    )
    top.legend(loc="upper right", ncols=3)
    return Plot("answers", "What the box did (lines) and what the arms' sums say (dashed)", figure)


def _expected(found: _Found, trace: PushTrace) -> Array:
    stiffness = found.predicted[0].stiffness
    if stiffness is None:
        raise ValueError("the springs' task has no springs")
    return np.asarray(np.linalg.solve(stiffness, trace.push.T).T)


@dataclass(frozen=True)
class ArmsSum:
    """The arms' sum at the object at one posture.

    Attributes:
        inertia, stiffness: (6, 6) of superposition, world axes at the object's origin.
        damping: (6, 6) of modules and motors' friction, added the same way.
        joints: (k, 6) how far the stacked joints move per wrench on the object, self-motions included.
        self_motion: (k, m) orthonormal joint motions that leave the object where it is.
    """

    inertia: Array
    stiffness: Array | None
    damping: Array
    joints: Array | None
    self_motion: Array


class SumPredictor:
    """Adds the arms of one task at any posture."""

    def __init__(self, assembly: Assembly) -> None:
        """Takes the gains of the task's start."""
        self._mechanism = Mechanism(assembly)
        modules = assembly.modules
        self._mechanism.update(modules.posture, np.zeros_like(modules.posture))
        damping = phase_damping(modules, self._mechanism.kinematics)
        self._setting = Setting(modules, start_equilibrium(modules), damping)
        self.posture = modules.posture

    @property
    def joints(self) -> NDArray[np.int64]:
        """The stacked joints of the holding arms, in the order in which they hold."""
        limbs = self._mechanism.model.limbs
        return np.concatenate([limbs[name].joints for name in self._holders()])

    def _holders(self) -> tuple[str, ...]:
        held = self._setting.modules.held
        if held is None:
            raise ValueError(NOTHING_HELD)
        return held.limbs

    def at(self, q: Array) -> ArmsSum:
        """Adds the arms at q (n,) [rad]."""
        state = analyse_state(self._mechanism, self._setting, q)
        held = _held(state)
        system, motion = held.system, held.motion
        springs_on = held.impedance.stiffness is not None and np.any(system.stiffness)
        joints = None
        if springs_on:
            joints = motion.motion @ np.linalg.solve(system.stiffness, motion.twist.T)
        null = np.linalg.svd(motion.twist)[2][6:].T
        inertia = held.impedance.inertia.inertia
        if inertia is None:
            raise ValueError("the arms are singular at this posture: the object has no inertia there")
        return ArmsSum(
            inertia=inertia,
            stiffness=held.impedance.stiffness if springs_on else None,
            damping=self._damping(state, held),
            joints=joints,
            self_motion=motion.motion @ null,
        )

    def _damping(self, state: Analysed, held: HeldImpedance) -> Array:
        """Adds the dampers of both arms, B_i = (J (D + D_motor)^-1 J^T)^-1, carried to the object."""
        friction = self._mechanism.model.column("motor_damping")
        limbs = self._mechanism.model.limbs
        total = np.zeros((6, 6))
        arms = [state.arms[name] for name in self._holders()]
        for arm, hand in zip(arms, held.hands, strict=True):
            dampers = arm.system.damping + np.diag(friction[limbs[arm.limb].joints])
            at_hand = np.linalg.inv(arm.jacobian @ np.linalg.solve(dampers, arm.jacobian.T))
            total += carry_inertia(at_hand, hand.offset)
        return total


def _held(state: Analysed) -> HeldImpedance:
    if state.held is None:
        raise ValueError(NOTHING_HELD)
    return state.held


@dataclass(frozen=True)
class PushAnswers:
    """Pushes and answers, m columns: wrenches (6, m), and what the object did, predicted and measured."""

    wrench: Array
    predicted: Array
    found: Array

    def errors(self, metric: Array) -> Array:
        """Gives |found - predicted| / |predicted| of every answer (m,) in a metric (6, 6), free of units."""
        wrong = self.found - self.predicted
        size = np.einsum("im,ij,jm->m", self.predicted, metric, self.predicted)
        return np.asarray(np.sqrt(np.einsum("im,ij,jm->m", wrong, metric, wrong) / size))

    def matrix(self) -> Array:
        """Gives the (6, 6) that turns answers into wrenches, by least squares; for pushes along all axes."""
        return np.asarray(self.wrench @ np.linalg.pinv(self.found))


def rest_places(assembly: Assembly, trace: PushTrace, predicted: ArmsSum) -> tuple[PushAnswers, Array]:
    """Takes half the difference of the rest places under opposite pushes, and the joints' (k, m) likewise."""
    if predicted.stiffness is None:
        raise ValueError("this task has no springs: a pushed object does not come to rest")
    wrenches, places, joints = [], [], []
    for push, opposite in zip(assembly.task.pushes[::2], assembly.task.pushes[1::2], strict=True):
        there, back = (trace.over(*full_strength(p, AT_REST)) for p in (push, opposite))
        wrenches.append(0.5 * (np.array(push.wrench) - np.array(opposite.wrench)))
        places.append(0.5 * (trace.place[there].mean(0) - trace.place[back].mean(0)))
        joints.append(0.5 * (trace.q[there].mean(0) - trace.q[back].mean(0)))
    wrench = np.array(wrenches).T
    return PushAnswers(wrench, np.linalg.solve(predicted.stiffness, wrench), np.array(places).T), np.array(
        joints
    ).T


def steady_speeds(assembly: Assembly, trace: PushTrace, predictor: SumPredictor) -> PushAnswers:
    """Takes the speed at the end of every push, and the predicted one at the posture of that moment."""
    wrenches, expected, found = [], [], []
    for push in assembly.task.pushes:
        during = trace.over(*full_strength(push, STEADY))
        wrench = np.array(push.wrench)
        wrenches.append(wrench)
        found.append(trace.twist[during].mean(0))
        expected.append(np.linalg.solve(predictor.at(trace.q[during].mean(0)).damping, wrench))
    return PushAnswers(np.array(wrenches).T, np.array(expected).T, np.array(found).T)


def inertia_of(assembly: Assembly, trace: PushTrace) -> Array:
    r"""Fits \int F dt = \Lambda v + B x + C \int x dt after the first push along every axis; gives \Lambda (6, 6).

    An arm that can also move within itself answers a push by a series in powers of 1/s: \Lambda s + B + C / s + ...,
    so the first two corrections are fitted beside \Lambda. Everything counts from the moment before the push.
    """
    impulse = _integral(trace.push, trace.time)
    regressors, impulses = [], []
    for push in assembly.task.pushes[::PUSHES_PER_AXIS]:
        during = trace.over(push.start - 0.5 * EVERY * assembly.period, push.start + FIT_TIME)
        first = int(np.argmax(during))
        moved = trace.place[during] - trace.place[first]
        faster = trace.twist[during] - trace.twist[first]
        regressors.append(np.hstack([faster, moved, _integral(moved, trace.time[during])]))
        impulses.append(impulse[during] - impulse[first])
    found, *_ = np.linalg.lstsq(np.vstack(regressors), np.vstack(impulses), rcond=None)
    return np.asarray(found[:6].T)


def _integral(values: Array, time: Array) -> Array:
    """Integrates (N, 6) over time from the first sample on, by trapezoids: pushes rise within a few samples."""
    pieces = 0.5 * (values[1:] + values[:-1]) * np.diff(time)[:, None]
    return np.vstack([np.zeros((1, values.shape[1])), np.cumsum(pieces, axis=0)])


def ratios(found: Array, predicted: Array) -> Array:
    """Gives the eigenvalues (6,) of predicted^-1 found, ascending: 1 where they agree, in any unit or frame."""
    return np.sort(np.linalg.eigvals(np.linalg.solve(predicted, found)).real)
