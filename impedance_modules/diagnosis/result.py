# SPDX-License-Identifier: BSD-3-Clause
"""What a diagnosis says, as frozen data: everything that JSON, report and terminal print."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impedance_modules.diagnosis.data.log import DataReport
from impedance_modules.diagnosis.rollout.outcome import CauseRollout, Rollout, shrink

Array = NDArray[np.float64]

EXIT_CODES: Mapping[str, int] = {
    "no_gap": 0,
    "explained": 0,
    "partly_explained": 5,
    "unexplained": 5,
    "ambiguous": 6,
    "insufficient_data": 7,
}
"""Verdict -> exit code of the command line."""


@dataclass(frozen=True)
class JointGap:
    """Held-out residual of one joint at one port.

    Attributes:
        joint: Name.
        residual: Which comparison: actuator, link, motor, whole, drive or velocity.
        before, after, noise_floor: Rms, in ``unit``.
        unit: N.m, N or rad/s.
    """

    joint: str
    residual: str
    before: float
    after: float
    noise_floor: float
    unit: str

    @property
    def shrink(self) -> float | None:
        """Part of the excess over the noise that is gone; None where there was none before."""
        return shrink(self.before, self.after, self.noise_floor)


@dataclass(frozen=True)
class Place:
    """A part of the gap: joint, port, regime and band [Hz], with its share of the excess residual power."""

    joint: str
    port: str
    regime: str
    band: tuple[float, float]
    share: float


@dataclass(frozen=True)
class Estimate:
    """An identified number with its standard deviation and unit."""

    value: float
    std: float
    unit: str


@dataclass(frozen=True)
class Rival:
    """A candidate that lost, or could not be told apart."""

    effect: str
    joints: tuple[str, ...]
    reason: str


@dataclass(frozen=True)
class Cause:
    """A named effect.

    Attributes:
        effect: Id.
        joints: Joints it acts on.
        port: actuator, link, sensor, timing or contact.
        parameters: Carrier -> symbol -> estimate.
        weight: Its part of the explained gap.
        shrink: Held-out shrink with this cause alone; None without a gap.
        equivalent: Candidates that these recordings cannot tell from it.
        rivals: Others, and why they lost.
        position_range, velocity_range: Joint -> range of the data that the fit rests on.
        rollout: What it does to the rollouts; None where it was not worn there.
    """

    effect: str
    joints: tuple[str, ...]
    port: str
    parameters: Mapping[str, Mapping[str, Estimate]]
    weight: float
    shrink: float | None
    equivalent: tuple[Rival, ...]
    rivals: tuple[Rival, ...]
    position_range: Mapping[str, tuple[float, float]]
    velocity_range: Mapping[str, tuple[float, float]]
    rollout: CauseRollout | None = None


@dataclass(frozen=True)
class Remainder:
    """What the causes leave: lack of fit (worst residual power over noise), whether that is fine, and words."""

    lack_of_fit: float
    explained: bool
    structure: str


@dataclass(frozen=True, eq=False)
class Series:
    """One joint's residual in one held-out recording, for report and viewer.

    Attributes:
        joint: Name.
        residual: Which comparison.
        unit: Of the values.
        episode: The recording.
        time: (M,) [s].
        measured: (M,) what a prediction is compared with; a prediction is it minus its residual.
        before, after: (M,) residual of the nominal model, and with the causes.
        regimes: What the joint does at each sample.
    """

    joint: str
    residual: str
    unit: str
    episode: str
    time: Array
    measured: Array
    before: Array
    after: Array
    regimes: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """The whole answer."""

    verdict: str
    robot: str
    episodes: tuple[str, ...]
    heldout: tuple[str, ...]
    data: DataReport | None
    reason: str
    gaps: tuple[JointGap, ...]
    shrink: float | None
    rollout: Rollout
    where: tuple[Place, ...]
    causes: tuple[Cause, ...]
    unexplained_weight: float
    remainder: Remainder
    next_motion: Mapping[str, object]
    series: tuple[Series, ...]

    @property
    def exit_code(self) -> int:
        """Of the command line."""
        return EXIT_CODES[self.verdict]
