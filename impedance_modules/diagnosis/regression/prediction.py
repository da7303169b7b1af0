# SPDX-License-Identifier: BSD-3-Clause
r"""What a fit leaves of recordings that it has not seen, measured by what it can foretell of them.

    r^T (1 + Z P Z^T)^{-1} r = \min_\delta |r - Z \delta|^2 + \delta^T P^{-1} \delta

r are residuals of unit noise, Z the columns and P the covariance of their coefficients by the fit. Links that the
fitted recordings hardly show are not known on another motion either: what they leave there tells nothing of a cause,
and costs no more than P allows. The squares of r alone would count each of its rows as an error of the law.

Source: the predictive distribution of linear regression (Bishop, Pattern Recognition and Machine Learning, 3.58), its
determinant left out: it is the same for all laws beside the same links.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from impedance_modules.arrays import Array, Indices


def foretold_squares(
    left: Sequence[Sequence[Array]],
    columns: Sequence[Sequence[Array]],
    ids: Sequence[Indices],
    weights: Array,
    covariance: Array,
) -> Array:
    """Squares of unseen residuals in the metric of their prediction.

    Args:
        left: Recording -> group -> (M,) residual r by the fit.
        columns: Recording -> group -> (M, k) Z.
        ids: Group -> (k,) which coefficients these belong to.
        weights: (groups,) weight of a group's squares.
        covariance: (K, K) of all coefficients once these recordings are known, too: the inverse of P^{-1} + Z^T W Z.

    Returns:
        (groups,) squares; what the better coefficients cost counts in the groups where they act.
    """
    right = np.zeros(len(covariance))
    for residuals, blocks in zip(left, columns, strict=True):
        for g, own in enumerate(ids):
            right[own] += weights[g] * (blocks[g].T @ residuals[g])
    moved = covariance @ right
    squares, acts = np.zeros((2, len(ids)))
    for residuals, blocks in zip(left, columns, strict=True):
        for g, own in enumerate(ids):
            part = blocks[g] @ moved[own]
            rest = residuals[g] - part
            squares[g] += rest @ rest
            acts[g] += part @ part
    total = float(weights @ acts)
    cost = max(float(right @ moved) - total, 0.0)
    return np.asarray(squares + cost / total * acts) if total > 0.0 else squares
