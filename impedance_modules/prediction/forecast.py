# SPDX-License-Identifier: BSD-3-Clause
"""Everything that ``check`` prints of a task.

Of every phase: how much of each joint's torque and range it uses, how far hands and object are deflected at rest, and
whether the sampled loop is stable. Of the whole task: the energy that its tank must hold.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.control.assembly import Assembly
from impedance_modules.modules.between_spring import springs_at
from impedance_modules.modules.equilibrium import Equilibrium
from impedance_modules.modules.held_object import OBJECT
from impedance_modules.modules.spring import displacement_of
from impedance_modules.prediction.compensation_forecast import (
    CompensationForecast,
    commanded,
    effort_at_rest,
)
from impedance_modules.prediction.energy_need import TankForecast
from impedance_modules.prediction.feasibility import TaskPrediction
from impedance_modules.prediction.hinge_forecast import HingeForecast, forecast_hinge, hinge_notes
from impedance_modules.prediction.joint_limits import beyond_range, too_fast
from impedance_modules.prediction.loop_stability import StabilityForecast
from impedance_modules.prediction.mechanism import Mechanism
from impedance_modules.prediction.obstacle_forecast import obstacle_notes
from impedance_modules.prediction.phase_loops import PhaseLoops
from impedance_modules.prediction.quasi_static import MotionPrediction, PredictedPhase
from impedance_modules.prediction.reach import reach_notes
from impedance_modules.prediction.statics import Rest, analyse_state
from impedance_modules.robot.model import Limb, RobotModel
from impedance_modules.spec.task import ReachedCondition
from impedance_modules.superposition.modes import longest_time_constant, natural_modes

GRAVITY_SAMPLES = 40
"""Moments of a phase at which the arms' own weight is taken into account."""


SLOW_REST, FAR_REST = 30.0, 0.25
"""A rest is noted as far off from these on: time constant [s] and way of a joint from the phase's end [rad]."""


@dataclass(frozen=True)
class SlowRest:
    """A rest that a phase's end is far from, and that is come to slowly.

    Attributes:
        joint: That turns most until then.
        angle: By how much [rad].
        time_constant: Of the slowest motion of its arm at rest [s].
    """

    joint: str
    angle: float
    time_constant: float


@dataclass(frozen=True)
class JointLoad:
    """The joint of an arm that comes closest to its torque limit.

    Attributes:
        joint: Its name.
        short: Its name within the limb.
        torque: Largest magnitude [N.m].
        limit: ``effort_max`` [N.m].
    """

    joint: str
    short: str
    torque: float
    limit: float

    @property
    def share(self) -> float:
        """Torque over limit."""
        return self.torque / self.limit


@dataclass(frozen=True)
class Deflection:
    """How far something at rest is from its equilibrium: distance [m] and angle [rad]."""

    distance: float
    angle: float


@dataclass(frozen=True)
class ArmForecast:
    """What one phase asks of one arm.

    Attributes:
        limb: The arm.
        commanded: Joint whose commanded torque comes closest to the limit, while it moves or at rest.
        total: The same with the torque that carries the arm's own weight. The limit is the motor's; springs
            that help a real robot carry its arms are not in its description, so this is an upper bound.
        beyond: Joint -> how far it would leave its range [rad]; empty if none does.
        too_fast: Joint -> speed that it would reach, beyond its limit [rad/s]; empty if none does.
        deflection: Of the hand at rest, against its springs; None without a spring there or without a rest.
        contact_force: Of the surfaces on the hand at rest [N]; None without a rest.
    """

    limb: str
    commanded: JointLoad
    total: JointLoad
    beyond: Mapping[str, float]
    too_fast: Mapping[str, float]
    deflection: Deflection | None
    contact_force: float | None


@dataclass(frozen=True)
class ObjectForecast:
    """The held object at a phase's rest.

    Attributes:
        deflection: From its target.
        contact_force: Of the surfaces on it [N].
    """

    deflection: Deflection
    contact_force: float


