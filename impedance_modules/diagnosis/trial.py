# SPDX-License-Identifier: BSD-3-Clause
r"""What a candidate gains on recordings that its fit has not seen.

    gain = \sum_g (n_g \kappa_g / 2) \log(SSE_g^{without} / SSE_g^{with})       [nats]

over held-out folds: the log predictive likelihood with each group's noise level profiled out, counted in
independent samples.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from impedance_modules.diagnosis.design import Design, Slot
from impedance_modules.diagnosis.fit import Fit, extend, fit, squares
from impedance_modules.diagnosis.noise import Floor, independent_part

Array = NDArray[np.float64]

BLOCK = 1.0
"""Length of the blocks over which a gain is averaged and its error judged [s]."""


@dataclass(frozen=True, eq=False)
class Trial:
    """A candidate, tried beside a model.

    Attributes:
        slot: The candidate.
        gain: Held-out gain [nats].
        folds: (folds,) part of each fold.
        powers: (groups,) held-out residual power that it explains, in units of the noise floor's.
        fits: Its fit without each fold.
        reduction: Largest part of a touched group's held-out squares that it removes.
    """

    slot: Slot
    gain: float
    powers: Array
    folds: Array
    fits: tuple[Fit, ...]
    reduction: float

    @property
    def reach(self) -> float:
        """Residual power that it explains over all groups."""
        return float(self.powers.sum())

    def reach_on(self, groups: Sequence[int]) -> float:
        """Residual power that it explains in some groups."""
        return float(self.powers[list(groups)].sum())


def significance(better: Array, worse: Array) -> float:
    """Mean difference of two models' block losses over its standard error."""
    difference = worse - better
    spread = float(difference.std(ddof=1)) if len(difference) > 1 else 0.0
    if spread == 0.0:
        return 0.0
    return float(difference.mean() / (spread / np.sqrt(len(difference))))


class Bench:
    """Fits a model on all folds but one, again and again, and tries candidates beside it.

    Attributes:
        design: The sums.
        folds: Indices of recordings, one tuple per fold.
        model: Accepted candidates.
        weights: (groups,) of the fits.
        independent: (groups,) part of the samples that count.
    """

    def __init__(
        self, design: Design, folds: Sequence[Sequence[int]], model: Sequence[Slot], floor: Floor, rate: float
    ) -> None:
        self.design, self.model, self.floor = design, tuple(model), floor
        self.folds = tuple(tuple(fold) for fold in folds)
        self.fitted = tuple(index for fold in self.folds for index in fold)
        self._block = max(2, round(BLOCK * rate))
        self.counts = np.array(
            [design.count(self.fitted, group) for group in range(len(design.groups))], dtype=float
        )
        self.independent = floor.independent
        self.weights = self.independent / np.maximum(floor.rms, 1e-9) ** 2
        for _ in range(3):
            self.whole = fit(design, self.fitted, self.model, self.weights)
            self.left = squares(design, self.fitted, self.whole.coefficients)
            self.independent = self._independent()
            size = np.maximum(self.left / self.counts, floor.rms**2)
            self.weights = self.independent / size

    def _independent(self) -> Array:
        parts = []
        for group in range(len(self.design.groups)):
            series = [self.design.residual(index, group, self.whole.coefficients) for index in self.fitted]
            parts.append(max(independent_part(series), 0.02))
        return np.array(parts)

    def _train(self, fold: int) -> tuple[int, ...]:
        return tuple(index for other, found in enumerate(self.folds) if other != fold for index in found)

    def fits(self, model: Sequence[Slot]) -> list[Fit]:
        """Fits a model without each fold in turn."""
        return [fit(self.design, self._train(fold), model, self.weights) for fold in range(len(self.folds))]

    @cached_property
    def base(self) -> list[Fit]:
        """The model's own fits."""
        return self.fits(self.model)

    @cached_property
    def base_squares(self) -> Array:
        """(folds, groups) held-out squares of the model."""
        return self._squares(self.base)

    def _squares(self, fits: Sequence[Fit]) -> Array:
        pairs = zip(self.folds, fits, strict=True)
        return np.array([squares(self.design, fold, found.coefficients) for fold, found in pairs])

    def losses(self, fits: Sequence[Fit], groups: Sequence[int]) -> Array:
        """Weighted held-out squares of some groups, in blocks of time, (blocks,)."""
        out: list[Array] = []
        for fold, found in zip(self.folds, fits, strict=True):
            for recording in fold:
                series = [
                    self.design.residual(recording, g, found.coefficients) ** 2 * self.weights[g]
                    for g in groups
                ]
                out.append(np.sum([_blocks(left, self._block) for left in series], axis=0))
        return np.concatenate(out)

    def trial(self, slot: Slot) -> Trial:
        """Tries one candidate beside the model."""
        trains = [self._train(fold) for fold in range(len(self.folds))]
        fits = [
            extend(self.design, t, base, slot, self.weights)
            for t, base in zip(trains, self.base, strict=True)
        ]
        with_it, without = self._squares(fits), self.base_squares
        ratio = np.log(without.sum(axis=0) / with_it.sum(axis=0))
        touched = list(slot.groups)
        folds = 0.5 * ((without - with_it) * self.weights).sum(axis=1)
        reduction = 1.0 - with_it.sum(axis=0)[touched] / without.sum(axis=0)[touched]
        return Trial(
            slot=slot,
            gain=float(0.5 * np.sum(self.counts * self.independent * ratio)),
            powers=(without - with_it).sum(axis=0) / self.floor.rms**2,
            folds=folds,
            fits=tuple(fits),
            reduction=float(reduction.max()),
        )

    def advantage(self, trial: Trial, rival: Trial | None) -> float:
        """Standard errors by which a trial's held-out losses lie below a rival's, or below the model's own.

        Both are judged where the trial's candidate acts.
        """
        groups = trial.slot.groups
        other = self.base if rival is None else rival.fits
        return significance(self.losses(trial.fits, groups), self.losses(other, groups))


def _blocks(values: Array, size: int) -> Array:
    """Sums over whole blocks; what is left over at the end joins the last one."""
    starts = np.arange(0, max(len(values) - size + 1, 1), size)
    return np.add.reduceat(values, starts)
