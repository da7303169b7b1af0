# SPDX-License-Identifier: BSD-3-Clause
"""From accepted causes to the verdict; what makes a remainder more than noise; pushes; regimes of motion."""

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from impedance_modules.diagnosis.model_selection import conclusion, external_pushes, gap_location
from impedance_modules.diagnosis.model_selection import lack_of_fit as remainder
from impedance_modules.diagnosis.model_selection.conclusion import propose_motion
from impedance_modules.diagnosis.model_selection.evidence import Evidence, above_negligible, negligible
from impedance_modules.diagnosis.model_selection.external_pushes import ExternalPush
from impedance_modules.diagnosis.model_selection.lack_of_fit import LackOfFit, RemainingStructure
from impedance_modules.diagnosis.model_selection.push_forces import (
    Forces,
    PushPlace,
    felt_directions,
    hat_functions,
    steady_gain,
)
from impedance_modules.diagnosis.result import Cause, Remainder, Rival
from impedance_modules.effects.catalogue import CATALOGUE

RIVAL = Rival("torque_offset", ("elbow",), "fits as well")


def cause(weight: float, *equivalent: Rival, effect: str = "viscous_friction", joint: str = "elbow") -> Cause:
    span = {joint: (-weight, weight)}
    return Cause(effect, (joint,), "link", {joint: {}}, weight, None, equivalent, (RIVAL,), span, span)


@pytest.mark.parametrize(
    ("causes", "explained", "near", "verdict"),
    [
        ([], True, True, "no_gap"),
        ([], False, True, "unexplained"),
        ([cause(0.9)], True, False, "explained"),
        ([cause(0.9)], False, True, "partly_explained"),
        ([cause(0.9, RIVAL)], True, False, "ambiguous"),
        ([cause(0.9, RIVAL)], False, True, "ambiguous"),
        ([cause(0.9, RIVAL)], False, False, "partly_explained"),
        ([cause(0.24, RIVAL)], False, True, "partly_explained"),
        ([cause(0.25, RIVAL)], False, True, "ambiguous"),
        ([cause(0.24)], True, True, "partly_explained"),
        ([cause(0.24, RIVAL)], True, True, "partly_explained"),
        ([cause(0.13), cause(0.13)], True, True, "explained"),
        ([cause(0.9), cause(0.049, RIVAL)], True, True, "explained"),
        ([cause(0.9), cause(0.05, RIVAL)], True, True, "ambiguous"),
        ([cause(0.13), cause(0.13, RIVAL)], False, True, "ambiguous"),
    ],
)
def test_the_verdict_follows_from_causes_rivals_and_remainder(causes, explained, near, verdict) -> None:
    assert conclusion.verdict_of(causes, Remainder(1.0, explained, ""), near=near) == verdict


@pytest.mark.parametrize(
    ("ratio", "weak", "passes"),
    [
        ((1.9, 0.9), False, True),
        ((2.1, 0.9), False, False),
        ((5.9, 0.9), True, True),
        ((1.0, 6.1), True, False),
    ],
)
def test_on_a_weak_floor_more_power_may_be_left(ratio, weak, passes) -> None:
    lack = LackOfFit(np.array(ratio), np.array([2.0, 1.0]), structures("a tone"))
    assert conclusion._power_passes(lack, weak=weak) is passes


def structures(words: str) -> tuple[RemainingStructure, ...]:
    """One structure of the first group, or none."""
    return (RemainingStructure(1.5, words, 0),) if words else ()


def test_one_effect_on_several_joints_is_one_cause() -> None:
    other = Rival("payload", (), "fits as well")
    both = conclusion._merge(cause(0.6, RIVAL), cause(0.2, other, RIVAL, joint="wrist"))
    assert (both.joints, both.weight) == (("elbow", "wrist"), 0.8)
    assert both.equivalent == (RIVAL, other) and both.rivals == (RIVAL,)
    assert both.parameters == {"elbow": {}, "wrist": {}}
    assert both.position_range == {"elbow": (-0.6, 0.6), "wrist": (-0.2, 0.2)} == both.velocity_range