@dataclass(frozen=True)
class PhaseForecast:
    """One phase.

    Attributes:
        predicted: Its motion.
        rest: Its static equilibrium where it ends; None where none was found.
        arms: What it asks of every arm.
        object: The held object at rest; None without an object or a rest.
        hinge: Of the held object; None without one.
        loops: Stability of every loop with this phase's gains.
        folds: Arms (or ``object``) that would fold at rest.
        slow: Where the rest is far off in time; None where it is not, or where there is none.
        between: Spring between two arms -> how far it is stretched at rest; empty without a rest.
    """

    predicted: PredictedPhase
    rest: Rest | None
    arms: tuple[ArmForecast, ...]
    object: ObjectForecast | None
    hinge: HingeForecast | None
    loops: tuple[StabilityForecast, ...]
    folds: tuple[str, ...]
    slow: SlowRest | None
    between: Mapping[str, Deflection] = field(default_factory=dict)


@dataclass(frozen=True)
class Forecast:
    """A whole task.

    Attributes:
        phases: In order.
        tank: What it costs.
        notes: What the task's author should know, most of all what would go wrong.
        compensation: What is compensated, and what it costs; None where nothing is.
    """

    phases: tuple[PhaseForecast, ...]
    tank: TankForecast
    notes: tuple[str, ...]
    compensation: CompensationForecast | None = None


def forecast_task(assembly: Assembly, prediction: TaskPrediction) -> Forecast:
    """Adds loads, deflections and stability to what a task's feasibility was judged by."""
    mechanism, motion = Mechanism(assembly), prediction.motion
    phases: list[PhaseForecast] = []
    carried = assembly.model.gravity if assembly.compensation is None else assembly.compensation.model.gravity
    for index, (phase, rest, judged) in enumerate(
        zip(motion.phases, prediction.rests, prediction.loops, strict=True)
    ):
        loads = _loads(prediction, index, carried)
        arms = tuple(
            _forecast_arm(mechanism, arm.limb, phase, loads, (motion, rest)) for arm in phase.modules.arms
        )
        hinge = _forecast_hinge(mechanism, phase, rest, judged, phases)
        phases.append(_forecast_phase(mechanism, phase, rest, arms, judged, hinge))
    notes = tuple(
        dict.fromkeys(
            [
                *reach_notes(assembly, prediction.missed),
                *_far_rests(assembly, phases),
                *obstacle_notes(assembly, motion, prediction.approaches),
                *(note for phase in phases for note in _notes(phase)),
            ]
        )
    )
    return Forecast(tuple(phases), prediction.tank, notes, prediction.compensation)


def _far_rests(assembly: Assembly, phases: Sequence[PhaseForecast]) -> Iterator[str]:
    """Says where a hand rests farther from its target than its phase asks for."""
    for spec, phase in zip(assembly.task.phases, phases, strict=True):
        until, motion = spec.until, phase.predicted.motion
        if not isinstance(until, ReachedCondition):
            continue
        moved = {name.partition(".")[0] for name in (*motion.moved, *motion.carried)}
        for arm in phase.arms:
            rest = arm.deflection if arm.limb in moved else None
            if rest is not None and (rest.distance > until.distance or rest.angle > until.angle):
                yield (
                    f"phase '{spec.name}': the hand of '{arm.limb}' rests {1e3 * rest.distance:.1f} mm and"
                    f" {rest.angle:.3f} rad from its target, at most {1e3 * until.distance:g} mm and"
                    f" {until.angle:g} rad are asked for: it arrives only if it swings through, or not at all"
                )


