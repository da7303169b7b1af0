# SPDX-License-Identifier: BSD-3-Clause
"""What the search does around the selection: pushes masked and found again, and what the flexible model may use."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from impedance_modules.diagnosis.model_selection import cause_search, search_beside_pushes
from impedance_modules.diagnosis.regression.design_matrix import Design
from impedance_modules.effects.catalogue import CATALOGUE
from tests.support.selection_samples import fitted, random_design


def term(name: str) -> SimpleNamespace:
    return SimpleNamespace(name=name, candidate=name, shaped=SimpleNamespace(shape={}), layout=None)


def selector(name: str, left: dict[str, float], lost: tuple[str, ...] = ()) -> SimpleNamespace:
    """Fits a model to what is left by the names of its terms; some terms cannot be moved to its rows."""

    def model_fit(model) -> SimpleNamespace:
        names = "".join(sorted(one.name for one in model))
        whole = SimpleNamespace(coefficients=f"{names} on {name}")
        return SimpleNamespace(
            name=f"{names} on {name}",
            left=np.array([0.25, 0.75]) * left.get(names, 1.0),
            whole=whole,
            design=SimpleNamespace(groups=()),
        )

    refiner = SimpleNamespace(
        term=lambda candidate, shape, layout: None if candidate in lost else term(candidate)
    )
    clear = {}
    design = SimpleNamespace(groups=(), whitening=SimpleNamespace(clear=clear), without=lambda mask: mask)
    return SimpleNamespace(model_fit=model_fit, refiner=refiner, design=design)


@pytest.mark.parametrize(("again", "well"), [(100.0, True), (119.0, True), (121.0, False)])
def test_causes_of_masked_rows_must_explain_them_about_as_well(again: float, well: bool) -> None:
    masked = selector("masked", {"b": again, "a": 100.0, "ac": 50.0})
    assert search_beside_pushes.fits_as_well(masked, [term("b")], [term("a")]) is well
    # A first cause that cannot be moved to the masked rows is compared without.
    masked = selector("masked", {"b": again, "a": 100.0, "ac": 50.0}, lost=("c",))
    assert search_beside_pushes.fits_as_well(masked, [term("b")], [term("a"), term("c")]) is well


def test_pushes_are_found_again_by_a_model_that_was_fitted_without_them(monkeypatch) -> None:
    seen = []
    monkeypatch.setattr(
        search_beside_pushes, "_noticeable_pushes", lambda *given: seen.append(given) or ("again",)
    )
    masked = selector("masked", {})
    causes = [term("a"), term("b")]
    assert search_beside_pushes._refitted_pushes(selector("all", {}), masked, causes, ["items"]) == ("again",)
    ((model_fit, items, coefficients),) = seen
    assert (model_fit.name, items, coefficients) == ("ab on all", ["items"], "ab on masked")
    assert search_beside_pushes._refitted_pushes(selector("all", {}, lost=("b",)), masked, causes, []) == ()


def test_a_push_counts_if_it_turns_some_joint_by_more_than_is_negligible(monkeypatch) -> None:
    """Of a link's torque; what a drive or a velocity shows is no matter of a push."""
    pushes = tuple(SimpleNamespace(recording=r) for r in (0, 1, 1))
    torques = iter([np.array([0.5, 0.05]), np.array([0.5, 0.15]), np.array([1.5, 0.0])])
    groups = (("link", 0), ("link", 1), ("actuator", 0), ("velocity", 1))
    monkeypatch.setattr(search_beside_pushes, "find_pushes", lambda *given: pushes)
    monkeypatch.setattr(
        search_beside_pushes, "negligible", lambda prepared, groups: np.array([1.0, 0.1, 0.0, 0.0])
    )
    monkeypatch.setattr(search_beside_pushes, "torque_of", lambda push, item: next(torques))
    model_fit = SimpleNamespace(design=SimpleNamespace(groups=groups))
    assert search_beside_pushes._noticeable_pushes(model_fit, [None, None]) == pushes[1:]


def calm_coefficients(design: Design, seconds_a_row: float = 0.05):
    """Of the links alone, by the moments in which nothing touched the arm."""

    def without(masks) -> Design:
        y, Z = [list(found) for found in design.y], [list(found) for found in design.Z]
        for (r, g), mask in masks.items():
            y[r][g], Z[r][g] = y[r][g] * mask, Z[r][g] * mask[:, None]
        return replace(design, y=tuple(map(tuple, y)), Z=tuple(map(tuple, Z)))

    def on(own: Design) -> SimpleNamespace:
        return SimpleNamespace(model_fit=lambda causes: fitted(own))

    items = [
        SimpleNamespace(samples=len(found[0]), band=SimpleNamespace(rate=1.0 / seconds_a_row, step=1))
        for found in design.y
    ]
    whole = SimpleNamespace(groups=design.groups, whitening=design.whitening, without=without)
    return search_beside_pushes._calm_coefficients(
        SimpleNamespace(design=whole, on=on), fitted(design), items
    )


