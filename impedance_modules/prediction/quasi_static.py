# SPDX-License-Identifier: BSD-3-Clause
r"""Quasi-static prediction: how a task goes on rigid arms, in large steps, before anything moves.

    (M + I_r) qdd + C + D qd = \tau_modules + contact + weight of the object,      A qd = 0 in the grasps

(thesis eq. 3.12; elastic joints, delay and noise left out). ``implicit_step`` solves for the velocity v_m at the part p
of a step of length h, stable for any h. Then

    q+ = q + h v_m,     v+ = v + (v_m - v) / p

p = 1/2 would lose no energy; p = 1 damps a step in which a point lands on a surface. The modules' torque in the middle
of the step, \tau - s K v_m - D (v_m - v) with s = p h, times q+ - q is the work that the energy tank must pay.
A motion that only repeats itself is integrated for a few periods and then continued.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.control.assembly import Assembly
from impedance_modules.control.set_points import blending_time
from impedance_modules.errors import BadFile
from impedance_modules.modules.arms import TaskModules, with_phase_gains
from impedance_modules.modules.damping import Damping, phase_damping
from impedance_modules.modules.equilibrium import Equilibrium, PhaseMotion, phase_motion, start_equilibrium
from impedance_modules.modules.minimum_jerk import minimum_jerk, minimum_jerk_slope
from impedance_modules.prediction.implicit_step import EquationOfMotion, ImplicitStep
from impedance_modules.prediction.mechanism import Mechanism, Setting
from impedance_modules.prediction.phase_end import ExternalForce, PhaseEnd
from impedance_modules.spec.gripper_spec import GripperCondition
from impedance_modules.spec.task import EQUILIBRIUM, PhaseSpec, SmoothCondition

NOT_PREDICTED = (SmoothCondition, GripperCondition)
"""Conditions whose coming nobody can foretell; the phase is taken to last for its duration."""

MIDDLE = 0.55
"""Part of a step at which forces balance; 1 in steps in which a point meets or leaves a surface."""

SHORTEST_STEP, LONGEST_STEP = 0.025, 0.04
"""Bounds of a step [s]; hands swing with 10 to 20 rad/s."""

RUNAWAY = 100.0
"""A joint that is so many times faster than its limit runs away: what would be predicted after that means nothing."""

STEPS = 200
"""Of a phase that does not oscillate."""

STEPS_PER_PERIOD = 32
"""Of an oscillation."""

STEPS_PER_SUBMOVEMENT, FINEST_STEP = 16, 0.005
"""Of a submovement, and the shortest step that one asks for [s]."""

SETTLING = 3.0
"""Time after which a motion that only repeats itself is taken as periodic [s], or two of its periods."""


@dataclass(frozen=True)
class PredictedPhase:
    """One phase of the prediction.

    Attributes:
        name: Of the phase.
        modules: With its gains.
        damping: Designed at its start.
        motion: Of its equilibria.
        began, ended: When [s].
        clock: Where the phase's clock stopped: ``duration``, or earlier where ``until`` was met [s].
        met: Whether ``until`` was met; None without one, and for one that is not predicted.
        samples: Those of the prediction that belong to it.
        q: (n,) where it ended [rad].
        friction_rest: Where the friction of the object's hinge has slipped to there [rad]; None without a hinge.
    """

    name: str
    modules: TaskModules
    damping: Damping
    motion: PhaseMotion
    began: float
    ended: float
    clock: float
    met: bool | None
    samples: slice
    q: Array
    friction_rest: float | None = None

    @property
    def equilibrium(self) -> Equilibrium:
        """All equilibria where the phase ends."""
        return self.motion.at(self.clock)

    @property
    def setting(self) -> Setting:
        """What pulls where the phase ends."""
        return Setting(self.modules, self.equilibrium, self.damping, self.friction_rest)


@dataclass(frozen=True)
class PredictedSample:
    """The predicted task at one instant; energies count from the start.

    Attributes:
        time: [s].
        q: (n,) [rad].
        velocity: (n,) [rad/s].
        effort: (n,) torque that the modules ask for [N.m].
        potential: U of springs and joint bias [J].
        work: Of that torque on the joints [J].
        kinetic: Of arms, rotors and object [J].
        surface_friction: Lost on surfaces [J].
        motor_friction: Lost in the motors' own friction [J].
        hinge_friction: Lost in friction and damping of the object's hinge [J].
    """

    time: float
    q: Array
    velocity: Array
    effort: Array
    potential: float
    work: float
    kinetic: float
    surface_friction: float
    motor_friction: float
    hinge_friction: float = 0.0


@dataclass(frozen=True)
class MotionPrediction:
    """The quasi-static prediction of a whole task: its phases and samples."""

    phases: tuple[PredictedPhase, ...]
    samples: tuple[PredictedSample, ...]


def predict_motion(assembly: Assembly) -> MotionPrediction:
    """Integrates all phases of a task.

    A phase whose ``until`` is not met within its duration goes on to the next, whatever the task says then. A
    surface that becomes smooth is not predicted: such a phase takes its whole duration.

    Raises:
        BadFile: A joint runs away, with its phase.
    """
    integration = _Integration(assembly)
    phases = []
    for index, spec in enumerate(assembly.task.phases):
        try:
            phases.append(integration.run(spec))
        except _RunsAway as found:
            problem = assembly.task.document.problem(("phases", index), str(found))
            raise BadFile([problem]) from None
    return MotionPrediction(tuple(phases), tuple(integration.samples))


class _RunsAway(Exception):  # noqa: N818 - it is what happens
    """A joint of the prediction runs away; says which and when."""


@dataclass(frozen=True)
class _Running:
    """What stays the same during a phase: modules with its gains, their dampers, how the equilibria move."""

    modules: TaskModules
    damping: Damping
    motion: PhaseMotion
    blend: float | None


class _Integration:
    """State of the prediction; energies [J] count from the start."""

    def __init__(self, assembly: Assembly) -> None:
        self._mechanism = Mechanism(assembly)
        model = assembly.model
        self._motor_damping = np.diag(model.motor_damping[self._mechanism.joints])
        self._fastest = RUNAWAY * model.column("velocity_max")
        self._q, self._v = assembly.modules.posture.copy(), np.zeros(model.n)
        self._modules = assembly.modules
        self._before: _Running | None = None
        self._equilibrium = start_equilibrium(assembly.modules)
        self._implicit = ImplicitStep(self._mechanism)
        self._external = ExternalForce(self._mechanism)
        self._pushed = bool(assembly.task.pushes)
        self._time = self._work = self._surface_friction = self._motor_friction = self._hinge_friction = 0.0
        self.samples: list[PredictedSample] = []

    def run(self, spec: PhaseSpec) -> PredictedPhase:
        """Integrates one phase from where the last one ended."""
        mechanism, first, began = self._mechanism, len(self.samples), self._time
        mechanism.update(self._q, self._v)
        modules = with_phase_gains(self._modules, spec)
        damping = phase_damping(modules, mechanism.kinematics)
        phase = _Running(modules, damping, phase_motion(modules, spec, self._equilibrium), spec.blend)
        clock, met = self._integrate(spec, phase)
        self._modules, self._before = modules, phase
        self._equilibrium = phase.motion.at(clock)
        return PredictedPhase(
            name=spec.name,
            modules=modules,
            damping=damping,
            motion=phase.motion,
            began=began,
            ended=self._time,
            clock=clock,
            met=None if spec.until is None or isinstance(spec.until, NOT_PREDICTED) else met,
            samples=slice(first, len(self.samples)),
            q=self._q.copy(),
            friction_rest=None if self._implicit.hinge is None else self._implicit.hinge.state.friction_rest,
        )

    def _integrate(self, spec: PhaseSpec, phase: _Running) -> tuple[float, bool]:
        """Returns the phase's clock at its end [s], and whether its ``until`` was met."""
        first, clock, met = len(self.samples), 0.0, False
        plan = plan_steps(spec, phase.motion, whole=self._pushed)
        end = PhaseEnd(spec, self._mechanism, self._external, phase.motion)
        while clock < plan.integrated - 1e-9 and not met:
            step = min(plan.step, plan.integrated - clock)
            self._record(phase, clock)
            self._advance(phase, clock, step)
            clock, self._time = clock + step, self._time + step
            self._refuse_runaway(spec.name)
            met = spec.until is not None and end.met(step)
        self._record(phase, clock)
        if not met and plan.repeated > 0.0:
            self._repeat(first, plan.period, plan.repeated)
            clock += plan.repeated
        return clock, met

    def _refuse_runaway(self, phase: str) -> None:
        ratio = np.abs(self._v) / self._fastest
        if np.all(ratio < 1.0):
            return
        worst = int(np.argmax(np.where(np.isfinite(ratio), ratio, np.inf)))
        raise _RunsAway(
            f"the predicted motion runs away in phase '{phase}': {self._mechanism.model.joint_names[worst]} passes"
            f" {RUNAWAY:g} times its speed limit at {self._time:.2f} s (valid: softer springs, more damping, or a"
            " shorter motion)"
        )

    def _advance(self, phase: _Running, clock: float, step: float) -> None:
        """Moves by one step of ``step`` seconds from the sample that was recorded last."""
        mechanism, joints = self._mechanism, self._mechanism.joints
        v, ahead, D = self._v[joints], MIDDLE * step, self._motor_damping
        drift = _effort_rate(mechanism, phase.modules, phase.motion, clock + 0.5 * ahead)
        drift += _damping_rate(mechanism, phase, clock, ahead)
        effort, bias = self.samples[-1].effort[joints] + ahead * drift, mechanism.kinematics.bias[joints]
        stiffness, dampers = mechanism.gains(phase.modules, phase.damping, phase.motion.at(clock))
        now = EquationOfMotion(
            inertia=mechanism.inertia(),
            stiffness=stiffness,
            dampers=dampers + D,
            force=effort - bias - D @ v + mechanism.object_load() + mechanism.push_load(self._time + ahead),
            velocity=v,
        )
        part, middle = self._solve(now, step)
        new, share = v + (middle - v) / part, part * step
        torque = effort - share * stiffness @ middle - dampers @ (middle - v)
        self._work += step * float(torque @ middle)
        self._surface_friction += self._implicit.friction_loss * step / share
        self._motor_friction += step * float(middle @ D @ middle)
        external = mechanism.arm_inertia() @ (new - v) / step + bias + D @ middle - torque
        self._external.update(external, step)
        self._q[joints] += step * middle
        self._v[joints] = new
        mechanism.update(self._q, self._v)
        if (hinge := self._implicit.hinge) is not None:
            hinge.follow(mechanism.hinge_motion()[0], step)
            self._hinge_friction += hinge.loss

    def _solve(self, now: EquationOfMotion, step: float) -> tuple[float, Array]:
        """Finds the part of the step at which forces balance, and the velocity there."""
        middle = self._implicit.solve(now, MIDDLE * step)
        if not (self._implicit.contacts_changed or self._implicit.hinge_holds):
            return MIDDLE, middle
        return 1.0, self._implicit.solve(now, step)

    def _record(self, phase: _Running, clock: float) -> None:
        """Keeps torque and energies at the present state."""
        effort, potential = self._module_efforts(phase, clock)
        v = self._v[self._mechanism.joints]
        kinetic = 0.5 * float(v @ self._mechanism.inertia() @ v) if np.any(v) else 0.0
        self.samples.append(
            PredictedSample(
                time=self._time,
                q=self._q.copy(),
                velocity=self._v.copy(),
                effort=effort,
                potential=potential,
                work=self._work,
                kinetic=kinetic,
                surface_friction=self._surface_friction,
                motor_friction=self._motor_friction,
                hinge_friction=self._hinge_friction,
            )
        )

    def _module_efforts(self, phase: _Running, clock: float) -> tuple[Array, float]:
        """Sums the modules' torque and energy, a phase's gains coming in by minimum jerk."""
        mechanism, targets = self._mechanism, phase.motion.at(clock)
        blending = blending_time(phase.blend, phase.motion.duration)
        part = 1.0 if clock >= blending else minimum_jerk(clock / blending)
        share = part if self._before is None else 1.0
        setting = Setting(phase.modules, targets, phase.damping, motion=phase.motion, clock=clock)
        effort, energy = mechanism.module_efforts(setting, self._q, self._v, force_share=share)
        if part == 1.0 or self._before is None:
            return effort, energy
        before = replace(setting, modules=self._before.modules, damping=self._before.damping)
        old_effort, old_energy = mechanism.module_efforts(before, self._q, self._v)
        return old_effort + part * (effort - old_effort), old_energy + part * (energy - old_energy)

    def _repeat(self, first: int, period: float, seconds: float) -> None:
        """Continues a motion that repeats itself: what its last period did, it goes on doing."""
        last = self.samples[-1]
        since = next(s for s in self.samples[first:] if s.time >= last.time - period - 1e-9)
        share = seconds / max(last.time - since.time, 1e-9)
        self._time += seconds
        self._work += share * (last.work - since.work)
        self._surface_friction += share * (last.surface_friction - since.surface_friction)
        self._motor_friction += share * (last.motor_friction - since.motor_friction)
        self._hinge_friction += share * (last.hinge_friction - since.hinge_friction)
        self.samples.append(
            replace(
                last,
                time=self._time,
                work=self._work,
                surface_friction=self._surface_friction,
                motor_friction=self._motor_friction,
                hinge_friction=self._hinge_friction,
            )
        )


