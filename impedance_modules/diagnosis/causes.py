# SPDX-License-Identifier: BSD-3-Clause
"""Stage 8: accepted candidates as causes: parameters with errors, own shrink, rivals, one entry per effect."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from impedance_modules.diagnosis.contact_cause import contact_cause
from impedance_modules.diagnosis.model_selection.evidence import Evidence
from impedance_modules.diagnosis.model_selection.rivals import judge_rivals
from impedance_modules.diagnosis.regression.candidates import Candidate
from impedance_modules.diagnosis.regression.model_fit import ModelTerm
from impedance_modules.diagnosis.regression.parameter_estimates import estimates
from impedance_modules.diagnosis.result import Cause

Array = NDArray[np.float64]


SLIGHT = 0.1
"""Weight of one joint's part over another's, of one effect, below which its rivals are not the effect's."""


def name_causes(evidence: Evidence) -> tuple[Cause, ...]:
    """Turns the accepted candidates into causes, those that explain most first."""
    merged: dict[tuple[str, str], Cause] = {}
    for term, gain in _in_order(evidence):
        cause = _cause(evidence, term, gain)
        key = (cause.effect, cause.port)
        merged[key] = _merge(merged[key], cause) if key in merged else cause
    total = evidence.excess_before
    left = min(1.0, evidence.excess(evidence.bench) / total) if total > 0.0 else 0.0
    gains = sum(cause.weight for cause in merged.values())
    scale = (1.0 - left) / gains if gains > 0.0 else 0.0
    weighed = [
        replace(cause, weight=cause.weight * scale, shrink=_own_shrink(evidence, cause))
        for cause in merged.values()
    ]
    if evidence.pushes:
        share = evidence.pushed_share
        weighed = [replace(cause, weight=cause.weight * (1.0 - share)) for cause in weighed]
        weighed.append(contact_cause(evidence.pushes, evidence.prepared, share))
    return tuple(sorted(weighed, key=lambda cause: -cause.weight))


def _in_order(evidence: Evidence) -> list[tuple[ModelTerm, float]]:
    """Each accepted term with the power it takes away after those that take more by themselves."""

    def left(model: Sequence[ModelTerm]) -> float:
        return evidence.excess(evidence.selector.bench(model))

    order = sorted(evidence.bench.model, key=lambda term: left([term]))
    steps = [left(order[:count]) for count in range(len(order) + 1)]
    return [(term, max(steps[i] - steps[i + 1], 1e-12)) for i, term in enumerate(order)]


def _cause(evidence: Evidence, term: ModelTerm, gain: float) -> Cause:
    candidate = term.candidate
    model = evidence.bench.model
    equal, lost = judge_rivals(evidence.selector, model, term)
    prismatic = any(
        body.prismatic and body.joint in candidate.joints for body in evidence.prepared[0].tree.bodies
    )
    return Cause(
        effect=candidate.effect.id,
        joints=candidate.joints,
        port=candidate.port,
        parameters={
            candidate.key: estimates(
                evidence.bench, evidence.selector.refiner, model.index(term), prismatic=prismatic
            )
        },
        weight=gain,
        shrink=None,
        equivalent=equal,
        rivals=lost,
        position_range=_range(evidence, candidate, "position"),
        velocity_range=_range(evidence, candidate, "velocity"),
    )


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
    most = max(one.weight, other.weight)
    return replace(
        one,
        joints=tuple(dict.fromkeys([*one.joints, *other.joints])),
        parameters={**one.parameters, **other.parameters},
        weight=one.weight + other.weight,
        # A joint where hardly anything happens says nothing about the others.
        equivalent=tuple(
            dict.fromkeys(
                rival for cause in (one, other) if cause.weight >= SLIGHT * most for rival in cause.equivalent
            )
        ),
        rivals=tuple(dict.fromkeys([*one.rivals, *other.rivals])),
        position_range={**one.position_range, **other.position_range},
        velocity_range={**one.velocity_range, **other.velocity_range},
    )


def _own_shrink(evidence: Evidence, cause: Cause) -> float | None:
    """Held-out shrink of the nominal model plus this cause alone."""
    own = [term for term in evidence.bench.model if (term.key[0], term.key[2]) == (cause.effect, cause.port)]
    before = evidence.excess_before
    if before <= 0.0:
        return None
    return 1.0 - float(np.sqrt(evidence.excess(evidence.selector.bench(own)) / before))