@pytest.mark.parametrize("push", [60.0, 300.0])
def test_a_push_does_not_pull_the_links_along(push: float) -> None:
    away, by_all = [], []
    for seed in range(20):
        clean = random_design(np.random.default_rng(seed), [])
        y = [list(found) for found in clean.y]
        during = (np.arange(len(y[0][0])) >= 25) & (np.arange(len(y[0][0])) < 55)
        for g in (0, 1):
            y[0][g] = y[0][g] + push * during * clean.Z[0][g][:, 0]
        pushed = replace(clean, y=tuple(map(tuple, y)))
        links = fitted(clean).whole.coefficients
        away.append(np.linalg.norm(calm_coefficients(pushed) - links))
        by_all.append(np.linalg.norm(fitted(pushed).whole.coefficients - links))
    assert np.mean(away) < 0.05 < 0.12 < np.mean(by_all)


@given(st.integers(0, 10_000), st.floats(0.0, 0.9))
def test_without_a_push_all_moments_count(seed: int, masked: float) -> None:
    """Rows that do not count are no calm moments beside which all others would be outlying."""
    design = random_design(np.random.default_rng(seed), [])
    y = [list(found) for found in design.y]
    for r, found in enumerate(y):
        for g, rows in enumerate(found):
            mask = np.arange(len(rows)) >= masked * len(rows)
            design.whitening.clear[r, g], y[r][g] = mask, rows * mask
    assert calm_coefficients(replace(design, y=tuple(map(tuple, y)))) is None


@pytest.fixture
def searched(monkeypatch):
    """Looks for pushes; the search on masked rows finds b, and the pushes again if it is told so."""

    def run(pushes: tuple, well: bool, refitted: tuple):
        monkeypatch.setattr(
            search_beside_pushes, "_noticeable_pushes", lambda model_fit, prepared, calm: pushes
        )
        monkeypatch.setattr(search_beside_pushes, "rows_of_link_residuals", lambda rows, groups: rows)
        monkeypatch.setattr(search_beside_pushes, "rows_without_pushes", lambda pushes, prepared: {})
        monkeypatch.setattr(search_beside_pushes, "intersect_masks", lambda one, other: {})
        monkeypatch.setattr(search_beside_pushes, "fits_as_well", lambda *given: well)
        monkeypatch.setattr(search_beside_pushes, "_refitted_pushes", lambda *given: refitted)
        first, masked = selector("all", {}), selector("masked", {})
        masked.run = lambda progress: SimpleNamespace(causes=(term("b"),))
        first.on = lambda design: masked
        said = []
        found = search_beside_pushes.without_pushes(
            first, SimpleNamespace(causes=(term("a"),)), [], said.append
        )
        return "masked" if found[0] is masked else "all", found[1].causes[0].name, found[2], bool(said)

    return run


def test_without_a_push_the_first_search_stands(searched) -> None:
    assert searched((), True, ("again",)) == ("all", "a", (), False)


def test_with_a_push_the_search_is_done_again_on_masked_rows(searched) -> None:
    assert searched(("push",), True, ("again",)) == ("masked", "b", ("again",), True)
    assert searched(("push",), True, ()) == ("masked", "b", ("push",), True)


def test_a_push_that_explains_less_than_the_first_causes_was_none(searched) -> None:
    assert searched(("push",), False, ("again",)) == ("all", "a", (), True)


def regressor(**more: object) -> SimpleNamespace:
    effect = SimpleNamespace(
        proportional_to_command=lambda port: port == "timing",
    )
    given = {
        "shape": {},
        "width": 1,
        "blocks": ({0: None},),
        "candidate": SimpleNamespace(effect=effect, port="link"),
    }
    return SimpleNamespace(**{**given, **more})


def test_the_flexible_model_uses_simple_candidates_of_one_joint() -> None:
    simple = [regressor(), regressor(width=3), regressor(candidate=None)]
    command = SimpleNamespace(effect=regressor().candidate.effect, port="timing")
    others = [
        regressor(width=4),
        regressor(shape={"vs": 0.1}),
        regressor(blocks=({0: None, 1: None},)),
        regressor(candidate=command),
    ]
    offered = [*others[:2], *simple, *others[2:]]
    assert cause_search._simple_candidates(offered) == simple


