# SPDX-License-Identifier: BSD-3-Clause
"""The motions that a probe is made of: one joint each, inside its limits, beginning and ending at the start.

holds        the joint rests at seven places far apart, reached from both sides: weights, springs, offsets
ladder       strokes both ways at three speeds: dry against viscous friction, laws of speed
ramp         one slow stroke each way: laws of position
reversals    small quick strokes: what happens where the motion turns
chirp        strokes that grow quicker and quicker: inertia against springs, delays and lags
two_loads    strokes both ways in the posture nearby that loads the joint least, and in the one that does most
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impedance_modules.diagnosis.experiment_design.motion_limits import MotionLimits

Array = NDArray[np.float64]
Weight = Callable[[Array], Array]
"""Postures (N, n) [rad] -> what the links' weight asks of the joints, (N, n) [N.m]."""

SWING_MAX = 0.5
"""Longest way to either side of the start [rad]."""

SWING_MIN = 0.05
"""Shortest way worth a stroke [rad]."""

SPEEDS = (0.12, 0.35, 1.0)
"""Speeds of a ladder over the joint's allowed one."""

WAYS = (0.3, 0.6, 1.0)
"""Ways of its strokes over the whole one: slow strokes are short."""

HOLD = 0.7
"""Time at each place [s]."""

SHORTEST = 0.35
"""Shortest stroke [s]; quicker ones the joint springs would not follow."""

SMALL = 0.08
"""Way of a small reversal [rad]."""

CARRIED = 1.2
"""How far joints visit at most for another load [rad]."""

PLACES = 7
"""Angles of every joint that are looked at for it."""

NEARLY = 0.1
"""Of postures whose loads differ by less than this part of what can be had, the nearest is taken."""

LOADED = 0.2
"""Way to either side with each load [rad]."""

OVERSHOOT = 0.03
"""By how much the joint springs may pass a stroke's end [rad]."""

CALM = 0.9
"""Part of its speed that a chirp uses: its strokes add up."""

SIZES = (1.0, 0.75, 0.5)
"""Sizes that are tried: the largest that is safe wins."""

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
class ProbeMotion:
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

    def then(self, other: ProbeMotion) -> ProbeMotion:
        """Appends another probe that begins, as every probe, at the same start."""
        kinds = (*self.kinds, *(kind for kind in other.kinds if kind not in self.kinds))
        return ProbeMotion(self.start, (*self.strokes, *other.strokes), kinds)

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


def motions(
    limits: MotionLimits, start: Array, joint: int, size: float, weight: Weight
) -> Iterator[ProbeMotion]:
    """Gives every kind of motion of a joint at a size; kinds for which there is no limits are left out.

    Args:
        limits: Limits.
        start: (n,) posture at which every motion begins and ends [rad].
        joint: Which moves.
        size: Part of the longest way.
        weight: Postures (N, n) -> torques (N, n) that the links' weight needs [N.m].
    """
    low = max(limits.lower[joint] + OVERSHOOT, start[joint] - size * SWING_MAX)
    high = min(limits.upper[joint] - OVERSHOOT, start[joint] + size * SWING_MAX)
    reach = _Reach(joint, float(start[joint]), float(low), float(high), float(limits.velocity[joint]))
    if reach.high - reach.low < SWING_MIN:
        return
    wide = _Reach(
        joint,
        reach.start,
        float(max(limits.lower[joint] + OVERSHOOT, start[joint] - size * CARRIED)),
        float(min(limits.upper[joint] - OVERSHOOT, start[joint] + size * CARRIED)),
        reach.speed,
    )
    for name, strokes in KINDS.items():
        chain = strokes(wide if name in WIDE else reach)
        if chain:
            yield ProbeMotion(start, tuple(chain), (f"{name} of {limits.joints[joint]}",))
    chain = _two_loads(reach, limits, start, weight, size)
    yield ProbeMotion(start, tuple(chain), (f"two_loads of {limits.joints[joint]}",))


def visit(joint: int, places: Sequence[float], duration: float, wait: float = 0.0) -> list[Stroke]:
    """Visits places with one joint, each in the same time, and waits at each."""
    out: list[Stroke] = []
    for place in places:
        out.append(Stroke({joint: place}, duration))
        if wait > 0.0:
            out.append(Stroke({}, wait))
    return out


@dataclass(frozen=True)
class _Reach:
    """Where one joint may visit: start, lower and upper end [rad], and its speed [rad/s]."""

    joint: int
    start: float
    low: float
    high: float
    speed: float

    def time(self, way: float, share: float = 1.0) -> float:
        """Duration of a stroke over a way at a part of the allowed speed [s]."""
        return max(SHORTEST, PEAK * abs(way) / (share * self.speed))


def _holds(reach: _Reach) -> list[Stroke]:
    places = np.linspace(reach.low, reach.high, 7)
    pace = reach.time(reach.high - reach.low, 0.5)
    up, down = [float(x) for x in places], [float(x) for x in places[-2::-1]]
    return [*visit(reach.joint, [*up, *down], max(0.6, pace / 4.0), HOLD), *_home(reach)]


