# SPDX-License-Identifier: BSD-3-Clause
r"""Time base of recordings: time stamps, resampling, one rate for all, the delay of effort, encoder resolution.

A drive samples by its own clock, a logger stamps when it receives the sample. A stamp that is wrong by \delta makes a
position wrong by v \delta, and two differentiations turn that into torque. Which of both times is right shows in the
positions: at the right times they are smooth.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import butter, sosfiltfilt

from impedance_modules.arrays import Array
from impedance_modules.diagnosis.data.log import Log
from impedance_modules.diagnosis.data.rigid_dynamics import gravity_regressor
from impedance_modules.diagnosis.data.rigid_tree import RigidTree
from impedance_modules.errors import BadInput

JITTER_WARNING = 0.1
"""Rms deviation of the steps, as a part of the step, from which on a warning is given."""

GAP_MAX = 20
"""A gap longer than this many steps is not interpolated."""

EVEN_STEPS = 1e-3
"""Stamps that are even to this part of a step need no resampling."""

LAG_MAX = 0.6
"""Longest delay that is searched [s]."""

SMOOTHER_PART = 0.8
"""Evenly counted times are taken if the positions are rougher than this part at the stamps."""

EVEN_STAMPS = 1e-3
"""Stamps that are even to this part of a step are taken as they are."""

COUNT_TOLERANCE = 0.5
"""Counted times further from any stamp than this part of a step mean that samples were not even."""

SAME_RATE = 1.01
"""Rates within this factor of each other count as equal."""

PASSBAND = 0.4
"""End of the band that is kept, over the new rate."""

FILE_ROUNDING = 1e-9
"""Differences below it come from the rounding of the file [rad]."""

DIFFERENCES_MIN = 20
"""Fewest differences from which a quantisation step is read."""

STEPS_MAX = 20.0
"""Differences of up to this many steps are compared with whole multiples of the step."""


def uniform_time(time: Array, place: str, warnings: list[str]) -> tuple[Array, float, float]:
    """Gives an even time base for recorded stamps.

    Returns:
        Even times [s], their rate [Hz], and the jitter: rms deviation of the steps over the median step.

    Raises:
        BadInput: Time repeats, decreases, changes its rate, or has a long gap.
    """
    steps = np.diff(time)
    bad = np.flatnonzero(steps <= 0.0)
    if bad.size:
        row = int(bad[0]) + 1
        what = "repeats itself" if steps[bad[0]] == 0.0 else "runs backwards"
        raise BadInput(f"{place}: time {what} in row {row}, {bad.size} times in all (valid: increasing time)")
    step = float(np.median(steps))
    half = len(steps) // 2
    first, second = float(np.median(steps[:half])), float(np.median(steps[half:]))
    if max(first, second) > 1.5 * min(first, second):
        raise BadInput(
            f"{place}: the rate changes from {1 / first:.4g} to {1 / second:.4g} Hz within the recording"
            " (valid: one rate per recording; split it)"
        )
    if steps.max() > GAP_MAX * step:
        row = int(np.argmax(steps))
        raise BadInput(
            f"{place}: a gap of {steps.max():.3g} s after row {row} (valid: split the recording there)"
        )
    typical = steps[steps < 3.0 * step]
    jitter = float(np.sqrt(np.mean((typical - step) ** 2)) / step)
    if jitter > JITTER_WARNING:
        warnings.append(f"{place}: time stamps jitter by {100 * jitter:.0f} % of the step; resampled")
    if steps.max() > 1.8 * step:
        warnings.append(f"{place}: {int((steps > 1.8 * step).sum())} samples were dropped; interpolated")
    count = round((time[-1] - time[0]) / step) + 1
    even = np.linspace(time[0], time[-1], count)
    return even, float((count - 1) / (even[-1] - even[0])), jitter


def sampling_times(time: Array, position: Array) -> Array:
    """Gives the times at which samples were taken, (N,): as stamped, or evenly counted where that is smoother.

    Args:
        time: (N,) stamps [s].
        position: (N, n) [rad].
    """
    steps = np.diff(time)
    if len(time) < 4 or np.any(steps <= 0.0):
        return time
    step = float(np.median(steps))
    index = np.concatenate([[0.0], np.cumsum(np.maximum(np.round(steps / step), 1.0))])
    counted = np.polyval(np.polyfit(index, time, 1), index)
    off = np.abs(counted - time).max() / step
    if off < EVEN_STAMPS or off > COUNT_TOLERANCE:
        return time
    return counted if _roughness(counted, position) < SMOOTHER_PART * _roughness(time, position) else time


def _roughness(time: Array, position: Array) -> float:
    """Third differences at even times, of each joint over its motion, (rms)."""
    even = np.linspace(time[0], time[-1], len(time))
    third = np.diff(CubicSpline(time, position, axis=0)(even), 3, axis=0)
    size = position.std(axis=0)
    return (
        float(np.sqrt(np.mean((third[:, size > 0.0] / size[size > 0.0]) ** 2))) if np.any(size > 0.0) else 0.0
    )


def resampled(values: Array, time: Array, even: Array, kind: str) -> Array:
    """Brings (N, n) samples to even times: measurements by a cubic spline, commands by a zero-order hold.

    Linear interpolation would attenuate a tenth of the sampling rate by a twentieth.
    """
    if len(time) == len(even) and np.allclose(
        time, even, rtol=0.0, atol=EVEN_STEPS * float(even[1] - even[0])
    ):
        return values
    if kind == "effort_command":
        return np.asarray(values[np.searchsorted(time, even + 1e-9, side="right") - 1])
    return np.asarray(CubicSpline(time, values, axis=0)(even))


def delayed(values: Array, time: Array, late: float) -> Array:
    """Delays samples (N, n) by a time [s], by cubic interpolation; before the start the first value is held."""
    if late == 0.0:
        return values
    return np.asarray(CubicSpline(time, values)(np.maximum(time - late, time[0])))


def unify_rates(logs: Sequence[Log], warnings: list[str]) -> list[Log]:
    """Brings all recordings to the lowest rate among them, after a zero-phase low-pass filter, and warns.

    The lowest, so that no recording shows detail that the others lack.
    """
    lowest = min(log.rate for log in logs)
    faster = [log for log in logs if log.rate > SAME_RATE * lowest]
    if not faster:
        return list(logs)
    names = ", ".join(f"{log.name} {log.rate:.4g} Hz" for log in faster[:5])
    more = f" and {len(faster) - 5} more" if len(faster) > 5 else ""
    warnings.append(f"mixed rates: {names}{more} brought to {lowest:.4g} Hz, the lowest of all")
    return [_slowed(log, lowest) if log.rate > SAME_RATE * lowest else log for log in logs]


def _slowed(log: Log, rate: float) -> Log:
    sections = butter(6, PASSBAND * rate / (0.5 * log.rate), output="sos")
    old = np.arange(log.samples) / log.rate
    new = np.arange(int(old[-1] * rate) + 1) / rate

    def slow(values: Array | None) -> Array | None:
        if values is None:
            return None
        smooth = sosfiltfilt(sections, values, axis=0)
        return np.column_stack([np.interp(new, old, column) for column in smooth.T])

    return replace(
        log,
        rate=rate,
        position=np.column_stack(
            [np.interp(new, old, c) for c in sosfiltfilt(sections, log.position, axis=0).T]
        ),
        velocity=slow(log.velocity),
        effort=slow(log.effort),
        command=slow(log.command),
        position_command=slow(log.position_command),
        in_contact=None
        if log.in_contact is None
        else log.in_contact[np.searchsorted(old, new).clip(0, log.samples - 1)],
    )


def common_delay(logs: Sequence[Log], tree: RigidTree) -> float | None:
    """Estimates the delay of measured effort behind commanded torque that all joints share [s].

    The peak of the cross-correlation of the two rates of change, refined by a parabola, as the median over
    joints and recordings; None where command or effort is missing or their shapes do not agree, and where the
    effort would come before the command, which only another effect can cause.
    """
    found = []
    for log in logs:
        if log.command is None or log.effort is None:
            continue
        asked = log.command
        if log.gravity_compensation == "robot":
            asked = asked + gravity_regressor(tree, log.position) @ tree.inertia
        for index in range(asked.shape[1]):
            lag = _lag(np.diff(asked[:, index]), np.diff(log.effort[:, index]), log.rate)
            if lag is not None:
                found.append(lag)
    if not found or np.median(found) < 0.0:
        return None
    return float(np.median(found))


def _lag(cause: Array, effect: Array, rate: float) -> float | None:
    if cause.std() == 0.0 or effect.std() == 0.0:
        return None
    span = min(int(LAG_MAX * rate), len(cause) // 4)
    size = 2 ** int(np.ceil(np.log2(2 * len(cause))))
    a, b = cause - cause.mean(), effect - effect.mean()
    spectrum = np.conj(np.fft.rfft(a, size)) * np.fft.rfft(b, size)
    correlation = np.fft.irfft(spectrum, size) / (len(a) * a.std() * b.std())
    window = np.concatenate([correlation[-span:], correlation[: span + 1]])
    peak = int(np.argmax(window))
    if window[peak] < 0.3 or peak in (0, len(window) - 1):
        return None
    left, middle, right = window[peak - 1 : peak + 2]
    shift = 0.5 * (left - right) / (left - 2.0 * middle + right)
    return float((peak - span + shift) / rate)


def quantisation_step(positions: Array) -> float:
    """Finds the quantisation step of positions (N,); zero where they are not quantised.

    Args:
        positions: One joint's [rad or m].
    """
    places = np.unique(np.round(positions / FILE_ROUNDING)) * FILE_ROUNDING
    gaps = np.diff(places)
    if len(gaps) < DIFFERENCES_MIN:
        return 0.0
    step = float(gaps.min())
    near = gaps[gaps < STEPS_MAX * step]
    counts = near / step
    on_grid = np.abs(counts - np.round(counts)) < 0.02 + FILE_ROUNDING / step
    return (
        float(np.median(near / np.round(counts))) if len(near) >= DIFFERENCES_MIN and on_grid.all() else 0.0
    )
