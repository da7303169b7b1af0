# SPDX-License-Identifier: BSD-3-Clause
"""What a candidate must show, one criterion at a time, and which of several that do as well is named."""

from collections.abc import Callable
from types import SimpleNamespace

import numpy as np
import pytest

from impedance_modules.diagnosis.model_selection import acceptance as criteria
from impedance_modules.diagnosis.model_selection import rivals as rivalry
from impedance_modules.diagnosis.model_selection.acceptance import (
    best_of_each,
    bic_penalty,
    both_delay_torque,
    by_merit,
    further_gain,
    promising,
    rejection_reason,
)
from impedance_modules.diagnosis.model_selection.candidate_trial import CandidateTrial
from impedance_modules.effects.catalogue import CATALOGUE


def trial(
    effect: str = "viscous_friction",
    key: str = "elbow",
    port: str = "actuator",
    *,
    groups: tuple[int, ...] = (0,),
    free: int = 1,
    shapes: int = 1,
    reach: float = 1000.0,
    **numbers: object,
) -> SimpleNamespace:
    """A trial that passes all criteria, but for the numbers that are given."""
    known = CATALOGUE.get(effect)
    candidate = None
    if known is not None:
        candidate = SimpleNamespace(effect=known, key=key, port=port, joints=(key,), name=effect)
    name = (effect, key, port)
    term = SimpleNamespace(
        key=name,
        groups=groups,
        generic=candidate is None,
        candidate=candidate,
        layout=SimpleNamespace(free=free),
        shaped=SimpleNamespace(key=name),
    )
    model_fit = SimpleNamespace(counts=np.full(3, 1000.0), design=SimpleNamespace(shapes={name: shapes}))
    good = {
        "gain": 300.0, "folds": np.array([150.0, 150.0]), "reduction": 0.5, "outside": False, "spread": 0.0,
        "narrow": 0.5, "gain_elsewhere": 0.0,
        "in_sample": SimpleNamespace(displaced=None, contrast_chi_square=np.inf, own=np.ones(1)),
        "reach_on": lambda chosen: reach,
    }  # fmt: skip
    known_numbers = {**good, **numbers}
    gains = np.array([known_numbers["gain"], 0.0])
    return SimpleNamespace(term=term, model_fit=model_fit, reach=reach, unseen_gains=gains, **known_numbers)


def test_what_a_candidate_does_to_a_recording_is_counted_where_it_acts() -> None:
    """Two motions apart, links that are fitted to one say little of the other, on any joint."""
    unseen = {0: [np.full(4, 1.0), np.full(4, 9.0)], 1: [np.full(4, 2.0), np.full(4, 9.0)]}
    model_fit = SimpleNamespace(
        folds=((0,), (1,)),
        unseen_squares=np.array([[40.0, 10.0], [20.0, 10.0]]),
        predicted_by_fold=lambda left: np.array([[float(x @ x) for x in left[r]] for r in (0, 1)]),
        weights=np.array([1.0, 0.5]),
    )
    term = SimpleNamespace(groups=(0,))
    found = CandidateTrial(model_fit, term, np.zeros((2, 1)), unseen, SimpleNamespace())
    assert found.folds == pytest.approx([0.5 * (40.0 - 4.0), 0.5 * (20.0 - 16.0)])


PENALTY = 0.5 * np.log(1000.0)


def test_the_penalty_counts_coefficients_and_shapes() -> None:
    assert bic_penalty(trial()) == pytest.approx(PENALTY)
    assert bic_penalty(trial(free=3, shapes=5)) == pytest.approx(3.0 * PENALTY + np.log(5.0))
    few = trial(groups=(0, 2))
    few.model_fit.counts = np.array([10.0, 1e9, 400.0])
    assert bic_penalty(few) == pytest.approx(0.5 * np.log(400.0))
    few.model_fit.counts = np.ones(3)
    assert bic_penalty(few) == pytest.approx(0.5 * np.log(2.0))


def test_what_passes_everything_passes() -> None:
    assert rejection_reason(trial(), []) is None


CRITERIA = {
    "gains too little": ({"gain": PENALTY + 7.49}, {"gain": PENALTY + 7.51}),
    "removes only": ({"reduction": 0.049}, {"reduction": 0.051}),
    "harms on others": ({"folds": np.array([100.0, -15.1])}, {"folds": np.array([100.0, -14.9])}),
    "end of what is physical": ({"outside": True}, {}),
    "another cause would leave": ({"in_sample": SimpleNamespace(displaced=object())}, {}),
    "helps on one alone": (
        {"spread": 0.31, "narrow": 0.951, "gain_elsewhere": 7.49},
        {"spread": 0.31, "narrow": 0.951, "gain_elsewhere": 7.51},
    ),
    "it should show on several": ({"spread": 0.31, "narrow": 0.951}, {"spread": 0.31, "narrow": 0.949}),
}  # fmt: skip
"""Part of a reason, numbers that are rejected for it, and numbers that just pass."""


