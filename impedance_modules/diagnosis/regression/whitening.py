# SPDX-License-Identifier: BSD-3-Clause
r"""The noise of every residual: how strong, of which colour, and the filter that makes it white and of unit size.

    e_t = (x_t + \sum_k a_k x_{t-k}) / s,      x the noise in the band

Repeats show the noise without any model: half the power of the difference of two residuals of one motion.
Without repeats it is what a flexible model of each joint (smooth functions, no physics) leaves; that floor is weak.
Filtered by the same coefficients, columns keep their meaning, and ordinary least squares is efficient and honest
about its errors (Aitken; Ljung 1999, prediction-error filter).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_toeplitz
from scipy.signal import welch

from impedance_modules.arrays import Array

Mask = NDArray[np.bool_]

ORDER = 4
"""Of the autoregression."""

LEAST = 0.02
"""White noise that is added to the estimated one, over its power: no frequency is trusted to be silent."""

FLAT = 0.8
"""Part of the band in which the band's own filter does nothing ..."""

EDGE = 0.6
"""... and from where to there its noise stands for that beyond, which no one shall dig out again."""

SEGMENT, SEGMENTS, SHORT = 64, 3, 16
"""Samples over which a spectrum is taken; fewer, but not below the last, where a piece has less than so many segments.

One periodogram alone is as rough as it is large, and a filter made of it digs out what happened to be quiet.
"""

WEAK = 2.0
"""By what factor a floor that no repeats measured may be wrong, either way; less where they measured a part of it."""


@dataclass(frozen=True, eq=False)
class Whitening:
    """Noise of all groups in all recordings.

    Attributes:
        filters: Group -> (ORDER + 1,) 1, a_1, a_2 ...
        innovation: (recordings, groups) s [N.m], [N] or [rad/s].
        rms: (recordings, groups) noise in the band.
        part: (groups,) power of whitened noise: its samples that are independent over all of them.
        samples: (groups,) independent samples that the floor rests on.
        assumed: (groups,) part of the floor's power that no repeats showed.
        weak: True where no repeats measured it.
        clear: Recording and group -> (M,) rows that count; where all of them do it is missing.
    """

    filters: tuple[Array, ...]
    innovation: Array
    rms: Array
    part: Array
    samples: Array
    assumed: Array
    weak: bool
    clear: Mapping[tuple[int, int], Mask] = field(default_factory=dict)

    @property
    def doubt(self) -> Array:
        """(groups,) factor by which the noise's power may differ from the floor, either way."""
        return np.asarray(1.0 + (WEAK - 1.0) * self.assumed)

    def apply(self, values: NDArray[np.floating], recording: int, group: int) -> NDArray[np.floating]:
        """Whitens (M, ...) samples; the first ORDER are lost."""
        taps = (self.filters[group] / self.innovation[recording, group]).astype(values.dtype)
        out = taps[0] * values[ORDER:]
        for lag in range(1, ORDER + 1):
            out += taps[lag] * values[ORDER - lag : -lag]
        left_out = self._left_out(recording, group)
        if left_out is not None:
            out[left_out] = 0.0
        return np.asarray(out)

    def _left_out(self, recording: int, group: int) -> Mask | None:
        """Whitened rows that rest on a row that does not count."""
        if (recording, group) not in self.clear:
            return None
        return np.asarray(np.convolve(~self.clear[recording, group], np.ones(ORDER + 1))[ORDER:-ORDER] > 0.0)

    def rows(self, recording: int, group: int, whitened: int) -> int:
        """Number of whitened rows that count, of so many."""
        left_out = self._left_out(recording, group)
        return whitened if left_out is None else whitened - int(left_out.sum())


def whitening_of(
    noise: Sequence[Sequence[Array]], share: Array, *, edge: float, lost: Array, assumed: Array, weak: bool
) -> Whitening:
    """Fits the noise model.

    Args:
        noise: Group -> pieces of noise.
        share: (recordings, groups) how much stronger the noise is there than in the pieces.
        edge: End of the band in cycles per sample.
        lost: (groups,) degrees of freedom that were fitted away to get the pieces.
        assumed: (groups,) part of the pieces' power that no repeats showed.
        weak: No repeats measured it.
    """
    filters, scale, rms, part, samples = [], [], [], [], []
    for group, pieces in enumerate(noise):
        count = sum(len(piece) for piece in pieces)
        grow = count / max(count - lost[group], 0.1 * count)
        power = max(sum(float(piece @ piece) for piece in pieces) / count * grow, 1e-24)
        taps = _autoregression(pieces, edge)
        left = [_filtered(piece, taps) for piece in pieces]
        frequency, density = spectrum(left)
        level = max(float(np.mean(density[frequency <= FLAT * edge])) * grow, 1e-24)
        filters.append(taps)
        scale.append(np.sqrt(level))
        rms.append(np.sqrt(power))
        part.append(min(1.0, max(float(np.mean(np.concatenate(left) ** 2)) * grow / level, 0.1)))
        samples.append(part[-1] * max(count - lost[group], 0.1 * count))
    return Whitening(
        filters=tuple(filters),
        innovation=share * np.array(scale),
        rms=share * np.array(rms),
        part=np.array(part),
        samples=np.array(samples),
        assumed=assumed,
        weak=weak,
    )


def _filtered(piece: Array, taps: Array) -> Array:
    return np.convolve(piece, taps)[ORDER : len(piece)]


def spectrum(pieces: Sequence[Array]) -> tuple[Array, Array]:
    """Frequencies [cycles per sample] and mean power density of all pieces, white noise's being its variance."""
    shortest = min(len(piece) for piece in pieces)
    size = min(SEGMENT, shortest, max(shortest // SEGMENTS, SHORT))
    weights = np.array([len(piece) for piece in pieces])
    found = np.empty((len(pieces), size))
    for length in np.unique(weights):
        alike = np.flatnonzero(weights == length)
        together = np.array([pieces[int(i)] for i in alike])
        found[alike] = welch(together, fs=1.0, nperseg=size, detrend=False, return_onesided=False)[1]
    frequency = np.abs(np.fft.fftfreq(size))
    return frequency, np.average(found, axis=0, weights=weights)


def _autoregression(pieces: Sequence[Array], edge: float) -> Array:
    """Yule and Walker's equations, (ORDER + 1,), the noise beyond the band no weaker than near its end.

    It may be stronger: noise of positions, four times differentiated behind a spring, rises up to the band's filter.
    """
    frequency, density = spectrum(pieces)
    near = (frequency > EDGE * edge) & (frequency <= FLAT * edge)
    if near.any():
        beyond = np.maximum(density, np.mean(density[near]))
        density = np.where(frequency > FLAT * edge, beyond, density)
    covariance = np.fft.ifft(density).real[: ORDER + 1]
    if covariance[0] <= 0.0:
        return np.concatenate([[1.0], np.zeros(ORDER)])
    covariance[0] *= 1.0 + LEAST
    return np.concatenate([[1.0], -solve_toeplitz(covariance[:ORDER], covariance[1:])])
