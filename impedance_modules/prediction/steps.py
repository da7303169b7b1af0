# SPDX-License-Identifier: BSD-3-Clause
"""How finely a phase is rehearsed, and how much of one that only repeats itself."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from impedance_modules.modules.equilibrium import PhaseMotion
from impedance_modules.spec.task import PhaseSpec

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
        rehearsed: Time that is rehearsed [s].
        skipped: Time that only repeats what was rehearsed [s].
        period: Over which it repeats [s].
    """

    step: float
    rehearsed: float
    skipped: float
    period: float


def plan_steps(phase: PhaseSpec, motion: PhaseMotion, *, whole: bool) -> StepPlan:
    """Divides a phase; one that waits for something, or must be rehearsed ``whole``, is not cut short."""
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
