# SPDX-License-Identifier: BSD-3-Clause
r"""What an object in both hands feels like: predicted by adding the arms, and measured by pushing it on the plant.

K:  x = K^-1 F at rest under a push        B:  v = B^-1 F under a steady push, springs off
\Lambda:  \int F dt = \Lambda v + B x + ... while short pushes start and stop it, springs off
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impedance_experiments.pushing import EVERY, Trace, full_strength
from impedance_modules.control.assembly import Assembly
from impedance_modules.modules.damping import phase_damping
from impedance_modules.modules.equilibrium import start_equilibrium
from impedance_modules.prediction.mechanism import Mechanism, Setting
from impedance_modules.prediction.statics import Analysed, analyse_state
from impedance_modules.superposition.object_impedance import HeldImpedance
from impedance_modules.superposition.operational_inertia import carry_inertia

Array = NDArray[np.float64]

AT_REST, STEADY = 0.5, 0.3
"""Last part of a push over which a place, or a speed, is averaged [s]."""
PUSHES_PER_AXIS = 4
"""Of ``two-arms-inertia``: it starts the object, stops it, sends it back and stops it."""
LISTENED = 0.9
"""How long the answer to the first of them is listened to [s]."""


NOTHING_HELD = "nothing is held in this task: there is no object to push"


@dataclass(frozen=True)
class Sum:
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


class Predictor:
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

    def at(self, q: Array) -> Sum:
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
        return Sum(
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
class Measured:
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


def rest_places(assembly: Assembly, trace: Trace, predicted: Sum) -> tuple[Measured, Array]:
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
    return Measured(wrench, np.linalg.solve(predicted.stiffness, wrench), np.array(places).T), np.array(
        joints
    ).T


def steady_speeds(assembly: Assembly, trace: Trace, predictor: Predictor) -> Measured:
    """Takes the speed at the end of every push, and the predicted one at the posture of that moment."""
    wrenches, expected, found = [], [], []
    for push in assembly.task.pushes:
        during = trace.over(*full_strength(push, STEADY))
        wrench = np.array(push.wrench)
        wrenches.append(wrench)
        found.append(trace.twist[during].mean(0))
        expected.append(np.linalg.solve(predictor.at(trace.q[during].mean(0)).damping, wrench))
    return Measured(np.array(wrenches).T, np.array(expected).T, np.array(found).T)


def inertia_of(assembly: Assembly, trace: Trace) -> Array:
    r"""Fits \int F dt = \Lambda v + B x + C \int x dt after the first push along every axis; gives \Lambda (6, 6).

    An arm that can also move within itself answers a push by a series in powers of 1/s: \Lambda s + B + C / s + ...,
    so the first two corrections are fitted beside \Lambda. Everything counts from the moment before the push.
    """
    impulse = _integral(trace.push, trace.time)
    regressors, impulses = [], []
    for push in assembly.task.pushes[::PUSHES_PER_AXIS]:
        during = trace.over(push.start - 0.5 * EVERY * assembly.period, push.start + LISTENED)
        first = int(np.argmax(during))
        moved = trace.place[during] - trace.place[first]
        faster = trace.twist[during] - trace.twist[first]
        regressors.append(np.hstack([faster, moved, _integral(moved, trace.time[during])]))
        impulses.append(impulse[during] - impulse[first])
    found, *_ = np.linalg.lstsq(np.vstack(regressors), np.vstack(impulses), rcond=None)
    return np.asarray(found[:6].T)


def _integral(values: Array, time: Array) -> Array:
    """Integrates (N, 6) over time from the first look on, by trapezoids: pushes rise within a few looks."""
    pieces = 0.5 * (values[1:] + values[:-1]) * np.diff(time)[:, None]
    return np.vstack([np.zeros((1, values.shape[1])), np.cumsum(pieces, axis=0)])


def ratios(found: Array, predicted: Array) -> Array:
    """Gives the eigenvalues (6,) of predicted^-1 found, ascending: 1 where they agree, in any unit or frame."""
    return np.sort(np.linalg.eigvals(np.linalg.solve(predicted, found)).real)
