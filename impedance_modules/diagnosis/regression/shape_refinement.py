# SPDX-License-Identifier: BSD-3-Clause
r"""Parameters that enter nonlinearly, a candidate's shape, are refined by Gauss-Newton from the best point of a grid.

With X(\theta) \beta the candidate's part, the shape's own column is d(X \beta)/d\theta by differences; columns and
shape are solved for together.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.diagnosis.regression.candidates import (
    Candidate,
    CandidateRegressor,
    candidate_regressors,
    repeats,
    shapes_of,
)
from impedance_modules.diagnosis.regression.design_matrix import ColumnLayout, Design, layout_of, scaled_block
from impedance_modules.diagnosis.regression.model_fit import ModelFit, ModelTerm
from impedance_modules.diagnosis.residuals.preparation import Prepared
from impedance_modules.effects.recorded_signals import Signals

ROUNDS = 5
"""Steps at most."""

PARTS = (1.0, 0.3)
"""Of a step, those that are tried in turn: a whole one may overshoot."""

REACH = 0.5
"""Longest step, as a part of the shape's value."""

SLOPE = 1e-3
"""Step of the differences, likewise."""


class ShapeRefiner:
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

    def regressor(self, candidate: Candidate, shape: Mapping[str, float]) -> CandidateRegressor | None:
        """A candidate's thinned columns, in their own units."""
        return next(
            iter(candidate_regressors([(candidate, shape)], self.prepared, self.signals, self._residuals)),
            None,
        )

    def term(
        self, candidate: Candidate, shape: Mapping[str, float], like: ColumnLayout | None = None
    ) -> ModelTerm | None:
        """Evaluates a candidate; scaled as another term where one is given."""
        regressor = self.regressor(candidate, shape)
        groups, nuisance = self.design.groups, self.design.nuisance
        layout = (
            None
            if regressor is None
            else layout_of(regressor, groups, nuisance.links, dict.fromkeys(range(len(groups)), 0))
        )
        if regressor is None or layout is None:
            return None
        if like is not None:
            layout = ColumnLayout(layout.shaped, layout.places, like.scale, like.precision, like.unseen)
        size = layout.shaped.size
        columns, fixed = [], []
        for r in range(len(self.prepared)):
            blocks = {
                g: np.asarray(
                    self.design.whitening.apply(
                        scaled_block(regressor, layout, r, groups[g], len(self.design.raw[r][g])).astype(
                            float
                        ),
                        r,
                        g,
                    )
                )
                for g in layout.places
            }
            columns.append({g: block[:, :size] for g, block in blocks.items()})
            fixed.append({g: block[:, size] for g, block in blocks.items() if layout.shaped.fixed})
        return ModelTerm(layout, tuple(columns), tuple(fixed))

    def slopes(self, term: ModelTerm, coefficients: Array) -> dict[str, tuple[Mapping[int, Array], ...]]:
        """What each nonlinear parameter changes per unit, symbol -> recording -> group -> (M,), whitened."""
        out: dict[str, tuple[Mapping[int, Array], ...]] = {}
        for symbol in term.candidate.effect.refined(term.shaped.shape):
            value = term.shaped.shape.get(symbol)
            if value is None:
                continue
            step = SLOPE * max(abs(value), 1e-3)
            moved = self.term(term.candidate, {**term.shaped.shape, symbol: value + step}, term.layout)
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

    def refine(self, model_fit: ModelFit, term: ModelTerm) -> ModelTerm:
        """Improves a candidate's shape beside a model; gives back what came in where nothing is better."""
        if term.generic or not term.candidate.effect.refined(term.shaped.shape):
            return term
        best = self._within_bounds(ModelFit(model_fit.design, model_fit.folds, [*model_fit.model, term]))
        for _ in range(ROUNDS):
            better = self._better(best)
            if better is None:
                break
            best = better
        return best.model[-1]

    def _within_bounds(self, model_fit: ModelFit) -> ModelFit:
        """The last term at that shape of its grid which leaves least, of those whose numbers are physical.

        Where a motion hardly tells a shape, the one that leaves least may ask for a friction below zero.
        """
        term = model_fit.model[-1]
        if not _out_of_bounds(model_fit):
            return model_fit
        coefficients = model_fit.of(len(model_fit.model) - 1)
        found = []
        for shape in (
            *shapes_of(term.candidate, self.signals),
            *term.candidate.effect.shapes_within_bounds(coefficients),
        ):
            moved = self.term(term.candidate, shape, term.layout if term.layout.unseen.any() else None)
            if moved is not None:
                found.append(ModelFit(model_fit.design, model_fit.folds, [*model_fit.model[:-1], moved]))
        physical = [one for one in found if not _out_of_bounds(one)]
        return min(physical, key=_loss, default=model_fit)

    def _better(self, best: ModelFit) -> ModelFit | None:
        """The first of some steps of the last term's shape that leaves less within bounds; None where none does.

        A whole step may lead where the shape is none; a part of it may not.
        """
        for part in PARTS:
            moved = self._step(best, part)
            if moved is None:
                continue
            better = ModelFit(best.design, best.folds, [*best.model[:-1], moved])
            leaves = _out_of_bounds(better) and not _out_of_bounds(best)
            if not leaves and _loss(better) < _loss(best) - 1e-3:
                return better
        return None

    def _step(self, model_fit: ModelFit, part: float) -> ModelTerm | None:
        """Some part of one step of the last term's shape; None where it has converged or cannot move.

        A ripple stays one: stretched over the whole travel it would be an offset or a spring.
        """
        term, index = model_fit.model[-1], len(model_fit.model) - 1
        coefficients = model_fit.of(index)
        shape = dict(term.shaped.shape)
        candidate = term.candidate
        site = candidate.site(self.prepared[0].signals)
        plausible = np.clip(coefficients, term.shaped.lower, term.shaped.upper)
        values = candidate.effect.values(plausible, shape, site)
        limited = candidate.effect.next_shape(values, shape)
        if limited == shape:
            told = self._newton(model_fit, term, coefficients * term.layout.scale)
            limited = {
                symbol: value + float(np.clip(told[symbol] - value, -_reach(value), _reach(value)))
                for symbol, value in shape.items()
            }
        limited = {
            symbol: candidate.effect.nearest(symbol, value + part * (limited[symbol] - value))
            for symbol, value in shape.items()
        }
        if all(abs(limited[s] - shape[s]) <= 1e-4 * max(abs(shape[s]), 1e-4) for s in shape):
            return None
        if not repeats(candidate, limited, self.signals):
            return None
        # A direction that the motion does not show stays one, however little the new shape shows of it.
        return self.term(candidate, limited, term.layout if term.layout.unseen.any() else None)

    def _newton(self, model_fit: ModelFit, term: ModelTerm, coefficients: Array) -> dict[str, float]:
        """Solves for coefficients and shape together, linearised."""
        slopes = self.slopes(term, coefficients)
        shape = dict(term.shaped.shape)
        for symbol, slope in slopes.items():
            cross, own, right = np.zeros(model_fit.size), 0.0, 0.0
            for r in model_fit.fitted:
                left = model_fit.residuals(model_fit.whole.coefficients, r)
                for g, column in slope[r].items():
                    weight = model_fit.weights[g]
                    cross[model_fit.ids[g]] += weight * (model_fit.rows[r][g].T @ column)
                    own += weight * float(column @ column)
                    right += weight * float(column @ left[g])
            free = own - float(cross @ model_fit.whole.inverse @ cross)
            if free > 1e-6 * own > 0.0:
                shape[symbol] = shape[symbol] + right / free
        return shape


def _reach(value: float) -> float:
    return REACH * abs(value)


def _out_of_bounds(model_fit: ModelFit) -> bool:
    """Whether the last term's coefficients leave their physical bounds."""
    shaped, found = model_fit.model[-1].shaped, model_fit.of(len(model_fit.model) - 1)
    return bool(np.any(found <= shaped.lower) or np.any(found >= shaped.upper))


def _loss(model_fit: ModelFit) -> float:
    """Twice the negative log-likelihood of the whole fit, priors included.

    With the weights of a fit that lacks the term, a tenth of a gap would count no more than noise elsewhere.
    """
    likelihood = float(model_fit.design.log_likelihood(model_fit.left, model_fit.counts).sum())
    return float(model_fit.whole.coefficients**2 @ model_fit.prior) - 2.0 * likelihood
