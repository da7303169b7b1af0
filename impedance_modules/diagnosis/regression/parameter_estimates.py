# SPDX-License-Identifier: BSD-3-Clause
r"""Moves a candidate's nonlinear parameters off their grid: Gauss and Newton, columns and shape together.

With X(\theta) \beta the candidate's part, the shape's own column is d(X \beta)/d\theta by differences. The same
columns give the shape's standard deviation: its place in the joint covariance (profile likelihood to second order).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from impedance_modules.diagnosis.residuals.preparation import Prepared
from impedance_modules.diagnosis.regression.model_fit import Bench
from impedance_modules.diagnosis.regression.candidates import Candidate
from impedance_modules.diagnosis.regression.design_matrix import Design
from impedance_modules.diagnosis.regression.drafts import Draft, draft_candidates
from impedance_modules.diagnosis.regression.slots import Slot, scaled_block, slot_of
from impedance_modules.diagnosis.regression.term import Term
from impedance_modules.effects.recorded_signals import Signals

Array = NDArray[np.float64]

ROUNDS = 5
"""Steps at most."""

CLOSE = 0.05
"""A step smaller than this part of a standard deviation is none."""

PARTS = (1.0, 0.3)
"""Of a step, those that are tried in turn: a whole one may overshoot."""

REACH = 0.5
"""Longest step, as a part of the shape's value."""

SLOPE = 1e-3
"""Step of the differences, likewise."""


class Refiner:
    """Evaluates candidates at any shape, in a design's rows.

    Attributes:
        design: The rows.
        prepared: The recordings.
        signals: Theirs, as columns may see them.
    """

    def __init__(self, design: Design, prepared: Sequence[Prepared], signals: Sequence[Signals]) -> None:
        """Takes rows and what they were made of."""
        self.design, self.prepared, self.signals = design, tuple(prepared), tuple(signals)
        self._residuals = list(dict.fromkeys(residual for residual, _ in design.groups))

    def draft(self, candidate: Candidate, shape: Mapping[str, float]) -> Draft | None:
        """A candidate's thinned columns, in their own units."""
        return next(
            iter(draft_candidates([(candidate, shape)], self.prepared, self.signals, self._residuals)), None
        )

    def term(self, candidate: Candidate, shape: Mapping[str, float], like: Slot | None = None) -> Term | None:
        """Evaluates a candidate; scaled as another term where one is given."""
        draft = self.draft(candidate, shape)
        groups, nuisance = self.design.groups, self.design.nuisance
        slot = (
            None
            if draft is None
            else slot_of(draft, groups, nuisance.links, dict.fromkeys(range(len(groups)), 0))
        )
        if draft is None or slot is None:
            return None
        if like is not None:
            slot = Slot(slot.shaped, slot.places, like.scale, like.precision, like.unseen)
        size = slot.shaped.size
        columns, fixed = [], []
        for r in range(len(self.prepared)):
            blocks = {
                g: np.asarray(
                    self.design.whitening.apply(
                        scaled_block(draft, slot, r, groups[g], len(self.design.raw[r][g])).astype(float),
                        r,
                        g,
                    )
                )
                for g in slot.places
            }
            columns.append({g: block[:, :size] for g, block in blocks.items()})
            fixed.append({g: block[:, size] for g, block in blocks.items() if slot.shaped.fixed})
        return Term(slot, tuple(columns), tuple(fixed))

    def slopes(self, term: Term, coefficients: Array) -> dict[str, tuple[Mapping[int, Array], ...]]:
        """What each nonlinear parameter changes per unit, symbol -> recording -> group -> (M,), whitened."""
        out: dict[str, tuple[Mapping[int, Array], ...]] = {}
        for symbol in term.candidate.effect.shape:
            value = term.shaped.shape.get(symbol)
            if value is None:
                continue
            step = SLOPE * max(abs(value), 1e-3)
            moved = self.term(term.candidate, {**term.shaped.shape, symbol: value + step}, term.slot)
            if moved is None or moved.groups != term.groups or moved.shaped.fixed != term.shaped.fixed:
                continue
            out[symbol] = tuple(
                {
                    g: ((new[g] - old[g]) @ coefficients + more.get(g, 0.0) - less.get(g, 0.0)) / step
                    for g in old
                }
                for new, old, more, less in zip(
                    moved.columns, term.columns, moved.fixed, term.fixed, strict=True
                )
            )
        return out

    def refine(self, bench: Bench, term: Term) -> Term:
        """Improves a candidate's shape beside a model; gives back what came in where nothing is better."""
        if term.generic or not term.candidate.effect.shape:
            return term
        best = Bench(bench.design, bench.folds, [*bench.model, term])
        for _ in range(ROUNDS):
            better = self._better(best, bench)
            if better is None:
                break
            best = better
        return best.model[-1]

    def _better(self, best: Bench, reference: Bench) -> Bench | None:
        """The first of some steps of the last term's shape that leaves less; None where none does."""
        for part in PARTS:
            moved = self._step(best, part)
            if moved is None:
                return None
            better = Bench(best.design, best.folds, [*best.model[:-1], moved])
            if _loss(better, reference) < _loss(best, reference) - 1e-3:
                return better
        return None

    def _step(self, bench: Bench, part: float) -> Term | None:
        """Some part of one step of the last term's shape; None where it has converged or cannot move."""
        term, index = bench.model[-1], len(bench.model) - 1
        coefficients = bench.of(index)
        shape = dict(term.shaped.shape)
        candidate = term.candidate
        values = candidate.effect.values(
            np.clip(coefficients, term.shaped.lower, term.shaped.upper),
            shape,
            self.prepared[0].signals,
            candidate.key,
            candidate.port,
        )
        limited = candidate.effect.next_shape(values, shape)
        if limited == shape:
            told = self._newton(bench, term, coefficients * term.slot.scale)
            limited = {
                symbol: value + float(np.clip(told[symbol] - value, -_reach(value), _reach(value)))
                for symbol, value in shape.items()
            }
        limited = {symbol: value + part * (limited[symbol] - value) for symbol, value in shape.items()}
        if all(abs(limited[s] - shape[s]) <= 1e-4 * max(abs(shape[s]), 1e-4) for s in shape):
            return None
        return self.term(candidate, limited)

    def _newton(self, bench: Bench, term: Term, coefficients: Array) -> dict[str, float]:
        """Solves for coefficients and shape together, linearised."""
        slopes = self.slopes(term, coefficients)
        shape = dict(term.shaped.shape)
        for symbol, slope in slopes.items():
            cross, own, right = np.zeros(bench.size), 0.0, 0.0
            for r in bench.fitted:
                left = bench.residuals(bench.whole.coefficients, r)
                for g, column in slope[r].items():
                    weight = bench.weights[g]
                    cross[bench.ids[g]] += weight * (bench.rows[r][g].T @ column)
                    own += weight * float(column @ column)
                    right += weight * float(column @ left[g])
            free = own - float(cross @ bench.whole.inverse @ cross)
            if free > 1e-6 * own > 0.0:
                shape[symbol] = shape[symbol] + right / free
        return shape


def _reach(value: float) -> float:
    return REACH * abs(value)


def _loss(bench: Bench, reference: Bench) -> float:
    """Squares left by the whole fit, all with the same weights."""
    return float(bench.left @ reference.weights) + float(bench.whole.coefficients**2 @ bench.prior)