@pytest.mark.parametrize("reason", CRITERIA)
def test_each_criterion_rejects_by_itself(reason: str) -> None:
    for numbers, rejected in zip(CRITERIA[reason], (True, False), strict=True):
        one = trial(**numbers)
        said = rejection_reason(one, [])
        assert (said is not None and reason in said) if rejected else said is None


def test_what_spreads_little_may_gain_on_one_joint() -> None:
    assert rejection_reason(trial(spread=0.29, narrow=1.0), []) is None


@pytest.mark.parametrize(
    ("numbers", "rejected"),
    [
        ({"gain": 100.0}, False),
        ({"gain": 307.0}, False),
        ({"gain": 309.0}, True),
        ({"gain": 400.0, "free": 2}, False),
        ({"gain": 400.0, "groups": (1,)}, False),
    ],
)
def test_a_generic_function_that_does_clearly_better_rejects(numbers: dict, rejected: bool) -> None:
    said = rejection_reason(trial(), [trial("generic", **numbers)])
    assert ("not specific" in str(said)) is rejected


# Which of several is named.


def names(*trials: SimpleNamespace) -> list[str]:
    return [one.term.key[0] for one in by_merit(trials)]


def test_what_explains_most_comes_first_and_of_equals_the_simplest() -> None:
    strong, weak = trial("coulomb_friction", reach=1000.0), trial("torque_offset", reach=900.0, gain=900.0)
    assert names(weak, strong) == ["coulomb_friction", "torque_offset"]
    near = trial("torque_offset", reach=951.0, gain=301.0)
    assert names(strong, near) == ["torque_offset", "coulomb_friction"]
    assert names(strong, trial("torque_offset", reach=951.0, free=2)) == ["coulomb_friction", "torque_offset"]
    assert names() == []


def screened(name: str, *, gain: float, worth: float, power: float, physical: bool = True) -> SimpleNamespace:
    shaped = SimpleNamespace(key=(name, "elbow", "link"), candidate=None if name == "generic" else object())
    return SimpleNamespace(
        layout=SimpleNamespace(shaped=shaped, worth=worth),
        gain=gain,
        worth=worth,
        power=power,
        physical=physical,
    )


def test_of_each_candidate_the_physical_shape_that_is_worth_most_is_tried() -> None:
    entries = [
        screened("a", gain=9.0, worth=1.0, power=1.0),
        screened("b", gain=8.0, worth=3.0, power=2.0),
        screened("a", gain=7.0, worth=2.0, power=1.0),
        screened("a", gain=6.0, worth=9.0, power=1.0, physical=False),
        screened("generic", gain=5.0, worth=9.0, power=9.0),
        screened("c", gain=1.0, worth=0.0, power=8.0),
    ]
    assert best_of_each(entries, 9) == [entries[2], entries[1], entries[5]]
    assert best_of_each(entries, 1) == [entries[2]]
    # By likelihood a, by power c; each once.
    assert [layout.shaped.key[0] for layout in promising(entries, 1)] == ["a", "c"]
    assert [layout.shaped.key[0] for layout in promising(entries, 3)] == ["a", "b", "c"]


def test_delay_and_lag_of_one_joint_are_the_pair_that_is_told_apart_with_care() -> None:
    delay, lag = trial("command_delay"), trial("actuator_lag")
    assert both_delay_torque(delay, lag) and both_delay_torque(lag, delay)
    for other in (
        trial("command_delay"),
        trial("actuator_lag", key="wrist"),
        trial("torque_gain"),
        trial("generic"),
    ):
        assert not both_delay_torque(delay, other)


# Rivals.


def left(*squares: float) -> SimpleNamespace:
    """A model fitted anew, by the mean squares that it leaves of each group on unseen recordings."""
    return SimpleNamespace(log_likelihood=-500.0 * np.log(squares))


def compared(
    rival: SimpleNamespace,
    own: SimpleNamespace | None = None,
    decided: float = rivalry.DECIDED,
    held_out: Callable[[object], np.ndarray] = lambda fit: np.zeros(2),
) -> bool:
    own = trial() if own is None else own

    def lead(other: SimpleNamespace) -> float:
        return rivalry.lead_of(own, rivalry.refit(own), held_out)(other)

    return rivalry._equal(own, rival, lead, decided)