def test_the_next_motion_asks_for_what_is_open() -> None:
    model = SimpleNamespace(joints=("shoulder", "elbow"))
    nothing, weak = SimpleNamespace(weak_joints=()), SimpleNamespace(weak_joints=("wrist",))
    start = {"elbow": 0.3}
    later = cause(0.1, Rival("payload", (), "fits as well"), joint="wrist")
    asked = propose_motion([cause(0.5), cause(0.4, RIVAL), later], weak, model, start)
    assert asked["purpose"] == "tell viscous_friction, torque_offset apart"
    assert (asked["joints"], asked["start"]) == (["elbow"], start)
    for name in ("viscous_friction", "torque_offset"):
        assert CATALOGUE[name].description.excitation in asked["excitation"]
    asked = propose_motion([cause(0.5)], weak, model, start)
    assert asked["joints"] == ["wrist"] and "reversals" in asked["excitation"]
    assert propose_motion([cause(0.5)], nothing, model, start)["purpose"] == "none needed"


@pytest.mark.parametrize(
    ("structure", "weak", "refused", "words"),
    [
        (
            "",
            False,
            True,
            "noise and parameters' uncertainty on wrist (actuator); 1 would pass; not explained",
        ),
        ("a tone", False, False, "1 would pass; a tone; not explained by the catalogue"),
        (
            "a tone",
            True,
            True,
            "1 would pass; the noise floor is weak, no recording repeats another; a tone; not",
        ),
    ],
)
def test_the_remainder_is_said_in_words(structure: str, weak: bool, refused: bool, words: str) -> None:
    lack = LackOfFit(np.array([1.5, 3.25]), np.array([2.0, 1.0]), structures(structure))
    nearest = SimpleNamespace(term=SimpleNamespace(candidate=SimpleNamespace(name="a payload")))
    evidence = SimpleNamespace(
        design=SimpleNamespace(groups=(("link", 0), ("actuator", 1))),
        floor=SimpleNamespace(weak=weak),
        refusal=SimpleNamespace(trial=nearest, reason="gains too little") if refused else None,
    )
    found = conclusion._remainder(lack, evidence, SimpleNamespace(joints=("elbow", "wrist")))
    assert (found.lack_of_fit, found.explained) == (3.25, False)
    assert found.failing == {("actuator", "wrist"), *({("link", "elbow")} if structure else ())}
    assert found.structure.startswith("residual power is 3.25 times noise") and words in found.structure
    assert ("(nearest: a payload, which gains too little)" in found.structure) is refused
    passing = conclusion._remainder(
        LackOfFit(np.ones(2), np.array([2.0, 1.5]), ()), evidence, SimpleNamespace(joints="ab")
    )
    assert passing.explained and "not explained" not in passing.structure and not passing.failing


# What is left.

RATE = 100.0


def test_a_tone_in_the_remainder_is_found_at_its_frequency() -> None:
    random = np.random.default_rng(0)
    time = np.arange(3000) / RATE
    noise = [random.standard_normal(3000 + 50 * k) for k in range(3)]
    assert remainder._tone(noise, RATE)[1] < remainder.TONE_MAX
    series = [part[:3000] + 0.4 * np.sin(2 * np.pi * 7.0 * time + k) for k, part in enumerate(noise)]
    frequency, ratio = remainder._tone(series, RATE)
    assert frequency == pytest.approx(7.0, abs=0.04) and ratio > 100.0
    # A constant is no tone.
    assert remainder._tone([part + 5.0 for part in noise], RATE)[1] < remainder.TONE_MAX


