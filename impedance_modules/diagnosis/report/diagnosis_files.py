# SPDX-License-Identifier: BSD-3-Clause
r"""A diagnosis as the JSON object of schemas/diagnosis.schema.json, and its causes as a patch.

Spectra are rms values in octaves, so that their squares add up to that of the whole. With X_k the discrete Fourier
transform of N samples with a Hann window w, an octave's power is 2 / (N \sum w^2) \sum_{k in octave} |X_k|^2.
"""

from __future__ import annotations

import dataclasses
import datetime
import json
import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

import impedance_modules
from impedance_modules.arrays import Array
from impedance_modules.diagnosis.gap_result import GapSize, JointGap, ResidualSeries
from impedance_modules.diagnosis.result import Cause, Diagnosis, Rival, Swallowed
from impedance_modules.diagnosis.rollout.patch_entry import patch_entry
from impedance_modules.diagnosis.rollout_result import CauseRollout, Rollout
from impedance_modules.effects.catalogue import CATALOGUE

FORMAT = 1

EDGES = (0.0, 0.25, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0)
"""Between octaves [Hz]."""

PATCHED = ("explained", "partly_explained", "ambiguous")
"""Verdicts with which a patch is written."""

VALUE_MAX = 9e8
"""Causes with larger numbers, beyond the format's bounds, are not in the patch."""


def diagnosis_object(diagnosis: Diagnosis) -> dict[str, Any]:
    """Builds the JSON object; numbers that do not exist are null."""
    return {
        "format": FORMAT,
        "verdict": diagnosis.verdict,
        "robot": diagnosis.robot,
        "data": _data(diagnosis),
        "gap": {
            "per_joint": per_joint(diagnosis.gaps),
            "per_port": [{"joint": g.joint, "residual": g.residual, **_size(g)} for g in diagnosis.gaps],
            "shrink": _number(diagnosis.shrink),
            "refitted_shrink": _number(diagnosis.refitted_shrink),
            "rollout": rollout_object(diagnosis.rollout),
            "spectrum": spectrum_object(diagnosis.series),
        },
        "where": [
            {"joint": p.joint, "port": p.port, "regime": p.regime, "band_hz": list(p.band), "share": p.share}
            for p in diagnosis.where
        ],
        "causes": [_cause(cause) for cause in diagnosis.causes],
        "small": [_cause(cause) for cause in diagnosis.small],
        "tolerance": diagnosis.tolerance,
        "swallowed": swallowed_object(diagnosis.swallowed),
        "unexplained_weight": diagnosis.unexplained_weight,
        "remainder": {
            "lack_of_fit": _number(diagnosis.remainder.lack_of_fit),
            "explained": diagnosis.remainder.explained,
            "structure": diagnosis.remainder.structure,
            **({} if diagnosis.remainder.limit is None else {"limit": diagnosis.remainder.limit}),
        },
        "next_motion": dict(diagnosis.next_motion),
        "patch": patch_object(diagnosis),
    }


def per_joint(gaps: Sequence[JointGap]) -> dict[str, dict[str, Any]]:
    """One entry per joint: its torque residual with the largest ratio to the noise."""
    out: dict[str, JointGap] = {}
    for gap in gaps:
        if gap.residual == "velocity":
            continue
        known = out.get(gap.joint)
        if known is None or gap.before / gap.noise_floor > known.before / known.noise_floor:
            out[gap.joint] = gap
    return {joint: {**_size(gap), "port": gap.residual} for joint, gap in out.items()}


def swallowed_object(swallowed: Swallowed | None) -> dict[str, Any] | None:
    """Builds the JSON object of what was fitted within priors; null without a fit."""
    if swallowed is None:
        return None
    hand = swallowed.hand
    return {
        "links": {
            name: {"mass": a.value, "unit": a.unit, "deviations": a.deviations}
            for name, a in swallowed.links.items()
        },
        "weights": {"deviations": swallowed.weights},
        "times": {
            name: {"later": a.value, "unit": a.unit, "deviations": a.deviations}
            for name, a in swallowed.times.items()
        },
        "hand": None
        if hand is None
        else {"link": hand.link, "mass": hand.mass, "unit": "kg", "share": hand.share},
    }


