# SPDX-License-Identifier: BSD-3-Clause
r"""Held-out residuals by octaves: rms in each, so that the squares of all octaves add up to the whole's.

With X_k the discrete Fourier transform of N samples behind a Hann window w, an octave's power is

    2 / (N \sum w^2) \sum_{k in octave} |X_k|^2
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impedance_modules.diagnosis.result import Series

Array = NDArray[np.float64]

EDGES = (0.0, 0.25, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0)
"""Between octaves [Hz]."""


def spectrum_object(series: Sequence[Series]) -> dict[str, Any]:
    """Builds the JSON object of the first held-out recording's residuals."""
    if not series:
        return {"edges_hz": [], "per_port": []}
    first = [item for item in series if item.episode == series[0].episode]
    highest = max((_nyquist(item.time) for item in first), default=0.0)
    edges = [edge for edge, below in zip(EDGES, (0.0, *EDGES), strict=False) if below < highest]
    return {
        "edges_hz": edges,
        "per_port": [
            {
                "joint": item.joint,
                "residual": item.residual,
                "before": _octaves(item.time, item.before, edges),
                "after": _octaves(item.time, item.after, edges),
                "unit": item.unit,
            }
            for item in first
        ],
    }


def _nyquist(time: Array) -> float:
    return 0.5 / float(np.median(np.diff(time)))


def _octaves(time: Array, values: Array, edges: Sequence[float]) -> list[float]:
    """Rms in each octave."""
    window = np.hanning(len(values))
    power = 2.0 * np.abs(np.fft.rfft(window * values)) ** 2 / (len(values) * np.sum(window**2))
    power[0] *= 0.5
    frequency = np.fft.rfftfreq(len(values), float(np.median(np.diff(time))))
    which = np.digitize(frequency, np.array(edges)) - 1
    inside = np.minimum(which, len(edges) - 2)
    return [float(np.sqrt(power[inside == k].sum())) for k in range(len(edges) - 1)]
