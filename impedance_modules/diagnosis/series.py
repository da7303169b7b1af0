# SPDX-License-Identifier: BSD-3-Clause
"""Held-out residuals over time, with what was measured, what was predicted, and what each joint did."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from impedance_modules.diagnosis.data.nominal_model import NominalModel
from impedance_modules.diagnosis.model_selection.evidence import Evidence
from impedance_modules.diagnosis.model_selection.gap_location import regimes
from impedance_modules.diagnosis.residuals.preparation import Prepared
from impedance_modules.diagnosis.result import Series

Array = NDArray[np.float64]

MOST_RECORDINGS = 4
"""Held-out recordings that are kept for report and viewer."""


def held_out_series(evidence: Evidence, model: NominalModel) -> tuple[Series, ...]:
    """Collects every residual of the first held-out recordings, without the causes and with them."""
    units = model.tree.units()
    out = []
    for index in evidence.heldout[:MOST_RECORDINGS]:
        item = evidence.prepared[index]
        left = evidence.plain.left(evidence.bench, index)
        doing = [_doing(item, model, joint) for joint in range(model.n)]
        for group, (residual, joint) in enumerate(evidence.design.groups):
            out.append(
                Series(
                    joint=model.joints[joint],
                    residual=residual,
                    unit="rad/s" if residual == "velocity" else units[joint],
                    episode=item.log.name,
                    time=item.time,
                    measured=_measured(item, residual)[:, joint],
                    before=evidence.design.raw[index][group],
                    after=left[group],
                    regimes=doing[joint],
                )
            )
    return tuple(out)


def _measured(item: Prepared, residual: str) -> Array:
    """What a residual compares its prediction with, in the band, (M, n)."""
    s, log = item.signals, item.log
    if residual == "velocity" and log.velocity is not None:
        return item.band.condense(log.velocity)
    if residual in {"link", "motor"} and s.effort is not None:
        return item.band.condense(s.effort)
    return item.band.condense(s.drive if s.drive is not None else np.zeros_like(s.position))


def _doing(item: Prepared, model: NominalModel, joint: int) -> tuple[str, ...]:
    """Name of the regime at every sample."""
    out = np.full(item.samples, "", dtype=object)
    for name, mask in regimes(item, model, joint).items():
        out[mask] = name
    return tuple(out.tolist())
