# SPDX-License-Identifier: BSD-3-Clause
r"""How the noise floor of the links' residual changes with the pose: an outstretched arm weighs its noise more.

    var(e - ID) = \sigma_e^2 + \sum_j M_ij(q)^2 \sigma_{a,j}^2

The repeats give both the residual's noise and the accelerations' at their own poses; at other poses the second
part is exchanged.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from impedance_modules.diagnosis.candidates import Group
from impedance_modules.diagnosis.dynamics import mass_matrix
from impedance_modules.diagnosis.noise import Floor
from impedance_modules.diagnosis.prepare import Prepared
from impedance_modules.effects.residuals import uses_motion

Array = NDArray[np.float64]

LEAST = 0.5
"""A floor is not lowered below this part of what the repeats measured."""


def floor_at(
    floor: Floor,
    groups: Sequence[Group],
    prepared: Sequence[Prepared],
    pairs: Sequence[tuple[int, int]],
    recordings: Sequence[int],
) -> Array:
    """Carries a floor measured by repeats over to other recordings, (groups,) rms; a weak one stays as it is."""
    if not pairs:
        return floor.rms
    noise = np.mean([_acceleration_noise(prepared[i], prepared[j]) for i, j in pairs], axis=0)
    measured = np.mean([_lever(prepared[i]) for pair in pairs for i in pair], axis=0)
    here = np.mean([_lever(prepared[i]) for i in recordings], axis=0)
    out = floor.rms.copy()
    for index, (residual, joint) in enumerate(groups):
        if uses_motion(residual):
            power = out[index] ** 2 + float((here - measured)[joint] @ noise)
            out[index] = np.sqrt(max(power, (LEAST * out[index]) ** 2))
    return out


def _lever(item: Prepared) -> Array:
    """Mean squares of the mass matrix over a recording, (n, n)."""
    return np.asarray(np.mean(mass_matrix(item.tree, item.position) ** 2, axis=0))


def _acceleration_noise(one: Prepared, other: Prepared) -> Array:
    """Noise power of each joint's acceleration in the band, (n,)."""
    first, second = (item.band.condense(item.signals.acceleration) for item in (one, other))
    size = min(len(first), len(second))
    return np.asarray(np.mean((first[:size] - second[:size]) ** 2, axis=0) / 2.0)
