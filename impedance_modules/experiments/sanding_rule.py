# SPDX-License-Identifier: BSD-3-Clause
r"""A rule that says "finished": set on some pieces of wood, judged on others.

The rule fires where the mean of a measure over a run's first windows stays below a bound. The bound is the one that,
on the pieces it is set on, makes the share of smooth pieces on which it fires less the share of rough ones largest,
halfway between the pieces to either side; the lowest of equals. A piece that gives too few windows (stuck, out of
contact) is not finished.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impedance_modules.runtime.roughness.windows import Window

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Operating:
    """A receiver operating characteristic.

    Attributes:
        false, true: (m,) shares of rough and of smooth pieces on which the rule fires, as its bound grows.
        area: Under the curve; 0.5 is guessing.
    """

    false: Array
    true: Array
    area: float


def score(windows: tuple[Window, ...], measure: str, count: int) -> float:
    """Returns the mean of ``band`` or ``friction`` over a run's first windows; infinite with too few of them."""
    values = [float(getattr(window, measure)) for window in windows[:count]]
    return float(np.mean(values)) if len(values) == count else float("inf")


def set_bound(smooth: Array, rough: Array) -> float:
    """Finds the bound that tells the scores of smooth pieces from those of rough ones best."""
    every = np.unique(np.concatenate([smooth, rough]))
    every = every[np.isfinite(every)]
    bounds = np.concatenate([[every[0] - 1e-9], 0.5 * (every[1:] + every[:-1]), [every[-1] + 1e-9]])
    gain = [np.mean(smooth < bound) - np.mean(rough < bound) for bound in bounds]
    return float(bounds[int(np.argmax(np.round(gain, 9)))])


def operate(smooth: Array, rough: Array) -> Operating:
    """Draws the curve of a rule over all its bounds."""
    bounds = np.concatenate([[-np.inf], np.sort(np.concatenate([smooth, rough]))])
    bounds = bounds[bounds < np.inf]
    false = np.array([*(np.mean(rough <= bound) for bound in bounds), 1.0])
    true = np.array([*(np.mean(smooth <= bound) for bound in bounds), 1.0])
    return Operating(false, true, float(np.trapezoid(true, false)))
