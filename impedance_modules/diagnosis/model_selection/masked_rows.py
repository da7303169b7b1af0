# SPDX-License-Identifier: BSD-3-Clause
"""What rows say that the search of joints' and links' effects leaves out, merged with what that search found.

Rows in contact, and rows in which hands hold an object, are compared with the task's surfaces and object when all
other causes are known. Weights are shares of the excess power of all rows.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.diagnosis.model_selection.evidence import Evidence
from impedance_modules.diagnosis.residuals.preparation import AppliedEffect, Prepared
from impedance_modules.diagnosis.result import Cause, Diagnosis
from impedance_modules.effects.catalogue import CATALOGUE
from impedance_modules.effects.residual_kinds import Residual, uses_motion

LEAD_MIN = 30.0
"""Deviance by which what is named of masked rows must lie ahead of another: errors of the positions make it large."""


@dataclass(frozen=True)
class RowsExplained:
    """How well rows that were masked are explained.

    Attributes:
        before: Chi-square with the task's numbers.
        after: With those found.
        count: Degrees of freedom.
        explained: Whether the remainder is the noise's.
        ambiguous: Whether another cause explains nearly as much.
    """

    before: float
    after: float
    count: int
    explained: bool
    ambiguous: bool


def merged(
    found: Diagnosis, evidence: Evidence, rows: RowsExplained, causes: Sequence[tuple[Cause, float]]
) -> Diagnosis:
    """Names causes of masked rows beside the others.

    Args:
        found: The result of all other rows.
        evidence: Of it.
        rows: What the causes explain together.
        causes: Each with its share of that.
    """
    free = evidence.whitened_excess(None) * sum(item.samples for item in evidence.prepared)
    start, left = max(rows.before - rows.count, 0.0), max(rows.after - rows.count, 0.0)
    total = free + start
    named = [replace(cause, weight=cause.weight * free / total) for cause in found.causes]
    named += [replace(cause, weight=(start - left) / total * share) for cause, share in causes]
    return replace(
        found,
        causes=tuple(sorted(named, key=lambda cause: -cause.weight)),
        unexplained_weight=(found.unexplained_weight * free + left) / total,
        verdict=_verdict(found, rows),
    )


def _verdict(found: Diagnosis, rows: RowsExplained) -> str:
    """The verdict of all rows, from that of the others and that of those masked."""
    if found.verdict not in ("no_gap", "explained", "ambiguous") or not rows.explained:
        return "partly_explained"
    return "ambiguous" if rows.ambiguous or found.verdict == "ambiguous" else "explained"


def motion_residual(prepared: Sequence[Prepared]) -> Residual | None:
    """Names a residual of all recordings that compares torque with the links' motion; None without one."""
    names = [
        name
        for name in prepared[0].residuals
        if uses_motion(name) and all(name in item.residuals for item in prepared)
    ]
    return names[0] if names else None


def effects_found(found: Diagnosis) -> Iterator[AppliedEffect]:
    """Effect, port and numbers of all named causes."""
    for cause in (*found.causes, *found.small):
        if CATALOGUE[cause.effect].bound_to_recording:
            continue
        values = {
            key: {symbol: estimate.value for symbol, estimate in symbols.items()}
            for key, symbols in cause.parameters.items()
        }
        yield cause.effect, cause.port, values


def share_closed(before: float, after: float) -> float | None:
    """Gives 1 - sqrt(after / before) of two excess powers; None without a gap."""
    return None if before <= 0.0 else 1.0 - float(np.sqrt(max(after, 0.0) / before))


def correlation_in_time(left: Sequence[Array]) -> float:
    r"""Gives (1 + \rho) / (1 - \rho) of whitened remainders, each in the order of time along its first axis."""
    pairs = [(x[:-1], x[1:]) for x in left if len(x) > 1]
    squares = sum(float(np.sum(a * a)) for a, _ in pairs)
    lag = sum(float(np.sum(a * b)) for a, b in pairs) / max(squares, 1e-300)
    lag = float(np.clip(lag, 0.0, 0.95))
    return (1.0 + lag) / (1.0 - lag)


def with_warning(found: Diagnosis, words: str) -> Diagnosis:
    """Adds a sentence for the reader."""
    if found.data is None:
        return found
    return replace(found, data=replace(found.data, warnings=(*found.data.warnings, words)))
