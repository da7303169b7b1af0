# SPDX-License-Identifier: BSD-3-Clause
r"""What jumps of torques do to a residual: nobody knows when, between two rows, a torque jumped.

    r_k = c_k x_k,      0 <= c_k <= 1

with the sizes x_k of `data.torque_jumps`: a command is logged as it is given, an effort before it acts. Where
controller and log keep step, all c_k of a joint are alike: a column with a prior. Where they do not, each is another
number: noise that is as strong as the jumps, and no cause.
"""

from __future__ import annotations

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.diagnosis.regression.candidates import Group
from impedance_modules.diagnosis.residuals.preparation import Prepared


def jump_column(item: Prepared, group: Group) -> Array:
    """What a row more of delay makes of the jumps of the torque that enters a residual, (M,) in the band."""
    return _in_band(item, group, 1.0)


def jump_noise(item: Prepared, group: Group, seed: int) -> Array:
    """(M,) what jumps make of a residual if their instants are by chance, evenly within a row."""
    return _in_band(item, group, np.random.default_rng(seed).uniform(-0.5, 0.5, len(item.effort_jumps)))


def _in_band(item: Prepared, group: Group, rows: Array | float) -> Array:
    """Jumps times so many rows of delay; most recordings have none."""
    residual, joint = group
    jumps = item.effort_jumps if residual in ("link", "motor") else item.command_jumps
    sizes = jumps[:, joint]
    if residual == "velocity" or not sizes.any():
        return np.zeros(item.samples)
    return np.asarray(item.band.condense(rows * sizes))