def test_noise_of_another_colour_and_what_is_below_the_noise_are_no_tones() -> None:
    random = np.random.default_rng(2)
    time = np.arange(6000) / RATE
    white = random.standard_normal(6000)
    spectrum = np.fft.rfft(white)
    frequency = np.fft.rfftfreq(6000, 1.0 / RATE)
    raised = np.fft.irfft(spectrum * (1.0 + 5.0 * np.exp(-(((frequency - 18.0) / 3.0) ** 2))), 6000)
    plain = np.abs(np.fft.rfft(raised)) ** 2
    assert plain.max() / np.median(plain) > 3.0 * remainder.TONE_MAX  # a median of all frequencies is fooled
    assert remainder._tone([raised], RATE)[1] < remainder.TONE_MAX
    line = np.sin(2.0 * np.pi * 18.0 * time)
    assert remainder._tone([raised + 2.0 * line], RATE)[1] > remainder.TONE_MAX
    assert remainder._tone([0.005 * (white + 2.0 * line)], RATE)[1] < 1.0


def test_a_moment_in_the_remainder_is_found() -> None:
    random = np.random.default_rng(1)
    noise = [random.standard_normal(1000), random.standard_normal(720)]
    quiet = remainder.moment_ratio(noise, RATE)
    assert quiet < 3.0
    blocks = [np.sum(noise[0][50 * k : 50 * (k + 1)] ** 2) for k in range(20)]
    blocks += [np.sum(noise[1][50 * k : 50 * (k + 1)] ** 2) for k in range(13)] + [
        np.sum(noise[1][650:] ** 2)
    ]
    assert quiet == pytest.approx(max(blocks) / max(np.median(blocks), 50.0))
    assert remainder.moment_ratio([0.1 * part for part in noise], RATE) == pytest.approx(max(blocks) / 5000.0)
    noise[0][300:320] += 12.0
    assert remainder.moment_ratio(noise, RATE) > 20.0


def test_orders_go_from_one_period_over_the_travel_to_what_the_samples_follow() -> None:
    q = np.linspace(0.0, 2.0, 101)
    orders = remainder._orders([q[:60], q[60:]])
    assert orders[0] * 2.0 == pytest.approx(2.5) and np.allclose(np.diff(orders) * 2.0, 2.5)
    assert orders[-1] * 0.02 < 1.0 and len(orders) == 30
    coarse = remainder._orders([np.linspace(0.0, 2.0, 21)])
    assert coarse[-1] * 0.1 < 1.0 <= (coarse[-1] + 1.25) * 0.1 + 0.13 and len(coarse) == 7
    assert remainder._orders([np.full(9, 0.3)]).size == 0
    assert remainder._orders([np.concatenate([np.zeros(99), np.ones(2)])]).size == 0


def test_the_worse_of_two_tests_counts_and_structure_fails() -> None:
    heldout, everything = np.array([[3.0, 3.0], [2.0, 1.0]]), np.array([[2.0, 2.0], [1.0, 1.0]])
    for one, other in ((heldout, everything), (everything, heldout)):
        assert remainder._worse(one, other).tolist() == [[2.0, 3.0], [1.0, 1.0]]
    for ratio, structure, passed in (
        (1.0, "", True),
        (2.0, "", True),
        (2.1, "", False),
        (1.0, "a tone", False),
    ):
        lack = LackOfFit(np.array([0.5, ratio]), np.array([1.0, 2.0]), structures(structure))
        assert lack.passed is passed
        assert lack.failing == {*([1] if ratio > 2.0 else []), *([0] if structure else [])}


def test_a_gap_is_negligible_below_a_thousandth_of_load_and_speed() -> None:
    items = [
        SimpleNamespace(load=np.full((n, 2), [3.0, 40.0]), velocity=np.full((n, 2), [0.5, 2.0]))
        for n in (5, 9)
    ]
    found = negligible(items, (("link", 0), ("actuator", 1), ("velocity", 1), ("velocity", 0)))
    assert found == pytest.approx([3e-3, 40e-3, 2e-3, 0.5e-3])


