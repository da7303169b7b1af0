# SPDX-License-Identifier: BSD-3-Clause
r"""Loops that are unstable for a while as the arms move: how far an oscillation grows before it decays again.

Where it grows by the factor g(q) per control period T, an oscillation of amplitude a becomes in the time dt

    a(t + dt) = g(q)^(dt / T) a(t),     and never less than it was at first

A moment at an unstable posture is no harm: noise grows there by little, and what it became decays.
"""

from __future__ import annotations

import itertools
import math
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from impedance_modules.control.assembly import Assembly
from impedance_modules.errors import Problem
from impedance_modules.prediction.loop_stability import forecast_stability, loop_growths
from impedance_modules.prediction.mechanism import Mechanism, Setting
from impedance_modules.prediction.phase_loops import PhaseLoops, gains_key, remedies, springs_of_loop
from impedance_modules.prediction.quasi_static import MotionPrediction, PredictedPhase, PredictedSample
from impedance_modules.prediction.statics import Analysed, analyse_state

LARGEST_AMPLIFICATION = 100.0
"""How far an oscillation may grow: from the noise of a measured velocity to half of a joint's speed limit."""

SAME_POSTURE = 0.1
"""Size of a box in joint angles in which a loop counts as the same [rad]."""


@dataclass(frozen=True)
class Passage:
    """An oscillation that grows by `LARGEST_AMPLIFICATION` on the way.

    Attributes:
        number: Of its loop, as ``forecast_stability`` lists them.
        phase: Index of the phase in which it has grown so far.
        time: When it has [s].
        fastest: Where on the way it grows fastest.
    """

    number: int
    phase: int
    time: float
    fastest: PredictedSample


def find_passages(assembly: Assembly, mechanism: Mechanism, motion: MotionPrediction) -> tuple[Passage, ...]:
    """Finds the loops whose oscillation grows too far on the predicted way, one passage for each."""
    growths, amplitudes = _Growths(assembly, mechanism), defaultdict[int, _Amplitude](_Amplitude)
    for index, phase in enumerate(motion.phases):
        for now, after in itertools.pairwise(motion.samples[phase.samples]):
            periods = (after.time - now.time) * assembly.rate
            for number, growth in enumerate(growths.at(phase, now)):
                amplitudes[number].go_on(growth, periods, now)
                if amplitudes[number].found is None and amplitudes[number].size > LARGEST_AMPLIFICATION:
                    amplitudes[number].found = Passage(
                        number, index, after.time, amplitudes[number].fastest or now
                    )
    return tuple(amplitude.found for amplitude in amplitudes.values() if amplitude.found is not None)


def passage_problems(assembly: Assembly, mechanism: Mechanism, motion: MotionPrediction) -> Iterator[Problem]:
    """Reports every oscillation that grows too far on the way, and what would be stable."""
    for passage in find_passages(assembly, mechanism, motion):
        phase = motion.phases[passage.phase]
        state = _state(mechanism, phase, passage.fastest)
        loops = forecast_stability(assembly, phase.modules, state.arms, state.held, state.coupled)
        loop = loops[passage.number]
        yield assembly.task.document.problem(
            springs_of_loop(assembly, passage.phase, loop.name),
            f"the loop of '{loop.name}' is predicted to be unstable on the way: at {assembly.rate:g} Hz an oscillation"
            f" has grown {LARGEST_AMPLIFICATION:g}-fold at {passage.time:.2f} s, in phase '{phase.name}',"
            " before its rest is reached",
            remedies(assembly, phase, PhaseLoops(passage.phase, state, loops), passage.number),
        )


def _state(mechanism: Mechanism, phase: PredictedPhase, sample: PredictedSample) -> Analysed:
    """Arms and object on the way, with the equilibria of that moment: those of the phase's end stretch its springs."""
    targets = phase.motion.at(min(sample.time - phase.began, phase.clock))
    return analyse_state(mechanism, Setting(phase.modules, targets, phase.damping), sample.q, at_rest=False)


@dataclass
class _Amplitude:
    """Amplitude of one loop's oscillation over what it was at first, and where on the way it grew fastest."""

    size: float = 1.0
    growth: float = 1.0
    fastest: PredictedSample | None = None
    found: Passage | None = None

    def go_on(self, growth: float, periods: float, sample: PredictedSample) -> None:
        """Lets it grow or decay at one posture."""
        if growth > self.growth or self.size == 1.0:
            self.growth, self.fastest = growth, sample
        self.size = max(1.0, self.size * math.exp(min(periods * math.log(max(growth, 0.1)), 100.0)))


class _Growths:
    """Growth per period of every loop, once for each box of postures."""

    def __init__(self, assembly: Assembly, mechanism: Mechanism) -> None:
        self._assembly, self._mechanism = assembly, mechanism
        self._known: dict[tuple[bytes, bytes], tuple[float, ...]] = {}

    def at(self, phase: PredictedPhase, sample: PredictedSample) -> tuple[float, ...]:
        """Gives them in the order of ``forecast_stability``."""
        key = gains_key(phase), np.round(sample.q / SAME_POSTURE).tobytes()
        if key not in self._known:
            state = _state(self._mechanism, phase, sample)
            self._known[key] = loop_growths(
                self._assembly, phase.modules, state.arms, state.held, state.coupled
            )
        return self._known[key]
