# SPDX-License-Identifier: BSD-3-Clause
"""Which motion can be spared: held out, it is predicted from what the others show, whatever their order."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from impedance_modules.diagnosis.data.log import Log

Array = NDArray[np.float64]

TAILS = (0.02, 0.98)
"""Quantiles between which a joint's positions and speeds are taken to reach."""

AS_GOOD = 0.05
"""Motions that leave this little less of the reach behind are spared as well."""


def most_spared(motions: Sequence[Sequence[Log]]) -> int:
    """Chooses the motion to hold out: nothing is tested outside what was fitted, and nothing is fitted too little.

    A motion that was repeated stays with those that are fitted, as long as there are others: repeats measure the
    noise. Of the rest the one is taken without which the others still reach furthest; of those that are as good,
    the one in which the joint that moves least moves most; then the last by name.

    Args:
        motions: Two or more, each with its repeats.
    """
    single = [i for i, found in enumerate(motions) if len(found) == 1]
    asked = single or list(range(len(motions)))
    reach = np.array([np.max([_reach(log) for log in found], axis=0) for found in motions])
    whole = np.maximum(reach.max(axis=0), 1e-9)
    left = {i: float(np.mean(np.delete(reach, i, axis=0).max(axis=0) / whole)) for i in asked}
    spared = [i for i in asked if left[i] >= max(left.values()) - AS_GOOD]
    return max(spared, key=lambda i: (round(float((reach[i] / whole).min()), 3), motions[i][0].name))


def _reach(log: Log) -> Array:
    """How far a recording's positions and speeds reach, each joint's, (2 n,)."""
    speed = np.diff(log.position, axis=0) * log.rate
    return np.concatenate([np.subtract(*np.quantile(x, TAILS[::-1], axis=0)) for x in (log.position, speed)])
