# SPDX-License-Identifier: BSD-3-Clause
"""What a push on a hand, or on the object in both hands, meets: at the start, or at rest in a phase.

The numbers come from ``superposition``; here they are taken at the right state and by the rules of what may be
printed: no stiffness where an arm folds or its joint springs are singular, no inertia at a singular posture.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.control.assembly import Assembly
from impedance_modules.errors import BadInput, nearest
from impedance_modules.modules.arms import TaskModules
from impedance_modules.modules.between_spring import springs_at
from impedance_modules.modules.damping import phase_damping
from impedance_modules.modules.equilibrium import start_equilibrium
from impedance_modules.modules.held_object import OBJECT
from impedance_modules.prediction.held_by_friction import FrictionHold, held_by_friction
from impedance_modules.prediction.mechanism import Mechanism, Setting
from impedance_modules.prediction.quasi_static import predict_motion
from impedance_modules.prediction.statics import Rest, analyse_state, find_rest
from impedance_modules.robot.model import Limb
from impedance_modules.superposition.arm_impedance import ArmImpedance
from impedance_modules.superposition.coupled_arms import CoupledArms
from impedance_modules.superposition.hinge_impedance import HingeImpedance, hinge_impedance
from impedance_modules.superposition.modes import JointSpace, VibrationMode, natural_modes
from impedance_modules.superposition.net_stiffness import net_stiffness
from impedance_modules.superposition.object_impedance import HeldImpedance, superpose
from impedance_modules.superposition.object_sum import ObjectSum, carried_preload, sum_at_object


@dataclass(frozen=True)
class FrameImpedance:
    """What a push on one frame meets; (6, 6), linear then angular, world axes, at the frame's origin, SI units.

    Attributes:
        frame: A hand, or ``object``.
        position: (3,) of its origin in world [m].
        rotation: (3, 3) of its axes in world.
        q: Joint -> angle [rad], of all joints behind it.
        until_rest: Joint -> by how much it turns from where the phase is predicted to end until it rests [rad]; None
            at the start posture.
        inertia, inertia_without_reflected: None at a singular posture.
        mobility: The inertia's inverse, which always exists.
        damping: None where the joints' dampers or the posture are singular.
        stiffness: With its preload; None where an arm folds or joint springs are singular.
        compliance: Given in the stiffness's place where joint springs are singular; None where the frame
            can move freely.
        stiffness_without_preload: Of the same springs, relaxed; None as above.
        preload: (6,) what the joint springs carry, F_b of the net stiffness; the object's: those of all arms that
            hold it, at its origin [N, N.m].
        wrench: (6,) what the modules exert through the frame on whatever it touches or holds [N, N.m].
        pressure: (6,) of the surfaces on it [N, N.m]; None at the start posture.
        friction: Of the surfaces on a hand that holds nothing, and where it stops the hand; None where no rough surface
            presses it, and at the start posture.
        folds: The springs cannot hold the load: pushed, it runs away.
        modes: Slowest first, of the joints behind it, motor friction included.
    """

    frame: str
    position: Array
    rotation: Array
    q: Mapping[str, float]
    until_rest: Mapping[str, float] | None
    inertia: Array | None
    inertia_without_reflected: Array | None
    mobility: Array
    damping: Array | None
    stiffness: Array | None
    compliance: Array | None
    stiffness_without_preload: Array | None
    preload: Array
    wrench: Array
    pressure: Array | None
    friction: FrictionHold | None
    folds: bool
    modes: tuple[VibrationMode, ...]


@dataclass(frozen=True)
class SpringState:
    """A spring between two arms at one state.

    Attributes:
        name: Of the spring.
        frames: The two it joins.
        stretch: (6,) e, in its own axes [m, rad].
        energy: Stored [J].
        wrench: (6,) on its first frame, at that frame's origin in world axes; on the second it exerts the opposite
            about the same point [N, N.m].
        stiffness, damping: (6, 6) in its own axes.
    """

    name: str
    frames: tuple[str, str]
    stretch: Array
    energy: float
    wrench: Array
    stiffness: Array
    damping: Array


@dataclass(frozen=True)
class CouplingOfHands:
    """How springs between arms couple their hands: what hand i feels where hand k moves, all other hands held still.

    Attributes:
        limbs: Of the hands.
        stiffness, damping: (h, h, 6, 6) by hand i and hand k, world axes at the hands; None where they do not exist.
        folds: The arms together do not return under their loads.
        modes: Of all their joints together, slowest first, motor friction included.
    """

    limbs: tuple[str, ...]
    stiffness: Array | None
    damping: Array | None
    folds: bool
    modes: tuple[VibrationMode, ...]


@dataclass(frozen=True)
class Analysis:
    """A task at one state.

    Attributes:
        phase: Its name; None at the start posture.
        arms: Limb name -> its hand.
        object: What they hold; None for nothing.
        sum: How the hands' impedances make the object's; None for nothing held.
        hinge: What a torque about the object's hinge meets; None without one.
        between: Springs between two arms.
        coupled: Groups of arms that these join and no object does. A hand of ``arms`` is told with all others of its
            group held still.
    """

    phase: str | None
    arms: Mapping[str, FrameImpedance]
    object: FrameImpedance | None
    sum: ObjectSum | None
    hinge: HingeImpedance | None = None
    between: tuple[SpringState, ...] = ()
    coupled: tuple[CouplingOfHands, ...] = ()


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
        return _analysis(assembly, mechanism, setting, q, None)
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
    found = _analysis(assembly, mechanism, predicted.setting, rest.q, (phase, rest))
    end = dict(zip(assembly.model.joint_names, predicted.q.tolist(), strict=True))
    held = assembly.modules.held
    holds = {
        limb: held_by_friction(mechanism, predicted.setting, rest, predicted.q, arm.frame)
        for limb, arm in found.arms.items()
        if held is None or limb not in held.limbs
    }
    return replace(
        found,
        arms={limb: replace(_since(arm, end), friction=holds.get(limb)) for limb, arm in found.arms.items()},
        object=None if found.object is None else _since(found.object, end),
    )


def _analysis(
    assembly: Assembly, mechanism: Mechanism, setting: Setting, q: Array, rest: tuple[str, Rest] | None
) -> Analysis:
    state, modules = analyse_state(mechanism, setting, q), setting.modules
    phase, pressure = (None, {}) if rest is None else (rest[0], rest[1].pressure)
    limbs = {arm.limb.name: arm.limb for arm in modules.arms}
    arms = {
        name: _pressed(_hand(mechanism, limbs[name], arm, q), pressure) for name, arm in state.arms.items()
    }
    held = state.held
    between = tuple(_spring_states(mechanism, setting))
    coupled = tuple(_coupling_of_hands(mechanism, modules, group) for group in state.coupled)
    if held is None or modules.held is None:
        return Analysis(phase, arms, None, None, between=between, coupled=coupled)
    holding, mirror = modules.held.limbs, assembly.robot.mirror
    at_object = _object(mechanism, [limbs[name] for name in holding], state.arms, held, q)
    own = modules.held.inertia(held.pose.rotation)
    for name, hand in zip(holding, held.hands, strict=True):
        arms[name] = replace(arms[name], wrench=hand.wrench + hand.shared)
    return Analysis(
        phase=phase,
        arms=arms,
        object=_pressed(at_object, pressure),
        sum=sum_at_object(
            holding,
            state.arms,
            held,
            own,
            plane=None if mirror is None else mirror.plane,
            stiffness=at_object.stiffness,
        ),
        hinge=hinge_impedance(modules.held, held, hidden=at_object.stiffness is None),
        between=between,
        coupled=coupled,
    )


def _spring_states(mechanism: Mechanism, setting: Setting) -> Iterator[SpringState]:
    """Tells every spring between two arms at the mechanism's state."""
    springs = setting.modules.between
    found = springs_at(springs, mechanism.kinematics, setting.targets.springs)
    for s, spring in enumerate(springs):
        error, K = found.error[s].copy(), spring.spec.stiffness
        yield SpringState(
            name=spring.name,
            frames=spring.frames,
            stretch=error,
            energy=0.5 * float(error @ K @ error),
            wrench=found.wrench[s, :6].copy(),
            stiffness=K,
            damping=setting.damping.of_between(spring),
        )


