# SPDX-License-Identifier: BSD-3-Clause
"""The conclusion: accepted terms become named causes with parameters and rivals; remainder and verdict.

The next motion to record follows from what is open. How far the gap shrinks is measured last (`held_out_gap`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from impedance_modules.diagnosis.data.log import DataReport
from impedance_modules.diagnosis.data.nominal_model import NominalModel
from impedance_modules.diagnosis.model_selection.evidence import Evidence
from impedance_modules.diagnosis.model_selection.external_pushes import cause_of_pushes
from impedance_modules.diagnosis.model_selection.gap_location import locate_gap
from impedance_modules.diagnosis.model_selection.lack_of_fit import LackOfFit, lack_of_fit
from impedance_modules.diagnosis.model_selection.naming import SHARE_THAT_MATTERS, noise_power, ranked_terms
from impedance_modules.diagnosis.model_selection.rivals import judge_rivals
from impedance_modules.diagnosis.regression.candidates import Candidate
from impedance_modules.diagnosis.regression.model_fit import ModelTerm
from impedance_modules.diagnosis.regression.parameter_estimates import estimates
from impedance_modules.diagnosis.residuals.preparation import Prepared
from impedance_modules.diagnosis.result import Cause, Diagnosis, Estimate, Remainder, Rival
from impedance_modules.diagnosis.rollout_result import no_rollout
from impedance_modules.effects.catalogue import CATALOGUE

EXPLAINED_MIN, WEAK_FLOOR_LIMIT = 0.25, 6.0
"""Causes that explain less than the first part of the gap neither explain it nor make it ambiguous, whatever the noise
would let pass; where a remainder is left, the verdict is ambiguous only if it passes by its power. The second is the
limit of residual power over noise where no repeats measure the noise."""


def conclude(
    evidence: Evidence, causes: tuple[Cause, ...], model: NominalModel, report: DataReport
) -> Diagnosis:
    """Puts verdict, remainder and next motion together; ``with_held_out_gap`` measures gap and shrink afterwards."""
    lack = lack_of_fit(evidence)
    remainder = _remainder(lack, evidence, model)
    logs = evidence.prepared
    return Diagnosis(
        verdict=verdict_of(causes, remainder, near=_power_passes(lack, weak=evidence.floor.weak)),
        robot=model.robot,
        episodes=tuple(item.log.name for item in logs),
        heldout=tuple(logs[index].log.name for index in evidence.heldout),
        data=report,
        reason="",
        gaps=(),
        shrink=None,
        rollout=no_rollout(),
        where=locate_gap(evidence, model),
        causes=causes,
        unexplained_weight=max(0.0, 1.0 - sum(cause.weight for cause in causes)),
        remainder=remainder,
        next_motion=propose_motion(causes, report, model, _median_posture(evidence, model)),
        series=(),
    )


def causes_of_model(evidence: Evidence) -> tuple[Cause, ...]:
    """Turns the accepted terms into causes, one per effect and port, those that explain most first."""
    merged: dict[tuple[str, str], Cause] = {}
    for term, gain in ranked_terms(evidence, noise_power(evidence)):
        cause = _cause(evidence, term, gain)
        key = (cause.effect, cause.port)
        merged[key] = _merge(merged[key], cause) if key in merged else cause
    total = evidence.whitened_excess(None)
    left = min(1.0, evidence.whitened_excess(evidence.model_fit) / total) if total > 0.0 else 0.0
    gains = sum(cause.weight for cause in merged.values())
    scale = (1.0 - evidence.outside_share) * (1.0 - left) / gains if gains > 0.0 else 0.0
    weighed = [replace(cause, weight=cause.weight * scale) for cause in merged.values()]
    if evidence.pushes:
        weighed.append(cause_of_pushes(evidence.pushes, evidence.pushed_share))
    return tuple(sorted(weighed, key=lambda cause: -cause.weight))


def compensation_note(prepared: Sequence[Prepared], causes: Sequence[Cause]) -> tuple[str, ...]:
    r"""Warns where a spring that the robot itself compensates may be the cause.

    A robot that models a spring beside a joint adds its torque to the command. The spring then shows at the link,
    \tau_{sensor} - \tau_{model}, and with opposite sign at the motor, \tau_{sensor} - \tau_{command} - g
    (`effects.springs`). If the robot adds another torque than the spring needs, no single effect fits both, and the
    effect that fits best is named.

    Args:
        prepared: The recordings.
        causes: The named causes.

    Returns:
        One sentence; none where commands or sensors are missing, or no cause looks like such a spring.
    """
    both = all({"link", "actuator"} <= set(item.residuals) for item in prepared)
    if not both or any(item.log.gravity_compensation != "robot" for item in prepared):
        return ()
    carried = {effect.id for effect in CATALOGUE.values() if effect.carried_by_robot}
    imitations = {effect.id for effect in CATALOGUE.values() if effect.imitates_carried}
    known = {joint for cause in causes if cause.effect in carried for joint in cause.joints}
    found = [
        cause
        for cause in causes
        if cause.effect not in carried
        and not set(cause.joints) <= known
        and {cause.effect, *(rival.effect for rival in cause.equivalent)} & (carried | imitations)
    ]
    if not found:
        return ()
    names = "; ".join(f"{cause.effect} on {', '.join(cause.joints)}" for cause in found)
    return (
        f"{names}: the robot adds torques of its own, and a spring beside a joint that it compensates shows both at the"
        " link and at the motor, where one effect in one place does not explain it (valid: the same motions without"
        " effort_command, as `impedance baxter record` writes them)",
    )


def propose_motion(
    causes: Sequence[Cause], report: DataReport, model: NominalModel, start: Mapping[str, float]
) -> Mapping[str, object]:
    """Says what to record next: joints, the excitation that the catalogue asks for, and the posture.

    `impedance probe` turns it into the shortest safe motion; it needs the robot's limits and shapes.

    Args:
        causes: The named causes.
        report: About the data.
        model: The nominal model.
        start: Joint -> middle of its recorded positions [rad].
    """
    return {**_asked(causes, report, model), "start": dict(start)}


def _asked(causes: Sequence[Cause], report: DataReport, model: NominalModel) -> Mapping[str, object]:
    unclear = [cause for cause in causes if cause.equivalent]
    if unclear:
        cause = unclear[0]
        names = [cause.effect, *(rival.effect for rival in cause.equivalent)]
        asked = dict.fromkeys(CATALOGUE[name].description.excitation for name in names if name in CATALOGUE)
        return {
            "purpose": f"tell {', '.join(dict.fromkeys(names))} apart",
            "joints": list(cause.joints or model.joints),
            "excitation": "; ".join(asked),
        }
    if report.weak_joints:
        return {
            "purpose": "see joints that hardly moved",
            "joints": list(report.weak_joints),
            "excitation": "reversals at three or more speeds over the joint's range",
        }
    return {"purpose": "none needed", "joints": [], "excitation": ""}


def verdict_of(causes: Sequence[Cause], remainder: Remainder, *, near: bool) -> str:
    """Says what follows from causes and remainder.

    Args:
        causes: Those that are named.
        remainder: What they leave.
        near: Whether it is no more than noise by its power, whatever structure it has.
    """
    if not causes:
        return "no_gap" if remainder.explained else "unexplained"
    enough = sum(cause.weight for cause in causes) >= EXPLAINED_MIN
    if (
        enough
        and (remainder.explained or near)
        and any(cause.equivalent and cause.weight >= SHARE_THAT_MATTERS for cause in causes)
    ):
        return "ambiguous"
    return "explained" if enough and remainder.explained else "partly_explained"


def _power_passes(lack: LackOfFit, *, weak: bool) -> bool:
    return bool(np.all(lack.ratio <= np.maximum(lack.limit, WEAK_FLOOR_LIMIT if weak else 0.0)))


def _remainder(found: LackOfFit, evidence: Evidence, model: NominalModel) -> Remainder:
    worst = int(np.argmax(found.ratio / found.limit))
    residual, joint = evidence.design.groups[worst]
    ratio = float(found.ratio[worst])
    words = (
        f"residual power is {ratio:.3g} times noise and parameters' uncertainty on {model.joints[joint]} ({residual});"
        f" {found.limit[worst]:.3g} would pass"
    )
    if evidence.floor.weak:
        words += "; the noise floor is weak, no recording repeats another"
    if found.structure:
        words += f"; {found.structure}"
    if not found.passed:
        words += "; not explained by the catalogue"
        if evidence.refusal is not None:
            words += (
                f" (nearest: {evidence.refusal.trial.term.candidate.name}, which {evidence.refusal.reason})"
            )
    groups = (evidence.design.groups[group] for group in found.failing)
    failing = frozenset((residual, model.joints[joint]) for residual, joint in groups)
    return Remainder(ratio, found.passed, words, float(found.limit[worst]), failing)


def _median_posture(evidence: Evidence, model: NominalModel) -> dict[str, float]:
    """Joint -> median of all recorded positions [rad], near which the next motion can begin."""
    middle = np.median(np.concatenate([item.position for item in evidence.prepared]), axis=0)
    return {joint: float(q) for joint, q in zip(model.joints, middle, strict=True)}


def _cause(evidence: Evidence, term: ModelTerm, gain: float) -> Cause:
    candidate = term.candidate
    model = evidence.model_fit.model
    compared = judge_rivals(evidence.selector, model, term, evidence.held_out_likelihood)
    prismatic = any(
        body.prismatic and body.joint in candidate.joints for body in evidence.prepared[0].tree.bodies
    )
    numbers = estimates(evidence.model_fit, evidence.selector.refiner, model.index(term), prismatic=prismatic)
    return Cause(
        effect=candidate.effect.id,
        joints=candidate.joints,
        port=candidate.port,
        parameters={candidate.key: numbers},
        weight=gain,
        shrink=None,
        equivalent=tuple(dict.fromkeys([*compared.equal, *_imitators(evidence, candidate, numbers)])),
        rivals=compared.lost,
        position_range=_range(evidence, candidate, "position"),
        velocity_range=_range(evidence, candidate, "velocity"),
        standing=compared.standing,
        outside=candidate.effect.is_outside(term.shaped.shape, candidate.site(evidence.prepared[0].signals)),
        elsewhere=compared.elsewhere,
    )


def _imitators(
    evidence: Evidence, candidate: Candidate, numbers: Mapping[str, Estimate]
) -> tuple[Rival, ...]:
    """Effects that would look like a cause with its numbers in every recording (`Effect.imitated_by`)."""
    values = {symbol: estimate.value for symbol, estimate in numbers.items()}
    found = [candidate.effect.imitated_by(candidate.site(item.signals), values) for item in evidence.prepared]
    alike = [effect for effect in found[0] if all(effect in others for others in found)]
    return tuple(
        Rival(effect, candidate.joints, "is the same in every motion that was recorded") for effect in alike
    )


def _range(evidence: Evidence, candidate: Candidate, quantity: str) -> Mapping[str, tuple[float, float]]:
    out = {}
    names = evidence.prepared[0].tree.joints
    for joint in candidate.joints:
        parts = [
            getattr(evidence.prepared[i], quantity)[:, names.index(joint)] for i in evidence.model_fit.fitted
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
        standing=one.standing.least(other.standing),
        outside=one.outside and other.outside,
        elsewhere=tuple(port for port in one.elsewhere if port in other.elsewhere),
    )
