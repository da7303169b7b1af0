# SPDX-License-Identifier: BSD-3-Clause
r"""The frequency band in which recordings are compared, and its zero-phase filter.

Differentiating a noisy position twice multiplies its noise by (2 \pi f)^2. The band ends where that noise would reach
a twentieth of the acceleration. Measured torque, predicted torque and every candidate's column pass the same filter,
so that it favours none of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache, partial
from typing import TypeVar

import numpy as np
from numpy.polynomial.polynomial import polyfit
from numpy.typing import NDArray
from scipy.ndimage import convolve1d, maximum_filter1d, uniform_filter1d
from scipy.signal import butter, firwin, kaiser_beta, oaconvolve, sosfiltfilt
from scipy.sparse import csr_array

from impedance_modules.arrays import Array
from impedance_modules.diagnosis.data.held_targets import renewal_rate
from impedance_modules.diagnosis.data.log import Log

Real = TypeVar("Real", np.float32, np.float64)

NOISE_SHARE = 0.05
"""Noise of the acceleration over the acceleration, at the end of the band."""

BAND_MIN, BAND_MAX = 3.0, 20.0
"""Least and greatest end of the band [Hz]."""

BAND_LEAST = 0.5
"""Least end of the band of a deflection [Hz]."""

DEFLECTION_FLAT = 1.5
"""Cutoff of a deflection's filter over the end of its band, 96 % of which passes: an arm that swings on its springs
moves most just there."""

WORK_RATE = 200.0
"""Recordings with a higher rate are thinned to it, after a zero-phase filter [Hz]."""

FLAT_UNTIL = 0.4
"""Frequency up to which thinned samples are whole [cycles per sample]."""

NOISE_ONLY = (0.25, 0.38)
"""Frequencies [cycles per sample] between which a thinned reading holds nothing but noise: beyond motion, before what
thinning filtered away."""

NOISE_EXCESS = 10.0
"""Times its noise beyond which a position's power is motion: a tenth of the noise is left at most."""

EDGE = 1.0
"""Width over which the gain of accelerations falls beyond the motion [Hz]: it rings for about a second."""

BINS = 5
"""Neighbouring frequencies over which that power is averaged."""

ENDS_MIN = 6
"""Least number of samples from which a slope at an end is taken."""

ALIAS_ATTENUATION = 100.0
"""Of what would appear at another frequency by thinning, and of the ripple below it [dB]."""

CLOCK_ERROR = 1.0 + 1e-3
"""A rate of 999.99 Hz is one of 1000 Hz."""

HALF_LENGTH = 2.6
"""Half the filter's length, in periods of the end of the band; this much is cut off at both ends."""

LENGTHS_KEPT = 64
"""Lengths of recordings whose filter is kept as a matrix."""


