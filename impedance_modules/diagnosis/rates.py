# SPDX-License-Identifier: BSD-3-Clause
"""One rate for recordings that were made at several: the lowest, so that nobody gains detail the others lack."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, sosfiltfilt

from impedance_modules.diagnosis.data.log import Log

Array = NDArray[np.float64]

SAME = 1.01
"""Rates that differ by less are one rate."""

PASS = 0.4
"""End of the band that is kept, over the new rate."""


def one_rate(logs: Sequence[Log], warnings: list[str]) -> list[Log]:
    """Brings all recordings to the lowest rate among them, behind a zero-phase low-pass, and says so."""
    lowest = min(log.rate for log in logs)
    faster = [log for log in logs if log.rate > SAME * lowest]
    if not faster:
        return list(logs)
    said = ", ".join(f"{log.name} {log.rate:.4g} Hz" for log in faster[:5])
    more = f" and {len(faster) - 5} more" if len(faster) > 5 else ""
    warnings.append(f"mixed rates: {said}{more} brought to {lowest:.4g} Hz, the lowest of all")
    return [_slowed(log, lowest) if log.rate > SAME * lowest else log for log in logs]


def _slowed(log: Log, rate: float) -> Log:
    sections = butter(6, PASS * rate / (0.5 * log.rate), output="sos")
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
        touching=None
        if log.touching is None
        else log.touching[np.searchsorted(old, new).clip(0, log.samples - 1)],
    )
