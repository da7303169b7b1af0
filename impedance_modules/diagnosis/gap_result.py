# SPDX-License-Identifier: BSD-3-Clause
"""How large the gap is, where it lies, and the residuals over time that report and viewer draw."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from impedance_modules.arrays import Array


@dataclass(frozen=True)
class JointGap:
    """Held-out residual of one joint at one port.

    Attributes:
        joint: Name.
        residual: Which comparison: actuator, link, motor, whole, drive or velocity.
        before: Rms of the nominal model, in ``unit``.
        after: Of it with the named causes alone, as a patch has them.
        refitted: With all causes, and links, weights and stamps as fitted beside them within their priors.
        noise_floor: Of the noise.
        unit: N.m, N or rad/s.
    """

    joint: str
    residual: str
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
