# SPDX-License-Identifier: BSD-3-Clause
r"""From the time stamps of a recording to even times, and its samples at those.

A drive samples by its own clock, and a logger stamps when it receives the sample. A stamp that is wrong by \delta makes
a position wrong by v \delta, and two differentiations turn that into torque; a command is moved to another row. So
samples are taken as evenly sampled, rows counted and the lost ones left out,

    t_k = t_0 + i_k / rate          (or a curve of fifth order in i_k: a clock that drifts)

unless the positions themselves show that they were taken at the stamps. Row k of a smooth motion, taken \delta_k later
than counted, is ahead by v_k \delta_k. So in third differences, in which a smooth motion is nearly nothing,

    D^3 q_k = b D^3 (v_k \delta_k) + noise,      b = 1: taken at the stamps;  b = 0: evenly, and stamped badly

and b is told by all rows together where each of them is mostly noise.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.polynomial.polynomial import polyfit, polyval
from scipy.interpolate import CubicSpline
from scipy.signal import savgol_filter

from impedance_modules.arrays import Array
from impedance_modules.errors import BadInput

JITTER_WARNING = 0.1
"""Rms deviation of the steps, as a part of the step, from which on a warning is given."""

GAP_MAX = 20
"""A gap longer than this many steps is not interpolated; a logger holds no more samples back."""

LOST, SEVERAL_LOST = 1.8, 2.5
"""From so many steps between two stamps on a sample was lost, and more than one."""

FILL_ORDER = 3
"""Of the polynomial across a gap."""

EVEN_STEPS = 1e-3
"""Stamps that are even to this part of a step are taken as they are."""

CLEARLY_SMOOTHER = 0.8
"""A clock that drifts is followed where positions have less than this part of the roughness then."""

TAKEN_MIN = 0.5
"""Least b of samples that were taken at the stamps."""

CERTAIN = 4.0
"""Standard deviations of b by which it must differ from zero."""

COLOUR = 1.5
"""Factor of its deviation, since third differences of noise are alike in neighbouring rows: sqrt(sum of rho_k^2)."""

SMOOTHED = 7
"""Rows over which a polynomial of third order gives the speed, and the slow part of the lateness."""

NEAR_COUNT = 0.5
"""Nine of ten stamps must lie within this part of a step of the counted times."""

BURST = 0.5
"""Half of the steps shorter than this part of the mean step: samples were held back and stamped together."""

LATE_ROWS = 8
"""A row that is late is on time again within so many rows; what was lost stays lost in all that follow."""

PULL = 0.05
"""Part of a stamp's lateness by which the counting follows a clock that drifts."""

CLOCK_ORDER = 5
"""Of the curve that follows a drifting clock."""


def sampling_times(time: Array, position: Array) -> Array:
    """Gives the times at which samples were taken, (N,) [s]; ``time`` itself where it is to be trusted.

    Args:
        time: (N,) stamps, increasing (``refuse_disorder``), 4 or more [s].
        position: (N, n) [rad].
    """
    counted = list(_even_times(time))
    if not counted or np.abs(counted[0] - time).max() < EVEN_STEPS * _step(time):
        return time
    rough = [_roughness(times, position) for times in counted]
    good = min(rough) / CLEARLY_SMOOTHER
    best = next(times for times, own in zip(counted, rough, strict=True) if own <= good)
    return time if _taken_at(time, best, position) else best


def _even_times(time: Array) -> Iterator[Array]:
    """Lists times at which samples may have been taken in truth, the simplest first."""
    rows, steps = np.arange(len(time), dtype=float), np.diff(time)
    mean = float(time[-1] - time[0]) / len(steps)
    if float(np.median(steps)) < BURST * mean:
        line = _fitted(rows, time, 1)
        if np.abs(line - time).max() < GAP_MAX * mean:
            yield line
        return
    # Whoever counts a late row as a lost one is one ahead from then on, and far from all stamps that follow.
    index = min(rows, _counted(time), key=lambda count: float(np.std(_fitted(count, time, 1) - time)))
    for order in (1, CLOCK_ORDER):
        times = _fitted(index, time, order)
        if _distance(times, time) < NEAR_COUNT * _step(time) and np.all(np.diff(times) > 0.0):
            yield times


def _step(time: Array) -> float:
    return float(np.median(np.diff(time)))


def _fitted(index: Array, time: Array, order: int) -> Array:
    """Times as a polynomial of the counted samples (N,), by least squares."""
    return np.asarray(np.polynomial.Polynomial.fit(index, time, order)(index))


def _distance(times: Array, stamps: Array) -> float:
    """Within which nine of ten stamps lie [s]."""
    return float(np.quantile(np.abs(times - stamps), 0.9))


def _counted(time: Array) -> Array:
    """Counts samples, (N,), and those that were lost: where all of the next rows are later than half a step.

    A row alone that is later was stamped late.
    """
    step, expected, count = _step(time), float(time[0]), 0
    index = np.zeros(len(time))
    settled: list[float] = _on_time(time, step).tolist()
    for k, stamp in enumerate(time[1:].tolist(), start=1):
        expected, count = expected + step, count + 1
        lost = max(0, round((settled[k] - expected) / step))
        expected, count = expected + lost * step, count + lost
        expected += PULL * (stamp - expected)
        index[k] = count
    return index


