# SPDX-License-Identifier: BSD-3-Clause
"""Submovements of a target: minimum-jerk displacements that may overlap in time and add."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

SUBMOVEMENTS = "submovements"
"""Key beside a target's coordinates."""

SHORTEST = 10.0
"""Control periods that a submovement must at least last: in fewer it is a jump, not a motion."""


@dataclass(frozen=True, order=True)
class Submovement:
    """One minimum-jerk displacement of a target.

    Attributes:
        start: When it begins, since the phase began [s].
        duration: For how long it lasts [s].
        by: (x, y, z, rx, ry, rz) how far it goes in the axes of the spring's ``expressed_in`` (of the object: world)
            [m]; the last three are a rotation vector in the same axes [rad].
    """

    start: float
    duration: float
    by: tuple[float, float, float, float, float, float]

    @property
    def end(self) -> float:
        """When it ends, since the phase began [s]."""
        return self.start + self.duration

    @property
    def moves(self) -> bool:
        """Whether it goes anywhere."""
        return any(self.by)

    @property
    def turns(self) -> bool:
        """Whether it turns the target."""
        return any(self.by[3:])


def build_submovements(raw: Sequence[Mapping[str, Any]]) -> tuple[Submovement, ...]:
    """Makes the submovements of clean plain data; their order in the file means nothing, so they are sorted."""
    return tuple(sorted(_build(given) for given in raw))


def _build(raw: Mapping[str, Any]) -> Submovement:
    x, y, z, rx, ry, rz = (float(raw["by"].get(axis, 0.0)) for axis in ("x", "y", "z", "rx", "ry", "rz"))
    return Submovement(float(raw["start"]), float(raw["duration"]), (x, y, z, rx, ry, rz))


def too_short(duration: float, rate: float) -> str | None:
    """Says that a submovement [s] is shorter than a control of some rate [Hz] can follow; None where it is not."""
    least = SHORTEST / rate
    if duration >= least:
        return None
    return (
        f"{duration:g} s is less than {SHORTEST:g} periods of the control, {least:g} s: a jump, not a motion"
    )
