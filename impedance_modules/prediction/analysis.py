# SPDX-License-Identifier: BSD-3-Clause
"""What a push on a hand, or on the object in both hands, meets: at the start, or at rest in a phase.

The numbers come from ``superposition``; here they are taken at the right state and by the rules of what may be
printed: no stiffness where an arm folds or its joint springs are singular, no inertia at a singular posture.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impedance_modules.arrays import Array
from impedance_modules.control.assembly import Assembly
from impedance_modules.errors import BadInput, nearest
from impedance_modules.modules.damping import phase_damping
from impedance_modules.modules.equilibrium import start_equilibrium
from impedance_modules.modules.held_object import OBJECT
from impedance_modules.prediction.mechanism import Mechanism, Setting
from impedance_modules.prediction.quasi_static import predict_motion
from impedance_modules.prediction.statics import Rest, analyse_state, find_rest
from impedance_modules.robot.model import Limb
from impedance_modules.superposition.arm_impedance import ArmImpedance
from impedance_modules.superposition.modes import JointSpace, VibrationMode, natural_modes
from impedance_modules.superposition.net_stiffness import net_stiffness
from impedance_modules.superposition.object_impedance import (
    HandImpedance,
    HeldImpedance,
    squeeze_force,
    superpose,
)
from impedance_modules.superposition.operational_inertia import OperationalInertia


@dataclass(frozen=True)
class FrameImpedance:
    """What a push on one frame meets; (6, 6), linear then angular, world axes, at the frame's origin, SI units.

    Attributes:
        frame: A hand, or ``object``.
        position: (3,) of its origin in world [m].
        q: Joint -> angle [rad], of all joints behind it.
        inertia, inertia_without_reflected: None at a singular posture.
        mobility: The inertia's inverse, which always exists.
        damping: None where the joints' dampers or the posture are singular.
        stiffness: With its preload; None where an arm folds or joint springs are singular.
        compliance: Given in the stiffness's place where joint springs are singular; None where the frame
            can move freely.
        stiffness_without_preload: Of the same springs, relaxed; None as above.
        preload: (6,) a hand: what the joint springs carry; the object: what all modules exert on it [N, N.m].
        folds: The springs cannot hold the load: pushed, it runs away.
        modes: Slowest first, of the joints behind it, motor friction included.
    """

    frame: str
    position: Array
    q: Mapping[str, float]
    inertia: Array | None
    inertia_without_reflected: Array | None
    mobility: Array
    damping: Array | None
    stiffness: Array | None
    compliance: Array | None
    stiffness_without_preload: Array | None
    preload: Array
    folds: bool
    modes: tuple[VibrationMode, ...]


@dataclass(frozen=True)
class Analysis:
    """A task at one state.

    Attributes:
        phase: Its name; None at the start posture.
        arms: Limb name -> its hand.
        object: What they hold; None for nothing.
        summands: What adds up to the object's matrices: limb name -> hand carried to the object.
        own: (6, 6) inertia of the object itself; None without one.
        squeeze: How hard the hands press the object [N]; None without one.
        pressure: Hand frame or ``object`` -> (6,) of the surfaces on it [N, N.m]; empty at the start posture.
    """

    phase: str | None
    arms: Mapping[str, FrameImpedance]
    object: FrameImpedance | None
    summands: Mapping[str, HandImpedance]
    own: Array | None
    squeeze: float | None
    pressure: Mapping[str, Array]


def analyse_task(assembly: Assembly, phase: str | None) -> Analysis:
    """Analyses a task at its start posture, or at rest where a phase ends, in contact.

    A phase ends where its motion does: after its duration, or when its ``until`` is met.

    Raises:
        BadInput: There is no such phase, or no static equilibrium was found in it.
    """
    mechanism = Mechanism(assembly)
    if phase is None:
        modules, q = assembly.modules, assembly.modules.posture
        mechanism.update(q, np.zeros_like(q))
        damping = phase_damping(modules, mechanism.kinematics)
        setting = Setting(modules, start_equilibrium(modules), damping)
        return _analysis(mechanism, setting, q, None, None)
    names = [spec.name for spec in assembly.task.phases]
    if phase not in names:
        raise BadInput(
            f"--phase {phase}: task '{assembly.task.name}' has no such phase{nearest(phase, names)}"
            f" (valid: {', '.join(names)})"
        )
    predicted = predict_motion(assembly).phases[names.index(phase)]
    rest = find_rest(mechanism, predicted.setting, predicted.q)
    if rest is None:
        raise BadInput(
            f"--phase {phase}: no static equilibrium where it ends; a force axis without stiffness may push into"
            " nothing, or an arm folds (valid: a phase that comes to rest)"
        )
    return _analysis(mechanism, predicted.setting, rest.q, phase, rest)


def _analysis(
    mechanism: Mechanism, setting: Setting, q: Array, phase: str | None, rest: Rest | None
) -> Analysis:
    state, modules = analyse_state(mechanism, setting, q), setting.modules
    limbs = {arm.limb.name: arm.limb for arm in modules.arms}
    arms = {name: _hand(mechanism, limbs[name], arm, q) for name, arm in state.arms.items()}
    pressure = {} if rest is None else rest.pressure
    held = state.held
    if held is None or modules.held is None:
        return Analysis(phase, arms, None, {}, None, None, pressure)
    holding = modules.held.limbs
    return Analysis(
        phase=phase,
        arms=arms,
        object=_object(mechanism, [limbs[name] for name in holding], state.arms, held, q),
        summands=dict(zip(holding, held.hands, strict=True)),
        own=modules.held.inertia(held.pose.rotation),
        squeeze=squeeze_force(held.hands, held.impedance.internal),
        pressure=pressure,
    )


def _hand(mechanism: Mechanism, limb: Limb, arm: ArmImpedance, q: Array) -> FrameImpedance:
    found = arm.stiffness
    friction = np.diag(mechanism.model.column("motor_damping")[limb.joints])
    return FrameImpedance(
        frame=limb.hand,
        position=arm.pose.translation,
        q=_angles(limb, q),
        inertia=arm.inertia.inertia,
        inertia_without_reflected=arm.inertia_without_reflected.inertia,
        mobility=arm.inertia.mobility,
        damping=arm.damping,
        stiffness=found.stiffness,
        compliance=found.compliance if found.stiffness is None else None,
        stiffness_without_preload=arm.stiffness_without_preload.stiffness,
        preload=arm.preload,
        folds=found.folds,
        modes=_modes(arm.system, friction),
    )


def _object(
    mechanism: Mechanism, limbs: list[Limb], arms: Mapping[str, ArmImpedance], held: HeldImpedance, q: Array
) -> FrameImpedance:
    found, singular = held.impedance, held.joints_singular
    motion = held.motion
    joints = np.concatenate([limb.joints for limb in limbs])
    friction = np.diag(mechanism.model.column("motor_damping")[joints])
    hidden = singular or held.folds
    return FrameImpedance(
        frame=OBJECT,
        position=held.pose.translation,
        q={name: angle for limb in limbs for name, angle in _angles(limb, q).items()},
        inertia=found.inertia.inertia,
        inertia_without_reflected=held.impedance_without_reflected.inertia.inertia,
        mobility=found.inertia.mobility,
        damping=found.damping,
        stiffness=None if hidden else found.stiffness,
        compliance=_compliance(held) if singular and not held.folds else None,
        stiffness_without_preload=_relaxed([arms[limb.name] for limb in limbs], held),
        preload=found.wrench,
        folds=held.folds,
        modes=_modes(held.system, motion.motion.T @ friction @ motion.motion),
    )


def _compliance(held: HeldImpedance) -> Array | None:
    """Gives the object's motion per wrench through the joints that keep the grasps."""
    free, nothing = np.zeros((6, 6)), np.zeros(6)
    return net_stiffness(held.motion.twist, held.system.stiffness, free, nothing).compliance


