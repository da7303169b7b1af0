# SPDX-License-Identifier: BSD-3-Clause
"""Rollouts as the JSON object ``gap.rollout`` and, per cause, ``rollout``."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from impedance_modules.diagnosis.rollout.outcome import CauseRollout, Drift, Rollout


def rollout_object(rollout: Rollout) -> dict[str, Any]:
    """Builds the JSON object; where nothing was rolled out it says why."""
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
            joint: {"position": _drift(drift), "velocity": _drift(rollout.velocity[joint])}
            for joint, drift in rollout.position.items()
        },
        "growth": {
            "time_s": list(rollout.growth.time),
            "before": _lists(rollout.growth.before),
            "after": _lists(rollout.growth.after),
        },
        "left_out": left_out,
    }


def _drift(drift: Drift) -> dict[str, Any]:
    return {
        "before": drift.before,
        "after": drift.after,
        "noise_floor": drift.noise_floor,
        "unit": drift.unit,
        "shrink": drift.shrink,
    }


def _lists(values: Mapping[str, tuple[float, ...]]) -> dict[str, list[float]]:
    return {joint: list(numbers) for joint, numbers in values.items()}


def cause_rollout_object(cause: CauseRollout | None) -> dict[str, Any] | None:
    """Builds a cause's entry; null where the rollouts could not wear it."""
    if cause is None:
        return None
    return {
        "without": cause.without,
        "with": cause.with_it,
        "ratio": cause.ratio,
        "standard_error": cause.standard_error if math.isfinite(cause.standard_error) else None,
        "verdict": cause.verdict,
    }
