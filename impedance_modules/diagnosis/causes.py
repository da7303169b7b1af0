# SPDX-License-Identifier: BSD-3-Clause
"""Stage 8: accepted candidates as causes: parameters with errors, own shrink, rivals, one entry per effect."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from impedance_modules.diagnosis.candidates import Candidate
from impedance_modules.diagnosis.design import Design, Slot
from impedance_modules.diagnosis.fit import Fit, squares
from impedance_modules.diagnosis.generic import candidate_of
from impedance_modules.diagnosis.noise import Floor
from impedance_modules.diagnosis.prepare import Prepared
from impedance_modules.diagnosis.result import Cause, Estimate
from impedance_modules.diagnosis.rivals import judge_rivals
from impedance_modules.diagnosis.trial import Bench

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Evidence:
    """What all causes are judged by.

    Attributes:
        design: The sums.
        folds: Fitted recordings by fold.
        heldout: Recordings that no fit has seen.
        prepared: All recordings.
        floor: The noise.
        heldout_noise: (groups,) its rms at the held-out recordings' poses.
        bench: The accepted model, fitted.
        rate: Of the thinned samples [Hz].

    """

    design: Design
    folds: tuple[tuple[int, ...], ...]
    heldout: tuple[int, ...]
    prepared: tuple[Prepared, ...]
    floor: Floor
    heldout_noise: Array
    bench: Bench
    rate: float

    @cached_property
    def calibrated(self) -> Fit:
        """The nominal model with the bodies' inertias adjusted within their prior, and no cause."""
        return Bench(self.design, self.folds, (), self.floor, self.rate).whole

    @cached_property
    def unit_power(self) -> Array:
        """(groups,) noise power of a residual's average joint: in its units powers of joints add as they are."""
        names = [residual for residual, _ in self.design.groups]
        power = self.floor.rms**2
        return np.array(
            [np.mean([p for p, other in zip(power, names, strict=True) if other == name]) for name in names]
        )

    def excess(self, coefficients: Array) -> float:
        """Held-out residual power beyond the noise, over all groups, in units of the average joint's noise."""
        counts = np.array([self.design.count(self.heldout, g) for g in range(len(self.design.groups))])
        power = squares(self.design, self.heldout, coefficients) / counts - self.heldout_noise**2
        return float(np.sum(np.clip(power, 0.0, None) / self.unit_power))


def name_causes(evidence: Evidence) -> tuple[Cause, ...]:
    """Turns the accepted candidates into causes, those that explain most first."""
    merged: dict[tuple[str, str], Cause] = {}
    for slot, gain in _in_order(evidence):
        cause = _cause(evidence, slot, gain)
        key = (cause.effect, cause.port)
        merged[key] = _merge(merged[key], cause) if key in merged else cause
    total = evidence.excess(np.zeros(evidence.design.total))
    left = min(1.0, evidence.excess(evidence.bench.whole.coefficients) / total) if total > 0.0 else 0.0
    gains = sum(cause.weight for cause in merged.values())
    scale = (1.0 - left) / gains if gains > 0.0 else 0.0
    weighed = [
        replace(cause, weight=cause.weight * scale, shrink=_own_shrink(evidence, cause))
        for cause in merged.values()
    ]
    return tuple(sorted(weighed, key=lambda cause: -cause.weight))


def _in_order(evidence: Evidence) -> list[tuple[Slot, float]]:
    """Each accepted candidate with the power it takes away after those that take more by themselves."""

    def left(model: Sequence[Slot]) -> float:
        fitted = Bench(evidence.design, evidence.folds, model, evidence.floor, evidence.rate).whole
        return evidence.excess(fitted.coefficients)

    order = sorted(evidence.bench.model, key=lambda slot: left([slot]))
    steps = [left(order[:count]) for count in range(len(order) + 1)]
    return [(slot, max(steps[i] - steps[i + 1], 1e-12)) for i, slot in enumerate(order)]


