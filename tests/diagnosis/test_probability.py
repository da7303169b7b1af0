# SPDX-License-Identifier: BSD-3-Clause
"""How likely a cause is true: the law's shape, and what it is computed from."""

from dataclasses import replace

import numpy as np
import pytest

from impedance_modules.diagnosis.diagnose import insufficient
from impedance_modules.diagnosis.model_selection.probability import (
    FEATURES,
    LAW,
    UNLIKELY,
    ProbabilityLaw,
    deviations,
    unlikely_beside_others,
    with_probabilities,
)
from impedance_modules.diagnosis.report.diagnosis_files import diagnosis_object
from impedance_modules.diagnosis.result import Cause, Diagnosis, Estimate, Grounds, Remainder, Rival, Standing
from impedance_modules.diagnosis.rollout_result import CauseRollout

FOR = {"gain": (0.0, 1e5), "lead": (0.0, 1e4), "weight": (0.0, 1.0), "deviations": (0.0, 1e3)}
AGAINST = {"lack_of_fit": (0.0, 100.0)}


def random_grounds(rng: np.random.Generator) -> Grounds:
    numbers = {
        name: float(low + (high - low) * rng.random() ** 3) for name, (low, high) in (FOR | AGAINST).items()
    }
    return Grounds(
        **numbers,
        explained=bool(rng.integers(2)),
        motion=int(rng.integers(-1, 2)),
        repeats=bool(rng.integers(2)),
        alternatives=int(rng.integers(4)),
        others=int(rng.integers(6)),
    )  # fmt: skip


def random_law(rng: np.random.Generator) -> ProbabilityLaw:
    betas = {name: sign * float(rng.exponential(1.0)) for name, sign in FEATURES.items()}
    return ProbabilityLaw(float(rng.normal(0.0, 3.0)), betas, float(rng.uniform(0.05, 1.0)))


def laws() -> list[tuple[ProbabilityLaw, Grounds, np.random.Generator]]:
    rng = np.random.default_rng(14)
    return [(LAW if i % 2 else random_law(rng), random_grounds(rng), rng) for i in range(200)]


def test_what_speaks_for_a_cause_never_lowers_its_probability() -> None:
    for law, grounds, rng in laws():
        before = law(grounds)
        for name, (_, high) in FOR.items():
            more = getattr(grounds, name) + float(rng.random()) * (high - getattr(grounds, name))
            assert law(replace(grounds, **{name: more})) >= before - 1e-15, name
        for name, (_, high) in AGAINST.items():
            more = getattr(grounds, name) + float(rng.random()) * (high - getattr(grounds, name))
            assert law(replace(grounds, **{name: more})) <= before + 1e-15, name
        assert law(replace(grounds, explained=True)) >= law(replace(grounds, explained=False))
        assert law(replace(grounds, repeats=True)) >= law(replace(grounds, repeats=False))
        assert law(replace(grounds, others=grounds.others + 1)) <= before


def test_a_longer_lead_raises_the_probability() -> None:
    """With a law that uses it: strictly, and without it a cause is as likely as its base says."""
    law = ProbabilityLaw(-1.0, {"lead": 0.7}, 1.0)
    plain = Grounds(0.0, 0.0, 1.0, 1.0, 0.5, True, 0, True, 0, 0)
    said = [law(replace(plain, lead=lead)) for lead in (0.0, 9.0, 99.0, 999.0)]
    odds = np.log(said) - np.log1p(-np.array(said))
    assert odds == pytest.approx([-1.0, -0.3, 0.4, 1.1])


def test_no_cause_is_certain_or_impossible() -> None:
    for law, grounds, _ in laws():
        assert 0.0 < law(grounds) < 1.0
    sure = ProbabilityLaw(1e6, {}, 0.5)
    assert replace(sure, base=-1e6)(random_grounds(np.random.default_rng(1))) > 0.0
    assert sure(replace(random_grounds(np.random.default_rng(1)), alternatives=0)) < 1.0


def test_equivalents_share_the_probability() -> None:
    """However much speaks for a cause: with k equivalents it is at most 1 / (1 + s k) likely."""
    for law, grounds, _ in laws():
        alone = law(replace(grounds, alternatives=0))
        for k in (1, 2, 5):
            shared = law(replace(grounds, alternatives=k))
            assert shared <= 1.0 / (1.0 + law.alternative * k)
            assert shared == pytest.approx(alone / (1.0 + law.alternative * k))


def test_a_cause_that_the_rollout_rejects_is_not_above_one_that_it_confirms() -> None:
    for law, grounds, _ in laws():
        worse, same, better = (law(replace(grounds, motion=motion)) for motion in (-1, 0, 1))
        assert worse <= same <= better


