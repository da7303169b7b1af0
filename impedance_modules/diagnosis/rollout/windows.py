# SPDX-License-Identifier: BSD-3-Clause
"""Where the windows of a rollout begin: evenly over the held-out recordings, alike in those that repeat each other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from impedance_modules.diagnosis.residuals.preparation import Prepared
from impedance_modules.diagnosis.rollout.drive import RUN_IN

MARGIN = 0.4
"""Left out at both ends of a recording, where filters have seen only one side [s]."""

WINDOW = 0.4
"""Length of a window [s]: long enough for friction to show, short enough for an open loop."""

WINDOWS = 20
"""Windows over all held-out recordings."""

FLOOR_WINDOWS = 4
"""Windows per recording of a fitted repeat, where no held-out recording has one."""


@dataclass(frozen=True)
class Window:
    """A recording's index, and when the window begins after the recording's own first sample [s]."""

    recording: int
    start: float


def held_out_windows(prepared: Sequence[Prepared], heldout: Sequence[int]) -> tuple[Window, ...]:
    """Spreads the windows over the held-out recordings; repeats are cut at the same times."""
    groups: dict[str, list[int]] = {}
    for index in heldout:
        groups.setdefault(prepared[index].log.group, []).append(index)
    chosen = list(groups.values())[:WINDOWS]
    out = []
    for members in chosen:
        count = max(1, round(WINDOWS / (len(chosen) * len(members))))
        out += spread(prepared, members, count)
    return tuple(out)


def floor_windows(prepared: Sequence[Prepared], pairs: Sequence[tuple[int, int]]) -> tuple[Window, ...]:
    """Windows of the first pair of recordings that repeat each other; none without one."""
    return tuple(spread(prepared, pairs[0], FLOOR_WINDOWS)) if pairs else ()


def spread(prepared: Sequence[Prepared], members: Sequence[int], count: int) -> list[Window]:
    """Cuts windows of several recordings at the same, even times; none while one of them touches something.

    The plant that lives a window again knows no surroundings.
    """
    last = min(prepared[index].log.duration for index in members) - MARGIN - WINDOW
    if last <= MARGIN:
        return []
    if any(prepared[index].log.touching is not None for index in members):
        free = [
            start
            for start in np.arange(MARGIN, last, 0.25 * WINDOW)
            if not any(_touches(prepared[index], float(start)) for index in members)
        ]
        places = np.linspace(0, len(free) - 1, count + 2)[1:-1]
        starts = np.unique([free[round(place)] for place in places if free])
    else:
        starts = np.linspace(MARGIN, last, count + 2)[1:-1]
    return [Window(index, float(start)) for index in members for start in starts]


def _touches(item: Prepared, start: float) -> bool:
    """Whether a recording's phases say that a window is spent in contact, were it for a moment."""
    touching, rate = item.log.touching, item.log.rate
    if touching is None:
        return False
    return bool(touching[round((start - RUN_IN) * rate) : round((start + WINDOW) * rate) + 1].any())


def common_windows(windows: Sequence[Window], pairs: Sequence[tuple[int, int]]) -> list[tuple[int, int]]:
    """Places of windows that show the same moment of two recordings that repeat each other."""
    place = {(window.recording, window.start): index for index, window in enumerate(windows)}
    return [
        (place[window.recording, window.start], place[other, window.start])
        for window in windows
        for one, other in pairs
        if window.recording == one and (other, window.start) in place
    ]