def _on_time(time: Array, step: float) -> Array:
    """When each row was due if the most punctual of it and the next ones was on time, (N,) [s]."""
    due = step * np.arange(len(time))
    ahead = np.concatenate([time - due, np.full(LATE_ROWS - 1, np.inf)])
    return np.asarray(due + sliding_window_view(ahead, LATE_ROWS).min(axis=1))


def _roughness(time: Array, position: Array) -> float:
    """Third differences at even times, of each joint over its motion, (rms)."""
    even = np.linspace(time[0], time[-1], len(time))
    third = np.diff(CubicSpline(time, position, axis=0)(even), 3, axis=0)
    size = position.std(axis=0)
    moved = size > 0.0
    return float(np.sqrt(np.mean((third[:, moved] / size[moved]) ** 2))) if np.any(moved) else 0.0


def _taken_at(times: Array, counted: Array, position: Array) -> bool:
    """Whether positions (N, n) were taken at their stamps ``times`` rather than at those that were counted.

    By what changes from row to row alone: slow lateness looks like another motion.
    """
    if len(times) <= SMOOTHED:
        return False
    mean = float(counted[-1] - counted[0]) / (len(counted) - 1)
    speed = savgol_filter(position, SMOOTHED, 3, deriv=1, delta=mean, axis=0)
    late = times - counted
    late = late - savgol_filter(late, SMOOTHED, 3)
    rough, ahead = (np.diff(values, 3, axis=0) for values in (position, speed * late[:, None]))
    moved = np.ptp(position, axis=0) > 0.0
    scale = np.sqrt(np.mean(rough[:, moved] ** 2, axis=0))
    y, x = (values[:, moved] / np.maximum(scale, 1e-300) for values in (rough, ahead))
    known = float(np.sum(x**2))
    if known == 0.0:
        return False
    share = float(np.sum(x * y)) / known
    deviation = COLOUR * float(np.std(y - share * x)) / np.sqrt(known)
    return bool(share > max(TAKEN_MIN, CERTAIN * deviation))


def refuse_disorder(time: Array, place: str) -> None:
    """Refuses stamps that repeat or decrease.

    Raises:
        BadInput: With the first such row.
    """
    steps = np.diff(time)
    bad = np.flatnonzero(steps <= 0.0)
    if bad.size:
        row = int(bad[0]) + 1
        what = "repeats itself" if steps[bad[0]] == 0.0 else "runs backwards"
        raise BadInput(f"{place}: time {what} in row {row}, {bad.size} times in all (valid: increasing time)")


def stamp_jitter(time: Array) -> float:
    """Gives the rms deviation of the steps between stamps over the median step; lost samples do not count."""
    step, steps = _step(time), np.diff(time)
    typical = steps[steps < LOST * step]
    return float(np.sqrt(np.mean((typical - step) ** 2)) / step)


def gaps_of(time: Array, steps: float = LOST) -> Array:
    """Finds where samples were lost: (G, 2) times of those before and after, so many steps apart or more [s]."""
    late = np.flatnonzero(np.diff(time) > steps * _step(time))
    return np.column_stack([time[late], time[late + 1]])


def uniform_time(time: Array, place: str, warnings: list[str]) -> tuple[Array, float]:
    """Gives even times from the first to the last sample [s], and their rate [Hz].

    Args:
        time: (N,) of the samples, increasing [s].
        place: Named in messages.
        warnings: Of lost samples, added to.

    Raises:
        BadInput: The rate changes, or there is a long gap.
    """
    step, steps = _step(time), np.diff(time)
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
    lost = int((np.round(steps / step) - 1.0)[steps > LOST * step].sum())
    if lost:
        warnings.append(f"{place}: {lost} samples were dropped; interpolated")
    count = len(time) + lost
    even = np.linspace(time[0], time[-1], count)
    return even, float((count - 1) / (even[-1] - even[0]))


def resampled(values: Array, time: Array, even: Array, kind: str) -> Array:
    """Brings (N, n) samples to even times: measurements by a cubic spline, commands along straight lines.

    Straight lines would attenuate a measurement's tenth of the sampling rate by a twentieth. A command steps; a spline
    would swing beyond its steps, and its last row held would be another row for each stamp that is a little late.
    Across a gap of several samples a spline would continue the noise of the two samples beside it; there a
    polynomial through as many samples on either side as were lost is taken.
    """
    if len(time) == len(even) and np.allclose(
        time, even, rtol=0.0, atol=EVEN_STEPS * float(even[1] - even[0])
    ):
        return values
    if kind == "effort_command":
        return np.column_stack([np.interp(even, time, column) for column in values.T])
    out = np.asarray(CubicSpline(time, values, axis=0)(even))
    for begin, end in gaps_of(time, SEVERAL_LOST):
        inside = (even > begin) & (even < end)
        out[inside] = _across(values, time, (begin, end), even[inside])
    return out


def _across(values: Array, time: Array, gap: tuple[float, float], wanted: Array) -> Array:
    """Values (k, n) within a gap, by a polynomial in time through (N, n) samples on both sides of it."""
    first, count = int(np.searchsorted(time, gap[0])), max(len(wanted), FILL_ORDER)
    near = slice(max(0, first - count + 1), first + count + 1)
    centre, half = 0.5 * (gap[0] + gap[1]), 0.5 * (time[near][-1] - time[near][0])
    order = min(FILL_ORDER, len(time[near]) - 1)
    found = polyfit((time[near] - centre) / half, values[near], order)
    return np.asarray(polyval((wanted - centre) / half, found).T)
