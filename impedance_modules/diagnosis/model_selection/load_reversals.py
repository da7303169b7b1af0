# SPDX-License-Identifier: BSD-3-Clause
r"""Where the load of a joint reverses whose encoder sits at the motor: the rows in which nobody saw its link.

With play the link then swings from one flank of the teeth to the other, and may rebound. The encoder reads the motor;
the link's acceleration \ddot\delta stays unknown, and by

    ID(\theta - \delta) - ID(\theta) = -(M \ddot\delta + (dID/dv) \dot\delta + (dID/dq) \delta)

every joint of the arm feels it, many times as much as what the same play costs at rest by the last term. No law of
the motion has this, and any other candidate would be named for it. So rows within a filter's length of

    |\tau_j| < 0.1 rms(\tau_j)      or a change of sign of \tau_j

do not count at any joint, if these rows leave clearly more than the others before any cause is known. What is left
says on which flank the link was.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.ndimage import binary_dilation

from impedance_modules.diagnosis.model_selection.reversals import MORE, kept_share, power_ratio
from impedance_modules.diagnosis.regression.model_fit import ModelFit
from impedance_modules.diagnosis.residuals.band import filter_length
from impedance_modules.diagnosis.residuals.contact_mask import (
    Mask,
    masked_seconds,
    rows_of_link_residuals,
)
from impedance_modules.diagnosis.residuals.preparation import Prepared
from impedance_modules.effects.joint_transmission import unloaded
from impedance_modules.effects.residual_kinds import uses_motion

LOADED_MIN = 0.2
"""Least part of the rows in which a joint must be loaded for certain."""


def rows_on_one_flank(
    model_fit: ModelFit, prepared: Sequence[Prepared]
) -> tuple[Mapping[tuple[int, int], Mask], int | None]:
    """Finds the joint with its encoder at the motor where reversals of the load leave most, beside other moments.

    Play of one joint shakes all of them, so only the one counts.

    Args:
        model_fit: What is known, before any cause was found.
        prepared: All recordings.

    Returns:
        Recording and group -> (M,) rows that count, and the joint; nothing where reversals leave no more.
    """
    groups = model_fit.design.groups
    worst, chosen, rows = MORE, None, {}
    for group, (residual, joint) in enumerate(groups):
        if not uses_motion(residual) or prepared[0].signals.encoder(joint) != "motor":
            continue
        clear = [_loaded(item, joint) for item in prepared]
        ratio = power_ratio(model_fit, group, clear)
        if ratio > worst and kept_share(clear) > LOADED_MIN:
            worst, chosen, rows = ratio, joint, rows_of_link_residuals(dict(enumerate(clear)), groups)
    return rows, chosen


def load_reversal_note(
    joint: int, masked: Mapping[tuple[int, int], Mask], prepared: Sequence[Prepared]
) -> str:
    """Says what does not count, and why."""
    each = {r: mask for (r, _), mask in masked.items()}
    seconds = sum(masked_seconds(prepared[r], mask) for r, mask in each.items())
    return (
        f"{seconds:.3g} s in which the load of {prepared[0].tree.joints[joint]} reverses do not count: its encoder sits"
        " at the motor, and how the link crosses the play was not recorded"
    )


def _loaded(item: Prepared, joint: int) -> Mask:
    """Rows (M,) farther than a filter's length from any moment without load on a joint."""
    free = unloaded(item.load[:, joint])
    rate = item.band.rate / item.band.step
    reach = 1 + int(np.ceil(filter_length(item.band.cutoff) * rate))
    return np.asarray(~binary_dilation(free, iterations=reach))
