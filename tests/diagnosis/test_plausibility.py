# SPDX-License-Identifier: BSD-3-Clause
"""A trial's own numbers can reject it, one reason at a time; and what each cause explains beyond the others."""

from types import SimpleNamespace

import numpy as np
import pytest

from impedance_modules.diagnosis.model_selection import plausibility
from impedance_modules.diagnosis.model_selection.naming import ranked_terms
from impedance_modules.diagnosis.model_selection.plausibility import Plausibility
from impedance_modules.effects.catalogue import CATALOGUE
from impedance_modules.effects.recorded_signals import DriveErrors

BODY = np.array([2.0, 0.0, 0.0, 0.0, 0.02, 0.0, 0.02, 0.0, 0.0, 0.02])
"""Mass, mass times centre, moments about the origin as the package orders them, of a small ball."""


def effect(**more: object) -> SimpleNamespace:
    given = {
        "computed_from_command": lambda port: False,
        "imitates_noise": lambda port, signals: False,
        "constant_part": None,
        "unresolved": lambda shape, resolution: None,
        "out_of_reach": lambda change, spread, reach: None,
        "values": lambda change, shape, site: {},
        "relations": lambda values: (),
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
        "term": term, "coefficients": np.array([own, own]) * 2.0, "outside": False, "discord": 0.0,
        "model_fit": SimpleNamespace(model=(), starts=(), design=SimpleNamespace(groups=(("link", 0),))),
        "in_sample": SimpleNamespace(contrast_chi_square=np.inf, own=own, beside=np.zeros(3), spread=own),
    }  # fmt: skip
    return SimpleNamespace(**{**given, **more})


def rules(**bodies: np.ndarray) -> Plausibility:
    return Plausibility(signals=None, bodies=bodies, reach=1.0, pairs=(), resolution=0.0)


def test_what_has_nothing_against_it_is_plausible() -> None:
    assert rules().implausible(trial()) is None
    assert rules(fore=BODY).unphysical(trial("fore", 0.1 * BODY)) is None


@pytest.mark.parametrize(("chi_square", "rejected"), [(11.9, True), (12.1, False)])
def test_what_makes_it_this_effect_must_be_there(chi_square: float, rejected: bool) -> None:
    one = trial(in_sample=SimpleNamespace(contrast_chi_square=chi_square, own=np.ones(1), spread=np.ones(1)))
    assert ("simpler one" in str(rules().implausible(one))) is rejected


def test_what_imitates_noise_is_named_of_repeated_motions_only() -> None:
    noisy = effect(imitates_noise=lambda port, signals: True, computed_from_command=lambda port: True)
    assert "positions' noise" in str(rules().implausible(trial(effect=noisy)))
    repeated = Plausibility(signals=None, bodies={}, reach=1.0, pairs=((0, 1),), resolution=0.0)
    assert repeated.implausible(trial(effect=noisy)) is None


def test_no_body_has_negative_mass() -> None:
    assert "no body" in str(rules(fore=BODY).unphysical(trial("fore", -1.5 * BODY)))
    # A body that is not this one, or a number that is no inertia, is not judged so.
    assert rules(upper=BODY).unphysical(trial("fore", -1.5 * BODY)) is None
    assert rules(fore=BODY).unphysical(trial("fore", [-9.0])) is None


@pytest.mark.parametrize(
    ("numbers", "reason"),
    [
        ({"outside": True}, "end of what is physical"),
        ({"key": "log", "discord": 0.31}, "end of what is physical"),
        ({"key": "log", "discord": 0.29}, None),
        ({"effect": effect(unresolved=lambda shape, resolution: "too fine")}, "too fine"),
        ({"effect": effect(out_of_reach=lambda c, spread, reach: f"{c[0]} {spread[0]} {reach}")}, "1.0 0.5 1.0"),
        ({"effect": effect(relations=lambda values: ("against each other", "second"))}, "against each other"),
    ],
)  # fmt: skip
def test_each_reason_rejects_by_itself(numbers: dict, reason: str | None) -> None:
    said = rules().unphysical(trial(**numbers))
    assert said is None if reason is None else reason in str(said)


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


