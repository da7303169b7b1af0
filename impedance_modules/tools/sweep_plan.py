# SPDX-License-Identifier: BSD-3-Clause
"""What a sweep varies, and the runs that follow: a grid or random draws, each with several noise seeds."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from impedance_modules.errors import BadInput
from impedance_modules.robot.hand_postures import with_joint_angles
from impedance_modules.spec.document import Document
from impedance_modules.spec.patch_file import read_patch
from impedance_modules.spec.task_reader import read_task
from impedance_modules.spec.task_text import changed, find_steps, task_document
from impedance_modules.spec.yaml_tree import KeyPath

POINTS = 5
"""Values of a range that does not say how many."""

MOST_RUNS = 100_000


@dataclass(frozen=True)
class Range:
    """One number that is varied.

    Attributes:
        path: As the user wrote it.
        low, high: Its range.
        points: Values of a grid, evenly spaced.
    """

    path: str
    low: float
    high: float
    points: int

    @property
    def values(self) -> tuple[float, ...]:
        """The grid's values."""
        return tuple(map(float, np.linspace(self.low, self.high, self.points)))


@dataclass(frozen=True)
class SweepJob:
    """One run, complete in itself, so that it can be sent elsewhere.

    Attributes:
        number: From 0.
        values: Path -> value.
        seed: Of the simulated noise.
        task: Text of the task file as it will run.
        patch: Text of the patch that is applied, or None.
        rate: Control rate [Hz], or None for the robot's.
        duration: Ends the run after this time [s]; None lets the task decide.
        keep: Folder for the run's recording, or None to keep none.
    """

    number: int
    values: Mapping[str, float]
    seed: int
    task: str
    patch: str | None
    rate: float | None
    duration: float | None
    keep: Path | None


@dataclass(frozen=True)
class SweepPlan:
    """A task and how it is varied.

    Attributes:
        task: Name or path of the task.
        ranges: What is varied, the first slowest.
        effects: Patch that is applied, or None; a path that begins with ``effects.`` varies one of its numbers.
        draws: Number of random draws, uniform in all ranges; None for the whole grid.
        seeds: Noise seeds per point.
        seed: First of them, and of the draws.
        rate, duration: See ``SweepJob``.
        keep: Folder for recordings, or None.
    """

    task: str
    ranges: tuple[Range, ...]
    effects: Path | None
    draws: int | None
    seeds: int
    seed: int
    rate: float | None
    duration: float | None
    keep: Path | None

    def points(self) -> list[dict[str, float]]:
        """Lists what the runs' numbers are, once for all noise seeds."""
        paths = [found.path for found in self.ranges]
        if self.draws is None:
            rows: Sequence[Sequence[float]] = list(
                itertools.product(*(found.values for found in self.ranges))
            )
        else:
            low, high = (
                np.array([getattr(found, side) for found in self.ranges]) for side in ("low", "high")
            )
            random = np.random.default_rng(self.seed)
            rows = random.uniform(low, high, (self.draws, len(paths))).tolist()
        return [dict(zip(paths, map(float, row), strict=True)) for row in rows]


def read_range(text: str) -> Range:
    """Reads ``PATH=LO:HI`` or ``PATH=LO:HI:N``.

    Raises:
        BadInput: It is none.
    """
    path, _, numbers = text.partition("=")
    parts = numbers.split(":")
    valid = "valid: PATH=LO:HI or PATH=LO:HI:N, e.g. environment.0.height=-0.05:0.05:11"
    try:
        low, high = (float(part) for part in parts[:2])
        points = int(parts[2]) if len(parts) == 3 else POINTS
    except ValueError:
        raise BadInput(f"--vary {text}: not a path with a range ({valid})") from None
    if not path or len(parts) > 3 or not math.isfinite(high - low):
        raise BadInput(f"--vary {text}: not a path with a range ({valid})")
    if low > high or points < 1 or (points == 1 and low < high):
        raise BadInput(f"--vary {text}: not a range from LO up to HI in N steps, N at least 2 ({valid})")
    return Range(path, low, high, points)


def make_jobs(plan: SweepPlan) -> list[SweepJob]:
    """Writes out every run of a plan.

    Raises:
        BadInput: A path leads to no number, is given twice, or there are too many runs.
        BadFile: The task or the patch is faulty as it stands.
    """
    with_joint_angles(*read_task(plan.task))
    task = task_document(plan.task)
    patch = None if plan.effects is None else read_patch(plan.effects).document
    numbers = {found.path: _find_number(found, task, patch) for found in plan.ranges}
    if len(numbers) < len(plan.ranges):
        raise BadInput("--vary names the same path twice (valid: each path once)")
    count = math.prod(found.points for found in plan.ranges) if plan.draws is None else plan.draws
    if count * plan.seeds > MOST_RUNS:
        raise BadInput(f"{count * plan.seeds} runs are too many (valid: up to {MOST_RUNS})")
    points = plan.points()
    files = _SourceTexts(task, patch, numbers)
    return [
        _job(plan, files, number, point, seed)
        for number, (point, seed) in enumerate(itertools.product(points, range(plan.seeds)))
    ]


@dataclass(frozen=True)
class _SourceTexts:
    """Task and patch as they stand; path -> whether it varies the patch, and its steps."""

    task: Document
    patch: Document | None
    numbers: Mapping[str, tuple[bool, KeyPath]]

    def texts(self, point: Mapping[str, float]) -> tuple[str, str | None]:
        """Writes both with one run's numbers."""
        in_task = {steps: point[path] for path, (from_patch, steps) in self.numbers.items() if not from_patch}
        in_patch = {steps: point[path] for path, (from_patch, steps) in self.numbers.items() if from_patch}
        return changed(self.task, in_task), None if self.patch is None else changed(self.patch, in_patch)


def _job(
    plan: SweepPlan, files: _SourceTexts, number: int, point: Mapping[str, float], seed: int
) -> SweepJob:
    task, patch = files.texts(point)
    return SweepJob(
        number=number,
        values=point,
        seed=plan.seed + seed,
        task=task,
        patch=patch,
        rate=plan.rate,
        duration=plan.duration,
        keep=None if plan.keep is None else plan.keep / f"run-{number:05d}",
    )


def _find_number(found: Range, task: Document, patch: Document | None) -> tuple[bool, KeyPath]:
    """Finds where a varied number stands: whether in the patch, and its steps."""
    from_patch = found.path.partition(".")[0] == "effects" and "effects" not in task.data
    if from_patch and patch is None:
        raise BadInput(
            f"--vary {found.path}: varies an effect, but no patch is applied (valid: --effects PATCH)"
        )
    data = patch.data if from_patch and patch is not None else task.data
    steps = find_steps(data, found.path)
    here = data
    for step in steps:
        here = here[step]  # type: ignore[index]
    if isinstance(here, bool) or not isinstance(here, int | float):
        raise BadInput(
            f"--vary {found.path}: stands for {type(here).__name__} '{str(here)[:40]}' (valid: a path to a number)"
        )
    return from_patch, steps
