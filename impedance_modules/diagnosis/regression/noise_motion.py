# SPDX-License-Identifier: BSD-3-Clause
r"""How the noise of a residual changes with the motion: an outstretched arm weighs its noise more, a heavy load shakes.

    var(e - ID) = k^2 \sigma_e^2 + S,   S = \sum_j M_ij(q)^2 \sigma_{a,j}^2

The repeats show the whole and the accelerations' noise \sigma_a at their own poses, hence \sigma_e; at other poses
S is exchanged. k is how much noisier a recording's torque sensors are, by their spectrum beyond the motion: many
sensors' noise grows with the load.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from impedance_modules.diagnosis.data.rigid_dynamics import mass_matrix
from impedance_modules.diagnosis.residuals.preparation import Prepared
from impedance_modules.diagnosis.regression.candidates import Group
from impedance_modules.diagnosis.regression.sensor_noise import white_noise
from impedance_modules.effects.residual_kinds import EFFORT_SIGN, uses_motion

Array = NDArray[np.float64]

SENSOR_MIN = 0.05
"""Least part of the noise that is the torque sensor's."""

LOUDER = (1.3, 16.0)
"""Power of a recording's sensor noise over that of the repeats: less is chance, and more would be no noise."""

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
    louder = _louder(prepared, pairs)
    measured = np.mean([levers[i] for pair in pairs for i in pair], axis=0) @ noise
    out = np.ones((len(prepared), len(groups)))
    for recording, lever in enumerate(levers):
        moved = lever @ noise
        for index, (residual, joint) in enumerate(groups):
            factor = louder[recording, joint] if EFFORT_SIGN[residual] != 0.0 else 1.0
            if uses_motion(residual):
                sensor = max(power[index] - measured[joint], SENSOR_MIN * power[index], 1e-24)
                out[recording, index] = np.sqrt((factor * sensor + moved[joint]) / (sensor + measured[joint]))
            else:
                out[recording, index] = np.sqrt(factor)
    return out


def _louder(prepared: Sequence[Prepared], pairs: Sequence[tuple[int, int]]) -> Array:
    """Power of each recording's sensor noise over that of the repeats, (recordings, n); one where it is about alike."""
    efforts = [item.log.effort for item in prepared]
    if any(effort is None for effort in efforts):
        return np.ones((len(prepared), prepared[0].signals.n))
    power = np.array([white_noise(effort) ** 2 for effort in efforts if effort is not None])
    repeated = np.mean([power[i] for pair in pairs for i in pair], axis=0)
    ratio = power / np.maximum(repeated, 1e-300)
    return np.where(ratio > LOUDER[0], np.minimum(ratio, LOUDER[1]), 1.0)


def _lever(item: Prepared) -> Array:
    """Mean squares of the mass matrix over a recording, (n, n)."""
    return np.asarray(np.mean(mass_matrix(item.tree, item.position[::FEW]) ** 2, axis=0))


def acceleration_noise(one: Prepared, other: Prepared) -> Array:
    """Noise power of each joint's acceleration in the band, (n,)."""
    first, second = (item.band.condense(item.signals.acceleration) for item in (one, other))
    size = min(len(first), len(second))
    return np.asarray(np.mean((first[:size] - second[:size]) ** 2, axis=0) / 2.0)
