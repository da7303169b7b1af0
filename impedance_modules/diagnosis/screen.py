# SPDX-License-Identifier: BSD-3-Clause
r"""A first look at all candidates: what each would gain in the sample, the nuisance and the model refitted.

With r and S the candidate's part of the normal equations after everything else is eliminated (a Schur
complement), its coefficients are S^{-1} r and its gain about r^T S^{-1} r / 2.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impedance_modules.diagnosis.design import Slot
from impedance_modules.diagnosis.fit import against, steady_shift, sum_gram
from impedance_modules.diagnosis.trial import Bench

Array = NDArray[np.float64]

COLLINEAR = 1e-4
"""A candidate of which less than this is left after elimination says nothing new."""

SLACK = 1.0
"""Standard deviations by which a coefficient may lie outside its physical bounds."""


@dataclass(frozen=True, eq=False)
class Look:
    """A candidate's first look.

    Attributes:
        slot: The candidate.
        gain: About the log-likelihood it would add [nats].
        power: About the residual power it would explain, in units of the noise floor.
        physical: Whether its coefficients keep the physical bounds.
    """

    slot: Slot
    gain: float
    power: float
    physical: bool


def screen(bench: Bench) -> list[Look]:
    """Looks at all candidates that the model does not hold yet, best first."""
    held = {slot.shaped.key for slot in bench.model}
    looks = [_look(bench, slot) for slot in bench.design.slots if slot.shaped.key not in held]
    return sorted((look for look in looks if look is not None), key=lambda look: -look.gain)


def _look(bench: Bench, slot: Slot) -> Look | None:
    design, base = bench.design, bench.whole
    cross, own, right = against(design, bench.fitted, slot, base, bench.weights)
    schur = own - cross @ base.inverse @ cross.T
    seen = np.diag(schur) > COLLINEAR * np.diag(own)
    if not seen.all():
        return None
    inverse = np.linalg.pinv(schur + np.diag(slot.precision), hermitian=True)
    fixed = 0.0
    if slot.fixed is not None:
        shift = steady_shift(design, bench.fitted, slot, bench.weights)
        fixed = _steady_gain(bench, slot)
        right = right - shift
    coefficients = inverse @ right
    spread = np.sqrt(np.clip(np.diag(inverse), 0.0, None)) * SLACK
    lower, upper = slot.shaped.lower * slot.scale, slot.shaped.upper * slot.scale
    physical = bool(np.all(coefficients > lower - spread) and np.all(coefficients < upper + spread))
    gain = 0.5 * float(right @ coefficients) + fixed
    touched = list(slot.groups)
    lift = float(np.max(1.0 / (bench.weights[touched] * bench.floor.rms[touched] ** 2)))
    return Look(slot, _saturated(gain, bench, slot), 2.0 * gain * lift, physical)


def _steady_gain(bench: Bench, slot: Slot) -> float:
    """What the part without a coefficient gains by itself [nats]."""
    gain = 0.0
    for group in slot.groups:
        ids = bench.design.ids[group]
        steady = np.flatnonzero(ids == slot.fixed) + 1
        row = sum_gram(bench.design, bench.fitted, group, steady, np.arange(len(ids) + 1))[0]
        used = np.flatnonzero(bench.whole.coefficients[ids])
        left = row[0] - row[used + 1] @ bench.whole.coefficients[ids[used]]
        gain += bench.weights[group] * float(left - 0.5 * row[steady[0]])
    return gain


def _saturated(gain: float, bench: Bench, slot: Slot) -> float:
    """Turns a gain at fixed noise into one with the noise profiled out: -n/2 log(1 - 2 gain / n)."""
    samples = float(np.sum(bench.counts[list(slot.groups)] * bench.independent[list(slot.groups)]))
    return -0.5 * samples * float(np.log(max(1.0 - 2.0 * gain / samples, 1e-6)))
