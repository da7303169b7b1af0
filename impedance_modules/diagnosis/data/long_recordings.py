# SPDX-License-Identifier: BSD-3-Clause
"""Reads recordings of any length: of a long one a few segments, spread over it, in which the joints move most.

Some minutes of a day's log suffice if every joint moves in them, early and late. The choice needs the thinned
positions only; all other channels are read in the chosen segments alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.episode.data import Episode
from impedance_modules.episode.reader import read_episode

KINDS = ("position", "velocity", "effort", "effort_command", "position_command", "phase")

TOTAL_MAX = 900.0
"""Seconds that all recordings together may contribute."""

ONE_MAX = 300.0
"""Seconds that one recording may contribute."""

SHARE_MIN = 30.0
"""Seconds that each contributes at least, however many there are."""

JOINTS = 7
"""Joints up to which that holds; of twice as many a fourth: candidates are pairs of joints, too."""

SEGMENT, SHORT_SEGMENT = 60.0, 20.0
"""Length of the segments of a long recording, and of those of which there are three where fewer would be used [s]."""

SAMPLES_READ = 40_000
"""Samples of a recording that are read to choose its segments."""

RATE_MIN_SEGMENTED = 25.0
"""Recordings with fewer samples per second are not segmented, and refused later [Hz]."""

KEY = "segment"
"""Key of the metadata that describes a segment; in memory only."""


@dataclass(frozen=True, eq=False)
class _Plan:
    """Which rows of one file are used.

    Attributes:
        coarse: Time and positions, thinned.
        every: Rows per thinned sample.
        rows: First and last + 1 of each segment; empty where the recording is used whole.
    """

    coarse: Episode
    every: int
    rows: tuple[tuple[int, int], ...]

    @property
    def seconds(self) -> float:
        time = self.coarse.time
        return float((time[-1] - time[0]) * len(time) / (len(time) - 1))


def read_recordings(paths: Sequence[Path]) -> list[list[Episode]]:
    """Reads each recording: whole as one episode, or as segments of it.

    Args:
        paths: Episode files or directories of runs.

    Returns:
        The episodes of each path. Recordings of one motion give the same segments.

    Raises:
        BadInput: A file that cannot be read.
    """
    looked = [_read_coarse(path) for path in paths]
    share = float(np.clip(TOTAL_MAX / len(paths), SHARE_MIN, ONE_MAX))
    plans: list[_Plan] = []
    for coarse, every in looked:
        known = next(
            (plan for plan in plans if plan.every == every and _same_motion(plan.coarse, coarse)), None
        )
        less = min(1.0, JOINTS / max(len(coarse.joints), 1)) ** 2
        rows = known.rows if known else _choose(coarse, every, max(SHARE_MIN, less * share))
        plans.append(_Plan(coarse, every, rows))
    return [_read(path, plan) for path, plan in zip(paths, plans, strict=True)]


def segment_origin(episode: Episode) -> float:
    """Time at which the whole recording began [s]."""
    segment: dict[str, Any] | None = episode.metadata.get(KEY)
    return float(episode.time[0]) if segment is None else float(segment["began"])


def segment_note(episode: Episode) -> str | None:
    """Says which segments of a long recording are used; None for one that is used whole."""
    segment: dict[str, Any] | None = episode.metadata.get(KEY)
    if segment is None:
        return None
    places = ", ".join(f"{first:.0f}-{last:.0f} s" for first, last in segment["used"])
    return (
        f"{segment['of']}: {segment['seconds']:.0f} s are more than is used; these segments are used, in which"
        f" the joints move most: {places}"
    )


def _read_coarse(path: Path) -> tuple[Episode, int]:
    """Time and positions of a recording, thinned, and the number of rows per thinned sample."""
    coarse = read_episode(path, ("position",), most_samples=SAMPLES_READ)
    return coarse, int(coarse.metadata["kept_every"])


def _choose(coarse: Episode, every: int, share: float) -> tuple[tuple[int, int], ...]:
    time = coarse.time
    seconds = float(time[-1] - time[0]) if len(time) > 1 else 0.0
    if seconds <= share or np.any(np.diff(time) <= 0.0) or len(time) * every < RATE_MIN_SEGMENTED * seconds:
        return ()  # short enough; or of a disordered time, or a slow rate, which are refused later
    count = max(1, int(share / SEGMENT), min(3, int(share / SHORT_SEGMENT)))
    length = min(SEGMENT, share / count)
    moved = np.abs(np.diff(coarse.matrix("position"), axis=0))
    whole = moved.sum(axis=0)
    travel = np.concatenate([[0.0], np.cumsum((moved / np.where(whole > 0.0, whole, np.inf)).sum(axis=1))])
    edges = np.linspace(time[0], time[-1], count + 1)
    return tuple(_best(time, travel, edges[i], edges[i + 1], length, every) for i in range(count))


def _best(time: Array, travel: Array, begin: float, end: float, length: float, every: int) -> tuple[int, int]:
    """First and last + 1 row of the segment of a given length, within bounds, with the most motion."""
    starts = np.flatnonzero((time >= begin) & (time <= end - length))
    if starts.size == 0:
        starts = np.array([int(np.searchsorted(time, begin))])
    stops = np.searchsorted(time, time[starts] + length).clip(max=len(time) - 1)
    best = int(np.argmax(travel[stops] - travel[starts]))
    return int(starts[best]) * every, int(stops[best]) * every


def _same_motion(one: Episode, other: Episode) -> bool:
    """Whether two long recordings show one motion."""
    samples = min(len(one), len(other))
    if one.joints != other.joints or abs(len(one) - len(other)) > 0.02 * samples:
        return False
    a, b = one.matrix("position")[:samples], other.matrix("position")[:samples]
    return bool(np.std(a - b) < 0.1 * np.std(a))


def _read(path: Path, plan: _Plan) -> list[Episode]:
    if not plan.rows:
        return [read_episode(path, KINDS)]
    whole = read_episode(path, KINDS, rows=plan.rows)
    lengths = [stop - first for first, stop in plan.rows]
    ends = np.cumsum(lengths)
    used = [
        (float(whole.time[end - length]), float(whole.time[end - 1]))
        for end, length in zip(ends, lengths, strict=True)
    ]
    began = float(plan.coarse.time[0])
    about = {"of": whole.name, "began": began, "seconds": plan.seconds, "used": used}
    return [
        _cut(whole, slice(end - length, end), f"@{place[0] - began:.0f}s", about)
        for end, length, place in zip(ends, lengths, used, strict=True)
    ]


def _cut(whole: Episode, rows: slice, mark: str, about: dict[str, Any]) -> Episode:
    original = whole.repeat_of
    metadata = {
        **whole.metadata,
        "episode": whole.name + mark,
        "repeat_of": None if original is None else original + mark,
        KEY: about,
    }
    return replace(whole.part(rows), metadata=MappingProxyType(metadata))