def _effort_rate(mechanism: Mechanism, modules: TaskModules, motion: PhaseMotion, clock: float) -> Array:
    """Gives how fast the torque grows because the equilibria move, (k,) [N.m/s]."""
    found = np.zeros(mechanism.k)
    slope = minimum_jerk_slope(clock / motion.duration) / motion.duration
    for limb, goal in motion.goals.items():
        bias = modules.arm(limb).bias
        if bias is not None:
            found[mechanism.parts[limb]] += bias.stiffness * (goal - motion.start.rests[limb]) * slope
    if not motion.moved:
        return found
    twists = motion.velocities(clock)
    for arm in modules.arms:
        for spring in arm.springs:
            if np.any(twists[spring.name]):
                pull = spring.world_stiffness @ twists[spring.name]
                found += mechanism.jacobian(spring.frame).T @ pull
    if any(spring.name in motion.moved for spring in modules.between):
        jacobians = mechanism.relative_jacobians(modules, motion.at(clock))
        for between, J in zip(modules.between, jacobians, strict=True):
            found += J.T @ between.spec.stiffness @ twists[between.name]
    return found


def _damping_rate(mechanism: Mechanism, phase: _Running, clock: float, ahead: float) -> Array:
    """Gives how fast the torque of dampers grows that count from an equilibrium on its way, (k,) [N.m/s]."""
    found = np.zeros(mechanism.k)
    moving = [
        spring
        for arm in phase.modules.arms
        for spring in arm.springs
        if spring.spec.damping_against == EQUILIBRIUM
    ]
    if moving and phase.motion.moved:
        now, then = phase.motion.velocities(clock), phase.motion.velocities(clock + ahead)
        for spring in moving:
            change = phase.damping.of_spring(spring) @ (then[spring.name] - now[spring.name])
            found += mechanism.jacobian(spring.frame).T @ change / ahead
    return found