def test_a_term_counts_if_it_is_more_than_negligible_in_any_group() -> None:
    terms = [SimpleNamespace(groups=groups) for groups in ((0,), (0, 1), (1,))]
    sizes = ({0: 0.9}, {0: 0.1, 1: 2.1}, {1: 1.9})
    plain = SimpleNamespace(
        torque=lambda fit, index, r: {g: np.full(7, size) for g, size in sizes[index].items()}
    )
    model_fit = SimpleNamespace(model=terms, design=SimpleNamespace(raw=(0, 1)))
    assert above_negligible(model_fit, plain, np.array([1.0, 2.0])) == [terms[1]]


# Pushes.


def test_runs_bridge_one_gap_and_end_at_two() -> None:
    def runs(text: str) -> list[tuple[int, int]]:
        return external_pushes.runs_of(np.array([letter == "x" for letter in text]))

    assert runs("..xx..x.") == [(2, 4), (6, 7)]
    assert runs("x.x..x.x") == [(0, 3), (5, 8)]
    assert runs("xxx") == [(0, 3)] and runs("...") == []


def test_quiet_times_give_the_size_of_noise_beneath_a_push() -> None:
    noise = 2.0 * np.random.default_rng(2).standard_normal(40_000)
    noise[:15_000] += 30.0
    assert external_pushes._quiet_rms(noise[15_000:]) == pytest.approx(2.0, rel=0.03)
    assert 2.0 < external_pushes._quiet_rms(noise) < 4.0
    assert external_pushes._quiet_rms(0.1 * noise[15_000:]) == 1.0


def forces(**more: object) -> Forces:
    given = {
        "body": "fore",
        "force": np.zeros((4, 3)),
        "covariance": np.eye(12),
        "joints": np.ones(6),
        "gain": 1.0,
    }
    chosen = {**given, **more}
    return Forces(place=PushPlace(str(chosen.pop("body"))), **chosen)


@pytest.mark.parametrize(
    ("joints", "least"), [([1.0], 1.0), ([1.0] * 3, 0.8), ([1.0] * 6, 0.75), ([1.0] * 6 + [0.01], 0.75)]
)
def test_a_force_must_explain_more_than_one_number_does_by_chance(joints, least) -> None:
    assert external_pushes._pattern_min(forces(joints=np.array(joints))) == pytest.approx(least)


def test_the_chi_square_of_hats_is_walds() -> None:
    random = np.random.default_rng(3)
    root = random.standard_normal((12, 12))
    found = forces(force=random.standard_normal((4, 3)), covariance=root @ root.T)
    part = found.force[1:3].ravel()
    wald = part @ np.linalg.inv((root @ root.T)[3:9, 3:9]) @ part
    assert external_pushes.chi_square_of(found, slice(3, 9)) == pytest.approx(wald)


def test_hats_are_a_partition_of_one_a_quarter_of_a_second_apart() -> None:
    item = SimpleNamespace(time=5.0 + np.arange(300) / RATE, log=SimpleNamespace(start=5.0))
    tips, hats = hat_functions(item, 300)
    assert np.allclose(np.diff(tips), 0.25) and tips[0] == 0.0 and tips[-1] >= 2.99
    assert np.allclose(hats.sum(axis=1), 1.0) and np.allclose(hats @ tips, np.arange(300) / RATE)
    assert hat_functions(item, 250)[0][0] == pytest.approx(0.5)


