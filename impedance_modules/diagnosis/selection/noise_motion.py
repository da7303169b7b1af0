# SPDX-License-Identifier: BSD-3-Clause
r"""How the noise of the links' residual changes with the pose: an outstretched arm weighs its noise more.

    var(e - ID) = \sigma_e^2 + S,   S = \sum_j M_ij(q)^2 \sigma_{a,j}^2

The repeats show the whole and the accelerations' noise \sigma_a at their own poses, hence \sigma_e; at other poses
S is exchanged.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from impedance_modules.diagnosis.dynamics import mass_matrix
from impedance_modules.diagnosis.prepare import Prepared
from impedance_modules.diagnosis.selection.candidates import Group
from impedance_modules.effects.residuals import uses_motion

Array = NDArray[np.float64]

SENSOR_MIN = 0.05
"""Least part of the noise that is the torque sensor's."""

FEW = 8
"""Every which sample is enough to know a mean of the mass matrix."""


def shares(
    groups: Sequence[Group],
    prepared: Sequence[Prepared],
    pairs: Sequence[tuple[int, int]],
    power: Sequence[float],
    noise: Array,
) -> Array:
    """Says how much stronger the noise is in each recording than in the repeats, (recordings, groups).

    Args:
        groups: The groups.
        prepared: The recordings.
        pairs: Repeats.
        power: (groups,) of the noise that they show.
        noise: (n,) power of the accelerations' noise.
    """
    levers = [_lever(item) for item in prepared]
    measured = np.mean([levers[i] for pair in pairs for i in pair], axis=0) @ noise
    out = np.ones((len(prepared), len(groups)))
    for recording, lever in enumerate(levers):
        moved = lever @ noise
        for index, (residual, joint) in enumerate(groups):
            if uses_motion(residual):
                sensor = max(power[index] - measured[joint], SENSOR_MIN * power[index], 1e-24)
                out[recording, index] = np.sqrt((sensor + moved[joint]) / (sensor + measured[joint]))
    return out


def _lever(item: Prepared) -> Array:
    """Mean squares of the mass matrix over a recording, (n, n)."""
    return np.asarray(np.mean(mass_matrix(item.tree, item.position[::FEW]) ** 2, axis=0))


def acceleration_noise(one: Prepared, other: Prepared) -> Array:
    """Noise power of each joint's acceleration in the band, (n,)."""
    first, second = (item.band.condense(item.signals.acceleration) for item in (one, other))
    size = min(len(first), len(second))
    return np.asarray(np.mean((first[:size] - second[:size]) ** 2, axis=0) / 2.0)