def _relaxed(arms: list[ArmImpedance], held: HeldImpedance) -> Array | None:
    """Sums the relaxed arms; None where one of them has no stiffness to be printed."""
    hands = []
    for arm, hand in zip(arms, held.hands, strict=True):
        if arm.stiffness_without_preload.stiffness is None:
            return None
        relaxed = arm.stiffness_without_preload.stiffness
        hands.append(replace(hand, stiffness=relaxed, wrench=np.zeros(6), shared=np.zeros(6)))
    return superpose(hands, None).stiffness


def _modes(system: JointSpace, friction: Array) -> tuple[VibrationMode, ...]:
    return natural_modes(replace(system, damping=system.damping + friction))


def _angles(limb: Limb, q: Array) -> dict[str, float]:
    return {name: float(q[joint]) for name, joint in zip(limb.joint_names, limb.joints, strict=True)}


def carried_inertia(hand: HandImpedance) -> OperationalInertia:
    """Carries a hand's inertia to the object: one summand of the thesis's eq. 4.30."""
    return hand.inertia.carried(hand.offset)


MATRICES = (
    "inertia",
    "inertia_without_reflected",
    "mobility",
    "damping",
    "stiffness",
    "compliance",
    "stiffness_without_preload",
)


def analysis_json(analysis: Analysis) -> dict[str, Any]:
    """Gives ``{"format": 1, "arms": {SIDE: X}, "object": X or null}``."""
    impedance = analysis.object
    return {
        "format": 1,
        "arms": {limb: _frame(found, analysis.phase) for limb, found in analysis.arms.items()},
        "object": None if impedance is None else _frame(impedance, analysis.phase),
    }


def write_analysis(analysis: Analysis, path: Path) -> None:
    """Writes the JSON file.

    Raises:
        BadInput: The file cannot be written.
    """
    text = json.dumps(analysis_json(analysis), indent=1, allow_nan=False)
    try:
        path.write_text(text + "\n", encoding="utf-8")
    except OSError as error:
        raise BadInput(f"--json {path}: cannot be written: {error.strerror}") from None


def _frame(impedance: FrameImpedance, phase: str | None) -> dict[str, Any]:
    found: dict[str, Any] = {
        "frame": impedance.frame,
        "position": impedance.position.tolist(),
        "q": dict(impedance.q),
    }
    found.update({name: _numbers(getattr(impedance, name)) for name in MATRICES})
    found.update({"preload": impedance.preload.tolist(), "folds": impedance.folds, "phase": phase})
    return found


def _numbers(matrix: NDArray[np.float64] | None) -> list[list[float]] | None:
    return None if matrix is None else [[float(value) for value in row] for row in matrix]