@pytest.mark.parametrize(
    ("reach", "behind", "refitted", "equal"),
    [
        (999.0, 4.9, 9.0, True),
        (999.0, 5.1, 9.0, False),
        (999.0, 9.0, 4.9, True),
        (500.0, 9.0, 5.1, False),
        (500.0, 1.0, 1.0, True),
        (0.0, 1.0, 1.0, False),
        (1500.0, -50.0, 9.0, True),
    ],
)
def test_a_rival_is_judged_by_the_evidence_of_both_fits_whatever_power_it_explains(
    monkeypatch, reach: float, behind: float, refitted: float, equal: bool
) -> None:
    """Tried in the cause's place, and once everything is fitted beside each of the two."""
    own, rival = trial(), trial("torque_offset", reach=reach, gain=300.0 - behind)
    fits = {id(own): left(1.0, 1.0), id(rival): left(1.0, np.exp(refitted / 500.0))}
    monkeypatch.setattr(rivalry, "refit", lambda one: fits[id(one)])
    assert compared(rival, own) is equal
    # Of three samples in a row that say the same, two are no evidence.
    ahead = min(behind, refitted)
    judged = compared(rival, own, decided=3.0 * rivalry.DECIDED)
    assert judged is (equal or (reach > 0.0 and ahead < 15.0))
    # The held-out recordings count as the fitted ones do.
    for lead in (-9.0, 9.0):
        seen = compared(
            rival, own, held_out=lambda fit, lead=lead: np.array([lead * (fit is fits[id(own)]), 0.0])
        )
        assert seen is (reach > 0.0 and min(behind, refitted) + lead < rivalry.DECIDED)


def test_what_a_rival_gains_elsewhere_does_not_make_it_equal(monkeypatch) -> None:
    """A clock that drifts shows in all velocities; a joint's friction it explains but for 60 nats."""
    own, clock = trial("coulomb_friction"), trial("clock_drift", groups=(0, 1), gain=2000.0)
    clock.unseen_gains = np.array([240.0, 1760.0])
    fits = {id(own): left(1.0, 5.0), id(clock): left(np.exp(60.0 / 500.0), 1.0)}
    monkeypatch.setattr(rivalry, "refit", lambda one: fits[id(one)])
    assert not compared(clock, own)
    # What explains the joint as well is as good, whatever else it explains.
    clock.unseen_gains = np.array([299.0, 1760.0])
    fits[id(clock)] = left(1.0, 1.0)
    assert compared(clock, own)


def test_nothing_equals_what_explains_nothing() -> None:
    assert not compared(trial("torque_offset"), trial(reach=0.0))


def test_a_rival_without_evidence_for_itself_is_none(monkeypatch) -> None:
    """A cause of 4 nats, not certain enough to be decided: what gains nothing is no other name for it."""
    monkeypatch.setattr(rivalry, "refit", lambda one: left(1.0))
    for gain, equal in ((10.0, True), (0.0, False)):
        own = trial(gain=14.0)
        assert compared(trial("torque_offset", gain=gain), own, decided=50.0) is equal


def fitted(unseen: float, in_sample: float, free: int) -> SimpleNamespace:
    one = trial("coulomb_friction", free=free)
    one.unseen_gain, one.in_sample = unseen, SimpleNamespace(**{**vars(one.in_sample), "gain": in_sample})
    return one


def test_further_numbers_gain_all_three_ways_or_not_at_all(monkeypatch) -> None:
    own, anew = fitted(100.0, 101.0, 1), {1: 0.0, 3: 200.0}
    monkeypatch.setattr(
        criteria, "refit", lambda one: SimpleNamespace(log_likelihood=np.array([anew[one.term.layout.free]]))
    )
    cost = bic_penalty(fitted(0.0, 0.0, 3)) - bic_penalty(own)
    assert cost > 0.0
    assert further_gain(fitted(120.0, 111.0, 3), own) == pytest.approx(10.0 - cost)
    assert further_gain(fitted(103.0, 141.0, 3), own) == pytest.approx(3.0 - cost)
    anew[3] = 2.0
    assert further_gain(fitted(120.0, 141.0, 3), own) == pytest.approx(2.0 - cost)


@pytest.mark.parametrize(
    ("further", "behind", "equal"), [(0.1, 0.1, True), (-0.1, 0.1, False), (0.1, -0.1, False)]
)
def test_a_richer_law_is_no_other_name_unless_it_is_likelier(monkeypatch, further, behind, equal) -> None:
    own, richer = trial("coulomb_friction"), trial("stribeck_friction", free=3)
    monkeypatch.setattr(rivalry, "further_gain", lambda *_: further)
    assert rivalry._equal(own, richer, lambda _: -behind, 5.0) is equal


