# SPDX-License-Identifier: BSD-3-Clause
r"""Chooses posture and joint springs for an arm whose joints carry a force at the hand.

The hand exerts a force f d by its joint springs, f anywhere in a range; whatever resists puts F_b = -f d on it. The
springs then pull the joints with tau = J^T f d, so their rest lies K^-1 tau beyond the posture. Among the postures
that the hand's place leaves open the best one needs the smallest sum of joint stiffness (``folding``).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from impedance_modules.control.assembly import Assembly
from impedance_modules.errors import BadInput
from impedance_modules.modules.arms import build_modules
from impedance_modules.modules.damping import phase_damping
from impedance_modules.modules.equilibrium import start_equilibrium
from impedance_modules.prediction.mechanism import Mechanism, Setting
from impedance_modules.prediction.statics import analyse_state
from impedance_modules.tools.tune.folding import folding_share, least_stiffness, unloading
from impedance_modules.tools.tune.self_motion import Posture, self_motion

Array = NDArray[np.float64]

MARGIN = 1.02
"""Times the stiffness at which the arm just folds: what is handed out."""

STIFFEST = 10000.0
"""Of a joint spring in a task file [N.m/rad]."""


@dataclass(frozen=True)
class Question:
    """What is asked.

    Attributes:
        arm: Limb whose joints carry the force.
        direction: (3,) of the force that the hand exerts, world axes, length 1.
        low, high: Its range [N].
        postures: How many postures of the self-motion are compared; 1 keeps the task's.
        reach: How far a spring's rest may lie from the posture [rad].
        softest: No joint spring is softer [N.m/rad]: a joint that the load does not turn would drift.
        alone: Whether the task's other springs are left out.
    """

    arm: str
    direction: Array
    low: float
    high: float
    postures: int
    reach: float
    softest: float
    alone: bool

    @property
    def ends(self) -> tuple[float, ...]:
        """The forces at both ends of the range [N]."""
        return (self.low, self.high)


@dataclass(frozen=True)
class Tuned:
    """One posture with its least joint springs.

    Attributes:
        posture: Which.
        stiffness: (k,) joint springs [N.m/rad], a little above the bound.
        folds_at: Share of ``stiffness`` at which the arm folds; 0 where other springs hold it anyhow.
        torque: (k,) that the springs exert at the end of the range with the larger force [N.m].
        rest: (k,) where the springs then rest [rad].
        share: Largest torque, the arm's own weight included, over its limit.
        hand: Stiffness of the hand along the force at both ends of the range [N/m].
    """

    posture: Posture
    stiffness: Array
    folds_at: float
    torque: Array
    rest: Array
    share: float
    hand: tuple[float, ...]

    @property
    def total(self) -> float:
        """Sum of the joint springs [N.m/rad], by which postures are compared."""
        return float(np.sum(self.stiffness))


@dataclass(frozen=True)
class Tuning:
    """All postures that can carry the force, and the best of them.

    Attributes:
        best: Needs the least joint stiffness.
        found: In the order of the self-motion.
        refused: Way along the self-motion -> why a posture cannot.
    """

    best: Tuned
    found: tuple[Tuned, ...]
    refused: dict[float, str]


def tune(assembly: Assembly, question: Question) -> Tuning:
    """Compares postures and finds each one's least joint springs.

    Raises:
        BadInput: The task holds an object, or no posture can carry the force; says why for each.
    """
    if assembly.task.object is not None:
        raise BadInput(
            f"task '{assembly.task.name}' holds an object: tune looks at one free arm (valid: a task without object)"
        )
    limb = assembly.model.limbs[question.arm]
    found, refused = list[Tuned](), dict[float, str]()
    for posture in self_motion(assembly.model, limb, assembly.modules.posture, question.postures):
        try:
            found.append(tune_posture(assembly, question, posture))
        except BadInput as error:
            refused[posture.along] = str(error)
    if not found:
        reasons = "; ".join(f"at {along:+.2f} rad: {why}" for along, why in refused.items())
        raise BadInput(f"no posture of arm '{question.arm}' carries this: {reasons}")
    best = min(found, key=lambda tuned: (round(tuned.total, 6), abs(tuned.posture.along)))
    return Tuning(best, tuple(found), refused)


def tune_posture(assembly: Assembly, question: Question, posture: Posture) -> Tuned:
    """Finds the least joint springs of one posture.

    Raises:
        BadInput: A torque passes its limit, a rest cannot lie far enough, or no stiffness is enough.
    """
    jacobian, others = unloaded_arm(assembly, question, posture)
    forces = [np.append(f * question.direction, np.zeros(3)) for f in question.ends]
    torques = np.array([jacobian.T @ force for force in forces])
    share = _share(assembly, question, posture, torques)
    loads = unloading(jacobian, others, [-force for force in forces])
    room = _room(assembly, question, posture, torques)
    least = np.maximum(np.max(np.abs(torques) / room, axis=0), question.softest)
    stiffness = MARGIN * least_stiffness(loads, least, STIFFEST)
    largest = int(np.argmax(np.abs(question.ends)))
    limb = assembly.model.limbs[question.arm]
    return Tuned(
        posture=posture,
        stiffness=stiffness,
        folds_at=folding_share(stiffness, loads),
        torque=torques[largest],
        rest=posture.q[limb.joints] + torques[largest] / stiffness,
        share=share,
        hand=tuple(_along(jacobian, np.diag(stiffness) - load, question.direction) for load in loads),
    )


def unloaded_arm(assembly: Assembly, question: Question, posture: Posture) -> tuple[Array, Array]:
    """Gives the hand's Jacobian (6, k) and S (k, k), the task's other springs in joint space, at a posture."""
    limb = assembly.model.limbs[question.arm]
    arm = assembly.task.arms[question.arm]
    angles = dict(zip(limb.short_names, map(float, posture.q[limb.joints]), strict=True))
    moved = replace(arm, posture=angles)
    if question.alone:
        moved = replace(moved, springs=())
    task = replace(assembly.task, arms={**assembly.task.arms, question.arm: moved})
    modules = build_modules(task, assembly.model)
    mechanism = Mechanism(replace(assembly, task=task, modules=modules))
    mechanism.update(posture.q, np.zeros_like(posture.q))
    setting = Setting(modules, start_equilibrium(modules), phase_damping(modules, mechanism.kinematics))
    seen = analyse_state(mechanism, setting, posture.q).arms[question.arm]
    bias = modules.arm(question.arm).bias
    own = np.zeros(limb.joints.size) if bias is None else np.asarray(bias.stiffness)
    return seen.jacobian.copy(), seen.system.stiffness - np.diag(own)


def _share(assembly: Assembly, question: Question, posture: Posture, torques: Array) -> float:
    """Gives the largest torque over its limit, the arm's own weight included; refuses what passes it."""
    model, limb = assembly.model, assembly.model.limbs[question.arm]
    limit, weight = model.column("effort_max")[limb.joints], model.gravity(posture.q)[limb.joints]
    shares = np.abs(torques + weight) / limit
    end, joint = np.unravel_index(int(np.argmax(shares)), shares.shape)
    if shares[end, joint] > 1.0:
        raise BadInput(
            f"{question.ends[end]:g} N ask {abs(torques[end, joint] + weight[joint]):.1f} N.m of"
            f" {limb.joint_names[joint]} with the arm's weight (valid: up to {limit[joint]:g} N.m)"
        )
    return float(shares.max())


def _room(assembly: Assembly, question: Question, posture: Posture, torques: Array) -> Array:
    """Gives how far each spring's rest may lie from the posture, the way it pulls, (2, k) [rad]."""
    model, limb = assembly.model, assembly.model.limbs[question.arm]
    q = posture.q[limb.joints]
    up, down = model.column("position_max")[limb.joints] - q, q - model.column("position_min")[limb.joints]
    room = np.minimum(question.reach, np.where(torques > 0.0, up, down))
    if np.any(room <= 0.0):
        joint = limb.joint_names[int(np.argmin(np.min(room, axis=0)))]
        raise BadInput(f"{joint} stands at its limit: its spring's rest cannot lie beyond")
    return np.asarray(room)


def _along(jacobian: Array, hessian: Array, direction: Array) -> float:
    """Gives the hand's stiffness along a direction, 1 / (d^T J H^-1 J^T d) [N/m]."""
    row = direction @ jacobian[:3]
    return float(1.0 / (row @ np.linalg.solve(hessian, row)))


def named(values: Array, names: Sequence[str], digits: int) -> dict[str, float]:
    """Puts rounded numbers (k,) beside their joints' short names."""
    return {name: round(float(value), digits) for name, value in zip(names, values, strict=True)}
