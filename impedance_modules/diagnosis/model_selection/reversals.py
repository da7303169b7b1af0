# SPDX-License-Identifier: BSD-3-Clause
r"""Where a joint with dry friction reverses or rests: the rows in which its law does not hold.

At rest dry friction is whatever holds the joint, anything up to fc; within a reversal it depends on how surfaces stick,
creep and bend before they slide, and on the moment of the reversal, which position sensors give roughly. No law of the
motion has this. What it leaves is sharp, of every frequency, and other candidates would be named for it.

So rows within a filter's length of

    |\dot q_j| < 2 v_0      or a change of sign of \dot q_j

do not count at a joint for which a law of dry friction was found, if these rows leave clearly more than the others.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from scipy.ndimage import binary_dilation

from impedance_modules.diagnosis.regression.candidates import Group
from impedance_modules.diagnosis.regression.model_fit import ModelFit, ModelTerm
from impedance_modules.diagnosis.residuals.contact_mask import Mask, masked_seconds
from impedance_modules.diagnosis.residuals.preparation import Prepared
from impedance_modules.effects.joint_motion import regularisation_velocity

REST = 2.0
"""Times the regularisation velocity below which a joint may rest."""

MORE = 2.0
"""Power left at reversals over that left elsewhere, from which they are not understood."""

KEPT = 0.5
"""Least part of a joint's rows that must remain."""


def rows_without_reversals(
    causes: Sequence[ModelTerm], make: Callable[[Sequence[ModelTerm]], ModelFit], prepared: Sequence[Prepared]
) -> Mapping[tuple[int, int], Mask]:
    """Finds where laws of dry friction leave clearly more than elsewhere because their joint reverses or rests.

    Beside a law of dry friction no other cause counts at its joint: one of them may be there for the reversals alone.

    Args:
        causes: That were accepted.
        make: Fits a model.
        prepared: All recordings.

    Returns:
        Recording and group -> (M,) rows that count; empty where reversals are understood.
    """
    out: dict[tuple[int, int], Mask] = {}
    for term in (cause for cause in causes if cause.candidate.effect.dry):
        apart = [other for other in causes if not set(other.groups) & set(term.groups)]
        model_fit = make([*apart, term])
        joint = prepared[0].tree.joints.index(term.candidate.joints[0])
        clear = [_sliding(item, joint) for item in prepared]
        for group in term.groups:
            if kept_share(clear) < KEPT or power_ratio(model_fit, group, clear) <= MORE:
                continue
            out |= {(r, group): mask for r, mask in enumerate(clear)}
    return out


def reversal_note(
    sliding: Mapping[tuple[int, int], Mask], prepared: Sequence[Prepared], groups: Sequence[Group]
) -> tuple[str, ...]:
    """Says what does not count at which joints; empty where everything does.

    Args:
        sliding: From `rows_without_reversals`.
        prepared: All recordings.
        groups: Of the rows.
    """
    seconds: dict[str, float] = {}
    for (r, g), mask in sliding.items():
        item, (_, joint) = prepared[r], groups[g]
        name = item.tree.joints[joint]
        seconds[name] = seconds.get(name, 0.0) + masked_seconds(item, mask)
    if not seconds:
        return ()
    said = ", ".join(f"{name} ({lost:.3g} s)" for name, lost in seconds.items())
    return (
        f"reversals and rests do not count at {said}: there dry friction leaves more than any law of the motion has",
    )


def _sliding(item: Prepared, joint: int) -> Mask:
    """Rows (M,) farther than a filter's length from any rest or reversal of a joint."""
    velocity = item.velocity[:, joint]
    least = REST * float(regularisation_velocity(item.signals.model.sliding)[joint])
    still = np.abs(velocity) < least
    still[1:] |= velocity[1:] * velocity[:-1] <= 0.0
    rate = item.band.rate / item.band.step
    reach = max(1, round(rate / item.band.cutoff))
    return np.asarray(~binary_dilation(still, iterations=reach))


def power_ratio(model_fit: ModelFit, group: int, clear: Sequence[Mask]) -> float:
    """Power left in the rows of a group that masks (M,) leave out, over that in the others; zero without either.

    Recordings of which rows are left out already do not count.
    """
    known = model_fit.design.whitening.clear
    near, apart = [], []
    for r, mask in enumerate(clear):
        if (r, group) in known:
            continue
        left = model_fit.residuals(model_fit.whole.coefficients, r)[group]
        # Whitened rows lack the first ones, which have no past.
        late = mask[mask.size - left.size :]
        near.append(left[~late] ** 2)
        apart.append(left[late] ** 2)
    powers = [
        float(np.mean(np.concatenate(part))) if part and sum(map(len, part)) else 0.0
        for part in (near, apart)
    ]
    return powers[0] / powers[1] if powers[1] > 0.0 else 0.0


def kept_share(clear: Sequence[Mask]) -> float:
    """Part of the rows that masks (M,) keep."""
    return sum(int(mask.sum()) for mask in clear) / sum(mask.size for mask in clear)
