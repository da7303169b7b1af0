# SPDX-License-Identifier: BSD-3-Clause
"""Unseen residuals in the metric of their prediction: an identity of least squares, and what it is for."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from impedance_modules.diagnosis.model_selection.candidate_trial import try_term
from impedance_modules.diagnosis.regression.model_fit import ModelFit, term_of
from impedance_modules.diagnosis.regression.prediction import foretold_squares
from tests.support.selection_samples import FOLDS, GROUPS, NUISANCE, layout, random_design, with_cause

CAUSE = layout(("cause", "a", "link"), {0: 0, 1: 0}, 1)
SEEDS = st.integers(0, 10**6)


def least(rows: np.ndarray, target: np.ndarray, precision: np.ndarray) -> float:
    """Smallest squares of a fit, prior included."""
    found = np.linalg.solve(rows.T @ rows + precision, rows.T @ target)
    left = target - rows @ found
    return float(left @ left + found @ precision @ found)


@given(SEEDS)
def test_unseen_squares_are_what_they_add_to_a_fit_of_everything(seed: int) -> None:
    """min over all rows less min over those that were seen: the same number without a prediction."""
    dice = np.random.default_rng(seed)
    size, prior = int(dice.integers(1, 6)), np.diag(dice.uniform(0.1, 3.0, 6))
    prior = prior[:size, :size]
    seen, unseen = (dice.normal(size=(int(dice.integers(3, 40)), size)) for _ in range(2))
    y, later = dice.normal(size=len(seen)), 3.0 * dice.normal(size=len(unseen))
    precision = seen.T @ seen + prior
    left = later - unseen @ np.linalg.solve(precision, seen.T @ y)
    covariance = np.linalg.inv(precision + unseen.T @ unseen)
    (found,) = foretold_squares([[left]], [[unseen]], [np.arange(size)], np.ones(1), covariance)
    everything = least(np.vstack([seen, unseen]), np.concatenate([y, later]), prior)
    assert found == pytest.approx(everything - least(seen, y, prior), rel=1e-9, abs=1e-9)
    mahalanobis = left @ np.linalg.solve(
        np.eye(len(left)) + unseen @ np.linalg.inv(precision) @ unseen.T, left
    )
    assert found == pytest.approx(mahalanobis, rel=1e-9, abs=1e-9)
    assert found <= float(left @ left) * (1.0 + 1e-12)


@given(SEEDS)
def test_weighted_groups_share_one_prediction(seed: int) -> None:
    """Groups that share coefficients: their weighted squares add up to those of all rows together."""
    dice = np.random.default_rng(seed)
    ids = [np.array([0, 2]), np.array([1, 2, 3]), np.array([3])]
    weights = dice.uniform(0.05, 1.0, 3)
    lengths = dice.integers(2, 20, (2, 3))
    left = [[2.0 * dice.normal(size=n) for n in row] for row in lengths]
    columns = [[dice.normal(size=(n, len(own))) for n, own in zip(row, ids, strict=True)] for row in lengths]
    P = np.diag(dice.uniform(0.2, 4.0, 4))
    whole = np.concatenate([np.sqrt(w) * x for row in left for w, x in zip(weights, row, strict=True)])
    wide = np.zeros((len(whole), 4))
    first = 0
    for row in columns:
        for w, block, own in zip(weights, row, ids, strict=True):
            wide[first : first + len(block), own] = np.sqrt(w) * block
            first += len(block)
    covariance = np.linalg.inv(np.linalg.inv(P) + wide.T @ wide)
    found = foretold_squares(left, columns, ids, weights, covariance)
    expected = whole @ np.linalg.solve(np.eye(len(whole)) + wide @ P @ wide.T, whole)
    assert float(weights @ found) == pytest.approx(expected, rel=1e-9)
    assert np.all(found >= 0.0)


@given(SEEDS)
def test_nothing_to_follow_leaves_the_squares(seed: int) -> None:
    left = np.random.default_rng(seed).normal(size=7)
    found = foretold_squares([[left]], [[np.zeros((7, 2))]], [np.arange(2)], np.ones(1), np.eye(2))
    assert found == pytest.approx([left @ left])


@pytest.mark.parametrize("seed", range(6))
def test_links_that_move_on_another_motion_refute_no_cause(seed: int) -> None:
    """A link that only one recording shows is off by two deviations there; the cause is in all of them."""
    dice = np.random.default_rng(seed)
    design = with_cause(random_design(dice, (CAUSE,)), CAUSE, [1.0])
    shown = dice.choice([-2.0, 2.0], NUISANCE)
    for g in range(len(GROUPS)):
        for r in range(len(design.Z)):
            design.Z[r][g][:] = 10.0 * design.Z[r][g] if r in FOLDS[1] else 1e-6 * design.Z[r][g]
        for r in FOLDS[1]:
            design.y[r][g][:] += design.Z[r][g] @ shown
    term = term_of(design, CAUSE)
    assert np.all(try_term(ModelFit(design, FOLDS, []), term).folds > 0.0)
    model_fit = ModelFit(design, FOLDS, [term])
    rows = sum(len(values) for r in FOLDS[1] for values in design.y[r])
    plain = sum(float(values @ values) for r in FOLDS[1] for values in model_fit.unseen[r])
    assert plain > 20.0 * rows
    assert model_fit.unseen_squares[1].sum() < 1.5 * rows
