# SPDX-License-Identifier: BSD-3-Clause
"""The path of a target that is read from an earlier recording: what a task says of it, and what was read."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

PATH = "path"
"""Key of a target in place of its coordinates."""

POSE, TARGET = "pose", "target"
"""What of a frame was recorded: where it was, or where its equilibrium was."""

SMOOTHING = 0.1
"""Time between two control points of the smooth path where a task does not state it [s]."""


@dataclass(frozen=True)
class PathCourse:
    """A smooth path through recorded poses: a uniform cubic B-spline (``modules.recorded_path``).

    Attributes:
        control: (k, 7) control points: position in world [m] and quaternion (x, y, z, w).
        spacing: Recorded time from one control point to the next [s].
        length: Recorded time from the path's beginning to its end, (k - 3) times that [s].
        deviation: Largest distance of a recorded place from the smooth path [m].
    """

    control: NDArray[np.float64] = field(repr=False, compare=False)
    spacing: float
    length: float
    deviation: float


@dataclass(frozen=True)
class PathSpec:
    """A path that a target takes from a recording.

    Attributes:
        episode: File or folder of the recording, as the task names it.
        frame: Whose poses are taken; None for the frame of the target's spring.
        of: ``pose`` or ``target``.
        first, last: Recorded time at which the path begins and ends [s]; None for all that was recorded.
        speed: Times the recorded speed.
        approach: Time of the minimum jerk onto the path's beginning [s]; None where the path begins at the target.
        smoothing: Recorded time between two control points at most [s].
        course: What was read; None as long as nothing was.
    """

    episode: str
    frame: str | None
    of: str
    first: float | None
    last: float | None
    speed: float
    approach: float | None
    smoothing: float
    course: PathCourse | None = None


def build_path(raw: Mapping[str, Any]) -> PathSpec:
    """Makes a path of clean plain data; nothing is read yet."""
    return PathSpec(
        episode=raw["episode"],
        frame=raw.get("frame"),
        of=raw.get("of", POSE),
        first=_number(raw, "from"),
        last=_number(raw, "to"),
        speed=float(raw.get("speed", 1.0)),
        approach=_number(raw, "approach"),
        smoothing=float(raw.get("smoothing", SMOOTHING)),
    )


def _number(raw: Mapping[str, Any], key: str) -> float | None:
    return float(raw[key]) if key in raw else None


def episode_path(task: Path, episode: str) -> Path:
    """Gives the place of a recording that a task names; a relative path begins at the task's folder."""
    return task.resolve().parent / episode
