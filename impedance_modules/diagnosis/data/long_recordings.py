# SPDX-License-Identifier: BSD-3-Clause
"""Reads recordings within bounds: of a long one a few stretches, spread over it, where the joints move most.

A day's log is no better than some minutes of it, once these show every joint moving, early and late. Only the
positions are looked through, thinned; of everything else only the stretches are kept.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impedance_modules.episode.data import Episode
from impedance_modules.episode.reader import read_episode

Array = NDArray[np.float64]

KINDS = ("position", "velocity", "effort", "effort_command", "position_command", "phase")

TOTAL_MAX = 900.0
"""Seconds that all recordings together may contribute."""

ONE_MAX = 300.0
"""Seconds that one recording may contribute."""

SHARE_MIN = 30.0
"""Seconds that each contributes at least, however many there are."""

STRETCH = 60.0
"""Length of the stretches of a long recording [s]."""

LOOKED_AT = 40_000
"""Samples of a recording that are looked through to choose its stretches."""

SPARSE = 25.0
"""A recording with fewer samples per second is not worth choosing from [Hz]."""

KEY = "stretch"
"""Of the metadata that a stretch carries in memory."""


@dataclass(frozen=True, eq=False)
class _Plan:
    """Which rows of one file are used.

    Attributes:
        coarse: Time and positions, thinned.
        every: Rows per thinned sample.
        rows: First and last + 1 of each stretch; empty where the recording is used whole.
    """

    coarse: Episode
    every: int
    rows: tuple[tuple[int, int], ...]

    @property
    def seconds(self) -> float:
        time = self.coarse.time
        return float((time[-1] - time[0]) * len(time) / (len(time) - 1))


def read_recordings(paths: Sequence[Path]) -> list[list[Episode]]:
    """Reads each recording: whole as one episode, or as the stretches that stand for it.

    Args:
        paths: Episode files or directories of runs.

    Returns:
        The episodes of each path. Recordings of one motion give the same stretches.

    Raises:
        BadInput: A file that cannot be read.
    """
    looked = [_look(path) for path in paths]
    share = float(np.clip(TOTAL_MAX / len(paths), SHARE_MIN, ONE_MAX))
    plans: list[_Plan] = []
    for coarse, every in looked:
        known = next((plan for plan in plans if plan.every == every and _alike(plan.coarse, coarse)), None)
        rows = known.rows if known else _choose(coarse, every, share)
        plans.append(_Plan(coarse, every, rows))
    return [_read(path, plan) for path, plan in zip(paths, plans, strict=True)]


def stretch_origin(episode: Episode) -> float:
    """Time at which the whole recording began [s]."""
    stretch: dict[str, Any] | None = episode.metadata.get(KEY)
    return float(episode.time[0]) if stretch is None else float(stretch["began"])


def stretch_note(episode: Episode) -> str | None:
    """Says what stands for a long recording; None for one that is used whole."""
    stretch: dict[str, Any] | None = episode.metadata.get(KEY)
    if stretch is None:
        return None
    places = ", ".join(f"{first:.0f}-{last:.0f} s" for first, last in stretch["used"])
    return (
        f"{stretch['of']}: {stretch['seconds']:.0f} s are more than is looked at; the stretches where the joints"
        f" move most stand for it: {places}"
    )


def _look(path: Path) -> tuple[Episode, int]:
    """Time and positions of a recording, thinned, and how many rows stand for one."""
    coarse = read_episode(path, ("position",), most_samples=LOOKED_AT)
    return coarse, int(coarse.metadata["kept_every"])


def _choose(coarse: Episode, every: int, share: float) -> tuple[tuple[int, int], ...]:
    time = coarse.time
    seconds = float(time[-1] - time[0]) if len(time) > 1 else 0.0
    if seconds <= share or np.any(np.diff(time) <= 0.0) or len(time) * every < SPARSE * seconds:
        return ()  # short enough; or of a disordered time, or a slow rate, which are refused later
    count = max(1, int(share / STRETCH))
    length = min(STRETCH, share)
    moved = np.abs(np.diff(coarse.matrix("position"), axis=0))
    whole = moved.sum(axis=0)
    worth = np.concatenate([[0.0], np.cumsum((moved / np.where(whole > 0.0, whole, np.inf)).sum(axis=1))])
    edges = np.linspace(time[0], time[-1], count + 1)
    return tuple(_best(time, worth, edges[i], edges[i + 1], length, every) for i in range(count))


def _best(  # noqa: PLR0917 - all of them belong together
    time: Array, worth: Array, begin: float, end: float, length: float, every: int
) -> tuple[int, int]:
    """Rows of the stretch of a length within bounds in which most moves."""
    starts = np.flatnonzero((time >= begin) & (time <= end - length))
    if starts.size == 0:
        starts = np.array([int(np.searchsorted(time, begin))])
    stops = np.searchsorted(time, time[starts] + length).clip(max=len(time) - 1)
    best = int(np.argmax(worth[stops] - worth[starts]))
    return int(starts[best]) * every, int(stops[best]) * every


def _alike(one: Episode, other: Episode) -> bool:
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

    def cut(quantity: Mapping[str, Array]) -> Mapping[str, Array]:
        return MappingProxyType({joint: values[rows] for joint, values in quantity.items()})

    return replace(
        whole,
        time=whole.time[rows],
        position=cut(whole.position),
        velocity=cut(whole.velocity),
        effort=cut(whole.effort),
        effort_command=cut(whole.effort_command),
        position_command=cut(whole.position_command),
        metadata=MappingProxyType(metadata),
    )