def _ladder(reach: _Reach) -> list[Stroke]:
    way = reach.high - reach.low
    out = visit(reach.joint, [reach.low], reach.time(way))
    for share, part in zip(SPEEDS, WAYS, strict=True):
        out += visit(reach.joint, [reach.low + part * way, reach.low], reach.time(part * way, share))
    return [*out, *_home(reach)]


def _ramp(reach: _Reach) -> list[Stroke]:
    way = reach.high - reach.low
    return [
        *visit(reach.joint, [reach.low], reach.time(way)),
        *visit(reach.joint, [reach.high, reach.low], reach.time(way, 0.15)),
        *_home(reach),
    ]


def _reversals(reach: _Reach) -> list[Stroke]:
    way = min(SMALL, (reach.high - reach.low) / 2.0)
    centre = min(max(reach.start, reach.low + way), reach.high - way)
    places = [centre + way, centre - way] * 5
    return [
        *visit(reach.joint, places, reach.time(2.0 * way, 0.5)),
        *_home(reach, abs(centre - reach.start) + way),
    ]


def _chirp(reach: _Reach) -> list[Stroke]:
    out: list[Stroke] = []
    for index, duration in enumerate(np.geomspace(2.0, SHORTEST, 16)):
        way = min((reach.high - reach.low) / 2.0, CALM * reach.speed * float(duration) / PEAK / 2.0)
        centre = min(max(reach.start, reach.low + way), reach.high - way)
        out.append(Stroke({reach.joint: centre + (way if index % 2 else -way)}, float(duration)))
    return [*out, *_home(reach)]


def _two_loads(
    reach: _Reach, limits: MotionLimits, start: Array, weight: Weight, size: float
) -> list[Stroke]:
    """Strokes both ways in the posture near the start that loads the joint least, and in the one that does most."""
    way = min(LOADED, (reach.high - reach.low) / 2.0)
    chain: list[Stroke] = []
    for goal in _loads(reach, limits, start, weight, size):
        farthest = max(abs(angle - start[joint]) / limits.velocity[joint] for joint, angle in goal.items())
        slow = max(SHORTEST, PEAK * float(farthest) / SPEEDS[1])
        centre = min(
            max(goal[reach.joint], float(limits.lower[reach.joint]) + OVERSHOOT + way),
            float(limits.upper[reach.joint]) - OVERSHOOT - way,
        )
        chain += [
            Stroke({**goal, reach.joint: centre - way}, slow),
            *visit(reach.joint, [centre + way, centre - way] * 2, reach.time(2.0 * way, SPEEDS[1])),
        ]
    back = {joint: float(start[joint]) for stroke in chain for joint in stroke.goal}
    return [*chain, Stroke(back, chain[0].duration + slow), Stroke({}, 0.5)]


def _loads(
    reach: _Reach, limits: MotionLimits, start: Array, weight: Weight, size: float
) -> tuple[dict[int, float], dict[int, float]]:
    """Angles of the joint and of one other with the smallest, and with the largest weight on the joint."""

    def places(joint: int) -> Array:
        ends = start[joint] - size * CARRIED, start[joint] + size * CARRIED
        return np.append(
            start[joint],
            np.linspace(
                max(limits.lower[joint] + OVERSHOOT, ends[0]),
                min(limits.upper[joint] - OVERSHOOT, ends[1]),
                PLACES,
            ),
        )

    goals = [
        {reach.joint: float(own), other: float(place)}
        for other in range(len(start))
        for place in places(other)
        for own in places(reach.joint)
        if other != reach.joint or place == own
    ]
    postures = np.tile(start, (len(goals), 1))
    for posture, goal in zip(postures, goals, strict=True):
        posture[list(goal)] = list(goal.values())
    load = np.abs(weight(postures)[:, reach.joint])
    way = np.sum(np.abs(postures - start), axis=1)
    span = float(np.ptp(load))
    light = np.where(load <= load.min() + NEARLY * span, way, np.inf)
    heavy = np.where(load >= load.max() - NEARLY * span, way, np.inf)
    return goals[int(np.argmin(light))], goals[int(np.argmin(heavy))]


def _home(reach: _Reach, way: float | None = None) -> list[Stroke]:
    longest = reach.high - reach.low if way is None else way
    return [Stroke({reach.joint: reach.start}, reach.time(longest, 0.5)), Stroke({}, 0.5)]


KINDS: dict[str, Callable[[_Reach], list[Stroke]]] = {
    "holds": _holds,
    "ladder": _ladder,
    "ramp": _ramp,
    "reversals": _reversals,
    "chirp": _chirp,
}
"""Kind -> its strokes."""


WIDE = ("holds",)
"""Kinds that visit as far as for another load: over a small range a weight is as constant as an offset."""
