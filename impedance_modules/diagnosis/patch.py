# SPDX-License-Identifier: BSD-3-Clause
"""The causes as a patch (design 3.4): what the plant and the model are to wear from now on."""

from __future__ import annotations

import datetime
import json
import math
from collections.abc import Iterator, Mapping
from typing import Any

import impedance_modules
from impedance_modules.diagnosis.result import Cause, Diagnosis

SHRINK_MIN = 0.02
"""A cause that shrinks the held-out gap by less is not worn."""

MOST = 9e8
"""Numbers beyond the format's bounds are no finding."""


def patch_object(diagnosis: Diagnosis) -> dict[str, Any] | None:
    """Builds the patch; None where nothing was found that may be worn."""
    effects = [_effect(cause) for cause in diagnosis.causes if _worn(cause)]
    if not effects or diagnosis.verdict not in ("explained", "partly_explained", "ambiguous"):
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


def _worn(cause: Cause) -> bool:
    values = [e.value for symbols in cause.parameters.values() for e in symbols.values()]
    finite = all(math.isfinite(value) and abs(value) < MOST for value in values)
    return finite and cause.shrink is not None and cause.shrink >= SHRINK_MIN


def _effect(cause: Cause) -> dict[str, Any]:
    out: dict[str, Any] = {
        "effect": cause.effect,
        "joints": list(cause.joints),
        "port": cause.port,
        "parameters": {
            key: {
                symbol: {"value": e.value, "unit": e.unit, **({"std": e.std} if math.isfinite(e.std) else {})}
                for symbol, e in symbols.items()
            }
            for key, symbols in cause.parameters.items()
        },
    }
    if cause.position_range:
        out["range"] = {
            "position": {joint: list(ends) for joint, ends in cause.position_range.items()},
            "velocity": {joint: list(ends) for joint, ends in cause.velocity_range.items()},
        }
    return out


def patch_text(patch: Mapping[str, Any]) -> str:
    """Writes a patch as YAML that every reader takes alike: block mappings, quoted text, numbers with a point."""
    return "# yaml-language-server: $schema=patch.schema.json\n" + "".join(_lines(patch, 0))


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