def _cause(evidence: Evidence, slot: Slot, gain: float) -> Cause:
    candidate = candidate_of(slot.shaped)
    model = evidence.bench.model
    equal, lost = judge_rivals(evidence.design, evidence.folds, model, slot, evidence.floor, evidence.rate)
    return Cause(
        effect=candidate.effect.id,
        joints=candidate.joints,
        port=candidate.port,
        parameters={candidate.key: _estimates(evidence, slot, candidate)},
        weight=gain,
        shrink=None,
        equivalent=equal,
        rivals=lost,
        position_range=_range(evidence, candidate, "position"),
        velocity_range=_range(evidence, candidate, "velocity"),
    )


def _estimates(evidence: Evidence, slot: Slot, candidate: Candidate) -> Mapping[str, Estimate]:
    """Parameters with standard deviations: the coefficients' carried through by differences."""
    whole: Fit = evidence.bench.whole
    signals = evidence.prepared[0].signals
    coefficients, shape = whole.of(slot), slot.shaped.shape

    def values(x: Array) -> dict[str, float]:
        return candidate.effect.values(x, shape, signals, candidate.key, candidate.port)

    clipped = np.clip(coefficients, slot.shaped.lower, slot.shaped.upper)
    nominal = values(clipped)
    covariance = whole.covariance_of(slot)
    roots = np.sqrt(np.clip(np.diag(covariance), 0.0, None))
    slopes = {symbol: np.zeros(slot.shaped.size) for symbol in nominal}
    for index, root in enumerate(roots):
        step = np.zeros(slot.shaped.size)
        step[index] = max(1e-3 * root, 1e-12)
        moved = values(clipped + step)
        for symbol in nominal:
            slopes[symbol][index] = (moved[symbol] - nominal[symbol]) / step[index]
    prismatic = _prismatic(evidence, candidate)
    out = {}
    for symbol, value in nominal.items():
        parameter = candidate.effect.description.parameter(symbol)
        unit = parameter.linear_unit if prismatic and parameter.linear_unit else parameter.unit
        variance = float(slopes[symbol] @ covariance @ slopes[symbol])
        out[symbol] = Estimate(float(value), float(np.sqrt(max(variance, 0.0))), unit)
    return out


def _prismatic(evidence: Evidence, candidate: Candidate) -> bool:
    return any(body.prismatic and body.joint in candidate.joints for body in evidence.prepared[0].tree.bodies)


def _range(evidence: Evidence, candidate: Candidate, quantity: str) -> Mapping[str, tuple[float, float]]:
    out = {}
    names = evidence.prepared[0].tree.joints
    for joint in candidate.joints:
        parts = [
            getattr(evidence.prepared[i], quantity)[:, names.index(joint)] for i in evidence.bench.fitted
        ]
        out[joint] = (float(min(x.min() for x in parts)), float(max(x.max() for x in parts)))
    return out


def _merge(one: Cause, other: Cause) -> Cause:
    return replace(
        one,
        joints=tuple(dict.fromkeys([*one.joints, *other.joints])),
        parameters={**one.parameters, **other.parameters},
        weight=one.weight + other.weight,
        equivalent=tuple(dict.fromkeys([*one.equivalent, *other.equivalent])),
        rivals=tuple(dict.fromkeys([*one.rivals, *other.rivals])),
        position_range={**one.position_range, **other.position_range},
        velocity_range={**one.velocity_range, **other.velocity_range},
    )


def _own_shrink(evidence: Evidence, cause: Cause) -> float | None:
    """Held-out shrink of the nominal model plus this cause alone."""
    slots = [
        s for s in evidence.bench.model if (s.shaped.key[0], s.shaped.key[2]) == (cause.effect, cause.port)
    ]
    alone = Bench(evidence.design, evidence.folds, slots, evidence.floor, evidence.rate).whole
    before = evidence.excess(np.zeros(evidence.design.total))
    if before <= 0.0:
        return None
    return 1.0 - float(np.sqrt(evidence.excess(alone.coefficients) / before))
