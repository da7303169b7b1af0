# SPDX-License-Identifier: BSD-3-Clause
"""The thesis's three cases at two depths: rough wood at the start and at the end of sanding, and a smooth piece."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from impedance_experiments.sanding_runs import Sanding, board_of, sand, sanding_task
from impedance_experiments.sanding_woods import KINDS, WoodKind
from impedance_modules.control.roughness_windows import Window, frequencies
from impedance_modules.errors import BadInput
from impedance_modules.spec.task import SurfaceSpec

Array = NDArray[np.float64]

SHALLOW, DEEP, SLANTED = "sand-wood", "sand-wood-deep", "sand-wood-slanted"
MOST_WINDOWS = 8
"""Windows per case; the thesis's eight."""


@dataclass(frozen=True)
class DepthRuns:
    """One depth of the equilibrium.

    Attributes:
        rough, smooth: The runs.
        start, end: First and last windows of the rough run.
        plain: Windows of the smooth run.
    """

    rough: Sanding
    smooth: Sanding
    start: tuple[Window, ...]
    end: tuple[Window, ...]
    plain: tuple[Window, ...]

    @property
    def cases(self) -> dict[str, tuple[Window, ...]]:
        """The three cases of fig. 5-11 and 5-13, by name."""
        return {
            "rough wood, start": self.start,
            "rough wood, end": self.end,
            "smooth wood": self.plain,
        }


def smooth_board(board: SurfaceSpec) -> SurfaceSpec:
    """Makes the same board of smooth wood: the middle of the smooth kind's ranges, no splinters."""
    wood = board.wood
    if wood is None or wood.roughness is None:
        return board
    ranges = KINDS[WoodKind.SMOOTH]
    even = replace(
        wood.roughness,
        height=float(np.mean(ranges.height)),
        friction=float(np.mean(ranges.rough_friction)),
    )
    return replace(board, wood=replace(wood, roughness=even, splinters=None))


def run_depth(task: str, seed: int, rough_seconds: float, smooth_seconds: float) -> DepthRuns:
    """Sands the task's own wood and its smooth likeness."""
    rough = sand(sanding_task(task, seconds=rough_seconds), seed)
    board = smooth_board(board_of(sanding_task(task)))
    smooth = sand(sanding_task(task, board=board, seconds=smooth_seconds), seed)
    count = min(MOST_WINDOWS, len(rough.windows) // 2)
    if count == 0 or not smooth.windows:
        raise BadInput(
            f"task '{task}': too few windows, {len(rough.windows)} on rough and {len(smooth.windows)} on smooth wood "
            f"(valid: two and one; on rough wood {rough.stuck} s were spent in splinters)"
        )
    return DepthRuns(
        rough, smooth, rough.windows[:count], rough.windows[-count:], smooth.windows[:MOST_WINDOWS]
    )


def numbers(windows: Sequence[Window], name: str) -> Array:
    """Collects one number of every window."""
    return np.array([getattr(window, name) for window in windows])


def spectrum(windows: Sequence[Window]) -> tuple[Array, Array]:
    """Gives frequencies [Hz] and mean amplitudes [N]."""
    return frequencies(), np.mean([window.spectrum for window in windows], axis=0)


def separation(first: Sequence[Window], second: Sequence[Window], name: str) -> float:
    """Gives how many standard deviations lie between the means of two cases; the pooled deviation."""
    a, b = numbers(first, name), numbers(second, name)
    pooled = float(np.sqrt(0.5 * (a.var() + b.var())))
    return abs(float(a.mean() - b.mean())) / max(pooled, 1e-12)


def contact_shares(run: Sanding, since: float) -> tuple[float, float]:
    """Gives the shares of the time in contact while the hand goes towards the robot, and while it pushes away."""
    moving = (np.abs(run.velocity[:, 0]) > 0.03) & (run.time > since)
    touching = run.force[:, 2] > 0.0
    towards, away = moving & (run.velocity[:, 0] < 0.0), moving & (run.velocity[:, 0] > 0.0)
    return float(np.mean(touching[towards])), float(np.mean(touching[away]))
