# SPDX-License-Identifier: BSD-3-Clause
r"""Stage 4: the noise floor of every residual, and how many of its samples are independent.

With repeats the floor is model-free: half the mean square of the difference of two residuals of one motion.
Without, it is judged from the residual's power at the end of the band, taken as white; that is weak, because
slow noise hides below it and fast structure is mistaken for it, and it is said to be weak.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impedance_modules.diagnosis.design import Design

Array = NDArray[np.float64]

UPPER = (0.6, 0.95)
"""Part of the band whose power stands for the noise where nothing repeats."""


@dataclass(frozen=True, eq=False)
class Floor:
    """Noise of each group.

    Attributes:
        rms: (groups,) [N.m], [N] or [rad/s].
        independent: (groups,) part of the samples that are independent.
        weak: True where no repeats measured it.
    """

    rms: Array
    independent: Array
    weak: bool


def noise_floor(
    design: Design,
    pairs: Sequence[tuple[int, int]],
    coefficients: Array,
    share: float,
    everything: Sequence[int],
) -> Floor:
    """Estimates the floor of each group.

    Args:
        design: The residuals.
        pairs: Indices of recordings that repeat each other.
        coefficients: Of the model whose residual is looked at.
        share: End of the band over half the rate of the thinned samples.
        everything: Recordings to judge by where nothing repeats.
    """
    rms = np.zeros(len(design.groups))
    independent = np.ones(len(design.groups))
    for group in range(len(design.groups)):
        if pairs:
            series = [_difference(design, pair, group, coefficients) for pair in pairs]
            rms[group] = np.sqrt(np.mean(np.concatenate(series) ** 2))
        else:
            series = [design.residual(index, group, coefficients) for index in everything]
            rms[group] = np.sqrt(np.mean([_upper_power(values, share) for values in series]))
        independent[group] = independent_part(series)
    return Floor(np.maximum(rms, 1e-12), independent, weak=not pairs)


def independent_part(series: Sequence[Array]) -> float:
    r"""Part of samples that count, (1 - \rho) / (1 + \rho) with \rho the correlation of neighbours."""
    above = sum(float(np.sum((x[1:] - x.mean()) * (x[:-1] - x.mean()))) for x in series)
    below = sum(float(np.sum((x - x.mean()) ** 2)) for x in series)
    correlation = float(np.clip(above / below if below > 0.0 else 0.0, 0.0, 0.98))
    return (1.0 - correlation) / (1.0 + correlation)


def _difference(design: Design, pair: tuple[int, int], group: int, coefficients: Array) -> Array:
    first, second = (design.residual(index, group, coefficients) for index in pair)
    size = min(len(first), len(second))
    return np.asarray((first[:size] - second[:size]) / np.sqrt(2.0))


def _upper_power(values: Array, share: float) -> float:
    """Mean square that white noise of the upper band's level would have over the whole band."""
    power = np.abs(np.fft.rfft(np.hanning(len(values)) * values)) ** 2
    place = np.linspace(0.0, 1.0, len(power)) / share
    upper = power[(place > UPPER[0]) & (place < UPPER[1])]
    level = float(np.median(upper)) / np.log(2.0) / (np.sum(np.hanning(len(values)) ** 2))
    return float(level * share)