@pytest.mark.parametrize(
    ("parameters", "replaces", "value", "sure", "kept"),
    [(1, False, 1.20, False, True), (1, False, 1.19, True, False), (1, False, 0.80, False, True),
     (1, False, 0.81, True, False), (2, False, 1.0, True, True), (2, False, 5.0, False, False),
     (1, True, 1.0, False, False), (1, True, 1.0, True, True)],
)  # fmt: skip
def test_a_single_number_must_differ_from_no_effect(
    monkeypatch, parameters, replaces, value, sure, kept
) -> None:
    """By 1.96 standard deviations, of 0.1 here; no effect is 1. Several numbers are judged together, and so is one that
    replaces the model's own, which is no fixed value."""
    described = SimpleNamespace(parameters=[SimpleNamespace(neutral=1.0)] * parameters)
    one = SimpleNamespace(
        candidate=SimpleNamespace(effect=SimpleNamespace(description=described, replaces=replaces))
    )
    found = {"s": SimpleNamespace(value=value, std=0.1)}
    monkeypatch.setattr(cause_search, "estimates", lambda fit, refiner, index, *, prismatic: found)
    monkeypatch.setattr(cause_search, "beyond_chance", lambda fit, refiner, index: sure)
    assert cause_search.significant_terms(SimpleNamespace(model=[one]), None) == ([one] if kept else [])


@pytest.mark.parametrize("name", ["joint_elasticity", "reflected_inertia", "surface_stiffness"])
@pytest.mark.parametrize("certain", [True, False])
def test_a_number_that_replaces_another_must_differ_from_it(
    monkeypatch: pytest.MonkeyPatch, name: str, certain: bool
) -> None:
    """K of 12 +- 33 N.m/rad is no elasticity: its compliance may as well be that of the robot file."""
    monkeypatch.setattr(cause_search, "beyond_chance", lambda model_fit, refiner, index: certain)
    one = SimpleNamespace(candidate=SimpleNamespace(effect=CATALOGUE[name]))
    model_fit = SimpleNamespace(model=[one])
    assert cause_search.significant_terms(model_fit, None) == ([one] if certain else [])


@pytest.mark.parametrize(("mass", "gain", "left"), [(3.0, 5.0, "gain"), (5.0, 3.0, "mass")])
def test_of_two_uncertain_causes_the_one_that_gains_less_goes_first(
    monkeypatch: pytest.MonkeyPatch, mass: float, gain: float, left: str
) -> None:
    """They explain the same: beside each other both are uncertain, and one alone is certain."""
    terms = [SimpleNamespace(name="mass", gain=mass), SimpleNamespace(name="gain", gain=gain)]
    selector = SimpleNamespace(
        model_fit=lambda model: SimpleNamespace(model=list(model)),
        design=SimpleNamespace(groups=()),
        refiner=None,
        reshaped=lambda model, removed: list(model),
    )
    monkeypatch.setattr(cause_search, "try_term", lambda rest, term: term)
    monkeypatch.setattr(cause_search, "negligible", lambda prepared, groups: None)
    monkeypatch.setattr(cause_search, "above_negligible", lambda model_fit, plain, least: model_fit.model)
    monkeypatch.setattr(
        cause_search,
        "significant_terms",
        lambda model_fit, refiner: model_fit.model if len(model_fit.model) == 1 else [],
    )
    found = cause_search.tested(selector, terms, None, ())
    assert [term.name for term in found.model] == [left]


@pytest.mark.parametrize(
    ("again", "kept"),
    [
        ((("coulomb_friction", 0),), True),
        ((("load_dependent_friction", 0), ("actuator_lag", 0)), True),
        ((("actuator_lag", 0),), False),
        ((("coulomb_friction", 1),), False),
        ((), False),
    ],
)
def test_reversals_are_left_out_only_where_friction_is_dry_without_them(
    monkeypatch: pytest.MonkeyPatch, again: tuple[tuple[str, int], ...], kept: bool
) -> None:
    def named(effect: str, group: int) -> SimpleNamespace:
        return SimpleNamespace(candidate=SimpleNamespace(effect=CATALOGUE[effect]), groups=(group,))

    first = SimpleNamespace(causes=[named("coulomb_friction", 0)])
    second = SimpleNamespace(causes=[named(*one) for one in again])
    monkeypatch.setattr(cause_search, "rows_without_reversals", lambda *rest: {(0, 0): np.array([True])})
    monkeypatch.setattr(cause_search, "reversal_note", lambda *rest: ("said",))
    masked = SimpleNamespace(run=lambda progress: second)
    design = SimpleNamespace(whitening=SimpleNamespace(clear={}), groups=(), without=lambda mask: mask)
    selector = SimpleNamespace(model_fit=None, design=design, on=lambda design: masked)
    found = cause_search._without_reversals(selector, first, (), lambda words: None)
    assert found == ((masked, second, ("said",)) if kept else (selector, first, ()))
