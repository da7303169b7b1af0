# SPDX-License-Identifier: BSD-3-Clause
"""Time base of recordings: one rate for all, the delay of effort."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import butter, sosfiltfilt

from impedance_modules.arrays import Array
from impedance_modules.diagnosis.data.log import Log, Mask
from impedance_modules.diagnosis.data.rigid_dynamics import gravity_regressor
from impedance_modules.diagnosis.data.rigid_tree import RigidTree

LAG_MAX = 0.6
"""Longest delay that is searched [s]."""

SAME_RATE = 1.01
"""Rates within this factor of each other count as equal."""

PASSBAND = 0.4
"""End of the band that is kept, over the new rate."""


def delayed(values: Array, time: Array, late: float) -> Array:
    """Delays samples (N, n) by a time [s], by cubic interpolation; beyond either end the value there is held."""
    if late == 0.0:
        return values
    return np.asarray(CubicSpline(time, values)(np.clip(time - late, time[0], time[-1])))


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

    def slowed(values: Array) -> Array:
        return np.asarray(CubicSpline(old, sosfiltfilt(sections, values, axis=0))(new))

    def slow(values: Array | None) -> Array | None:
        return None if values is None else slowed(values)

    def marked(values: Mask | None) -> Mask | None:
        return None if values is None else values[np.searchsorted(old, new).clip(0, log.samples - 1)]

    return replace(
        log,
        rate=rate,
        position=slowed(log.position),
        velocity=slow(log.velocity),
        effort=slow(log.effort),
        command=slow(log.command),
        position_command=slow(log.position_command),
        rounding=slow(log.rounding),
        in_contact=marked(log.in_contact),
        carrying=marked(log.carrying),
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
