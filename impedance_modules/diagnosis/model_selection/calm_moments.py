# SPDX-License-Identifier: BSD-3-Clause
"""What a model leaves of the recordings, moment by moment, and the rows in which that is usual."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.diagnosis.regression.disturbed_moments import undisturbed_rows
from impedance_modules.diagnosis.regression.model_fit import ModelFit
from impedance_modules.diagnosis.residuals.contact_mask import Mask, rows_of_link_residuals
from impedance_modules.diagnosis.residuals.preparation import Prepared
from impedance_modules.effects.residual_kinds import uses_motion


def calm_rows(model_fit: ModelFit, prepared: Sequence[Prepared]) -> dict[tuple[int, int], Mask]:
    """Recording and group -> (M,) rows in which a model leaves no more than usual of the residuals of links.

    Empty where nothing is unusual, or too much of it to come from outside.
    """
    groups = model_fit.design.groups
    moved = [g for g, (residual, _) in enumerate(groups) if uses_motion(residual)]
    if not moved:
        return {}
    left, shown = _left(model_fit, prepared, moved)
    band = prepared[0].band
    clear = undisturbed_rows(left, shown, band.rate / band.step)
    if all(rows.all() for rows in clear):
        return {}
    return rows_of_link_residuals(dict(enumerate(clear)), groups)


def _left(
    model_fit: ModelFit, prepared: Sequence[Prepared], groups: Sequence[int]
) -> tuple[list[list[Array]], list[list[Mask]]]:
    """What a model leaves of the rows that count, group -> recording -> (m,), and which of all (M,) these are."""
    known = model_fit.design.whitening.clear
    left: list[list[Array]] = [[] for _ in groups]
    shown: list[list[Mask]] = [[] for _ in groups]
    for r, item in enumerate(prepared):
        own = model_fit.residuals(model_fit.whole.coefficients, r)
        for place, g in enumerate(groups):
            rows = known.get((r, g), np.ones(item.samples, dtype=bool)).copy()
            past = item.samples - len(own[g])  # whitened rows lack the first ones, which have no past
            rows[:past] = False
            left[place].append(own[g][rows[past:]])
            shown[place].append(rows)
    return left, shown