def test_the_shipped_law_keeps_the_signs_and_shares_with_equivalents() -> None:
    assert LAW.coefficients, "run: python -m benchmarks.wide calibrate OUT --write"
    assert set(LAW.coefficients) <= set(FEATURES)
    assert all(beta * FEATURES[name] > 0.0 for name, beta in LAW.coefficients.items())
    assert 0.0 < LAW.alternative <= 1.0


def a_cause(effect: str = "viscous_friction", *equivalent: Rival, **numbers: Estimate) -> Cause:
    span = {"elbow": (-1.0, 1.0)}
    return Cause(effect, ("elbow",), "link", {"elbow": numbers}, 0.6, 0.9, equivalent, (), span, span)


@pytest.mark.parametrize(
    ("weight", "gain", "named"),
    [(0.001, 4.0, False), (0.001, 5000.0, True), (0.2, 4.0, True)],
)
def test_beside_others_a_cause_of_little_weight_must_be_likely(
    weight: float, gain: float, named: bool
) -> None:
    """One that carries a part of the gap is named however doubtful it is: the page says so."""
    large = replace(a_cause("base_tilt", rx=number(0.3, 0.001)), standing=Standing(9000.0, 0.0), weight=0.7)
    other = replace(a_cause(fv=number(1.0, 0.3)), standing=Standing(gain, 0.0), weight=weight)
    remainder = Remainder(1.5, True, "", 2.0)
    found = replace(insufficient("arm", ["run"], ""), causes=(large, other), remainder=remainder)
    refused = unlikely_beside_others(found, repeats=True)
    assert [cause.effect for cause in refused] == ([] if named else [other.effect])
    assert all((cause.probability or 0.0) < UNLIKELY for cause in refused)
    left = replace(found, remainder=replace(remainder, explained=False))
    assert unlikely_beside_others(left, repeats=True) == ()  # all are doubtful there
    alone = replace(found, causes=(other,))
    assert unlikely_beside_others(alone, repeats=True) == ()


def number(value: float, std: float) -> Estimate:
    return Estimate(value, std, "1")


@pytest.mark.parametrize(
    ("cause", "expected"),
    [
        (a_cause(fv=number(1.0, 0.1)), 10.0),
        (a_cause("torque_gain", s=number(1.2, 0.1)), 2.0),
        (a_cause("base_tilt", rx=number(0.1, 0.1), ry=number(0.3, 0.1)), 3.0),
        (replace(a_cause(), parameters={"a": {"fv": number(9.0, 1.0)}, "b": {"fv": number(4.0, 1.0)}}), 4.0),
        (a_cause(fv=number(1.0, 0.0)), 1000.0),
        (a_cause(fv=number(1.0, float("inf"))), 0.0),
        (a_cause(fv=number(0.0, 0.0)), 0.0),
        # A push is felt along no axis alone: by its gain, half of a chi-square.
        (
            replace(
                a_cause("external_contact", fx=number(6.0, 400.0), start=number(5.0, 0.01)),
                standing=Standing(4.5, 0.0),
            ),
            3.0,
        ),
        (a_cause(), 0.0),
    ],
)
def test_deviations_are_those_of_the_least_certain_carrier_from_no_effect(cause, expected) -> None:
    assert deviations(cause) == pytest.approx(expected)


def found(*causes: Cause, small: tuple[Cause, ...] = (), limit: float | None = 2.0) -> Diagnosis:
    nothing = insufficient("pendulum", ["run-1"], "")
    verdict = "explained" if causes else "no_gap"
    return replace(
        nothing, verdict=verdict, causes=causes, small=small, remainder=Remainder(3.0, True, "", limit)
    )


def test_every_cause_gets_its_probability_and_the_grounds_that_it_follows_from() -> None:
    shown = CauseRollout(4.0, 1.0, 4.0, 0.1, "helps")
    named = replace(
        a_cause("viscous_friction", Rival("coulomb_friction", ("elbow",), ""), fv=number(1.0, 0.1)),
        standing=Standing(50.0, -3.0),
        rollout=shown,
    )
    other = replace(a_cause("torque_offset", c=number(1.0, 0.5)), standing=Standing(20.0, 8.0))
    judged = with_probabilities(found(named, other, small=(other,)), repeats=False)
    expected = Grounds(50.0, 0.0, 0.6, pytest.approx(10.0), 1.5, True, 1, False, 1, 1)
    assert judged.causes[0].grounds == expected
    assert judged.small[0].grounds == replace(judged.causes[1].grounds, others=0)
    for cause in (*judged.causes, *judged.small):
        assert cause.probability == LAW(cause.grounds)
    entries = diagnosis_object(judged)
    for entry in (*entries["causes"], *entries["small"]):
        assert entry["probability"] == LAW(Grounds(**entry["grounds"]))


def test_a_cause_beside_a_remainder_that_nobody_judged_is_refused() -> None:
    with pytest.raises(ValueError, match="nobody judged"):
        with_probabilities(found(a_cause(), limit=None), repeats=True)
    assert with_probabilities(found(limit=None), repeats=True).causes == ()
