# SPDX-License-Identifier: BSD-3-Clause
"""Trials and screening on random rows: what the shortcuts give is what fitting everything anew gives."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from impedance_modules.diagnosis.model_selection.candidate_trial import (
    CandidateTrial,
    TermProducts,
    add_to_fit,
    term_products,
    try_term,
)
from impedance_modules.diagnosis.model_selection.evidence import Evidence
from impedance_modules.diagnosis.model_selection.naming import without_unconfirmed
from impedance_modules.diagnosis.model_selection.screening import Screening
from impedance_modules.diagnosis.regression.model_fit import ModelFit, ModelTerm, term_of
from impedance_modules.diagnosis.regression.parameter_estimates import _covariance
from tests.support.selection_samples import (
    FOLDS,
    GROUPS,
    NUISANCE,
    fitted,
    layout,
    least_squares,
    random_design,
    with_cause,
)

KNOWN = layout(("known", "a", "link"), {0: 0, 1: 0}, 2, scale=[2.0, 0.5], precision=[0.3, 0.0])
NEW = layout(("new", "b", "link"), {1: 2, 2: 0}, 2, scale=[0.5, 3.0], precision=[0.0, 0.7])
STEADY = layout(("steady", "b", "link"), {0: 2, 1: 4}, 1, fixed=True)
LAYOUTS = (KNOWN, NEW, STEADY)
SEEDS = pytest.mark.parametrize("seed", range(4))


def sample(seed: int, cause: tuple[float, ...] = (1.0, -2.0), new=NEW) -> tuple[ModelFit, ModelTerm]:
    """A model with one known cause, and a second cause that it lacks."""
    design = random_design(np.random.default_rng(seed), LAYOUTS)
    design = with_cause(with_cause(design, KNOWN, [0.8, 0.4]), new, cause)
    return fitted(design, term_of(design, KNOWN)), term_of(design, new)


def products_of(model_fit: ModelFit, term: ModelTerm, recordings) -> list[TermProducts]:
    return [term_products(model_fit, term, r) for r in recordings]


@SEEDS
@pytest.mark.parametrize("new", [NEW, STEADY], ids=["plain", "with a part that has no coefficient"])
def test_a_term_that_is_added_has_the_coefficients_of_a_fit_of_everything(seed: int, new) -> None:
    model_fit, term = sample(seed, (0.7,) * new.shaped.size, new)
    for recordings, base in ((model_fit.fitted, model_fit.whole), (model_fit.train(1), model_fit.without[1])):
        products = products_of(model_fit, term, recordings)
        beside, own, covariance = add_to_fit(products, base, term)
        all_of_it, inverse = least_squares(model_fit, [*model_fit.model, term], recordings)
        size = term.shaped.size
        assert np.allclose(beside, all_of_it[:-size], atol=1e-6)
        assert np.allclose(own, all_of_it[-size:], atol=1e-6)
        assert np.allclose(covariance, inverse[-size:, -size:], rtol=1e-5)


def squares(trial: CandidateTrial, with_it: bool) -> np.ndarray:
    """(folds, groups), by a fit of everything without each fold, by what that can foretell."""
    model_fit, terms = trial.model_fit, [*trial.model_fit.model, *([trial.term] if with_it else [])]
    out = np.zeros((len(FOLDS), len(GROUPS)))
    for fold, recordings in enumerate(FOLDS):
        found, _ = least_squares(model_fit, terms, model_fit.train(fold))
        unseen = {}
        for r in recordings:
            unseen[r] = []
            for g in range(len(GROUPS)):
                left = model_fit.design.y[r][g] - model_fit.design.Z[r][g] @ found[:NUISANCE]
                first = NUISANCE
                for term in terms:
                    if g in term.columns[r]:
                        left = left - term.columns[r][g] @ found[first : first + term.shaped.size]
                        left = left - term.fixed[r].get(g, 0.0)
                    first += term.shaped.size
                unseen[r].append(left)
        out[fold] = model_fit.predicted_squares(unseen, recordings)
    return out


def likelihood(squares: np.ndarray, counts: np.ndarray) -> np.ndarray:
    """Of white rows whose level is at least the noise's."""
    level = np.maximum(squares / counts, 1.0)
    return -0.5 * counts * np.log(level) - 0.5 * squares / level