def _coupling_of_hands(mechanism: Mechanism, modules: TaskModules, group: CoupledArms) -> CouplingOfHands:
    count = len(group.limbs)
    joints = np.concatenate([modules.arm(limb).limb.joints for limb in group.limbs])

    def blocks(matrix: Array | None) -> Array | None:
        return None if matrix is None else matrix.reshape(count, 6, count, 6).transpose(0, 2, 1, 3)

    return CouplingOfHands(
        limbs=group.limbs,
        stiffness=None if group.folds else blocks(group.stiffness),
        damping=blocks(group.damping),
        folds=group.folds,
        modes=_modes(group.system, np.diag(mechanism.model.motor_damping[joints])),
    )


def _since(found: FrameImpedance, end: Mapping[str, float]) -> FrameImpedance:
    """Adds how far the joints turn from the predicted end of the phase, joint -> [rad], until they rest."""
    return replace(found, until_rest={name: angle - end[name] for name, angle in found.q.items()})


def _pressed(found: FrameImpedance, pressure: Mapping[str, Array]) -> FrameImpedance:
    """Adds what the surfaces exert on the frame, where that is known."""
    return replace(found, pressure=pressure.get(found.frame))


def _hand(mechanism: Mechanism, limb: Limb, arm: ArmImpedance, q: Array) -> FrameImpedance:
    found = arm.stiffness
    friction = np.diag(mechanism.model.motor_damping[limb.joints])
    return FrameImpedance(
        frame=limb.hand,
        position=arm.pose.translation,
        rotation=arm.pose.rotation,
        q=_angles(limb, q),
        until_rest=None,
        inertia=arm.inertia.inertia,
        inertia_without_reflected=arm.inertia_without_reflected.inertia,
        mobility=arm.inertia.mobility,
        damping=arm.damping,
        stiffness=found.stiffness,
        compliance=found.compliance if found.stiffness is None else None,
        stiffness_without_preload=arm.stiffness_without_preload.stiffness,
        preload=arm.preload,
        wrench=arm.wrench - arm.preload,
        pressure=None,
        friction=None,
        folds=found.folds,
        modes=_modes(arm.system, friction),
    )


