# SPDX-License-Identifier: BSD-3-Clause
"""Library of probe motions: one joint each, inside its limits, beginning and ending at the start posture.

holds        the joint rests at seven places far apart, reached from both sides: weights, springs, offsets
ladder       strokes both ways at three speeds: dry against viscous friction, laws of speed
ramp         one slow stroke in each direction: laws of position
reversals    small quick strokes: effects where the motion reverses
chirp        strokes of decreasing duration: inertia against springs, delays and lags
two_loads    strokes both ways in the nearby posture that loads the joint least, and in the one that loads it most

A probe is a chain of strokes; each takes the joint springs' rest posture to a new place by minimum jerk,

    rest(t) = r_0 + s(t / T) (r_1 - r_0),      s(x) = 10 x^3 - 15 x^4 + 6 x^5,

as a phase of a task does with `posture`; peak speed 15/8 |r_1 - r_0| / T.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.diagnosis.experiment_design.motion_limits import MotionLimits

Weight = Callable[[Array], Array]
"""Postures (N, n) [rad] -> torque of the links' weight, (N, n) [N.m]."""

SWING_MAX = 0.5
"""Longest stroke to either side of the start [rad]."""

SWING_MIN = 0.05
"""Shortest range for a motion [rad]."""

SPEEDS = (0.12, 0.35, 1.0)
"""Speeds of a ladder, as parts of the joint's allowed speed."""

LENGTHS = (0.3, 0.6, 1.0)
"""Lengths of its strokes, as parts of the range: slow strokes are short."""

HOLD = 0.7
"""Time at each place [s]."""

SHORTEST = 0.35
"""Shortest duration of a stroke that the joint springs follow [s]."""

REVERSAL = 0.08
"""Length of a small reversal [rad]."""

DISPLACEMENT_MAX = 1.2
"""Largest displacement of a joint from the start to change its load [rad]."""

PLACES = 7
"""Angles per joint among which the postures of least and most load are searched."""

LOAD_TOLERANCE = 0.1
"""Among postures whose loads differ by less than this part of the load's range, the nearest is taken."""

LOADED_STROKE = 0.2
"""Stroke to either side with each load [rad]."""

OVERSHOOT = 0.03
"""Allowed overshoot of the joint springs beyond a stroke's end [rad]."""

CHIRP_SPEED = 0.9
"""Part of the allowed speed that a chirp uses, because its strokes superpose."""

SIZES = (1.0, 0.75, 0.5)
"""Relative sizes that are tried; the largest safe one is taken."""

PEAK_SPEED = 15.0 / 8.0
"""Peak speed of a minimum-jerk stroke over its mean speed."""