@dataclass(frozen=True)
class StepPlan:
    """Steps of one phase.

    Attributes:
        step: Length of a step [s].
        integrated: Time that is integrated [s].
        repeated: Time that only repeats what was integrated [s].
        period: Over which it repeats [s].
    """

    step: float
    integrated: float
    repeated: float
    period: float


def plan_steps(phase: PhaseSpec, motion: PhaseMotion, *, whole: bool) -> StepPlan:
    """Divides a phase; one that waits for something, or must be integrated ``whole``, is not cut short."""
    waves = np.concatenate([np.zeros(0), *(m.frequency[m.amplitude != 0.0] for m in motion.moved.values())])
    step = min(max(phase.duration / STEPS, SHORTEST_STEP), LONGEST_STEP)
    period = 1.0
    if waves.size:
        step = min(step, 1.0 / (STEPS_PER_PERIOD * float(np.max(waves))))
        period = 1.0 / float(np.min(waves))
    moving = [part for moved in motion.moved.values() for part in moved.submovements if part.moves]
    if moving:
        shortest = min(part.duration for part in moving)
        step = min(step, max(shortest / STEPS_PER_SUBMOVEMENT, FINEST_STEP))
    paths = [moved.path for moved in motion.moved.values() if moved.path is not None and moved.path.moves]
    if paths:
        step = min(step, SHORTEST_STEP)
    over = max([0.0, *(part.end for part in moving), *(path.end for path in paths)])
    repeats_after = over + max(SETTLING, 2.0 * period) + period
    if whole or phase.until is not None or _travels(motion) or phase.duration <= repeats_after:
        return StepPlan(step, phase.duration, 0.0, period)
    return StepPlan(step, repeats_after, phase.duration - repeats_after, period)


def _travels(motion: PhaseMotion) -> bool:
    """Tells whether anything goes to a new place during the whole phase."""
    if any(np.any(goal != motion.start.rests[limb]) for limb, goal in motion.goals.items()):
        return True
    for moved in motion.moved.values():
        first, last = moved.end_vectors()
        if np.any(moved.goal[:3] != moved.start.translation) or np.any(np.abs(last - first) > 1e-12):
            return True
    return False