@dataclass(frozen=True)
class CommonBand:
    """The band of a data set: the same steps for all of its recordings.

    Clocks differ: of 200.0009 and 199.9999 Hz one would keep every fourth sample and the other every third. Repeats
    could not be compared then, and one noise would have two colours.

    Attributes:
        cutoff: End of the band [Hz].
        thinning: Every so many recorded samples one is kept, which brings them to at most `WORK_RATE`.
        step: Decimation of what was thinned, to at least 2.5 samples per period of the cutoff.
    """

    cutoff: float
    thinning: int
    step: int

    @classmethod
    def of(cls, rate: float, cutoff: float) -> CommonBand:
        """Chooses the steps for recordings of about one rate [Hz]."""
        thinning = max(1, int(rate * CLOCK_ERROR // WORK_RATE))
        return cls(cutoff, thinning, max(1, int(rate * CLOCK_ERROR / thinning / (2.5 * cutoff))))

    def thin(self, values: Array) -> Array:
        """Keeps one of so many samples (N, n), after a zero-phase filter that is flat up to `FLAT_UNTIL`.

        The noise of a sensor is read just below that: a filter that begins earlier would hide half of its power.
        """
        return values if self.thinning == 1 else _flat_until_edge(values, self.thinning)[:: self.thinning]

    def thin_mask(self, values: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Thins (N,) marks as `thin` does samples: a kept mark is set if any up to the next one is."""
        return np.logical_or.reduceat(values, np.arange(0, len(values), self.thinning))

    def at(self, rate: float) -> Band:
        """The band of a recording that was thinned to a rate [Hz]."""
        return Band(rate, self.cutoff, self.step)


@dataclass(frozen=True)
class Band:
    """How a recording is filtered and thinned.

    Attributes:
        rate: Of the samples that go in [Hz].
        cutoff: End of the band [Hz].
        step: Decimation: every so many samples one is kept.
        motion_cutoff: Cutoff of the motion that enters models and columns [Hz].
    """

    rate: float
    cutoff: float
    step: int

    @property
    def motion_cutoff(self) -> float:
        """Cutoff of the motion filter, far enough above the band to leave it flat [Hz]."""
        return min(2.5 * self.cutoff, 0.4 * self.rate)

    @property
    def margin(self) -> int:
        """Samples cut off at each end: whole steps, so that the kept samples fall into place."""
        return self.step * max(1, round(HALF_LENGTH / self.cutoff * self.rate / self.step))

    @property
    def reach(self) -> float:
        """How far the filter spreads what happens at one time [s]: half its length, and a row.

        The motion was filtered by itself and differentiated before.
        """
        return (self.margin + 1.5 * self.step) / self.rate

    @cached_property
    def _taps(self) -> Array:
        return np.asarray(firwin(2 * self.margin + 1, self.cutoff, fs=self.rate, window=("kaiser", 4.0)))

    def smooth(self, values: Array) -> Array:
        """Filters motion with zero phase, along the first axis."""
        return _zero_phase(values, self.rate, self.motion_cutoff)

    def kept(self, samples: int) -> int:
        """Counts how many of so many samples `condense` keeps."""
        return max(0, (samples - 2 * self.margin - 1) // self.step + 1)

    def condense(self, values: NDArray[Real]) -> NDArray[Real]:
        """Filters samples along the first axis, cuts the margins off and keeps every `step`-th."""
        flat = values.reshape(len(values), -1)
        out: NDArray[Real] = _decimating(self, len(values), values.dtype.char) @ flat
        return out.reshape(len(out), *values.shape[1:])

    def pick(self, values: Array) -> Array:
        """Keeps the samples that `condense` keeps, unfiltered."""
        return values[self.margin : len(values) - self.margin : self.step][: self.kept(len(values))]


@lru_cache(LENGTHS_KEPT)
def _decimating(band: Band, samples: int, kind: str) -> csr_array:
    """(kept, samples) the filter of a band as a sparse matrix, a row for each sample that is kept.

    A column's result is the same to the last bit beside any others, as a product of dense matrices would not promise.
    """
    taps = band._taps.astype(kind)
    kept, width = band.kept(samples), len(taps)
    first = band.step * np.arange(kept)
    columns = (first[:, None] + np.arange(width)).ravel()
    return csr_array((np.tile(taps, kept), columns, width * np.arange(kept + 1)), shape=(kept, samples))


def choose_band(logs: Sequence[Log]) -> CommonBand:
    """Finds the band that suits all recordings; their rates are about alike (`data.time_base`)."""
    found = [
        _cutoff(log.position[:, joint], log.rate) for log in logs for joint in range(log.position.shape[1])
    ]
    known = [cutoff for cutoff in found if cutoff is not None]
    rate = min(log.rate for log in logs)
    highest = min(BAND_MAX, rate / 5.0, _below_renewals(logs))
    cutoff = np.clip(np.median(known) if known else BAND_MIN, min(BAND_MIN, highest), highest)
    return CommonBand.of(rate, float(cutoff))


def _below_renewals(logs: Sequence[Log]) -> float:
    """End of a band without the frequency at which held targets are renewed, and its multiples [Hz]; else infinite.

    There the arm jerks, and what a jerk does between two rows, or beyond what a spring's load may be differentiated, no
    recording shows. Half of that frequency has little of it. Rare steps of a target are no frequency.
    """
    rates = [rate for rate in map(renewal_rate, logs) if rate >= 2.0 * BAND_MIN]
    return 0.5 * min(rates, default=np.inf)


def renewal_note(logs: Sequence[Log], common: CommonBand) -> tuple[str, ...]:
    """Says that held targets end the band; nothing where they do not."""
    end = _below_renewals(logs)
    if common.cutoff < end:
        return ()
    return (
        f"targets are held and renewed {2.0 * end:.3g} times a second, and the arm jerks: compared below"
        f" {common.cutoff:.3g} Hz only (valid for more: a target that moves all the time)",
    )


def filter_length(cutoff: float) -> float:
    """About the length that the band's filter removes at each end of a recording [s]."""
    return HALF_LENGTH / cutoff


def least_duration(cutoff: float, rows: int) -> float:
    """About how long a segment must be [s] to give so many samples in the band."""
    return rows / 2.5 / cutoff


def deflection_cutoffs(log: Log) -> Array:
    """Finds the cutoffs (n,) of the torques that bend the joints' springs, before they are differentiated twice [Hz].

    At the end of their band the noise of the reading, or of the positions whose accelerations make them, is
    `NOISE_SHARE` of the derivative; the filter is flat up to there.
    """
    # Each derivative lifts the noise, too: single frequencies of it would pass for all the motion there is.
    known = partial(_cutoff, rate=log.rate, bins=BINS, beyond=NOISE_ONLY)
    if log.effort is not None and log.effort_source == "joint_sensor":
        found = [known(column) for column in log.effort.T]
    else:
        found = [known(column, derivatives=4) for column in log.position.T]
    ends = [BAND_LEAST if end is None else max(end, BAND_LEAST) for end in found]
    return DEFLECTION_FLAT * np.array(ends)


def above_noise(position: Array, acceleration: Array, rate: float) -> Array:
    r"""Leaves of accelerations what is motion, at each frequency as far as positions stand out of their white noise.

        G(f) = max(0, 1 - 10 N / P(f)),      P the positions' power, N its level beyond the motion

    The gain falls over `EDGE` beyond the motion: a steep filter would make each jerk ring, long before and after it.
    The residual is made of the same accelerations. Columns that share their noise fit it: of links whose inertia
    hardly shows, least squares find one that makes the noise smaller.

    Args:
        position: (N, n) as read [rad].
        acceleration: (N, n) [rad/s^2].
        rate: Of both [Hz].
    """
    power, frequency = periodogram(position), np.asarray(np.fft.rfftfreq(len(position)), dtype=float)
    level = uniform_filter1d(power, BINS, axis=0)
    gain = np.maximum(1.0 - NOISE_EXCESS * _white_level(power, frequency) / np.maximum(level, 1e-300), 0.0)
    # What is slower than the motion's strongest frequency is kept whole: the mean is not in the power.
    slow = np.arange(len(frequency))[:, None] < np.argmax(level, axis=0)
    gain = _soft_edges(np.where(slow, np.max(gain, axis=0), gain), EDGE * len(position) / rate)
    return np.column_stack([_passed(*pair, frequency) for pair in zip(acceleration.T, gain.T, strict=True)])


def _soft_edges(gain: Array, width: float) -> Array:
    """A gain (F, n) that is nowhere less, and falls over so many frequencies."""
    half = max(1, round(0.5 * width))
    kernel = np.hanning(2 * half + 3)[1:-1]
    wide = maximum_filter1d(gain, 2 * half + 1, axis=0)
    return np.asarray(convolve1d(wide, kernel / kernel.sum(), axis=0, mode="nearest"))


def _passed(values: Array, gain: Array, frequency: Array) -> Array:
    """Passes samples (N,) as far as a gain (F,) lets them; zero where it lets half of none.

    Continued as in a mirror, a recording has a kink at its ends, which a filter rounds off. So a parabola with the
    slopes at both ends is taken away before, and added after.
    """
    kept, samples = np.flatnonzero(gain > 0.5), len(values)
    if not kept.size:
        return np.zeros(samples)
    near = min(max(ENDS_MIN, round(0.5 / max(frequency[kept[-1]], 1.0 / samples))), samples // 2)
    steps = np.arange(near)
    first, last = polyfit(steps, values[:near], 2)[1], -polyfit(steps, values[: -near - 1 : -1], 2)[1]
    time = np.arange(samples)
    bow = first * time + 0.5 * (last - first) / (samples - 1) * time**2
    spectrum = np.fft.rfft(np.concatenate([values - bow, (values - bow)[::-1]]))
    spectrum *= np.interp(np.fft.rfftfreq(2 * samples), frequency, gain)
    return np.asarray(bow + np.fft.irfft(spectrum, 2 * samples)[:samples])


def periodogram(values: Array) -> Array:
    """Power (F, ...) of samples (N, ...) about their mean, by a Hann window."""
    window = np.hanning(len(values)).reshape(-1, *(1,) * (values.ndim - 1))
    return np.asarray(np.abs(np.fft.rfft(window * (values - values.mean(axis=0)), axis=0)) ** 2)


def _white_level(power: Array, frequency: Array) -> Array:
    """Level of white noise in periodograms (F, ...), by their median beyond the motion [cycles per sample]."""
    beyond = (frequency > NOISE_ONLY[0]) & (frequency < NOISE_ONLY[1])
    return np.asarray(np.median(power[beyond], axis=0) / np.log(2.0))


def _cutoff(
    values: Array,
    rate: float,
    derivatives: int = 2,
    *,
    bins: int = 1,
    beyond: tuple[float, float] = (0.35, 0.5),
) -> float | None:
    """End of the band of one joint, by so many derivatives of its readings; None where noise is all there is.

    Args:
        values: (N,) readings.
        rate: Of them [Hz].
        derivatives: How often they are differentiated.
        bins: Neighbouring frequencies that must stand out of the noise together to be motion.
        beyond: Frequencies that hold noise alone [cycles per sample].
    """
    power = periodogram(values)
    frequency = np.fft.rfftfreq(len(values), 1.0 / rate)
    alone = (frequency > beyond[0] * rate) & (frequency <= beyond[1] * rate)
    noise = float(np.median(power[alone])) / np.log(2.0)
    lift = (2.0 * np.pi * frequency) ** (2 * derivatives)
    noise_power = np.cumsum(lift * noise)
    moves = uniform_filter1d(power, bins) > NOISE_EXCESS * noise
    signal_power = np.cumsum(lift * np.clip(power - noise, 0.0, None) * moves)
    if signal_power[-1] == 0.0:
        return None
    within = noise_power <= NOISE_SHARE**2 * signal_power[-1]
    return float(frequency[np.flatnonzero(within)[-1]]) if within.any() else None


def _flat_until_edge(values: Array, step: int) -> Array:
    """Filters samples (N, n) for being thinned; beyond their ends they are continued as if turned about them."""
    width = (0.5 - FLAT_UNTIL) / step
    half = min(
        round((ALIAS_ATTENUATION - 7.95) / 28.7 / width), len(values) - 1
    )  # Kaiser's length of a filter
    window = ("kaiser", kaiser_beta(ALIAS_ATTENUATION))
    taps = firwin(2 * half + 1, 0.5 * (FLAT_UNTIL + 0.5) / step, fs=1.0, window=window)
    before = 2.0 * values[0] - values[half:0:-1]
    after = 2.0 * values[-1] - values[-2 : -half - 2 : -1]
    return np.asarray(
        oaconvolve(np.concatenate([before, values, after]), taps[:, None], mode="valid", axes=0)
    )


def _zero_phase(values: Array, rate: float, cutoff: float) -> Array:
    sections = butter(4, cutoff / (0.5 * rate), output="sos")
    return np.asarray(sosfiltfilt(sections, values, axis=0))
