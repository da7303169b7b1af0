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
from impedance_modules.effects.residual_kinds import Residual


def jump_columns(item: Prepared, residual: Residual) -> Array:
    """What a row more of delay makes of the jumps of the torque that enters a residual, (M, n) in the band."""
    return item.band.condense(_jumps(item, residual))


def jump_noise(item: Prepared, group: Group, seed: int) -> Array:
    """(M,) what jumps make of a residual if their instants are by chance, evenly within a row."""
    residual, joint = group
    sizes = _jumps(item, residual)[:, joint]
    if not sizes.any():
        return np.zeros(item.samples)
    early = np.random.default_rng(seed).uniform(-0.5, 0.5, sizes.shape)
    return np.asarray(item.band.condense(early * sizes))


def _jumps(item: Prepared, residual: Residual) -> Array:
    if residual == "velocity":
        return np.zeros_like(item.effort_jumps)
    return item.effort_jumps if residual in ("link", "motor") else item.command_jumps