@dataclass(frozen=True)
class Stroke:
    """Moves some joints to new angles in a given time; an empty goal waits.

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
        kinds: The motions that it consists of, by name.
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
    """Gives every kind of motion of a joint at a size; kinds that do not fit into its limits are left out.

    Args:
        limits: Limits.
        start: (n,) posture at which every motion begins and ends [rad].
        joint: Which moves.
        size: Part of the longest stroke.
        weight: Postures (N, n) -> torques (N, n) of the links' weight [N.m].
    """
    low = max(limits.lower[joint] + OVERSHOOT, start[joint] - size * SWING_MAX)
    high = min(limits.upper[joint] - OVERSHOOT, start[joint] + size * SWING_MAX)
    reach = _Reach(joint, float(start[joint]), float(low), float(high), float(limits.velocity[joint]))
    if reach.high - reach.low < SWING_MIN:
        return
    wide = _Reach(
        joint,
        reach.start,
        float(max(limits.lower[joint] + OVERSHOOT, start[joint] - size * DISPLACEMENT_MAX)),
        float(min(limits.upper[joint] - OVERSHOOT, start[joint] + size * DISPLACEMENT_MAX)),
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
    """Range of one joint: start, lower and upper end [rad], and its speed [rad/s]."""

    joint: int
    start: float
    low: float
    high: float
    speed: float

    def time(self, length: float, share: float = 1.0) -> float:
        """Duration of a stroke of a length [rad] at a part of the allowed speed [s]."""
        return max(SHORTEST, PEAK_SPEED * abs(length) / (share * self.speed))


def _holds(reach: _Reach) -> list[Stroke]:
    places = np.linspace(reach.low, reach.high, 7)
    pace = reach.time(reach.high - reach.low, 0.5)
    up, down = [float(x) for x in places], [float(x) for x in places[-2::-1]]
    return [*visit(reach.joint, [*up, *down], max(0.6, pace / 4.0), HOLD), *_return(reach)]


def _ladder(reach: _Reach) -> list[Stroke]:
    length = reach.high - reach.low
    out = visit(reach.joint, [reach.low], reach.time(length))
    for share, part in zip(SPEEDS, LENGTHS, strict=True):
        out += visit(reach.joint, [reach.low + part * length, reach.low], reach.time(part * length, share))
    return [*out, *_return(reach)]


def _ramp(reach: _Reach) -> list[Stroke]:
    length = reach.high - reach.low
    return [
        *visit(reach.joint, [reach.low], reach.time(length)),
        *visit(reach.joint, [reach.high, reach.low], reach.time(length, 0.15)),
        *_return(reach),
    ]


def _reversals(reach: _Reach) -> list[Stroke]:
    length = min(REVERSAL, (reach.high - reach.low) / 2.0)
    centre = min(max(reach.start, reach.low + length), reach.high - length)
    places = [centre + length, centre - length] * 5
    return [
        *visit(reach.joint, places, reach.time(2.0 * length, 0.5)),
        *_return(reach, abs(centre - reach.start) + length),
    ]


def _chirp(reach: _Reach) -> list[Stroke]:
    out: list[Stroke] = []
    for index, duration in enumerate(np.geomspace(2.0, SHORTEST, 16)):
        length = min(
            (reach.high - reach.low) / 2.0, CHIRP_SPEED * reach.speed * float(duration) / PEAK_SPEED / 2.0
        )
        centre = min(max(reach.start, reach.low + length), reach.high - length)
        out.append(Stroke({reach.joint: centre + (length if index % 2 else -length)}, float(duration)))
    return [*out, *_return(reach)]


def _two_loads(
    reach: _Reach, limits: MotionLimits, start: Array, weight: Weight, size: float
) -> list[Stroke]:
    """Strokes both ways in the nearby posture that loads the joint least, and in the one that loads it most."""
    length = min(LOADED_STROKE, (reach.high - reach.low) / 2.0)
    chain: list[Stroke] = []
    for goal in _loads(reach, limits, start, weight, size):
        farthest = max(abs(angle - start[joint]) / limits.velocity[joint] for joint, angle in goal.items())
        slow = max(SHORTEST, PEAK_SPEED * float(farthest) / SPEEDS[1])
        centre = min(
            max(goal[reach.joint], float(limits.lower[reach.joint]) + OVERSHOOT + length),
            float(limits.upper[reach.joint]) - OVERSHOOT - length,
        )
        chain += [
            Stroke({**goal, reach.joint: centre - length}, slow),
            *visit(reach.joint, [centre + length, centre - length] * 2, reach.time(2.0 * length, SPEEDS[1])),
        ]
    back = {joint: float(start[joint]) for stroke in chain for joint in stroke.goal}
    return [*chain, Stroke(back, chain[0].duration + slow), Stroke({}, 0.5)]


def _loads(
    reach: _Reach, limits: MotionLimits, start: Array, weight: Weight, size: float
) -> tuple[dict[int, float], dict[int, float]]:
    """Angles of the joint and of one other joint with the smallest and with the largest weight on the joint."""

    def places(joint: int) -> Array:
        ends = start[joint] - size * DISPLACEMENT_MAX, start[joint] + size * DISPLACEMENT_MAX
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
    length = np.sum(np.abs(postures - start), axis=1)
    span = float(np.ptp(load))
    light = np.where(load <= load.min() + LOAD_TOLERANCE * span, length, np.inf)
    heavy = np.where(load >= load.max() - LOAD_TOLERANCE * span, length, np.inf)
    return goals[int(np.argmin(light))], goals[int(np.argmin(heavy))]


def _return(reach: _Reach, length: float | None = None) -> list[Stroke]:
    longest = reach.high - reach.low if length is None else length
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
"""Kinds with the larger range: over a small range weight cannot be distinguished from an offset."""
