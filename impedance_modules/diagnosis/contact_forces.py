# SPDX-License-Identifier: BSD-3-Clause
r"""Forces on one link over time: r = -J^T(q) f(t), f piecewise linear, fitted to the links' whitened residual."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impedance_modules.diagnosis.regression.model_fit import ModelFit
from impedance_modules.diagnosis.residuals.preparation import Prepared
from impedance_modules.effects.residual_kinds import uses_motion

Array = NDArray[np.float64]

SPACING = 0.25
"""Between the tips of two hats [s]."""


@dataclass(frozen=True, eq=False)
class Forces:
    """Hats of one link on one recording: (k, 3) forces, their covariance, and what each joint gains by them."""

    body: str
    force: Array
    covariance: Array
    joints: Array
    gain: float


def hats_of(item: Prepared, rows: int) -> tuple[Array, Array]:
    """Tips (k,) [s] and hats (rows, k) at the recording's last rows."""
    time = item.time[-rows:] - item.log.start
    tips = np.arange(time[0], time[-1] + SPACING, SPACING)
    return tips, np.clip(1.0 - np.abs(time[:, None] - tips) / SPACING, 0.0, None)


def free_torques(bench: ModelFit, item: Prepared, r: int, left: Sequence[Array], g: int) -> Array:
    """Chi-square (k,) of a free torque of one joint at each hat."""
    _, hats = hats_of(item, item.samples)
    X = np.asarray(bench.design.whitening.apply(hats, r, g))
    gram = X.T @ X + 1e-6 * np.eye(X.shape[1])
    covariance = np.linalg.inv(gram)
    torque = covariance @ (X.T @ left[g])
    return np.asarray(torque**2 / np.diag(covariance))


def fit_forces(bench: ModelFit, item: Prepared, r: int, left: Sequence[Array], body: str) -> Forces:
    """Fits one link's hats."""
    J = item.band.condense(item.signals.model.jacobian(body, item.signals.position)[:, :3])
    _, hats = hats_of(item, item.samples)
    count = hats.shape[1]
    gram, right = 1e-6 * np.eye(3 * count), np.zeros(3 * count)
    blocks = {}
    for g, (residual, joint) in enumerate(bench.design.groups):
        if not uses_motion(residual):
            continue
        columns = -(hats[:, :, None] * J[:, None, :, joint]).reshape(len(hats), -1)
        X = np.asarray(bench.design.whitening.apply(columns, r, g))
        gram += X.T @ X
        right += X.T @ left[g]
        blocks[g] = X
    covariance = np.linalg.inv(gram)
    force = np.asarray(covariance @ right)
    joints = np.array(
        [float(np.sum(left[g] ** 2) - np.sum((left[g] - X @ force) ** 2)) for g, X in blocks.items()]
    )
    return Forces(body, force.reshape(-1, 3), np.asarray(covariance), joints, float(force @ right))


def strength_of(forces: Forces, part: slice) -> float:
    """Chi-square of some hats together."""
    force = forces.force.reshape(-1)[part]
    return float(force @ np.linalg.solve(forces.covariance[part, part], force))
