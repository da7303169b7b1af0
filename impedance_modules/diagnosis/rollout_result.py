# SPDX-License-Identifier: BSD-3-Clause
"""What re-simulated motion says: errors before and after, how they grow, and which causes help."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from impedance_modules.arrays import Array
from impedance_modules.diagnosis.gap_result import GapSize


@dataclass(frozen=True, eq=False)
class Rollout:
    """The result of all rollouts.

    Attributes:
        drive: Which torque drove the plant: ``command``, ``effort`` (at the link) or ``motor``; empty if nothing
            was rolled out.
        window: Length of a window [s].
        windows: Number of windows.
        episodes: Recordings they are cut from.
        floor: ``repeats``, or ``weak``: from the noise of the initial states alone.
        position, velocity: Joint -> its error.
        growth: Over the horizon.
        shrink: Of position and velocity of all joints, squares summed in units of their floors'; None without a gap.
        whole: All causes together, the links adjusted; None without a rollout.
        causes: Effect and port -> comparison with and without the cause; the simulated ones.
        left_out: What was not simulated.
        traces: For the report.
    """

    drive: str
    window: float
    windows: int
    episodes: tuple[str, ...]
    floor: str
    position: Mapping[str, RolloutError]
    velocity: Mapping[str, RolloutError]
    growth: ErrorGrowth
    shrink: float | None
    whole: CauseRollout | None
    causes: Mapping[tuple[str, str], CauseRollout]
    left_out: tuple[LeftOut, ...]
    traces: tuple[RolloutTrace, ...]


class RolloutError(GapSize):
    """Rms error of one joint's rollouts in one quantity, over all windows."""


@dataclass(frozen=True)
class ErrorGrowth:
    """How position errors grow: rms over windows at times after the seed.

    Attributes:
        time: Since the seed [s].
        before, after: Joint -> one value per time [rad] or [m].
    """

    time: tuple[float, ...]
    before: Mapping[str, tuple[float, ...]]
    after: Mapping[str, tuple[float, ...]]


@dataclass(frozen=True)
class CauseRollout:
    """Rollouts with a cause compared with those without it, or all causes with none.

    Attributes:
        without, with_it: Error power over that of the noise or, if larger, of the remainder after all causes; mean over
            windows and over the joints that the cause acts on.
        ratio: Geometric mean over windows of ``without`` over ``with_it``.
        standard_error: Of its logarithm.
        verdict: ``helps``, ``worsens`` or ``no difference``.
    """

    without: float
    with_it: float
    ratio: float
    standard_error: float
    verdict: str


@dataclass(frozen=True)
class LeftOut:
    """Something that was not simulated, and why."""

    what: str
    why: str


@dataclass(frozen=True, eq=False)
class RolloutTrace:
    """One joint's held-out window with the largest error of the nominal plant, for the report.

    Attributes:
        time: [s] of the recording.
        measured, before, after: (M,) positions.
    """

    joint: str
    episode: str
    time: Array
    measured: Array
    before: Array
    after: Array


def no_rollout(*reasons: LeftOut) -> Rollout:
    """The result where no window could be simulated, with the reasons."""
    return Rollout("", 0.0, 0, (), "", {}, {}, ErrorGrowth((), {}, {}), None, None, {}, reasons, ())