@pytest.mark.parametrize("doubt", [1.0, 2.0])
def test_less_than_the_noise_is_no_likelier_by_its_logarithm(doubt: float) -> None:
    design = random_design(np.random.default_rng(0), LAYOUTS)
    design.whitening.doubt = np.full(len(GROUPS), doubt)
    n = design.count([0])

    def of(power: float) -> float:
        return float(design.log_likelihood(power * n, n).sum())

    for before, after in ((10.0, 2.0), (4.0, 1.0), (2.0, 1.0 / doubt)):
        assert of(after) - of(before) == pytest.approx(0.5 * n.sum() * np.log(before / after))
    assert of(0.25 / doubt) - of(0.5 / doubt) == pytest.approx(0.125 * n.sum())
    falling = [of(power) for power in np.linspace(0.0, 4.0, 200)]
    assert np.all(np.diff(falling) < 0.0)


@SEEDS
def test_what_a_trial_says_of_unseen_recordings_follows_from_the_squares_it_leaves(seed: int) -> None:
    model_fit, term = sample(seed)
    trial = try_term(model_fit, term)
    before, after = squares(trial, False), squares(trial, True)
    gone = before - after
    n, w = model_fit.counts, model_fit.weights
    gain = float(np.sum(likelihood(after.sum(axis=0), n) - likelihood(before.sum(axis=0), n)))
    assert trial.unseen_gain == pytest.approx(gain, rel=1e-6)
    assert trial.powers == pytest.approx(gone.sum(axis=0), rel=1e-5, abs=1e-5)
    assert trial.reach == pytest.approx(gone.sum(), rel=1e-6)
    assert trial.reach_on([2]) == pytest.approx(gone[:, 2].sum(), rel=1e-6)
    assert trial.folds == pytest.approx(0.5 * gone[:, [1, 2]] @ w[[1, 2]], rel=1e-6)
    parts = 1.0 - after.sum(axis=0) / before.sum(axis=0)
    assert trial.reduction == pytest.approx(max(parts[1], parts[2]), rel=1e-6)
    assert trial.narrow == pytest.approx((gone.sum(axis=0) * w).max() / (gone.sum(axis=0) @ w), rel=1e-6)
    assert trial.gain == min(trial.unseen_gain, trial.in_sample.gain)
    assert model_fit.log_likelihood == pytest.approx(likelihood(before.sum(axis=0), n), rel=1e-9)


@SEEDS
def test_the_gain_of_all_recordings_counts_what_the_prior_costs(seed: int) -> None:
    model_fit, term = sample(seed)
    found, _ = least_squares(model_fit, [*model_fit.model, term], model_fit.fitted)
    joined = ModelFit(model_fit.design, FOLDS, [*model_fit.model, term])
    after = joined.squares(found, model_fit.fitted)
    before = model_fit.left
    prior = np.concatenate([np.ones(NUISANCE), KNOWN.precision, NEW.precision])
    old = np.concatenate([model_fit.whole.coefficients, [0.0, 0.0]])
    ahead = likelihood(after, model_fit.counts) - likelihood(before, model_fit.counts)
    gain = float(ahead.sum() + 0.5 * prior @ (old**2 - found**2))
    trial = try_term(model_fit, term).in_sample
    assert trial.gain == pytest.approx(gain, rel=1e-5)
    assert np.allclose(trial.own, found[-2:], atol=1e-6) and np.allclose(trial.beside, found[:-2], atol=1e-6)


@SEEDS
def test_what_falls_on_other_groups_is_the_rest_of_the_predicted_power(seed: int) -> None:
    model_fit, term = sample(seed)
    trial = try_term(model_fit, term)
    power = np.zeros(len(GROUPS))
    for fold, recordings in enumerate(FOLDS):
        for r in recordings:
            for g in (1, 2):
                torque = term.columns[r][g] @ trial.coefficients[fold]
                power[g] += model_fit.weights[g] * torque @ torque
    assert trial.spread == pytest.approx(power.min(where=power > 0, initial=np.inf) / power.sum(), rel=1e-9)


def test_a_mean_coefficient_outside_its_bounds_is_seen() -> None:
    model_fit, term = sample(0)
    trial = try_term(model_fit, term)
    mean = trial.coefficients.mean(axis=0) / term.layout.scale
    for lower, upper, outside in ((-1.0, 1.0, False), (1e-3, 1.0, True), (-1.0, -1e-3, True)):
        shaped = replace(term.shaped, lower=mean + lower, upper=mean + upper)
        moved = replace(term, layout=replace(term.layout, shaped=shaped))
        assert replace(trial, term=moved).outside is outside


