# SPDX-License-Identifier: BSD-3-Clause
r"""A task predicted on the rigid arms, in large steps, before anything moves.

    (M + I_r) qdd + C + D qd = \tau_modules + contact + weight of the object,      A qd = 0 in the grasps

(thesis eq. 3.12; elastic joints, delay and noise left out). A linearly implicit step, stable for any length h, finds
the velocity v_m at the part p of the step from stiffness K and dampers D of springs and surfaces, s = p h:

    (M + s D + s^2 K) (v_m - v) = s (\tau - s K v),     A v_m = -(disagreement of the hands) / s
    q+ = q + h v_m,     v+ = v + (v_m - v) / p

p = 1/2 would lose no energy, p = 1 lets a landing point stay down. The modules' torque in the middle of the step,
\tau - s K v_m - D (v_m - v), times q+ - q is the work that the energy tank must pay.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impedance_modules.control.assembly import Assembly
from impedance_modules.modules.arms import TaskModules, with_phase_gains
from impedance_modules.modules.damping import Damping, phase_damping
from impedance_modules.modules.equilibrium import Equilibrium, PhaseMotion, phase_motion, start_equilibrium
from impedance_modules.modules.pose_motion import minimum_jerk, minimum_jerk_slope
from impedance_modules.prediction.implicit_step import Motion, Pressing
from impedance_modules.prediction.mechanism import Mechanism, Setting
from impedance_modules.prediction.phase_end import Feel, PhaseEnd
from impedance_modules.spec.task import PhaseSpec, SmoothCondition

Array = NDArray[np.float64]

MIDDLE = 0.55
"""Part of a step at which forces balance; 1 in steps in which a point meets or leaves a surface."""

BLENDING = 0.5
"""Gains of a phase come in over this time [s], as in the run (``control.gains``, which needs the compiler)."""


def predict_motion(assembly: Assembly) -> MotionPrediction:
    """Goes through all phases of a task.

    A phase whose ``until`` is not met within its duration goes on to the next, whatever the task says then. A
    surface that becomes smooth is not predicted: such a phase takes its whole duration.
    """
    stage = _Stage(assembly)
    phases = tuple(stage.play(phase) for phase in assembly.task.phases)
    return MotionPrediction(phases, tuple(stage.samples))


class _Stage:
    """The moving state of a motion."""

    def __init__(self, assembly: Assembly) -> None:
        self._mechanism = Mechanism(assembly)
        model = assembly.model
        self._motor_damping = np.diag(model.column("motor_damping")[self._mechanism.joints])
        self._q, self._v = assembly.modules.posture.copy(), np.zeros(model.n)
        self._modules = assembly.modules
        self._old: tuple[TaskModules, Damping] | None = None
        self._equilibrium = start_equilibrium(assembly.modules)
        self._pressing = Pressing(self._mechanism)
        self._feel = Feel(self._mechanism)
        self._pushed = bool(assembly.task.pushes)
        self._time = self._work = self._rubbed = self._friction = 0.0
        self.samples: list[PredictedSample] = []

    def play(self, phase: PhaseSpec) -> PredictedPhase:
        """Rehearses one phase from where the last one ended."""
        mechanism, first = self._mechanism, len(self.samples)
        mechanism.update(self._q, self._v)
        modules = with_phase_gains(self._modules, phase)
        damping = phase_damping(modules, mechanism.kinematics)
        motion = phase_motion(modules, phase, self._equilibrium)
        began, clock = self._time, 0.0
        plan = plan_steps(phase, motion, whole=self._pushed)
        end, met = PhaseEnd(phase, mechanism, self._feel, motion), False
        while clock < plan.predicted - 1e-9 and not met:
            step = min(plan.step, plan.predicted - clock)
            self._advance(modules, damping, motion, clock, step)
            clock, self._time = clock + step, self._time + step
            met = phase.until is not None and end.met(step)
        self._record(modules, damping, motion, clock)
        if not met and plan.skipped > 0.0:
            self._skip(first, plan.period, plan.skipped)
            clock += plan.skipped
        self._modules, self._old = modules, (modules, damping)
        self._equilibrium = motion.at(clock)
        return PredictedPhase(
            name=phase.name,
            modules=modules,
            damping=damping,
            motion=motion,
            began=began,
            ended=self._time,
            clock=clock,
            met=None if phase.until is None or isinstance(phase.until, SmoothCondition) else met,
            samples=slice(first, len(self.samples)),
            q=self._q.copy(),
        )

    def _advance(
        self, modules: TaskModules, damping: Damping, motion: PhaseMotion, clock: float, step: float
    ) -> None:
        """Solves for one step of ``step`` seconds."""
        mechanism, joints = self._mechanism, self._mechanism.joints
        self._record(modules, damping, motion, clock)
        v, ahead = self._v[joints], MIDDLE * step
        effort = self.samples[-1].effort[joints] + ahead * _drift(
            mechanism, modules, motion, clock + 0.5 * ahead
        )
        bias = mechanism.kinematics.bias[joints]
        stiffness, dampers = mechanism.gains(modules, damping)
        motion_now = Motion(
            inertia=mechanism.inertia(),
            stiffness=stiffness,
            dampers=dampers + self._motor_damping,
            force=effort
            - bias
            - self._motor_damping @ v
            + mechanism.object_load()
            + mechanism.push_load(self._time + ahead),
            velocity=v,
        )
        part, middle = self._solve(motion_now, step)
        new, share = v + (middle - v) / part, part * step
        worked = effort - share * stiffness @ middle - dampers @ (middle - v)
        self._work += step * float(worked @ middle)
        self._rubbed += self._pressing.rubbed * step / share
        self._friction += step * float(middle @ self._motor_damping @ middle)
        external = mechanism.arm_inertia() @ (new - v) / step + bias + self._motor_damping @ middle - worked
        self._feel.update(external, step)
        self._q[joints] += step * middle
        self._v[joints] = new
        mechanism.update(self._q, self._v)

    def _solve(self, now: Motion, step: float) -> tuple[float, Array]:
        """Finds the part of the step at which forces balance, and the velocity there."""
        middle = self._pressing.solve(now, MIDDLE * step)
        if not self._pressing.changed:
            return MIDDLE, middle
        return 1.0, self._pressing.solve(now, step)

    def _record(self, modules: TaskModules, damping: Damping, motion: PhaseMotion, clock: float) -> None:
        """Notes torque and energies at the present state."""
        effort, potential = self._modules_at(modules, damping, motion, clock)
        v = self._v[self._mechanism.joints]
        kinetic = 0.5 * float(v @ self._mechanism.inertia() @ v) if np.any(v) else 0.0
        self.samples.append(
            PredictedSample(
                self._time,
                self._q.copy(),
                effort,
                potential,
                self._work,
                kinetic,
                self._rubbed,
                self._friction,
            )
        )

    def _modules_at(
        self, modules: TaskModules, damping: Damping, motion: PhaseMotion, clock: float
    ) -> tuple[Array, float]:
        """Sums the modules' torque and energy, a phase's gains coming in by minimum jerk."""
        mechanism, targets = self._mechanism, motion.at(clock)
        terms = mechanism.module_efforts(Setting(modules, targets, damping), self._q, self._v)
        blending = min(BLENDING, motion.duration)
        if clock >= blending:
            return terms.effort, terms.energy
        part = minimum_jerk(clock / blending)
        if self._old is None:
            forces = [term.effort for term in terms.parts if term.kind == "force"]
            return terms.effort - (1.0 - part) * np.sum(
                [np.zeros_like(self._q), *forces], axis=0
            ), terms.energy
        old_modules, old_damping = self._old
        old = mechanism.module_efforts(Setting(old_modules, targets, old_damping), self._q, self._v)
        effort = old.effort + part * (terms.effort - old.effort)
        return effort, old.energy + part * (terms.energy - old.energy)

    def _skip(self, first: int, period: float, skipped: float) -> None:
        """Continues a motion that repeats itself: what its last period did, it goes on doing."""
        last = self.samples[-1]
        since = next(s for s in self.samples[first:] if s.time >= last.time - period - 1e-9)
        share = skipped / max(last.time - since.time, 1e-9)
        self._time += skipped
        self._work += share * (last.work - since.work)
        self._rubbed += share * (last.rubbed - since.rubbed)
        self._friction += share * (last.friction - since.friction)
        self.samples.append(
            PredictedSample(
                self._time,
                last.q,
                last.effort,
                last.potential,
                self._work,
                last.kinetic,
                self._rubbed,
                self._friction,
            )
        )


def _drift(mechanism: Mechanism, modules: TaskModules, motion: PhaseMotion, clock: float) -> Array:
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
    return found


FINEST, COARSEST = 0.025, 0.04
"""Bounds of a step [s]; hands swing with 10 to 20 rad/s."""

STEPS = 200
"""Of a phase that does not oscillate."""

STEPS_PER_PERIOD = 32
"""Of an oscillation."""

SETTLING = 3.0
"""Time after which a motion that only repeats itself is taken as periodic [s], or two of its periods."""


@dataclass(frozen=True)
class StepPlan:
    """Steps of one phase.

    Attributes:
        step: Length of a step [s].
        predicted: Time that is predicted [s].
        skipped: Time that only repeats what was predicted [s].
        period: Over which it repeats [s].
    """

    step: float
    predicted: float
    skipped: float
    period: float


def plan_steps(phase: PhaseSpec, motion: PhaseMotion, *, whole: bool) -> StepPlan:
    """Divides a phase; one that waits for something, or must be predicted ``whole``, is not cut short."""
    waves = np.concatenate([np.zeros(0), *(m.frequency[m.amplitude != 0.0] for m in motion.moved.values())])
    step = min(max(phase.duration / STEPS, FINEST), COARSEST)
    period = 1.0
    if waves.size:
        step = min(step, 1.0 / (STEPS_PER_PERIOD * float(np.max(waves))))
        period = 1.0 / float(np.min(waves))
    repeats_after = max(SETTLING, 2.0 * period) + period
    if whole or phase.until is not None or _travels(motion) or phase.duration <= repeats_after:
        return StepPlan(step, phase.duration, 0.0, period)
    return StepPlan(step, repeats_after, phase.duration - repeats_after, period)


def _travels(motion: PhaseMotion) -> bool:
    """Tells whether anything goes to a new place during the whole phase."""
    if any(np.any(goal != motion.start.rests[limb]) for limb, goal in motion.goals.items()):
        return True
    for moved in motion.moved.values():
        first, last = moved.triples()
        if np.any(moved.goal[:3] != moved.start.translation) or np.any(np.abs(last - first) > 1e-12):
            return True
    return False


@dataclass(frozen=True)
class PredictedPhase:
    """One phase as it was predicted.

    Attributes:
        name: Of the phase.
        modules: With its gains.
        damping: Designed at its start.
        motion: Of its equilibria.
        began, ended: When [s].
        clock: Where the phase's clock stopped: ``duration``, or earlier where ``until`` was met [s].
        met: Whether ``until`` was met; None without one.
        samples: Rows of the motion that belong to it.
        q: (n,) where it ended [rad].
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

    @property
    def equilibrium(self) -> Equilibrium:
        """All equilibria where the phase ends."""
        return self.motion.at(self.clock)

    @property
    def setting(self) -> Setting:
        """What pulls where the phase ends."""
        return Setting(self.modules, self.equilibrium, self.damping)


@dataclass(frozen=True)
class PredictedSample:
    """The predicted task at one instant; energies count from the start.

    Attributes:
        time: [s].
        q: (n,) [rad].
        effort: (n,) torque that the modules ask for [N.m].
        potential: U of springs and joint bias [J].
        work: Of that torque on the joints [J].
        kinetic: Of arms, rotors and object [J].
        rubbed: Lost on surfaces [J].
        friction: Lost in the motors' own friction [J].
    """

    time: float
    q: Array
    effort: Array
    potential: float
    work: float
    kinetic: float
    rubbed: float
    friction: float


@dataclass(frozen=True)
class Rest:
    """A static equilibrium.

    Attributes:
        q: (n,) [rad].
        effort: (n,) torque that the modules command [N.m].
        pressure: Hand frame or ``object`` -> (6,) of the surfaces on it, at its origin, world axes [N, N.m].
    """

    q: Array
    effort: Array
    pressure: Mapping[str, Array]


@dataclass(frozen=True)
class MotionPrediction:
    """A whole task, predicted: its phases and samples."""

    phases: tuple[PredictedPhase, ...]
    samples: tuple[PredictedSample, ...]
