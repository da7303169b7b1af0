# SPDX-License-Identifier: BSD-3-Clause
"""Moments of a recording in which something touched the arm: their power is no part of the noise.

A short disturbance (a push, a knock) must not raise the floor that would then hide it. So a flexible model is fitted
once more with windows of outlying power weighted down (iteratively reweighted least squares), and in the difference of
two repeats such windows count as the others do.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation

from impedance_modules.arrays import Array
from impedance_modules.diagnosis.residuals.contact_mask import MARGIN

Mask = NDArray[np.bool_]

WINDOW = 0.5
"""Length of the windows whose power is compared [s]."""

DISTURBED = 100.0
"""Power of a window over that of the median one, beyond which it is no noise on any joint: white noise reaches four,
a real joint with stick-slip forty."""

OUTLYING = 20.0
"""The same on the other joints, once one was disturbed."""

TOGETHER = 2
"""Joints that show an outlying moment at once when something pushes a link."""

USUAL = 4.0
"""Power over that of the median window up to which a window counts fully."""

LEAST_POWER = 1e-30
"""Power that stands for none at all."""

OUTLYING_SHARE_MAX = 0.2
"""Part of all windows that may be outlying; what is more frequent belongs to the recording."""

ONE_PUSH_MAX = 0.4
"""The same where they follow each other: somebody leans on an arm for seconds, and short recordings have few."""

STEPS = 6
"""Times that a fit is repeated with outlying windows counting less."""

Left = tuple[list[Array], float]
"""What a fit leaves, one piece (M,) for each recording, and the samples of white noise that it uses up."""


@dataclass(frozen=True, eq=False)
class RobustFit:
    """What a fit leaves on one joint.

    Attributes:
        ordinary: With all windows weighted alike.
        robust: With outlying windows weighted down, and then scaled to the power of the others.
        disturbed: Whether some windows, and not too many, cannot be noise.
    """

    ordinary: Left
    robust: Left
    disturbed: bool


def fit_robustly(fit: Callable[[Array | None], Left], rate: float) -> RobustFit:
    """Fits twice: a flexible model that follows one disturbance misfits all other windows.

    The second fit is repeated with each window weighted by the median power over its own.

    Args:
        fit: Takes weights (sum of M,) of the squares, or None for none.
        rate: Samples a second [1/s].
    """
    ordinary = fit(None)
    size = max(2, round(WINDOW * rate))
    pieces, used = ordinary
    for _ in range(STEPS):
        pieces, used = fit(np.concatenate(_each(pieces, size, lambda ratio: np.minimum(1.0, USUAL / ratio))))
    ratios = np.concatenate(_each(pieces, size, lambda ratio: ratio))
    few = float(np.mean(ratios > OUTLYING)) <= OUTLYING_SHARE_MAX
    if not few:
        return RobustFit(ordinary, ordinary, disturbed=False)
    gains = _each(pieces, size, lambda ratio: np.where(ratio > OUTLYING, ratio**-0.5, 1.0))
    robust = [piece * gain for piece, gain in zip(pieces, gains, strict=True)]
    return RobustFit(ordinary, (robust, used), disturbed=float(ratios.max()) > DISTURBED)


def without_disturbed(
    apart: Sequence[Sequence[Array]], shown: Sequence[Sequence[Mask]], rate: float
) -> list[list[Array]]:
    """Scales the moments in which something touched one of two repeats to the power of the others.

    What pushes a link turns several joints at once, or one by far more than a joint by itself.

    Args:
        apart: Group -> pair -> difference of the rows that count.
        shown: Group -> pair -> (M,) which those are.
        rate: Rows a second [1/s].
    """
    size = max(2, round(WINDOW * rate))
    ratios, pushed = _outlying(apart, shown, size)
    if not any(where.any() for where in pushed):
        return [list(own) for own in apart]
    return [
        [
            piece
            * np.repeat(np.where(where & (ratio > OUTLYING), ratio, 1.0) ** -0.5, size)[: len(mask)][mask]
            for piece, ratio, where, mask in zip(own, found, pushed, masks, strict=True)
        ]
        for own, found, masks in zip(apart, ratios, shown, strict=True)
    ]


def undisturbed_rows(
    left: Sequence[Sequence[Array]], shown: Sequence[Sequence[Mask]], rate: float
) -> list[Mask]:
    """Recording -> (M,) rows in which nothing touched the arm, by what a model leaves; all where too many would go.

    Args:
        left: Group -> recording -> remainder of the rows that count.
        shown: Group -> recording -> (M,) which those are.
        rate: Rows a second [1/s].
    """
    size = max(2, round(WINDOW * rate))
    _, touched = _outlying(left, shown, size)
    margin = np.ones(2 * round(MARGIN * rate) + 1, dtype=bool)
    return [
        ~binary_dilation(np.repeat(where, size)[: len(rows)], structure=margin)
        for where, rows in zip(touched, shown[0], strict=True)
    ]


def _outlying(
    pieces: Sequence[Sequence[Array]], shown: Sequence[Sequence[Mask]], size: int
) -> tuple[list[list[Array]], list[Mask]]:
    """Group -> piece -> power of each moment (k,) over the usual one; piece -> (k,) touched, none if too many are."""
    ratios = [_moments(own, masks, size) for own, masks in zip(pieces, shown, strict=True)]
    touched = [_touched(np.array(piece)) for piece in zip(*ratios, strict=True)]
    if touched and _frequent(touched):
        touched = [np.zeros_like(where) for where in touched]
    return ratios, touched


def _frequent(touched: Sequence[Mask]) -> bool:
    """Whether outlying moments, recording -> (k,), are too frequent to come from outside."""
    runs = sum(int(where[0]) + int(np.count_nonzero(where[1:] & ~where[:-1])) for where in touched)
    most = ONE_PUSH_MAX if runs == 1 else OUTLYING_SHARE_MAX
    return float(np.mean(np.concatenate(touched))) > most


def _touched(ratios: Array) -> Mask:
    """Moments (k,) whose power over the usual one, (groups, k), shows that something touched the arm."""
    together = np.sum(ratios > OUTLYING, axis=0) >= TOGETHER
    return np.asarray(together | np.any(ratios > DISTURBED, axis=0))


def _moments(pieces: Sequence[Array], masks: Sequence[Mask], size: int) -> list[Array]:
    """Pair -> power of each moment over that of the median one; 0 where no row counts."""
    powers = []
    for piece, mask in zip(pieces, masks, strict=True):
        squares = np.zeros(len(mask))
        squares[mask] = piece**2
        starts = np.arange(0, len(mask), size)
        rows = np.add.reduceat(mask.astype(float), starts)
        powers.append(np.where(rows > 0.0, np.add.reduceat(squares, starts) / np.maximum(rows, 1.0), np.nan))
    every = np.concatenate(powers)
    usual = max(float(np.nanmedian(every)) if np.isfinite(every).any() else 0.0, LEAST_POWER)
    return [np.nan_to_num(power / usual) for power in powers]


def _each(pieces: Sequence[Array], size: int, law: Callable[[Array], Array]) -> list[Array]:
    """Some law of each moment's power over the median one's, for every sample."""
    ratios = _moments(pieces, [np.ones(len(piece), dtype=bool) for piece in pieces], size)
    return [
        np.repeat(law(np.maximum(ratio, LEAST_POWER)), size)[: len(piece)]
        for ratio, piece in zip(ratios, pieces, strict=True)
    ]