def rollout_object(rollout: Rollout) -> dict[str, Any]:
    """Builds the JSON object ``gap.rollout``; without a rollout it gives the reasons."""
    left_out = [{"what": item.what, "why": item.why} for item in rollout.left_out]
    if not rollout.windows:
        return {"windows": 0, "left_out": left_out}
    return {
        "windows": rollout.windows,
        "window_s": rollout.window,
        "episodes": list(rollout.episodes),
        "driven_by": rollout.drive,
        "noise_floor_from": rollout.floor,
        "shrink": rollout.shrink,
        "all_causes": cause_rollout_object(rollout.whole),
        "per_joint": {
            joint: {"position": _size(drift), "velocity": _size(rollout.velocity[joint])}
            for joint, drift in rollout.position.items()
        },
        "growth": {
            "time_s": list(rollout.growth.time),
            "before": _lists(rollout.growth.before),
            "after": _lists(rollout.growth.after),
        },
        "left_out": left_out,
    }


def cause_rollout_object(cause: CauseRollout | None) -> dict[str, Any] | None:
    """Builds a cause's entry; null where it was not simulated."""
    if cause is None:
        return None
    return {
        "without": cause.without,
        "with": cause.with_it,
        "ratio": cause.ratio,
        "standard_error": cause.standard_error if math.isfinite(cause.standard_error) else None,
        "verdict": cause.verdict,
    }


def spectrum_object(series: Sequence[ResidualSeries]) -> dict[str, Any]:
    """Builds the JSON object of the first held-out recording's residuals."""
    if not series:
        return {"edges_hz": [], "per_port": []}
    first = [item for item in series if item.episode == series[0].episode]
    highest = max((_nyquist(item.time) for item in first), default=0.0)
    edges = [edge for edge, below in zip(EDGES, (0.0, *EDGES), strict=False) if below < highest]
    return {
        "edges_hz": edges,
        "per_port": [
            {
                "joint": item.joint,
                "residual": item.residual,
                "before": _octaves(item.time, item.before, edges),
                "after": _octaves(item.time, item.after, edges),
                "unit": item.unit,
            }
            for item in first
        ],
    }


def patch_object(diagnosis: Diagnosis) -> dict[str, Any] | None:
    """Builds the patch; None where no cause belongs into it."""
    effects = [_effect(cause) for cause in diagnosis.causes if _in_patch(cause, diagnosis.shrink)]
    if not effects or diagnosis.verdict not in PATCHED:
        return None
    return {
        "format": 1,
        "robot": diagnosis.robot,
        "provenance": {
            "origin": "diagnosis",
            "date": datetime.date.today().isoformat(),
            "episodes": list(diagnosis.episodes),
            "verdict": diagnosis.verdict,
            "versions": {"impedance-modules": impedance_modules.__version__},
        },
        "effects": effects,
    }


def patch_text(patch: Mapping[str, Any]) -> str:
    """Writes a patch as YAML that all readers read alike: block mappings, quoted text, numbers with a point."""
    return "# yaml-language-server: $schema=patch.schema.json\n" + "".join(_lines(patch, 0))


def _size(gap: GapSize) -> dict[str, Any]:
    return {
        "before": gap.before,
        "after": gap.after,
        "refitted": gap.refitted,
        "noise_floor": gap.noise_floor,
        "unit": gap.unit,
        "shrink": _number(gap.shrink),
    }


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
        "place": CATALOGUE[cause.effect].description.place(cause.port),
        "other_places": other_places(cause),
        "parameters": {
            key: {s: {"value": e.value, "std": e.std, "unit": e.unit} for s, e in symbols.items()}
            for key, symbols in cause.parameters.items()
        },
        "weight": cause.weight,
        **_probability(cause),
        "shrink": _number(cause.shrink),
        "range": _ranges(cause),
        "rollout": cause_rollout_object(cause.rollout),
        "equivalent": [_rival(rival) | {} for rival in cause.equivalent],
        "rivals": [_rival(rival) | {"lost_because": rival.reason} for rival in cause.rivals],
    }


def other_places(cause: Cause) -> list[str]:
    """Links of the chain at which the same effect would explain the recordings as well."""
    return [CATALOGUE[cause.effect].description.place(port) for port in cause.elsewhere]


def _probability(cause: Cause) -> dict[str, Any]:
    """The probability and what it follows from; nothing where it was not computed."""
    if cause.probability is None or cause.grounds is None:
        return {}
    return {"probability": cause.probability, "grounds": dataclasses.asdict(cause.grounds)}