def test_what_a_candidate_drives_out_of_its_bounds_is_named() -> None:
    """Two nearly equal columns share one torque; the second takes it all, and the first becomes negative."""
    first = layout(("first", "a", "link"), {0: 0}, 1, bounds=(0.0, np.inf))
    second = layout(("second", "a", "link"), {0: 1}, 1)
    design = random_design(np.random.default_rng(8), [first, second])
    X = [list(found) for found in design.X]
    for found in X:
        found[0] = np.column_stack([found[0][:, 1] + 0.5 * found[0][:, 0], found[0][:, 1]]).astype(np.float32)
    design = replace(design, X=tuple(tuple(found) for found in X))
    for coefficients, displaced in (((-4.0, 8.0), True), ((4.0, 8.0), False)):
        caused = with_cause(with_cause(design, first, coefficients[:1]), second, coefficients[1:])
        model_fit = fitted(caused, term_of(caused, first))
        found = try_term(model_fit, term_of(caused, second)).in_sample.displaced
        assert (found is model_fit.model[0]) is displaced


def test_contrasts_are_judged_by_walds_test() -> None:
    rows = ((1.0, -1.0),)
    effect = SimpleNamespace(contrasts=rows)
    new = layout(
        ("new", "b", "link"), {1: 2, 2: 0}, 2, scale=[0.5, 3.0], candidate=SimpleNamespace(effect=effect)
    )
    model_fit, _ = sample(2)
    term = term_of(model_fit.design, new)
    found = try_term(model_fit, term).in_sample
    products = products_of(model_fit, term, model_fit.fitted)
    _, more, covariance = add_to_fit(products, model_fit.whole, term)
    left = more[0] / 0.5 - more[1] / 3.0
    L = np.array([1.0 / 0.5, -1.0 / 3.0])
    joined = ModelFit(model_fit.design, FOLDS, [*model_fit.model, term_of(model_fit.design, new)])
    after = joined.squares(np.concatenate([found.beside, found.own]), model_fit.fitted)
    weights = 1.0 / np.maximum(after[[1, 2]] / model_fit.counts[[1, 2]], 1.0)
    known = max(1.0, float(np.min(weights / model_fit.weights[[1, 2]])))
    assert known > 1.5
    assert found.contrast_chi_square == pytest.approx(known * left**2 / (L @ covariance @ L), rel=1e-6)
    assert try_term(*sample(2)).in_sample.contrast_chi_square == np.inf


# Screening: all candidates at once.


@SEEDS
def test_screening_gives_every_candidate_the_gain_of_a_fit_of_everything(seed: int) -> None:
    model_fit, _ = sample(seed)
    design = model_fit.design
    ranked = Screening(design, model_fit.fitted).rank(model_fit)
    assert {entry.layout.shaped.key[0] for entry in ranked} <= {"new", "steady"}
    assert ranked[0].layout.shaped.key[0] == "new"
    assert [entry.gain for entry in ranked] == sorted((entry.gain for entry in ranked), reverse=True)
    for entry in ranked:
        term = term_of(design, entry.layout)
        found, _ = least_squares(model_fit, [*model_fit.model, term], model_fit.fitted)
        joined = ModelFit(design, FOLDS, [*model_fit.model, term])

        def cost(fit: ModelFit, coefficients: np.ndarray, prior: np.ndarray) -> float:
            left = fit.squares(coefficients, model_fit.fitted)
            return 0.5 * float(model_fit.weights @ left + prior @ coefficients**2)

        prior = np.concatenate([np.ones(NUISANCE), KNOWN.precision])
        gained = cost(model_fit, model_fit.whole.coefficients, prior) - cost(
            joined, found, np.concatenate([prior, entry.layout.precision])
        )
        touched = list(entry.layout.groups)
        samples = float(model_fit.counts[touched].sum())
        assert entry.gain == pytest.approx(-0.5 * samples * np.log(1.0 - 2.0 * gained / samples), rel=1e-3)
        assert entry.power == pytest.approx(2.0 * gained / model_fit.weights[touched].min(), rel=1e-3)
        penalty = 0.5 * entry.layout.shaped.size * np.log(samples)
        assert entry.worth == pytest.approx(entry.gain - penalty, rel=1e-9)
        assert entry.physical