@given(st.integers(0, 10_000), st.integers(2, 12))
def test_a_force_that_keeps_its_direction_explains_what_it_is(seed: int, count: int) -> None:
    """One of any direction and size loses nothing; what noise explains in every direction is not its own."""
    random = np.random.default_rng(seed)
    root = random.normal(size=(3 * count, 3 * count)) + 3.0 * np.sqrt(count) * np.eye(3 * count)
    covariance = root @ root.T
    way, sizes = random.normal(size=3), random.uniform(1.0, 2.0, count)
    steady = np.outer(sizes, way)
    whole = float(steady.reshape(-1) @ np.linalg.solve(covariance, steady.reshape(-1)))
    found = steady_gain(forces(force=steady, covariance=covariance), 0, count)
    assert found == pytest.approx(whole - count - 2.0, rel=1e-4, abs=1e-6)
    to_and_fro = random.normal(size=(count, 3))
    every = float(np.sum(to_and_fro**2))
    one_way = np.linalg.svd(to_and_fro)[1][0] ** 2
    gain = steady_gain(forces(force=to_and_fro, covariance=np.eye(3 * count)), 0, count)
    assert gain <= every - count - 2.0 + 1e-9
    assert gain == pytest.approx(one_way - count - 2.0, rel=1e-6)


@pytest.mark.parametrize(("elsewhere", "unrest"), [(1.0, 1.0), (2.366, 1.0), (7.098, 3.0)])
def test_what_a_model_leaves_elsewhere_asks_for_more_of_a_push(elsewhere: float, unrest: float) -> None:
    assert external_pushes._unrest(np.full(20, elsewhere)) == pytest.approx(unrest)
    assert external_pushes._unrest(np.zeros(0)) == 1.0


def push(
    recording: int = 0,
    start: float = 1.0,
    end: float = 2.0,
    force=(4.0, 0.0, 0.0),
    gain: float = 90.0,
    felt: int = 3,
) -> ExternalPush:
    return ExternalPush(
        recording, PushPlace("fore"), start, end, np.array(force), np.ones(3), np.eye(3)[:felt], gain
    )


def recordings(*groups: str) -> list[SimpleNamespace]:
    time = np.arange(301) / RATE
    logs = [SimpleNamespace(start=0.0, group=group, name=f"run{k}") for k, group in enumerate(groups)]
    return [SimpleNamespace(time=time, log=log, samples=len(time)) for log in logs]


def test_what_a_repeat_shows_too_is_no_push() -> None:
    items = recordings("a", "a", "b")
    tips, _ = hat_functions(items[0], 301)
    inside = ((tips >= 1.0) & (tips <= 2.0))[:, None]

    def seen(there: Forces, at: int) -> bool:
        return external_pushes._in_a_repeat(push(), items, {0: forces(), at: there})

    def there(size: float, where: np.ndarray = inside, body: str = "fore") -> Forces:
        return forces(force=np.where(where, [size, 0.0, 0.0], 0.0), body=body)

    assert seen(there(4.0), 1) and seen(there(2.1), 1) and seen(there(5.9), 1)
    assert not seen(there(1.9), 1) and not seen(there(6.1), 1)
    assert (
        not seen(there(4.0), 2) and not seen(there(4.0, ~inside), 1) and not seen(there(4.0, body="upper"), 1)
    )
    assert not external_pushes._in_a_repeat(push(), items, {0: there(4.0)})
    # A force across the directions that the joints feel is no difference.
    across = forces(force=np.where(inside, [4.0, 0.0, 900.0], 0.0))
    assert not seen(across, 1)
    assert external_pushes._in_a_repeat(push(felt=2), items, {0: forces(), 1: across})
    # The tips at both ends of a push belong to it.
    ends = np.isclose(tips, 1.0)[:, None] | np.isclose(tips, 2.0)[:, None]
    strong = there(4.0 * inside.sum() / ends.sum(), ends)
    assert seen(strong, 1)


def test_a_push_is_masked_with_its_margin() -> None:
    items = recordings("a", "b")
    found = external_pushes.rows_without_pushes([push(1), push(1, 2.5, 2.6)], items)
    time = items[1].time
    masked = ((time >= 0.799) & (time <= 2.201)) | ((time >= 2.299) & (time <= 2.801))
    assert list(found) == [1] and np.array_equal(~found[1], masked)