def _rival(rival: Rival) -> dict[str, Any]:
    return {"effect": rival.effect, "joints": list(rival.joints)}


def _ranges(cause: Cause) -> dict[str, Mapping[str, list[float]]]:
    return {
        "position": {joint: list(ends) for joint, ends in cause.position_range.items()},
        "velocity": {joint: list(ends) for joint, ends in cause.velocity_range.items()},
    }


def _lists(values: Mapping[str, tuple[float, ...]]) -> dict[str, list[float]]:
    return {joint: list(numbers) for joint, numbers in values.items()}


def _number(value: float | None) -> float | None:
    return None if value is None or not math.isfinite(value) else value


def _nyquist(time: Array) -> float:
    return 0.5 / float(np.median(np.diff(time)))


def why_no_patch(diagnosis: Diagnosis) -> str:
    """Says why there is no patch."""
    if diagnosis.verdict not in PATCHED:
        return f"the verdict is {diagnosis.verdict}, and no cause is named"
    effects = [CATALOGUE[cause.effect] for cause in diagnosis.causes]
    if effects and all(effect.bound_to_recording for effect in effects):
        return f"{', '.join(effect.description.id for effect in effects)}: {effects[0].not_exported}"
    return "no effect shrank the held-out gap"


def _octaves(time: Array, values: Array, edges: Sequence[float]) -> list[float]:
    """Rms in each octave."""
    window = np.hanning(len(values))
    power = 2.0 * np.abs(np.fft.rfft(window * values)) ** 2 / (len(values) * np.sum(window**2))
    power[0] *= 0.5
    frequency = np.fft.rfftfreq(len(values), float(np.median(np.diff(time))))
    which = np.digitize(frequency, np.array(edges)) - 1
    inside = np.minimum(which, len(edges) - 2)
    return [float(np.sqrt(power[inside == k].sum())) for k in range(len(edges) - 1)]


def _in_patch(cause: Cause, together: float | None) -> bool:
    """Whether a cause has numbers that the format can hold, and shrinks the gap, alone or with the others.

    Every named cause is one that held-out recordings need beside the others. Alone, one may be small beside what links
    that are not quite known make of the gap, or enlarge it: a spring that holds against a lean of the base.
    """
    values = [e.value for symbols in cause.parameters.values() for e in symbols.values()]
    finite = all(math.isfinite(value) and abs(value) < VALUE_MAX for value in values)
    if not finite or cause.shrink is None:
        return False
    return max(cause.shrink, -math.inf if together is None else together) > 0.0


def _effect(cause: Cause) -> dict[str, Any]:
    entry = patch_entry(cause)
    out: dict[str, Any] = {
        "effect": entry.effect,
        "joints": list(entry.joints),
        "port": entry.port,
        "parameters": {
            key: {
                symbol: {"value": e.value, "unit": e.unit, **({"std": e.std} if math.isfinite(e.std) else {})}
                for symbol, e in symbols.items()
            }
            for key, symbols in entry.parameters.items()
        },
    }
    if cause.position_range:
        out["range"] = {
            "position": {joint: list(ends) for joint, ends in cause.position_range.items()},
            "velocity": {joint: list(ends) for joint, ends in cause.velocity_range.items()},
        }
    return out


def _lines(value: Mapping[str, Any], depth: int) -> Iterator[str]:
    for key, item in value.items():
        head = f"{'  ' * depth}{json.dumps(key)}:"
        if isinstance(item, Mapping):
            yield f"{head}\n"
            yield from _lines(item, depth + 1)
        elif isinstance(item, list) and item and isinstance(item[0], Mapping):
            yield f"{head}\n"
            for entry in item:
                yield f"{'  ' * (depth + 1)}-\n"
                yield from _lines(entry, depth + 2)
        elif isinstance(item, list):
            yield f"{head} [{', '.join(_scalar(entry) for entry in item)}]\n"
        else:
            yield f"{head} {_scalar(item)}\n"


def _scalar(value: str | float) -> str:
    """A number keeps a point before its exponent: without one YAML 1.1 reads text."""
    if isinstance(value, str):
        return json.dumps(value)
    text = repr(value)
    mantissa, mark, exponent = text.partition("e")
    return f"{mantissa}.0e{exponent}" if mark and "." not in mantissa else text