@pytest.mark.parametrize(
    ("bounds", "physical"), [((0.5, 1.5), True), ((1.5, 3.0), False), ((-3.0, 0.5), False)]
)
def test_screening_says_what_is_outside_its_bounds(bounds: tuple[float, float], physical: bool) -> None:
    own = layout(("own", "a", "link"), {0: 0}, 1, bounds=bounds, scale=[2.0])
    design = with_cause(random_design(np.random.default_rng(9), [own]), own, [2.0])
    (entry,) = Screening(design, (0, 1, 2, 3)).rank(fitted(design))
    assert entry.physical is physical


def test_screening_leaves_out_what_the_model_holds_and_what_equals_it() -> None:
    first = layout(("first", "a", "link"), {0: 0}, 1)
    same = layout(("same", "a", "link"), {0: 1}, 1)
    design = random_design(np.random.default_rng(10), [first, same])
    X = [list(found) for found in design.X]
    for found in X:
        found[0][:, 1] = 3.0 * found[0][:, 0]
    design = with_cause(replace(design, X=tuple(tuple(found) for found in X)), first, [2.0])
    assert len(Screening(design, (0, 1, 2, 3)).rank(fitted(design))) == 2
    assert Screening(design, (0, 1, 2, 3)).rank(fitted(design, term_of(design, first))) == []


# The held-out recordings have the last word.


def with_held_out(y: tuple, design: Any, *names: Any) -> Evidence:
    """Evidence of some candidates for rows, of which the last recording is held out."""
    other = replace(design, y=y, raw=y)
    make = SimpleNamespace(design=other, model_fit=lambda model: fitted(other, *model), simplest=list)
    make.reshaped = lambda model, removed: list(model)
    terms = [term_of(other, name) for name in names]
    return Evidence(make, (len(y) - 1,), (), make.model_fit(terms), None, None, None)


@pytest.mark.parametrize("weak", [True, False])
def test_a_cause_that_the_held_out_recording_does_not_have_goes(weak: bool) -> None:
    """The recording has it backwards: whether or not repeats measured the noise."""
    model_fit, new = sample(3)
    design = replace(
        model_fit.design, whitening=SimpleNamespace(**{**vars(model_fit.design.whitening), "weak": weak})
    )
    y = [list(found) for found in design.y]
    for g, block in new.columns[len(y) - 1].items():
        y[-1][g] = y[-1][g] - 2.0 * block @ np.array([1.0, -2.0])
    rows = tuple(tuple(found) for found in y)
    named = replace(NEW, shaped=replace(NEW.shaped, candidate=SimpleNamespace(name="new on b")))
    found, notes = without_unconfirmed(with_held_out(design.y, design, KNOWN, named))
    assert [term.key[0] for term in found.model_fit.model] == ["known", "new"] and notes == ()
    found, notes = without_unconfirmed(with_held_out(rows, design, KNOWN, named))
    assert [term.key[0] for term in found.model_fit.model] == ["known"]
    assert notes == ("not named: new on b: held-out recordings do not need it",)


def numberless(size: int) -> Any:
    """A candidate whose numbers are its coefficients."""
    effect = SimpleNamespace(shape=(), values=lambda coefficients, shape, site: {})
    return SimpleNamespace(effect=effect, site=lambda signals: None)


@pytest.mark.parametrize("held", [0.0, 4.0])
def test_errors_grow_with_what_is_left_and_how_it_is_correlated(held: float) -> None:
    """C = f (P + A)^{-1}, f = 1.45 (1 + rho) / (1 - rho)."""
    one = layout(("spring", "elbow", "link"), {0: 0, 1: 0}, 2, precision=[held, 0.0], candidate=numberless(2))
    design = with_cause(random_design(np.random.default_rng(9), [one]), one, [1.5, -2.0])
    term = term_of(design, one)
    model_fit = fitted(design, term)
    refiner = SimpleNamespace(prepared=[SimpleNamespace(signals=None)], slopes=lambda *rest: {})
    above = below = 0.0
    for r in model_fit.fitted:
        left = model_fit.residuals(model_fit.whole.coefficients, r)
        for g in (0, 1):
            above += model_fit.weights[g] * left[g][1:] @ left[g][:-1]
            below += model_fit.weights[g] * left[g] @ left[g]
    rho = max(above / below, 0.0)
    _, inverse = least_squares(model_fit, [term], model_fit.fitted)
    expected = 1.45 * (1.0 + rho) / (1.0 - rho) * inverse[NUISANCE:, NUISANCE:]
    np.testing.assert_allclose(_covariance(model_fit, refiner, 0, []), expected, rtol=1e-6, atol=1e-12)