def _object(
    mechanism: Mechanism,
    limbs: list[Limb],
    arms: Mapping[str, ArmImpedance],
    held: HeldImpedance,
    q: Array,
) -> FrameImpedance:
    found, singular = held.impedance, held.joints_singular
    motion, holding = held.motion, [arms[limb.name] for limb in limbs]
    joints = np.concatenate([limb.joints for limb in limbs])
    friction = np.diag(mechanism.model.motor_damping[joints])
    hidden = singular or held.folds
    return FrameImpedance(
        frame=OBJECT,
        position=held.pose.translation,
        rotation=held.pose.rotation,
        q={name: angle for limb in limbs for name, angle in _angles(limb, q).items()},
        until_rest=None,
        inertia=found.inertia.inertia,
        inertia_without_reflected=held.impedance_without_reflected.inertia.inertia,
        mobility=found.inertia.mobility,
        damping=found.damping,
        stiffness=None if hidden else found.stiffness,
        compliance=_compliance(held) if singular and not held.folds else None,
        stiffness_without_preload=_relaxed(holding, held),
        preload=carried_preload(holding, held.pose.translation),
        wrench=found.wrench,
        pressure=None,
        friction=None,
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
    total = superpose(hands, None).stiffness
    if held.coupling is None or total is None:
        return total
    return None if held.coupling.relaxed is None else total + held.coupling.relaxed


def _modes(system: JointSpace, friction: Array) -> tuple[VibrationMode, ...]:
    return natural_modes(replace(system, damping=system.damping + friction))


def _angles(limb: Limb, q: Array) -> dict[str, float]:
    return {name: float(q[joint]) for name, joint in zip(limb.joint_names, limb.joints, strict=True)}
