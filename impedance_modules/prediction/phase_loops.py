# SPDX-License-Identifier: BSD-3-Clause
"""Whether the loops of a task's phases are stable at its rate and delay; what would be, where they are not."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from impedance_modules.control.assembly import Assembly
from impedance_modules.errors import Problem
from impedance_modules.modules.held_object import OBJECT
from impedance_modules.prediction.loop_stability import StabilityForecast, forecast_stability, loop_growths
from impedance_modules.prediction.mechanism import Mechanism
from impedance_modules.prediction.quasi_static import MotionPrediction, PredictedPhase
from impedance_modules.prediction.statics import Analysed, Rest, analyse_state

RATE_STEP = 1.25
"""Factor from one rate to the next while a stable one is looked for."""

RATE_PRECISION = 1.02
"""Factor between a rate that is stable and one that is not, where the search ends."""


@dataclass(frozen=True)
class PhaseLoops:
    """The loops of phases with the same gains, where the least stable of them is judged.

    Attributes:
        phase: Index of that phase.
        state: Its arms and object where it comes to rest (or ends).
        loops: With its gains, there.
    """

    phase: int
    state: Analysed
    loops: tuple[StabilityForecast, ...]


def judge_loops(
    assembly: Assembly, mechanism: Mechanism, motion: MotionPrediction, rests: Sequence[Rest | None]
) -> tuple[PhaseLoops, ...]:
    """Judges the loops of every phase; phases with the same gains share the judgement of the least stable."""
    worst: dict[bytes, tuple[float, int, Analysed]] = {}
    for index, (phase, rest) in enumerate(zip(motion.phases, rests, strict=True)):
        state = analyse_state(mechanism, phase.setting, phase.q if rest is None else rest.q)
        growth = max(loop_growths(assembly, phase.modules, state.arms, state.held, state.coupled))
        if gains_key(phase) not in worst or growth > worst[gains_key(phase)][0]:
            worst[gains_key(phase)] = growth, index, state
    shared = {
        key: PhaseLoops(
            index,
            state,
            forecast_stability(assembly, motion.phases[index].modules, state.arms, state.held, state.coupled),
        )
        for key, (_, index, state) in worst.items()
    }
    return tuple(shared[gains_key(phase)] for phase in motion.phases)


def gains_key(phase: PredictedPhase) -> bytes:
    """Tells phases with different gains apart."""
    springs = [spring for arm in phase.modules.arms for spring in arm.springs]
    return b"".join(spring.stiffness.tobytes() + spring.damping.tobytes() for spring in springs)


def unstable_loops(
    assembly: Assembly, motion: MotionPrediction, judged: Sequence[PhaseLoops]
) -> Iterator[Problem]:
    """Reports every loop in which an oscillation grows, once for each set of gains, and what would be stable.

    An arm that folds, a motion that grows without swinging, is not reported: no rate would help it.
    """
    for found in {id(one): one for one in judged}.values():
        phase = motion.phases[found.phase]
        for number, loop in enumerate(found.loops):
            if not loop.stable:
                yield assembly.task.document.problem(
                    springs_of_loop(assembly, found.phase, loop.name),
                    _told(assembly, phase, loop),
                    remedies(assembly, phase, found, number),
                )


def springs_of_loop(assembly: Assembly, phase: int, loop: str) -> tuple[str | int, ...]:
    """Finds the task's springs that make a loop: those of the phase, where it changes them, or those of an arm."""
    held = assembly.task.object
    if loop not in (OBJECT, *assembly.task.arms):
        return ("between",)
    limbs = held.held_by if loop == OBJECT and held is not None else (loop,)
    for number in range(phase, -1, -1):
        if any(target.split(".")[0] in limbs for target in assembly.task.phases[number].stiffness):
            return ("phases", number, "stiffness")
    arms = assembly.task.document.data["arms"]
    limb = limbs[0]
    return ("arms", arms[limb].get("mirror", limb), "springs")


def _told(assembly: Assembly, phase: PredictedPhase, loop: StabilityForecast) -> str:
    """Says what grows how fast."""
    delay = 1e3 * assembly.robot.timing.command_delay
    what = "a motion" if loop.frequency is None else f"a motion of {loop.frequency:.1f} Hz"
    return (
        f"the loop of '{loop.name}' is predicted to be unstable at {assembly.rate:g} Hz and {delay:g} ms of delay in"
        f" phase '{phase.name}': {what} grows by {100.0 * (loop.oscillating_growth - 1.0):.2g} % per period"
    )


def remedies(assembly: Assembly, phase: PredictedPhase, judged: PhaseLoops, number: int) -> list[str]:
    """Lists what would be stable: a softer hand, a higher rate; or what an experiment may do."""
    loop, found = judged.loops[number], []
    if loop.scale is not None and 0.0 < loop.scale < 1.0:
        softer = loop.scale * loop.stiffness
        found.append(
            f"at most {softer:.0f} N/m instead of {loop.stiffness:.0f} with all axes in proportion and the same"
            " damping ratio"
        )
    rate = _stable_rate(assembly, phase, judged.state, number)
    if rate is not None:
        found.append(f"--rate {rate:.0f} or more")
    if not found:
        found.append("less damping or softer joint springs")
    return [*found, "run --allow-unstable in simulation"]


def _stable_rate(assembly: Assembly, phase: PredictedPhase, state: Analysed, number: int) -> float | None:
    """Finds a rate [Hz] above the present one from which the loop is stable; None up to the robot's highest."""

    def stable(rate: float) -> bool:
        faster = replace(assembly, rate=rate)
        return forecast_stability(faster, phase.modules, state.arms, state.held, state.coupled)[number].stable

    highest = assembly.robot.timing.rate_max
    low, high = assembly.rate, min(RATE_STEP * assembly.rate, highest)
    while not stable(high):
        if high >= highest:
            return None
        low, high = high, min(RATE_STEP * high, highest)
    while high > RATE_PRECISION * low:
        middle = (low * high) ** 0.5
        low, high = (low, middle) if stable(middle) else (middle, high)
    return math.ceil(high)
