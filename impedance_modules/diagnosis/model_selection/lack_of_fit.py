# SPDX-License-Identifier: BSD-3-Clause
r"""Whether what is left is noise: the last word on a verdict.

    F_g = \frac{SSE_g / n_g}{1 + v_g},      v_g the variance that the parameters' own uncertainty gives

in whitened rows, on recordings that no fit has seen. The limit is Fisher's for so many samples here and in the
floor, all groups together, or what is `negligible` beside the joint's own load where that is more; and no
stand-in may find structure in it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import f as fisher

from impedance_modules.diagnosis.model_selection.evidence import Evidence
from impedance_modules.diagnosis.structure import structure

Array = NDArray[np.float64]

ALPHA = 0.002
"""Probability that a right model fails, all groups together."""

SYSTEMATIC = 1.45
"""Power over noise that the nominal model's own approximations may leave (differences, held commands, filters)."""

WEAK = 2.0
"""Factor on the limit where no repeats measured the floor; in between where they showed a part of it."""

LEAST = 1e-24
"""Rms that stands for none at all."""


@dataclass(frozen=True, eq=False)
class Lack:
    """The test's outcome.

    Attributes:
        ratio: (groups,) residual power over expected power.
        limit: (groups,) what may pass.
        structure: What a stand-in still finds, in words; empty if nothing.
    """

    ratio: Array
    limit: Array
    structure: str

    @property
    def passed(self) -> bool:
        """Nothing but noise is left."""
        return bool(np.all(self.ratio <= self.limit)) and not self.structure


def lack_of_fit(evidence: Evidence) -> Lack:
    """Tests what the accepted model leaves, on unseen recordings and on all of them."""
    unseen = _ratios(evidence, evidence.heldout)
    fitted = _ratios(evidence, (*evidence.bench.fitted, *evidence.heldout))
    ratio, limit = (np.array(part) for part in zip(*map(_worse, unseen, fitted), strict=True))
    return Lack(ratio, limit, structure(evidence))


def _worse(one: tuple[float, float], other: tuple[float, float]) -> tuple[float, float]:
    return max(one, other, key=lambda pair: pair[0] / pair[1])


def _ratios(evidence: Evidence, recordings: Sequence[int]) -> list[tuple[float, float]]:
    """Residual power over expected power, and its limit, of each group."""
    bench, design = evidence.bench, evidence.design
    rescale = design.whitening.innovation / evidence.floor.innovation
    left = {r: bench.residuals(bench.whole.coefficients, r) for r in recordings}
    chance = 1.0 - ALPHA / len(design.groups)
    factors = SYSTEMATIC * (1.0 + (WEAK - 1.0) * evidence.floor.assumed)
    small = (evidence.negligible / np.maximum(evidence.rms(bench, recordings), LEAST)) ** 2
    out = []
    for g, ids in enumerate(bench.ids):
        rows = np.concatenate([left[r][g] * rescale[r, g] for r in recordings])
        T = np.concatenate([bench.rows[r][g] * rescale[r, g] for r in recordings])
        variance = float(np.sum((T @ bench.whole.inverse[np.ix_(ids, ids)]) * T) / len(T))
        part, count = design.whitening.part[g], design.count(recordings)[g]
        ratio = part * float(np.sum(rows**2)) / count / (part + variance)
        limit = float(factors[g]) * float(fisher.ppf(chance, count, design.whitening.samples[g]))
        out.append((ratio, max(limit, ratio * float(small[g]))))
    return out
