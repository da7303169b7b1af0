# SPDX-License-Identifier: BSD-3-Clause
"""A diagnosis as the JSON object of the contract (design 3.3)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from impedance_modules.diagnosis.patch import patch_object
from impedance_modules.diagnosis.result import Cause, Diagnosis, JointGap, Rival
from impedance_modules.diagnosis.rollout.to_json import cause_rollout_object, rollout_object
from impedance_modules.diagnosis.spectrum import spectrum_object

FORMAT = 1


def diagnosis_object(diagnosis: Diagnosis) -> dict[str, Any]:
    """Builds the JSON object; numbers that do not exist are null."""
    return {
        "format": FORMAT,
        "verdict": diagnosis.verdict,
        "robot": diagnosis.robot,
        "data": _data(diagnosis),
        "gap": {
            "per_joint": per_joint(diagnosis.gaps),
            "per_port": [
                {"joint": g.joint, "residual": g.residual, "shrink": _number(g.shrink), **_gap(g)}
                for g in diagnosis.gaps
            ],
            "shrink": _number(diagnosis.shrink),
            "rollout": rollout_object(diagnosis.rollout),
            "spectrum": spectrum_object(diagnosis.series),
        },
        "where": [
            {"joint": p.joint, "port": p.port, "regime": p.regime, "band_hz": list(p.band), "share": p.share}
            for p in diagnosis.where
        ],
        "causes": [_cause(cause) for cause in diagnosis.causes],
        "unexplained_weight": diagnosis.unexplained_weight,
        "remainder": {
            "lack_of_fit": _number(diagnosis.remainder.lack_of_fit),
            "explained": diagnosis.remainder.explained,
            "structure": diagnosis.remainder.structure,
        },
        "next_motion": dict(diagnosis.next_motion),
        "patch": patch_object(diagnosis),
    }


def per_joint(gaps: Sequence[JointGap]) -> dict[str, dict[str, Any]]:
    """One entry per joint: its torque residual that stands out of the noise the most."""
    out: dict[str, JointGap] = {}
    for gap in gaps:
        if gap.residual == "velocity":
            continue
        known = out.get(gap.joint)
        if known is None or gap.before / gap.noise_floor > known.before / known.noise_floor:
            out[gap.joint] = gap
    return {
        joint: {**_gap(gap), "shrink": _number(gap.shrink), "port": gap.residual}
        for joint, gap in out.items()
    }


def _gap(gap: JointGap) -> dict[str, Any]:
    return {"before": gap.before, "after": gap.after, "noise_floor": gap.noise_floor, "unit": gap.unit}


def _data(diagnosis: Diagnosis) -> dict[str, Any]:
    out: dict[str, Any] = {"episodes": list(diagnosis.episodes), "heldout": list(diagnosis.heldout)}
    if diagnosis.reason:
        out["reason"] = diagnosis.reason
    report = diagnosis.data
    if report is not None:
        out |= {
            "rate_hz": dict(report.rates),
            "jitter": dict(report.jitter),
            "weak_joints": list(report.weak_joints),
            "repeats": [list(names) for names in report.repeats],
            "torque": report.torque,
            "delay_s": _number(report.delay),
            "warnings": list(report.warnings),
        }
    return out


def _cause(cause: Cause) -> dict[str, Any]:
    return {
        "effect": cause.effect,
        "joints": list(cause.joints),
        "port": cause.port,
        "parameters": {
            key: {s: {"value": e.value, "std": e.std, "unit": e.unit} for s, e in symbols.items()}
            for key, symbols in cause.parameters.items()
        },
        "weight": cause.weight,
        "shrink": _number(cause.shrink),
        "range": _ranges(cause),
        "rollout": cause_rollout_object(cause.rollout),
        "equivalent": [_rival(rival) | {} for rival in cause.equivalent],
        "rivals": [_rival(rival) | {"lost_because": rival.reason} for rival in cause.rivals],
    }


def _rival(rival: Rival) -> dict[str, Any]:
    return {"effect": rival.effect, "joints": list(rival.joints)}


def _ranges(cause: Cause) -> dict[str, Mapping[str, list[float]]]:
    return {
        "position": {joint: list(ends) for joint, ends in cause.position_range.items()},
        "velocity": {joint: list(ends) for joint, ends in cause.velocity_range.items()},
    }


def _number(value: float | None) -> float | None:
    return None if value is None or not math.isfinite(value) else value