@pytest.mark.parametrize(
    ("own", "other", "cancel"),
    [(1.0, -1.0, True), (1.0, -0.51, True), (1.0, -0.49, False), (-0.51, 1.0, True), (1.0, 1.0, False)],
)
def test_constant_parts_that_take_each_other_back_are_none(own: float, other: float, cancel: bool) -> None:
    def with_constant(name: str, value: float, groups: tuple[int, ...] = (0,)) -> SimpleNamespace:
        found = effect(constant_part="c", values=lambda change, shape, site: {"c": float(change[0])})
        candidate = SimpleNamespace(effect=found, key="elbow", port="link", site=lambda signals: None)
        layout, shaped = SimpleNamespace(scale=np.array([2.0])), SimpleNamespace(shape={}, size=1)
        return SimpleNamespace(
            key=(name, "elbow", "link"), candidate=candidate, groups=groups, layout=layout, shaped=shaped
        )

    def judged(there: SimpleNamespace) -> bool:
        fit = SimpleNamespace(
            model=(there,), starts=(1,), design=SimpleNamespace(groups=(("link", 0), ("link", 1)))
        )
        sample = SimpleNamespace(own=np.array([2.0 * own]), beside=np.array([9.0, 2.0 * other]))
        one = SimpleNamespace(term=with_constant("offset", own), model_fit=fit, in_sample=sample)
        return plausibility._constant_parts_cancel(one, None)

    assert judged(with_constant("asymmetry", other)) is cancel
    assert not judged(with_constant("asymmetry", other, (1,)))
    assert not judged(with_constant("offset", other))


def test_a_cause_is_credited_with_what_it_explains_beyond_the_stronger_ones() -> None:
    """Three terms that explain 6, 3 and 2 of 10 alone; the second is half contained in the first."""
    terms = [SimpleNamespace(name=name) for name in "abc"]
    left = {"": 10.0, "a": 8.0, "b": 4.0, "c": 7.0, "bc": 2.5, "abc": 2.5}
    evidence = SimpleNamespace(
        model_fit=SimpleNamespace(model=terms),
        selector=SimpleNamespace(model_fit=lambda model: "".join(sorted(term.name for term in model))),
        excess=lambda names: left[names],
    )
    found = ranked_terms(evidence)
    assert [term.name for term, _ in found] == ["b", "c", "a"]
    assert [gain for _, gain in found] == pytest.approx([6.0, 1.5, 1e-12])


def noisy(seed: int, effect: str) -> tuple[SimpleNamespace, tuple[SimpleNamespace, ...]]:
    """A trial of a drive's effect fitted to a clean joint whose accelerations are noise, as is their curvature."""
    random = np.random.default_rng(seed)
    acceleration = np.convolve(random.standard_normal(2004), np.ones(5) / 5.0, mode="valid")
    curvature = 100.0 * np.gradient(np.gradient(acceleration))
    column = 0.5 * curvature if effect == "joint_elasticity" else acceleration
    items = (
        SimpleNamespace(
            signals=SimpleNamespace(reflected_inertia=np.array([0.5])), noise=(acceleration, curvature)
        ),
    )
    whitening = SimpleNamespace(apply=lambda values, r, g: values)
    design = SimpleNamespace(groups=(("actuator", 0),), whitening=whitening)
    model_fit = SimpleNamespace(model=(), starts=(), design=design, fitted=(0,))
    one = trial(effect=CATALOGUE[effect], model_fit=model_fit)
    one.term.layout.scale = np.ones(1)
    one.term.columns = ({0: column[:, None]},)
    own = float(column @ (-0.5 * acceleration) / (column @ column))
    one.in_sample.own, one.in_sample.spread = np.array([own]), np.array([0.02 * abs(own)])
    return one, items


@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize(("effect", "sign"), [("joint_elasticity", 1.0), ("reflected_inertia", -1.0)])
def test_what_noise_alone_makes_is_rejected(
    monkeypatch: pytest.MonkeyPatch, seed: int, effect: str, sign: float
) -> None:
    """Clean data give a stiffness that is positive, a rotor that is too light, both certain: errors in variables."""

    def errors(item: SimpleNamespace, _: int) -> SimpleNamespace:
        acceleration, curvature = item.noise
        drive = DriveErrors(acceleration[:, None], curvature[:, None])
        return SimpleNamespace(drive=drive, of=lambda group: -0.5 * acceleration)

    monkeypatch.setattr(plausibility, "made_by_positions", errors)
    clean, items = noisy(seed, effect)
    signals = SimpleNamespace(measures_springs=True, spring_compliance=np.zeros(1))
    known = Plausibility(signals=signals, bodies={}, reach=1.0, pairs=(), resolution=0.0, prepared=items)
    assert sign * clean.in_sample.own[0] > 0.0
    assert "noise alone" in str(known.implausible(clean))
    assert plausibility.made_by_noise(clean, items) == pytest.approx(clean.in_sample.own[0], rel=1e-9)
    soft = 3.0 * clean.in_sample.own
    clean.in_sample.own = soft
    monkeypatch.setattr(Plausibility, "unphysical", lambda self, one: None)
    assert known.implausible(clean) is None
