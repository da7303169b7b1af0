# SPDX-License-Identifier: BSD-3-Clause
r"""What compensating a patch's effects costs along a task's predicted motion: torque, and energy of the tank.

Motion and contact are predicted as if the effects were not there: what is compensated takes them back. The command is

    \tau_cmd = \tau + \tau_c,      booked as  \sum_joints max(s_- W_i, s_+ W_i),      W_i = \int \tau_cmd,i dq_i

of which the tank does not pay what has a potential, U_c(q) - U_c(q_0). The rest is friction along the desired motion, a
drive that gives too little, and how far its gain is unknown.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.control.assembly import Assembly
from impedance_modules.control.compensator import Compensator, compensator_of
from impedance_modules.effects.compensate import CompensatedEffect
from impedance_modules.effects.compensation_builder import CompensationNumbers
from impedance_modules.modules.compensation import compensate, compensation_energy
from impedance_modules.modules.equilibrium_velocity import follow_equilibrium
from impedance_modules.modules.sum import lay_out, write_equilibrium, write_gains
from impedance_modules.prediction.mechanism import Mechanism
from impedance_modules.prediction.quasi_static import (
    MotionPrediction,
    PredictedPhase,
    PredictedSample,
    plan_steps,
)
from impedance_modules.prediction.statics import Rest


@dataclass(frozen=True)
class EffectCost:
    """What one effect costs.

    Attributes:
        effect: The effect.
        joint: On which it takes the largest share of the torque limit.
        torque: There [N.m].
        limit: Of that joint's motor [N.m].
        drawn: What the tank pays for it over the whole task, at the worst moment [J].
        given: What its potential holds at the start, which the claim of passivity counts [J].
    """

    effect: CompensatedEffect
    joint: str
    torque: float
    limit: float
    drawn: float
    given: float


@dataclass(frozen=True)
class CompensationForecast:
    """What is compensated along a predicted motion of m samples.

    Attributes:
        effort: (m, n) added to what the other modules ask for [N.m].
        drawn: (m,) what the tank has paid for it [J].
        at_rest: Of each phase, (n,) added where it comes to rest [N.m]; None without a rest.
        costs: Of each effect.
    """

    effort: Array
    drawn: Array
    at_rest: tuple[Array | None, ...]
    costs: tuple[EffectCost, ...]

    def strongest(self, joint: str) -> CompensatedEffect | None:
        """Finds the effect that asks the most torque of a joint; None where none has its largest share there."""
        there = [cost for cost in self.costs if cost.joint == joint]
        return max(there, key=lambda cost: cost.torque).effect if there else None


def forecast_compensation(
    assembly: Assembly, mechanism: Mechanism, motion: MotionPrediction, rests: Sequence[Rest | None]
) -> CompensationForecast | None:
    """Follows what is compensated along a predicted motion; None where nothing is."""
    found = assembly.compensation
    if found is None:
        return None
    modules, samples = assembly.modules, motion.samples
    total = compensator_of(found, modules, assembly.period)
    velocities = _desired_velocities(assembly, mechanism, motion, total)
    effort, held = _along(total, samples, velocities)
    work = _Quadrature(assembly, motion)
    alone: list[EffectCost] = []
    for effect in found.effects:
        own = Compensator(found.model, effect.numbers, modules=modules, period=assembly.period)
        alone.append(_cost(assembly, effect, own, (samples, velocities, work)))
    return CompensationForecast(
        effort=effort,
        drawn=work.drawn(effort, held, found.numbers),
        at_rest=tuple(None if rest is None else _at_rest(total, rest) for rest in rests),
        costs=tuple(alone),
    )


def _desired_velocities(
    assembly: Assembly, mechanism: Mechanism, motion: MotionPrediction, total: Compensator
) -> Array:
    """Gives the desired joint velocity at every sample, (m, n) [rad/s], by the law of the control loop."""
    laid_out = lay_out(assembly.modules, assembly.model.n, total.record)
    follower, velocities = total.record.motion, np.zeros((len(motion.samples), assembly.model.n))
    for phase in motion.phases:
        write_gains(laid_out, phase.modules, phase.damping)
        for index in range(phase.samples.start, phase.samples.stop):
            sample = motion.samples[index]
            since = sample.time - motion.samples[max(index - 1, 0)].time
            if since > 0.0 or not follower.known:
                follower.period = since
                mechanism.update(sample.q, sample.velocity)
                targets = phase.motion.at(min(sample.time - phase.began, phase.clock))
                write_equilibrium(laid_out, phase.modules, targets)
                follow_equilibrium(follower, laid_out.springs, laid_out.bias, mechanism.kinematics.arms)
            velocities[index] = follower.velocity
    return velocities


def _along(
    compensator: Compensator, samples: Sequence[PredictedSample], velocities: Array
) -> tuple[Array, Array]:
    """Gives the torque that is added at every sample, and its part with a potential, (m, n) each [N.m]."""
    record = compensator.record
    effort, held = np.zeros_like(velocities), np.zeros_like(velocities)
    for index, sample in enumerate(samples):
        compensator.update(sample.q)
        record.motion.velocity[:] = velocities[index]
        compensate(record, sample.effort, sample.q, 1.0)
        effort[index], held[index] = record.effort, record.held
    return effort, held


def _at_rest(compensator: Compensator, rest: Rest) -> Array:
    compensator.update(rest.q)
    compensator.record.motion.velocity[:] = 0.0
    compensate(compensator.record, rest.effort, rest.q, 1.0)
    return compensator.record.effort.copy()


class _Quadrature:
    """Work of torques along the predicted motion; a part that repeats itself goes on as its last period did."""

    def __init__(self, assembly: Assembly, motion: MotionPrediction) -> None:
        self._samples = motion.samples
        self._efforts = np.array([sample.effort for sample in motion.samples])
        self._steps = np.diff(np.array([sample.q for sample in motion.samples]), axis=0)
        self._repeats: list[tuple[int, int, float]] = []
        for spec, phase in zip(assembly.task.phases, motion.phases, strict=True):
            plan = plan_steps(spec, phase.motion, whole=bool(assembly.task.pushes))
            repeat = _repeat(motion, phase, plan.period)
            if repeat is not None:
                self._repeats.append(repeat)

    def drawn(self, effort: Array, held: Array, numbers: CompensationNumbers) -> Array:
        """Gives what the tank has paid for an added torque (m, n), of which a part (m, n) has a potential [J]."""
        work = self._work(self._efforts + effort)
        booked = numbers.least_gain * work + (numbers.most_gain - numbers.least_gain) * np.maximum(work, 0.0)
        return np.asarray(np.sum(booked - self._work(self._efforts + held), axis=1))

    def _work(self, torque: Array) -> Array:
        """Integrates torques (m, n) along the motion, (m, n) [J]."""
        steps = 0.5 * (torque[1:] + torque[:-1]) * self._steps
        for last, first, share in self._repeats:
            steps[last - 1] += share * np.sum(steps[first : last - 1], axis=0)
        return np.concatenate([np.zeros((1, torque.shape[1])), np.cumsum(steps, axis=0)])


def _repeat(motion: MotionPrediction, phase: PredictedPhase, period: float) -> tuple[int, int, float] | None:
    """Finds the last sample of a phase that stands for many periods, the first of the last one, and how many."""
    last = phase.samples.stop - 1
    since, until = motion.samples[last - 1].time, motion.samples[last].time
    if phase.samples.start >= last or until - since <= period:
        return None
    indices = range(phase.samples.start, last)
    first = next(i for i in indices if motion.samples[i].time >= since - period - 1e-9)
    spent = since - motion.samples[first].time
    return last, first, (until - since) / max(spent, 1e-9)


def _cost(
    assembly: Assembly,
    effect: CompensatedEffect,
    own: Compensator,
    along: tuple[Sequence[PredictedSample], Array, _Quadrature],
) -> EffectCost:
    """Sums up one effect as if it were the only one."""
    samples, velocities, work = along
    effort, held = _along(own, samples, velocities)
    limit, largest = assembly.limits.effort_max, np.max(np.abs(effort), axis=0)
    worst = int(np.argmax(largest / limit))
    own.update(samples[0].q)
    return EffectCost(
        effect=effect,
        joint=assembly.model.joint_names[worst],
        torque=float(largest[worst]),
        limit=float(limit[worst]),
        drawn=float(np.max(work.drawn(effort, held, effect.numbers))),
        given=float(compensation_energy(own.record, samples[0].q)) if effect.has_potential else 0.0,
    )


def commanded(
    motion: MotionPrediction, compensation: CompensationForecast | None, phase: PredictedPhase
) -> list[Array]:
    """Lists the commanded torque (n,) at every sample of a phase [N.m]."""
    efforts = [sample.effort for sample in motion.samples[phase.samples]]
    if compensation is None:
        return efforts
    return [effort + added for effort, added in zip(efforts, compensation.effort[phase.samples], strict=True)]


def effort_at_rest(rest: Rest, compensation: CompensationForecast | None, phase: int) -> Array:
    """Gives the commanded torque (n,) where a phase comes to rest [N.m]."""
    added = None if compensation is None else compensation.at_rest[phase]
    return rest.effort if added is None else np.asarray(rest.effort + added)
