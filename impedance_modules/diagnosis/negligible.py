# SPDX-License-Identifier: BSD-3-Clause
r"""What is too small to be a gap: less than a thousandth of what the joint carries, or of how fast it turns.

    |r|_{rms} \le 10^{-3} |\tau|_{rms},      velocities likewise

Nobody knows masses or gravity to more digits, and an engine's own integration is hardly better. Where sensors are
noisier than that, the noise decides long before.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from impedance_modules.diagnosis.regression.candidates import Group
from impedance_modules.diagnosis.regression.model_fit import ModelFit, ModelTerm
from impedance_modules.diagnosis.regression.parameter_estimates import UnwhitenedFit
from impedance_modules.diagnosis.residuals.preparation import Prepared

Array = NDArray[np.float64]

NEGLIGIBLE = 1e-3
"""Part of a joint's own load, or speed."""


def negligible(prepared: Sequence[Prepared], groups: Sequence[Group]) -> Array:
    """(groups,) rms below which nothing matters, in each residual's unit."""
    load, speed = (
        NEGLIGIBLE * np.sqrt(np.mean(np.concatenate(values) ** 2, axis=0))
        for values in ([item.load for item in prepared], [item.velocity for item in prepared])
    )
    return np.array([speed[joint] if residual == "velocity" else load[joint] for residual, joint in groups])


def felt(bench: ModelFit, plain: UnwhitenedFit, least: Array) -> list[ModelTerm]:
    """Terms of a fitted model whose own part is more than negligible somewhere.

    Args:
        bench: The model.
        plain: Rows in their own units.
        least: (groups,) what is negligible.
    """
    recordings = range(len(bench.design.raw))
    kept = []
    for index, term in enumerate(bench.model):
        parts = [plain.torque(bench, index, r) for r in recordings]
        size = {g: np.sqrt(np.mean(np.concatenate([part[g] for part in parts]) ** 2)) for g in term.groups}
        if any(value > least[g] for g, value in size.items()):
            kept.append(term)
    return kept
