# SPDX-License-Identifier: BSD-3-Clause
"""The motions that a probe is made of: one joint each, inside its room, beginning and ending at the start.

holds        the joint rests at five places, reached from both sides: weights, springs, offsets, Coulomb friction
ladder       strokes both ways at three speeds: dry against viscous friction, laws of speed
ramp         one slow stroke each way: laws of position
reversals    small quick strokes: what happens where the motion turns
chirp        strokes that grow quicker and quicker: inertia against springs, delays and lags
two_loads    the ladder with a neighbouring joint in two places: laws of the load
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impedance_modules.diagnosis.probe.room import Room
from impedance_modules.diagnosis.probe.strokes import PEAK, Motion, Stroke, go

Array = NDArray[np.float64]

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

CARRIED = 0.5
"""How far the neighbouring joint goes for another load [rad]."""

SIZES = (1.0, 0.5)
"""Sizes that are tried: the largest that is safe wins."""


@dataclass(frozen=True)
class _Reach:
    """Where one joint may go: start, lower and upper end [rad], and its speed [rad/s]."""

    joint: int
    start: float
    low: float
    high: float
    speed: float

    def time(self, way: float, share: float = 1.0) -> float:
        """Duration of a stroke over a way at a part of the allowed speed [s]."""
        return max(SHORTEST, PEAK * abs(way) / (share * self.speed))


def motions(room: Room, start: Array, joint: int, size: float) -> Iterator[Motion]:
    """Gives every kind of motion of a joint at a size; kinds for which there is no room are left out."""
    low = max(room.lower[joint], start[joint] - size * SWING_MAX)
    high = min(room.upper[joint], start[joint] + size * SWING_MAX)
    reach = _Reach(joint, float(start[joint]), float(low), float(high), float(room.velocity[joint]))
    if reach.high - reach.low < SWING_MIN:
        return
    for name, strokes in KINDS.items():
        chain = strokes(reach)
        if chain:
            yield Motion(start, tuple(chain), (f"{name} of {room.joints[joint]}",))
    neighbour = joint + 1 if joint + 1 < len(start) else joint - 1
    if neighbour >= 0:
        there = start[neighbour] + CARRIED * (
            1.0 if start[neighbour] + CARRIED < room.upper[neighbour] else -1.0
        )
        if room.lower[neighbour] < there < room.upper[neighbour]:
            ladder = _ladder(reach)
            slow = max(SHORTEST, PEAK * CARRIED / float(room.velocity[neighbour]))
            back = Stroke({neighbour: float(start[neighbour])}, slow)
            chain = [*ladder, Stroke({neighbour: float(there)}, slow), *ladder, back]
            yield Motion(start, tuple(chain), (f"two_loads of {room.joints[joint]}",))


def _holds(reach: _Reach) -> list[Stroke]:
    places = np.linspace(reach.low, reach.high, 5)
    pace = reach.time(reach.high - reach.low, 0.5)
    up, down = [float(x) for x in places], [float(x) for x in places[-2::-1]]
    return [*go(reach.joint, [*up, *down], max(0.6, pace / 3.0), HOLD), *_home(reach)]


def _ladder(reach: _Reach) -> list[Stroke]:
    way = reach.high - reach.low
    out = go(reach.joint, [reach.low], reach.time(way))
    for share, part in zip(SPEEDS, WAYS, strict=True):
        out += go(reach.joint, [reach.low + part * way, reach.low], reach.time(part * way, share))
    return [*out, *_home(reach)]


def _ramp(reach: _Reach) -> list[Stroke]:
    way = reach.high - reach.low
    return [
        *go(reach.joint, [reach.low], reach.time(way)),
        *go(reach.joint, [reach.high, reach.low], reach.time(way, 0.15)),
        *_home(reach),
    ]


def _reversals(reach: _Reach) -> list[Stroke]:
    way = min(SMALL, (reach.high - reach.low) / 2.0)
    centre = min(max(reach.start, reach.low + way), reach.high - way)
    places = [centre + way, centre - way] * 5
    return [
        *go(reach.joint, places, reach.time(2.0 * way, 0.5)),
        *_home(reach, abs(centre - reach.start) + way),
    ]


def _chirp(reach: _Reach) -> list[Stroke]:
    out: list[Stroke] = []
    for index, duration in enumerate(np.geomspace(2.0, SHORTEST, 16)):
        way = min((reach.high - reach.low) / 2.0, reach.speed * float(duration) / PEAK / 2.0)
        centre = min(max(reach.start, reach.low + way), reach.high - way)
        out.append(Stroke({reach.joint: centre + (way if index % 2 else -way)}, float(duration)))
    return [*out, *_home(reach)]


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