def _loads(
    prediction: TaskPrediction, index: int, carried: Callable[[Array], Array]
) -> tuple[list[Array], list[Array]]:
    """Lists the commanded torques of a phase, and motor torques with the weight that robots carry (n,) [N.m]."""
    phase, rest, added = prediction.motion.phases[index], prediction.rests[index], prediction.compensation
    samples, efforts = prediction.motion.samples[phase.samples], commanded(prediction.motion, added, phase)
    every = max(1, len(samples) // GRAVITY_SAMPLES)
    loaded = [
        effort + carried(sample.q) for sample, effort in zip(samples[::every], efforts[::every], strict=True)
    ]
    if rest is not None:
        efforts.append(effort_at_rest(rest, added, index))
        loaded.append(efforts[-1] + carried(rest.q))
    return efforts, loaded


def _forecast_phase(
    mechanism: Mechanism,
    phase: PredictedPhase,
    rest: Rest | None,
    arms: tuple[ArmForecast, ...],
    judged: PhaseLoops,
    hinge: HingeForecast | None,
) -> PhaseForecast:
    """Sums up one phase."""
    modules, state = phase.modules, judged.state
    folds = [limb for limb, arm in state.arms.items() if arm.stiffness.folds]
    joined = {limb for group in state.coupled for limb in group.limbs}
    folds = [limb for limb in folds if limb not in joined]
    folds += [group.name for group in state.coupled if group.folds]
    held = state.held
    if held is not None and modules.held is not None:
        # Between the hands of one object an arm is held: what counts is whether the whole folds.
        folds = [limb for limb in folds if limb not in modules.held.limbs] + [OBJECT] * held.folds
    return PhaseForecast(
        predicted=phase,
        rest=rest,
        arms=arms,
        object=None if rest is None else _forecast_object(mechanism, phase.equilibrium, rest),
        hinge=hinge,
        loops=judged.loops,
        folds=() if rest is None else tuple(folds),
        slow=None if rest is None else _slow_rest(mechanism, phase, rest),
        between={} if rest is None else _stretches(mechanism, phase, rest),
    )


def _stretches(mechanism: Mechanism, phase: PredictedPhase, rest: Rest) -> dict[str, Deflection]:
    """Gives how far each spring between two arms is stretched at rest."""
    mechanism.update(rest.q, np.zeros_like(rest.q))
    springs = phase.modules.between
    found = springs_at(springs, mechanism.kinematics, phase.equilibrium.springs)
    return {spring.name: _deflection(found.error[s]) for s, spring in enumerate(springs)}


def _forecast_hinge(
    mechanism: Mechanism,
    phase: PredictedPhase,
    rest: Rest | None,
    judged: PhaseLoops,
    before: Sequence[PhaseForecast],
) -> HingeForecast | None:
    """Sums up the hinge of the held object, which goes on from where the last phase left it."""
    held = phase.modules.held
    if held is None or held.hinge is None:
        return None
    began = held.hinge.spec.angle
    if before and before[-1].hinge is not None:
        began = before[-1].hinge.ended
    return forecast_hinge(mechanism, phase, began, None if rest is None else judged.state.held)


def _slow_rest(mechanism: Mechanism, phase: PredictedPhase, rest: Rest) -> SlowRest | None:
    """Looks how far the phase's end is from its rest, and how slowly a free arm comes to it."""
    model, held = mechanism.model, phase.modules.held
    way, holding = rest.q - phase.q, () if held is None else held.limbs
    for limb in (arm.limb for arm in phase.modules.arms if arm.limb.name not in holding):
        joint = int(limb.joints[np.argmax(np.abs(way[limb.joints]))])
        if abs(way[joint]) < FAR_REST:
            continue
        system = analyse_state(mechanism, phase.setting, rest.q).arms[limb.name].system
        friction = np.diag(model.motor_damping[limb.joints])
        slowest = longest_time_constant(natural_modes(replace(system, damping=system.damping + friction)))
        if slowest > SLOW_REST:
            return SlowRest(model.joint_names[joint], float(way[joint]), slowest)
    return None


def _forecast_arm(
    mechanism: Mechanism,
    limb: Limb,
    phase: PredictedPhase,
    loads: tuple[list[Array], list[Array]],
    course: tuple[MotionPrediction, Rest | None],
) -> ArmForecast:
    """Sums up one arm in one phase; ``loads`` are its commanded and its motors' torques."""
    (motion, rest), (efforts, loaded) = course, loads
    model, samples = mechanism.model, motion.samples[phase.samples]
    return ArmForecast(
        limb=limb.name,
        commanded=_largest_load(model, limb, efforts),
        total=_largest_load(model, limb, loaded),
        beyond=beyond_range(model, limb.joints, [sample.q for sample in samples]),
        too_fast=too_fast(model, limb.joints, [sample.velocity for sample in samples]),
        deflection=None if rest is None else _hand_deflection(mechanism, limb, phase, rest),
        contact_force=None if rest is None else float(np.linalg.norm(rest.pressure[limb.hand][:3])),
    )


def _largest_load(model: RobotModel, limb: Limb, efforts: Sequence[Array]) -> JointLoad:
    largest = np.max(np.abs(np.array(efforts)), axis=0)
    limit = model.column("effort_max")
    place = int(np.argmax((largest / limit)[limb.joints]))
    joint = int(limb.joints[place])
    return JointLoad(
        limb.joint_names[place], limb.short_names[place], float(largest[joint]), float(limit[joint])
    )


def _hand_deflection(
    mechanism: Mechanism, limb: Limb, phase: PredictedPhase, rest: Rest
) -> Deflection | None:
    """Takes the hand's spring that is stretched farthest."""
    springs = [s for s in phase.modules.arm(limb.name).springs if s.frame == limb.hand]
    if not springs:
        return None
    pose = mechanism.model.pose(rest.q, limb.hand)
    targets = phase.equilibrium.springs
    found = [_deflection(displacement_of(pose, targets[spring.name])) for spring in springs]
    return max(found, key=lambda deflection: deflection.distance)


def _forecast_object(mechanism: Mechanism, targets: Equilibrium, rest: Rest) -> ObjectForecast | None:
    """Gives how far the held object at rest is from its target; None without an object."""
    if targets.object is None:
        return None
    mechanism.update(rest.q, np.zeros_like(rest.q))
    deflection = _deflection(displacement_of(mechanism.object_pose(), targets.object))
    return ObjectForecast(deflection, float((rest.pressure[OBJECT][:3] ** 2).sum() ** 0.5))


def _deflection(offset: Array) -> Deflection:
    return Deflection(float(np.linalg.norm(offset[:3])), float(np.linalg.norm(offset[3:])))


def _notes(phase: PhaseForecast) -> Iterator[str]:
    name = phase.predicted.name
    if phase.predicted.met is False:
        yield f"phase '{name}': what it waits for has not come by the end of its duration"
    if phase.rest is None:
        yield f"phase '{name}': no static equilibrium was found where it ends"
    elif phase.rest.slides_off:
        yield (
            f"phase '{name}': where it rests a round surface falls away faster than the springs hold (N/R outweighs"
            " them): only friction keeps it there"
        )
    if phase.slow is not None:
        yield (
            f"phase '{name}': until it rests {phase.slow.joint} still turns by {phase.slow.angle:.2f} rad, with a time"
            f" constant of {phase.slow.time_constant:.0f} s; the phase ends long before"
        )
    if phase.hinge is not None:
        yield from hinge_notes(name, phase.hinge)
    for what in phase.folds:
        yield f"phase '{name}': '{what}' folds at rest: loads outweigh the springs"
    for arm in phase.arms:
        for joint, angle in arm.beyond.items():
            yield f"phase '{name}': {joint} would leave its range by {angle:.2f} rad; the run's limits stop it"
        for joint, speed in arm.too_fast.items():
            yield f"phase '{name}': {joint} would reach {speed:.2f} rad/s; the run keeps it to its limit, so it lags"
        if arm.total.share > 1.0:
            yield (
                f"phase '{name}': {arm.total.joint} needs {arm.total.torque:.1f} N.m with the arm's own"
                f" weight, its motor gives {arm.total.limit:g} N.m"
            )
    for loop in phase.loops:
        if not loop.stable:
            yield f"'{loop.name}' is predicted to be unstable at this rate and delay: soften it or damp it less"