def test_the_strongest_push_on_a_link_is_described() -> None:
    pushes = [push(0, gain=99.0), push(1, 0.5, force=(9.0, 1.0, 2.0))]
    found = external_pushes.cause_of_pushes(pushes, 0.3)
    numbers = found.parameters["fore"]
    assert (numbers["fx"].value, numbers["start"].value, numbers["end"].value) == (4.0, 1.0, 2.0)
    assert (found.effect, found.weight, found.joints, found.port) == ("external_contact", 0.3, (), "contact")
    notes = external_pushes.push_notes(pushes[::-1], recordings("a", "b"))
    assert notes[0].startswith("run0: pushed from outside, 1.00 to 2.00 s, with 4 N on fore")
    assert notes[1].startswith("run1: pushed from outside, 0.50 to 2.00 s, with 9.3 N on fore; ")
    (note,) = external_pushes.push_notes([push(felt=2)], recordings("a"))
    assert "4 N on fore, along (1.00, 0.00, 0.00) and (0.00, 1.00, 0.00) in base axes" in note


@pytest.mark.parametrize("seed", range(5))
def test_joints_with_parallel_axes_feel_no_force_along_them(seed: int) -> None:
    """Whatever the base's orientation; and a force that is certain is felt, however uncertain beside the others."""
    random = np.random.default_rng(seed)
    axes = np.linalg.qr(random.normal(size=(3, 3)))[0]
    spread = np.array([0.05, 0.3, 400.0])
    covariance = axes @ np.diag(spread**2) @ axes.T
    force = axes @ np.array([0.3, 0.1, 30.0])
    felt = felt_directions(force, covariance)
    assert len(felt) == 2
    assert felt @ felt.T == pytest.approx(np.eye(2), abs=1e-9)
    assert felt @ axes[:, 2] == pytest.approx([0.0, 0.0], abs=1e-9)
    assert felt.T @ felt @ force == pytest.approx(axes[:, :2] @ [0.3, 0.1])
    assert len(felt_directions(axes @ np.array([0.3, 0.1, 900.0]), covariance)) == 3
    assert len(felt_directions(np.zeros(3), np.eye(3))) == 3


@pytest.mark.parametrize("known", [False, True])
def test_a_push_that_turns_one_joint_is_one_on_a_link_that_others_show_pushed(
    monkeypatch, known: bool
) -> None:
    """Alone it may be a fault of that joint."""
    (item,) = recordings("a")
    tips, _ = hat_functions(item, 301)
    inside = (tips >= 1.0) & (tips <= 2.0)
    there = forces(
        force=np.where(inside[:, None], [0.0, 12.0, 0.0], 0.0),
        covariance=np.eye(3 * len(tips)),
        joints=np.array([100.0, 1.0, 1.0, 1.0, 1.0, 1.0]),
    )
    each = {0: np.where(inside, 144.0, 0.0)}
    monkeypatch.setattr(
        external_pushes, "free_torques", lambda fit, item, r, left, g: each.get(g, np.zeros(len(tips)))
    )
    groups = tuple(("link", joint) for joint in range(6))
    fit = SimpleNamespace(design=SimpleNamespace(groups=groups, whitening=SimpleNamespace(weak=True)))
    found = external_pushes._intervals(fit, item, 0, (), there, known)
    assert len(found) == known
    if found:
        assert (found[0].start, found[0].end) == (0.75, 2.25) and found[0].force[1] == pytest.approx(12.0)


def test_one_link_is_taken_for_all_recordings_unless_another_fits_far_better() -> None:
    def tried(hand: float, wrist: float) -> dict[PushPlace, Forces]:
        return {
            PushPlace(name): forces(body=name, gain=gain) for name, gain in (("hand", hand), ("wrist", wrist))
        }

    alike = external_pushes._on_one_place({0: tried(900.0, 800.0), 3: tried(90.0, 100.0)})
    assert {r: found.place.body for r, found in alike.items()} == {0: "hand", 3: "hand"}
    apart = external_pushes._on_one_place({0: tried(900.0, 800.0), 3: tried(60.0, 100.0)})
    assert {r: found.place.body for r, found in apart.items()} == {0: "hand", 3: "wrist"}


