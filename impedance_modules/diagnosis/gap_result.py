# SPDX-License-Identifier: BSD-3-Clause
"""How large the gap is, where it lies, and the residuals over time that report and viewer draw."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from impedance_modules.arrays import Array


@dataclass(frozen=True)
class GapSize:
    """Rms of what recordings and model differ by.

    Attributes:
        before: Of the nominal model, in ``unit``.
        after: Of it with the named causes alone, as a patch has them.
        refitted: With all causes, and links, weights and stamps as fitted beside them within their priors.
        noise_floor: Of the noise; of simulated motion what initial states and repetition alone give.
        unit: N.m, N, rad/s, rad, m or m/s.
    """

    before: float
    after: float
    refitted: float
    noise_floor: float
    unit: str

    @property
    def shrink(self) -> float | None:
        """Part of the excess over the noise that is gone; None where there was none before."""
        return shrink(self.before, self.after, self.noise_floor)


@dataclass(frozen=True)
class JointGap(GapSize):
    """Held-out residual of one joint at one port.

    Attributes:
        joint: Name.
        residual: Which comparison: actuator, link, motor, whole, drive or velocity.
    """

    joint: str
    residual: str


@dataclass(frozen=True)
class GapLocation:
    """A part of the gap: joint, port, regime of motion and band [Hz], with its share of the excess residual power."""

    joint: str
    port: str
    regime: str
    band: tuple[float, float]
    share: float


@dataclass(frozen=True, eq=False)
class ResidualSeries:
    """Time series of one joint's residual in one held-out recording, for report and viewer.

    Attributes:
        joint: Name.
        residual: Which comparison.
        unit: Of the values.
        episode: The recording.
        time: (M,) [s].
        measured: (M,) measured quantity; the prediction is this minus the residual.
        before, after, refitted: (M,) residual of the nominal model, with the named causes alone, and with links,
            weights and stamps refitted beside them.
        regimes: Regime of motion at each sample.
    """

    joint: str
    residual: str
    unit: str
    episode: str
    time: Array
    measured: Array
    before: Array
    after: Array
    refitted: Array
    regimes: tuple[str, ...]


def shrink(before: float, after: float, noise_floor: float) -> float | None:
    """Part of an rms error's excess over its noise that is gone, 1 - sqrt(excess after / excess before).

    Returns:
        1 where nothing is left, negative where it grew; None where there was no excess before.
    """
    start = before**2 - noise_floor**2
    left = max(0.0, after**2 - noise_floor**2)
    return None if start <= 0.0 else 1.0 - float(np.sqrt(left / start))


def total_shrink(before: Array, after: Array, floor: Array) -> float | None:
    r"""Shrink over all residuals g, squares summed in units of each noise floor; None without a gap.

        1 - sqrt(sum_g max(0, after_g^2 / floor_g^2 - 1) / sum_g max(0, before_g^2 / floor_g^2 - 1))

    Residuals that were within their noise before count as far as the causes lift them out of it.

    Args:
        before: (groups,) rms without the causes, each group's in its own unit.
        after: Likewise with them.
        floor: Likewise of the noise.
    """  # fmt: skip
    start, left = (float(np.sum(np.clip((rms / floor) ** 2 - 1.0, 0.0, None))) for rms in (before, after))
    return None if start <= 0.0 else 1.0 - float(np.sqrt(left / start))
