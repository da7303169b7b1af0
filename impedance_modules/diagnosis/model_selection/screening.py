# SPDX-License-Identifier: BSD-3-Clause
r"""Screening of all candidates at once: what each would gain in the sample, nuisance and model refitted.

With r and S the candidate's part of the normal equations after everything else is eliminated (a Schur
complement), its coefficients are S^{-1} r and its gain is r^T S^{-1} r / 2. What a candidate has in common with
the nuisance does not depend on the model and is summed once.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from impedance_modules.arrays import Array, Indices
from impedance_modules.diagnosis.regression.design_matrix import ColumnLayout, Design
from impedance_modules.diagnosis.regression.model_fit import ModelFit

Mask = NDArray[np.bool_]

COLLINEAR = 1e-4
"""A candidate of which less than this is left after elimination is collinear with the model."""

RIDGE = 1e-7
"""Part of a column's power that is added to keep a candidate's own columns apart."""

SLACK = 1.0
"""Standard deviations by which a coefficient may lie outside its physical bounds."""


@dataclass(frozen=True, eq=False)
class ScreenedCandidate:
    """What screening says of a candidate.

    Attributes:
        layout: The candidate.
        gain: About the log-likelihood it would add [nats].
        power: About the residual power it would explain, in units of the noise.
        physical: Whether its coefficients keep the physical bounds.
        worth: The gain less the Bayesian penalty of its coefficients, by which shapes of one candidate are compared.
    """

    layout: ColumnLayout
    gain: float
    power: float
    physical: bool
    worth: float


class Screening:
    """Sums over the fitted recordings that every round of screening needs.

    Attributes:
        design: All candidates.
        first: (layouts,) index of each layout's first column among all columns.
    """

    def __init__(self, design: Design, recordings: Sequence[int]) -> None:
        """Sums once what no model changes."""
        self.design, self._recordings = design, tuple(recordings)
        widths = np.array([layout.shaped.width for layout in design.layouts], dtype=np.intp)
        self.first = np.concatenate([[0], np.cumsum(widths)]).astype(np.intp)
        self._widths = widths
        self._lags = int(widths.max(initial=1))
        self._ids = tuple(self._columns(g) for g in range(len(design.groups)))
        self._nuisance = tuple(
            sum(
                np.asarray(design.X[r][g].T @ design.Z[r][g].astype(np.float32), float)
                for r in self._recordings
            )
            for g in range(len(design.groups))
        )
        self._own = tuple(self._bands(g) for g in range(len(design.groups)))
        self.classes = [(int(width), np.flatnonzero(widths == width)) for width in np.unique(widths)]
        self._ranked: WeakKeyDictionary[ModelFit, list[ScreenedCandidate]] = WeakKeyDictionary()

    def _columns(self, group: int) -> Indices:
        """Which of all columns stand in a group, in its order."""
        found = [
            np.arange(self.first[i], self.first[i + 1])
            for i, layout in enumerate(self.design.layouts)
            if group in layout.places
        ]
        return np.concatenate(found).astype(np.intp) if found else np.zeros(0, np.intp)

    def _bands(self, group: int) -> Array:
        """(lags, C) sums of products of each column with itself and those behind it."""
        count = len(self._ids[group])
        out = np.zeros((self._lags, count))
        for r in self._recordings:
            X = self.design.X[r][group]
            for lag in range(min(self._lags, count)):
                out[lag, : count - lag] += np.einsum("mc,mc->c", X[:, : count - lag], X[:, lag:])
        return out

    def rank(self, model_fit: ModelFit) -> list[ScreenedCandidate]:
        """Ranks all candidates that the model does not hold yet, best first; done once for each model.

        Where priors are far off, several would explain everything, and more by what they save there: of these the one
        with the largest power is first.
        """
        known = self._ranked.get(model_fit)
        if known is None:
            known = self._ranked[model_fit] = self._ranking(model_fit)
        return known

    def _ranking(self, model_fit: ModelFit) -> list[ScreenedCandidate]:
        cross, own, right = self._against(model_fit)
        pulled = cross @ model_fit.whole.inverse
        left = np.zeros_like(own)
        for lag in range(self._lags):
            rows = len(own[lag]) - lag
            left[lag, :rows] = own[lag, :rows] - np.einsum("ca,ca->c", pulled[:rows], cross[lag:])
        held = {term.key for term in model_fit.model}
        entries: list[ScreenedCandidate] = []
        for width, members in self.classes:
            entries += self._judge(model_fit, width, members, (own, left, right), held)
        return sorted(entries, key=lambda entry: (-entry.gain, -entry.power))

    def _against(self, model_fit: ModelFit) -> tuple[Array, Array, Array]:
        """All columns against the model (C, A), against themselves (lags, C), and against what is left (C,)."""
        total = int(self.first[-1])
        cross, own, right = np.zeros((total, model_fit.size)), np.zeros((self._lags, total)), np.zeros(total)
        left = {r: model_fit.left_of(r) for r in self._recordings}
        for g, ids in enumerate(self._ids):
            weight, nuisance = model_fit.weights[g], model_fit.design.nuisance.ids[g]
            k = len(nuisance)
            more = np.zeros((len(ids), len(model_fit.ids[g]) - k + 1))
            for r in self._recordings:
                block = np.column_stack([model_fit.rows[r][g][:, k:], left[r][g]]).astype(np.float32)
                more += self.design.X[r][g].T @ block
            cross[np.ix_(ids, nuisance)] += weight * self._nuisance[g]
            cross[np.ix_(ids, model_fit.ids[g][k:])] += weight * more[:, :-1]
            own[:, ids] += weight * self._own[g]
            right[ids] += weight * more[:, -1]
        return cross, own, right

    def _judge(
        self,
        model_fit: ModelFit,
        width: int,
        members: Indices,
        sums: tuple[Array, Array, Array],
        held: set[tuple[str, str, str]],
    ) -> list[ScreenedCandidate]:
        """Looks at the candidates of one width together."""
        own, left, right = sums
        columns = self.first[members][:, None] + np.arange(width)
        S = np.empty((len(members), width, width))
        for i in range(width):
            for j in range(i, width):
                S[:, i, j] = S[:, j, i] = left[j - i][columns[:, i]]
        power = own[0][columns]
        layouts = [self.design.layouts[i] for i in members]
        out: list[ScreenedCandidate] = []
        for fixed in (False, True):
            chosen = np.array(
                [i for i, layout in enumerate(layouts) if layout.shaped.fixed == fixed], dtype=np.intp
            )
            size = width - fixed
            if not len(chosen) or size == 0:
                continue
            part, b = S[chosen], right[columns[chosen]]
            some = [layouts[i] for i in chosen]
            precision = np.array([layout.precision for layout in some])
            matrix = part[:, :size, :size] + np.einsum(
                "np,pq->npq", precision + RIDGE * power[chosen][:, :size], np.eye(size)
            )
            pull = b[:, :size] - (part[:, :size, size] if fixed else 0.0)
            inverse = np.linalg.pinv(matrix, hermitian=True)
            found = np.einsum("npq,nq->np", inverse, pull)
            gain = 0.5 * np.einsum("np,np->n", found, pull)
            if fixed:
                gain = gain + b[:, size] - 0.5 * part[:, size, size]
            spread = SLACK * np.sqrt(np.clip(np.einsum("npp->np", inverse), 0.0, None))
            shown = np.einsum("npp->np", part)[:, :size] > COLLINEAR * power[chosen][:, :size]
            seen = np.all(shown | np.array([layout.unseen for layout in some]), axis=1)
            out += _looks(model_fit, some, (found, spread, gain), seen, held)
        return out


def _looks(
    model_fit: ModelFit,
    layouts: Sequence[ColumnLayout],
    found: tuple[Array, Array, Array],
    seen: Mask,
    held: set[tuple[str, str, str]],
) -> list[ScreenedCandidate]:
    coefficients, spread, gains = found
    lower = np.array([layout.shaped.lower * layout.scale for layout in layouts])
    upper = np.array([layout.shaped.upper * layout.scale for layout in layouts])
    physical = np.all((coefficients > lower - spread) & (coefficients < upper + spread), axis=1)
    out = []
    for i in np.flatnonzero(seen & (gains > 0.0)):
        layout = layouts[int(i)]
        if layout.shaped.key in held:
            continue
        touched = list(layout.groups)
        samples = float(np.sum(model_fit.counts[touched]))
        gain = -0.5 * samples * float(np.log(max(1.0 - 2.0 * gains[i] / samples, 1e-6)))
        power = float(2.0 * gains[i] / np.min(model_fit.weights[touched]))
        worth = gain - 0.5 * layout.free * float(np.log(max(samples, 2.0)))
        out.append(ScreenedCandidate(layout, gain, power, bool(physical[i]), worth))
    return out