# Regimes of motion.

LIMITS = SimpleNamespace(lower=-1.0, upper=1.0)


def regime(q: float, v: float, a: float, load: float = 1.0) -> str:
    """Of a joint that moves evenly."""
    many = 40
    columns = {"position": q, "velocity": v, "acceleration": a, "load": load}
    item = SimpleNamespace(
        samples=many, **{name: np.full((many, 1), value) for name, value in columns.items()}
    )
    model = SimpleNamespace(tree=SimpleNamespace(bodies=[SimpleNamespace(limits=LIMITS)]), effort_max=[10.0])
    (name,) = set(gap_location._regime_names(item, model, 0))
    return name


@pytest.mark.parametrize(
    ("state", "name"),
    [
        ((0.0, 0.1, 0.0, 9.91), "saturated"),
        ((0.0, 0.1, 0.0, -9.91), "saturated"),
        ((0.0, 0.1, 0.0, 9.89), "slow"),
        ((-0.951, 0.1, 0.0), "near_limit"),
        ((0.951, 0.1, 0.0), "near_limit"),
        ((0.949, 0.1, 0.0), "slow"),
        ((-0.949, 0.1, 0.0), "slow"),
        ((0.0, 0.049, 0.051), "reversal"),
        ((0.0, 0.051, 0.051), "slow"),
        ((0.0, 0.009, 0.049), "hold"),
        ((0.0, -0.011, 0.049), "slow"),
        ((0.0, 0.2, 0.91), "accelerating"),
        ((0.0, 0.2, -0.91), "accelerating"),
        ((0.0, 0.2, 0.89), "slow"),
        ((0.0, 0.51, 0.0), "fast"),
        ((0.0, -0.51, 0.0), "fast"),
        ((0.0, 0.49, 0.0), "slow"),
    ],
)
def test_a_sample_belongs_to_the_first_regime_that_fits(state, name: str) -> None:
    assert regime(*state) == name


def test_a_joint_that_turns_slowly_reverses() -> None:
    many = 200
    time = np.arange(many) / RATE
    v = 0.04 * np.sin(2 * np.pi * time + 0.1)
    item = SimpleNamespace(
        samples=many, position=np.zeros((many, 1)), velocity=v[:, None], acceleration=np.zeros((many, 1)),
        load=np.ones((many, 1)),
    )  # fmt: skip
    model = SimpleNamespace(tree=SimpleNamespace(bodies=[SimpleNamespace(limits=None)]), effort_max=[10.0])
    found = gap_location.regimes(item, model, 0)
    turns = np.flatnonzero(np.diff(np.sign(v)) != 0)
    for turn in turns:
        assert found["reversal"][turn - 2 : turn + 4].all()
    assert 10 <= found["reversal"].sum() <= 9 * len(turns)
    assert sum(mask.sum() for mask in found.values()) == many


def test_the_band_holds_the_middle_four_fifths_of_the_power() -> None:
    time = np.arange(4000) / RATE
    tones = sum(np.sin(2 * np.pi * f * time) for f in (1.0, 2.0, 4.0, 8.0, 16.0))
    item = SimpleNamespace(band=SimpleNamespace(step=2, rate=2.0 * RATE))
    low, high = gap_location._band([tones, tones[:50]], item)
    assert low == pytest.approx(1.0, abs=0.1) and high == pytest.approx(16.0, abs=0.1)
    faint = tones + 3.0 * np.sin(2 * np.pi * 5.0 * time)
    low, high = gap_location._band([faint], item)
    assert low == pytest.approx(2.0, abs=0.1) and high == pytest.approx(8.0, abs=0.1)