def test_a_richer_law_of_the_same_joint_contains_the_cause() -> None:
    own, richer = trial("coulomb_friction"), trial("stribeck_friction", free=3)
    assert rivalry.contains(richer, own) and not rivalry.contains(own, richer)
    assert not rivalry.contains(trial("stribeck_friction", key="wrist", free=3), own)
    # Bodies are compared by what the recordings say of them, not by their symbols.
    load, body = trial("payload", key="fore", free=4), trial("link_inertia", key="fore", free=1)
    assert rivalry.contains(load, body) and not rivalry.contains(body, load)


def test_a_law_whose_contrast_is_not_there_contains_the_simpler_one() -> None:
    name = next(n for n, e in CATALOGUE.items() if e.contrasts and "joint" in e.description.keys)
    own = trial("torque_offset")
    unlike = not set(CATALOGUE[name].description.symbols) > set(
        CATALOGUE["torque_offset"].description.symbols
    )
    for chi_square, empty in ((11.9, True), (12.1, False)):
        rival = trial(name, in_sample=SimpleNamespace(contrast_chi_square=chi_square))
        if unlike:
            assert rivalry.contains(rival, own) is empty


@pytest.mark.parametrize(
    ("rival", "reason"),
    [
        (trial("torque_offset", reach=0.0), "explains nothing"),
        (trial("stribeck_friction", free=3), "contains the cause"),
        (trial("torque_offset", reach=1001.0, free=2), "further parameters cost"),
        (trial("torque_offset", reach=1001.0), "explains 100 %"),
        (trial("torque_offset", reach=640.0, free=2), "explains 64 %"),
    ],
)
def test_a_rival_is_told_why_it_lost(rival, reason: str) -> None:
    assert reason in rivalry._reason(trial("coulomb_friction"), rival)


def test_one_effect_on_the_same_joints_is_one_answer() -> None:
    one, other = trial("torque_gain").term.candidate, trial("torque_gain", port="sensor").term.candidate
    assert rivalry.same_name(one, other)
    assert not rivalry.same_name(one, trial("torque_gain", key="wrist").term.candidate)
    assert not rivalry.same_name(one, trial("torque_offset").term.candidate)


def test_a_cause_of_more_coefficients_must_be_ahead_by_their_penalty_too(monkeypatch) -> None:
    """7 nats more: decided between causes of one coefficient, open where the cause has three."""
    rival = trial("torque_offset", gain=293.0)
    for free, equal in ((1, False), (3, True)):
        own = trial("payload", free=free)
        monkeypatch.setattr(
            rivalry, "refit", lambda one, own=own: left(1.0 if one is own else np.exp(7.0 / 500.0))
        )
        assert compared(rival, own) is equal


def with_contrasts(
    rows: tuple[tuple[float, ...], ...], *, dry: bool = False, **more: object
) -> SimpleNamespace:
    """A rival of three coefficients, of which contrasts say what makes it more than the cause."""
    rival = trial("torque_offset", **more)
    rival.term.candidate = SimpleNamespace(effect=SimpleNamespace(contrasts=rows, dry=dry))
    return rival


@pytest.mark.parametrize(("behind", "alone"), [(4.9, True), (5.1, False)])
def test_what_makes_a_rival_more_may_do_as_well_by_itself(monkeypatch, behind: float, alone: bool) -> None:
    monkeypatch.setattr(rivalry, "part_of", lambda term, kept: list(kept))
    monkeypatch.setattr(
        rivalry,
        "try_term",
        lambda fit, kept: trial(gain=300.0 - behind) if kept == [1, 2] else trial(gain=0.0),
    )
    rows = ((0.0, 1.0, 0.0), (0.0, 0.0, 2.0))
    assert rivalry._alone(with_contrasts(rows), trial()) is alone
    assert rivalry._alone(with_contrasts(rows, dry=True), trial()) is False  # friction that falls to nothing
    for other in ((), ((1.0, -1.0, 0.0),)):
        assert rivalry._alone(with_contrasts(other), trial()) is False


@pytest.mark.parametrize(("spread", "still"), [((0.1, 3.1), True), ((9.0, 2.9), False)])
def test_what_makes_a_rival_more_may_be_as_large_as_the_cause_for_all_that_is_seen(spread, still) -> None:
    own = trial(in_sample=SimpleNamespace(own=np.array([-3.0, 1.0])))
    seen = SimpleNamespace(spread=np.array(spread))
    assert rivalry._open(with_contrasts(((0.0, 1.0),), in_sample=seen), own) is still
    assert rivalry._open(with_contrasts((), in_sample=seen), own) is False
    assert rivalry._open(with_contrasts(((1.0, 1.0),), in_sample=seen), own) is False
