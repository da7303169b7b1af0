# SPDX-License-Identifier: BSD-3-Clause
r"""A probe as a chain of strokes: each takes the joint springs' rest to a new place by minimum jerk.

    rest(t) = r_0 + s(t / T) (r_1 - r_0),      s(x) = 10 x^3 - 15 x^4 + 6 x^5

which is what a phase of a task does to `posture`; peak speed 15/8 |r_1 - r_0| / T.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

PEAK = 15.0 / 8.0
"""Peak speed of a minimum-jerk stroke over its mean speed."""


@dataclass(frozen=True)
class Stroke:
    """Takes some joints to new angles in a time; an empty goal waits.

    Attributes:
        goal: Index of the joint -> angle [rad].
        duration: [s].
    """

    goal: Mapping[int, float]
    duration: float


@dataclass(frozen=True, eq=False)
class Motion:
    """A whole probe.

    Attributes:
        start: (n,) angles at rest before it begins [rad].
        strokes: One after the other.
        kinds: What it is made of, in words.
    """

    start: Array
    strokes: tuple[Stroke, ...]
    kinds: tuple[str, ...]

    @property
    def duration(self) -> float:
        """Length in time [s]."""
        return sum(stroke.duration for stroke in self.strokes)

    @property
    def moved(self) -> tuple[int, ...]:
        """Indices of the joints that it moves."""
        return tuple(sorted({joint for stroke in self.strokes for joint in stroke.goal}))

    def then(self, other: Motion) -> Motion:
        """Appends another probe that begins, as every probe, at the same start."""
        kinds = (*self.kinds, *(kind for kind in other.kinds if kind not in self.kinds))
        return Motion(self.start, (*self.strokes, *other.strokes), kinds)

    def rest(self, time: Array) -> Array:
        """Gives the rest angles (N, n) at times (N,) [s]."""
        out = np.tile(self.start, (len(time), 1))
        place, began = self.start.copy(), 0.0
        for stroke in self.strokes:
            x = np.clip((time - began) / stroke.duration, 0.0, 1.0)
            s = x**3 * (10.0 - 15.0 * x + 6.0 * x**2)
            inside = time >= began
            for joint, angle in stroke.goal.items():
                out[inside, joint] = place[joint] + s[inside] * (angle - place[joint])
                place[joint] = angle
            began += stroke.duration
        return out


def go(joint: int, places: Sequence[float], duration: float, wait: float = 0.0) -> list[Stroke]:
    """Visits places with one joint, each in the same time, and waits at each."""
    out: list[Stroke] = []
    for place in places:
        out.append(Stroke({joint: place}, duration))
        if wait > 0.0:
            out.append(Stroke({}, wait))
    return out