def test_noise_is_a_mean_square_over_the_held_out_recordings() -> None:
    rms = np.array([[9.0, 9.0], [3.0, 1.0], [4.0, 1.0]])
    own = SimpleNamespace(floor=SimpleNamespace(rms=rms), heldout=(1, 2))
    assert Evidence.heldout_noise.func(own) == pytest.approx([np.sqrt(12.5), 1.0])


def test_excess_torque_is_counted_in_the_mean_noise_of_a_residuals_joints() -> None:
    groups = (("link", 0), ("link", 1), ("velocity", 0))
    own = SimpleNamespace(
        design=SimpleNamespace(groups=groups),
        heldout_noise=np.array([3.0, 1.0, 2.0]),
        rms=lambda fit: np.array([3.5, 0.5, 4.0]),
    )
    assert Evidence.excess_torque(own, None) == pytest.approx((12.25 - 9.0) / 5.0 + 0.0 + 12.0 / 4.0)


def test_whitened_excess_is_what_rows_leave_beyond_their_number() -> None:
    fit = SimpleNamespace(
        size=2,
        whole=SimpleNamespace(coefficients=np.array([1.0, 2.0])),
        squares=lambda coefficients, recordings: np.array([300.0, 90.0]) / (1.0 + coefficients.sum()),
    )
    own = SimpleNamespace(
        calibrated=fit, judges=(0,), design=SimpleNamespace(count=lambda recordings: np.array([50.0, 30.0]))
    )
    own.whitened_power = lambda model: Evidence.whitened_power(own, model)
    assert Evidence.whitened_excess(own, None) == pytest.approx(5.0 + 2.0)
    assert Evidence.whitened_excess(own, fit) == pytest.approx(0.5)


def test_the_share_of_what_comes_from_outside_is_the_power_beyond_noise_where_it_acts() -> None:
    left = np.array([3.0, 1.0, 1.0, 2.0])
    quiet = np.array([0.5, 0.1, 0.1, 0.1])  # than its floor, but where it is pushed
    own = SimpleNamespace(
        prepared=[None],
        design=SimpleNamespace(groups=(("link", 0), ("velocity", 0))),
        plain=SimpleNamespace(left=lambda fit, recording: [left, quiet]),
        calibrated=None,
        floor=SimpleNamespace(rms=np.array([[0.5, 0.5]])),
        heldout_noise=np.array([2.0, 2.0]),
        counted=lambda recording, group: np.array([False, True, True, False]),
        disturbed_rows=lambda recording, group: np.array([False, False, False, group == 0]),
        _pushed=lambda recording, group: np.array([True, False, False, False]),
        pushes=(push(),),
        disturbed={(0, 0): None},
    )
    parts = np.array([9.0 - 0.25, 4.0 - 0.25, 2 * (1.0 - 0.25)])
    assert Evidence._outside_shares.func(own) == pytest.approx(tuple(parts[:2] / parts.sum()))
    own.pushes, own.disturbed = (), {}
    assert Evidence._outside_shares.func(own) == (0.0, 0.0)


def test_rows_that_no_law_has_are_judged_by_their_own_power() -> None:
    """Where they are no more than a thousandth of the load, they are no finding."""
    left = [np.array([3.0, 4.0, 0.1, 0.1]), np.array([3.0, 4.0, 0.1, 0.1])]
    own = SimpleNamespace(
        design=SimpleNamespace(groups=(("link", 0), ("link", 1))),
        plain=SimpleNamespace(left=lambda fit, recording: left),
        model_fit=None,
        floor=SimpleNamespace(rms=np.array([[0.5, 0.5]])),
        disturbed_rows=lambda recording, group: np.array([True, True, False, False]),
        disturbed={(0, 0): None, (0, 1): None},
        negligible=np.array([0.1, 4.0]),
        heldout_noise=np.array([0.5, 0.5]),
    )
    assert Evidence.disturbed_powers(own) == pytest.approx([12.5 / 0.25, 0.0])
