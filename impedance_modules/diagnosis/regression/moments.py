# SPDX-License-Identifier: BSD-3-Clause
"""Moments that are far too loud for noise: what a push or a knock leaves must not set the floor that would hide it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

WINDOW = 0.5
"""Length of a moment [s]."""

STRUCK = 100.0
"""Power of a moment over that of the median one, beyond which it is no noise on any joint: white noise comes to four,
a real joint that sticks and slips to forty."""

LOUD = 20.0
"""The same on the other joints, once one was struck."""

USUAL = 4.0
"""Power over that of the median moment up to which a moment counts fully."""

LEAST = 1e-30
"""Power that stands for none at all."""

RARE = 0.2
"""Part of all moments that may be so loud; what is loud more often belongs to the recording."""

STEPS = 6
"""Times that a fit is repeated with loud moments counting less."""

Left = tuple[list[Array], float]
"""What a fit leaves, one piece (M,) for each recording, and the samples of white noise that it uses up."""


@dataclass(frozen=True, eq=False)
class Heard:
    """What a fit leaves on one joint.

    Attributes:
        plain: With all moments alike.
        quiet: By a fit that hardly looks at loud moments, which are then made as loud as the others.
        struck: Whether some moment, and not too many, cannot be noise.
    """

    plain: Left
    quiet: Left
    struck: bool


def listen(fit: Callable[[Array | None], Left], rate: float) -> Heard:
    """Fits twice: a flexible model that bends to a loud moment spoils all the others.

    The second fit is repeated with each moment weighted by the median power over its own.

    Args:
        fit: Takes weights (sum of M,) of the squares, or None for none.
        rate: Samples a second [1/s].
    """
    plain = fit(None)
    size = max(2, round(WINDOW * rate))
    pieces, used = plain
    for _ in range(STEPS):
        pieces, used = fit(np.concatenate(_each(pieces, size, lambda ratio: np.minimum(1.0, USUAL / ratio))))
    ratios = np.concatenate(_each(pieces, size, lambda ratio: ratio))
    rare = float(np.mean(ratios > LOUD)) <= RARE
    if not rare:
        return Heard(plain, plain, struck=False)
    gains = _each(pieces, size, lambda ratio: np.where(ratio > LOUD, ratio**-0.5, 1.0))
    quiet = [piece * gain for piece, gain in zip(pieces, gains, strict=True)]
    return Heard(plain, (quiet, used), struck=float(ratios.max()) > STRUCK)


def _each(pieces: Sequence[Array], size: int, law: Callable[[Array], Array]) -> list[Array]:
    """Some law of each moment's power over the median one's, for every sample."""
    powers = [_powers(piece, size) for piece in pieces]
    usual = max(float(np.median(np.concatenate(powers))), LEAST)
    return [
        np.repeat(law(np.maximum(power / usual, LEAST)), size)[: len(piece)]
        for power, piece in zip(powers, pieces, strict=True)
    ]


def _powers(piece: Array, size: int) -> Array:
    """Mean square of each moment, the last one shorter."""
    starts = np.arange(0, len(piece), size)
    return np.asarray(np.add.reduceat(piece**2, starts) / np.diff(np.append(starts, len(piece))))
