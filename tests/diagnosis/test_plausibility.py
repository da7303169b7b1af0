# SPDX-License-Identifier: BSD-3-Clause
"""A trial's own numbers can reject it, one reason at a time; and what each cause explains beyond the others."""

from types import SimpleNamespace

import numpy as np
import pytest

from impedance_modules.diagnosis.model_selection import plausibility
from impedance_modules.diagnosis.model_selection.naming import ranked_terms
from impedance_modules.diagnosis.model_selection.plausibility import Plausibility
from impedance_modules.effects.catalogue import CATALOGUE

BODY = np.array([2.0, 0.0, 0.0, 0.0, 0.02, 0.0, 0.02, 0.0, 0.0, 0.02])
"""Mass, mass times centre, moments about the origin as the package orders them, of a small ball."""


def effect(**more: object) -> SimpleNamespace:
    given = {
        "computed_from_command": lambda port: False,
        "unresolved": lambda shape, resolution: None,
        "values": lambda change, shape, site: {},
        "relations": lambda values: (),
        "contradicted": lambda values, sites: None,
    }
    return SimpleNamespace(**{**given, **more})


def trial(key: str = "elbow", change: np.ndarray | None = None, **more: object) -> SimpleNamespace:
    own = np.ones(1) if change is None else np.array(change, dtype=float)
    candidate = SimpleNamespace(
        effect=more.pop("effect", effect()),
        key=key,
        port="link",
        site=lambda signals: SimpleNamespace(signals=signals, port="link"),
    )
    term = SimpleNamespace(
        key=("new", key, "link"), candidate=candidate, groups=(0,), columns=({},), fixed=({},),
        layout=SimpleNamespace(scale=np.full(len(own), 2.0)), shaped=SimpleNamespace(shape={}, size=len(own)),
    )  # fmt: skip
    given = {
        "term": term, "coefficients": np.array([own, own]) * 2.0, "outside": False,
        "model_fit": SimpleNamespace(
            model=(), starts=(), fitted=(),
            design=SimpleNamespace(groups=(("link", 0),), nuisance=SimpleNamespace(size=0)),
            whole=SimpleNamespace(inverse=np.zeros((0, 0)), coefficients=np.zeros(0)),
        ),
        "in_sample": SimpleNamespace(contrast_chi_square=np.inf, own=own, beside=np.zeros(3), spread=own),
    }  # fmt: skip
    return SimpleNamespace(**{**given, **more})


def rules(**bodies: np.ndarray) -> Plausibility:
    return Plausibility(signals=(None,), bodies=bodies, pairs=(), resolution=0.0, slow=0.25)


def test_what_has_nothing_against_it_is_plausible() -> None:
    assert rules().implausible(trial()) is None
    assert rules(fore=BODY).unphysical(trial("fore", 0.1 * BODY)) is None


@pytest.mark.parametrize(("chi_square", "rejected"), [(11.9, True), (12.1, False)])
def test_what_makes_it_this_effect_must_be_there(chi_square: float, rejected: bool) -> None:
    one = trial()
    one.in_sample.contrast_chi_square = chi_square
    assert ("simpler one" in str(rules().implausible(one))) is rejected


def test_no_body_has_negative_mass() -> None:
    assert "no body" in str(rules(fore=BODY).unphysical(trial("fore", -1.5 * BODY)))
    # A body that is not this one, or a number that is no inertia, is not judged so.
    assert rules(upper=BODY).unphysical(trial("fore", -1.5 * BODY)) is None
    assert rules(fore=BODY).unphysical(trial("fore", [-9.0])) is None


@pytest.mark.parametrize(
    ("numbers", "reason"),
    [
        ({"outside": True}, "end of what is physical"),
        ({"effect": effect(unresolved=lambda shape, resolution: "too fine")}, "too fine"),
        ({"effect": effect(relations=lambda values: ("against each other", "second"))}, "against each other"),
    ],
)  # fmt: skip
def test_each_reason_rejects_by_itself(numbers: dict, reason: str) -> None:
    assert reason in str(rules().unphysical(trial(**numbers)))


def law(name: str, joint: str = "elbow", port: str = "link") -> SimpleNamespace:
    candidate = SimpleNamespace(effect=CATALOGUE[name])
    return SimpleNamespace(key=(name, joint, port), candidate=candidate)


def test_a_law_of_friction_that_contains_another_one_excludes_it() -> None:
    contains = plausibility._contains_law
    assert contains(law("stribeck_friction"), law("coulomb_friction"))
    assert not contains(law("coulomb_friction"), law("stribeck_friction"))
    assert not contains(law("stribeck_friction"), law("coulomb_friction", "wrist"))
    assert not contains(law("stribeck_friction"), law("coulomb_friction", "elbow", "actuator"))
    assert not contains(law("stribeck_friction"), law("viscous_friction"))
    assert not contains(law("coulomb_friction"), law("coulomb_friction"))


def ranked(names: str, left: dict[str, float]) -> list[tuple[str, float]]:
    """What `ranked_terms` gives where each set of terms leaves the given power."""
    evidence = SimpleNamespace(
        model_fit=SimpleNamespace(model=[SimpleNamespace(name=name) for name in names]),
        selector=SimpleNamespace(model_fit=lambda model: "".join(sorted(term.name for term in model))),
    )
    return [(term.name, gain) for term, gain in ranked_terms(evidence, left.__getitem__)]


def test_a_cause_is_credited_with_what_it_explains_beyond_the_stronger_ones() -> None:
    """Three terms that explain 6, 3 and 2 of 10 alone; all that the third explains is in the others."""
    left = {"": 10.0, "a": 8.0, "b": 4.0, "c": 7.0, "ab": 4.0, "ac": 6.5, "bc": 2.5, "abc": 2.5}
    assert ranked("abc", left) == [("b", 6.0), ("c", pytest.approx(1.5)), ("a", 1e-12)]


def test_causes_that_act_against_each_other_are_both_credited() -> None:
    """A lean of the base and a spring against it: either alone makes a gap of 10 larger, both close it."""
    left = {"": 10.0, "a": 25.0, "b": 16.0, "ab": 1.0}
    assert ranked("ab", left) == [("b", 24.0), ("a", 15.0)]


@pytest.mark.parametrize(
    ("before", "deviation", "rejected"),
    [(0.0, 3.4, False), (0.0, 3.6, True), (0.0, -3.6, True), (-9.0, 9.4, False), (9.0, -9.6, True)],
)
def test_a_gain_that_needs_links_further_off_than_stated_is_none(
    before: float, deviation: float, rejected: bool
) -> None:
    """One nuisance, known to half a deviation of its prior, of which three are allowed, or as many as before."""
    one = trial()
    one.in_sample.beside = np.array([deviation])
    one.model_fit.design.nuisance = SimpleNamespace(size=1)
    one.model_fit.whole = SimpleNamespace(inverse=np.array([[0.25]]), coefficients=np.array([before]))
    assert ("links" in str(rules().unphysical(one))) is rejected
