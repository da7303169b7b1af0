# SPDX-License-Identifier: BSD-3-Clause
"""Single decisions of the search for causes, on simple made-up models: which is tried, exchanged, displaced, kept."""

from collections import Counter
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest

from impedance_modules.diagnosis.model_selection import (
    candidate_trial,
    forward_selection,
    geared_start,
    lack_of_fit,
    rivals,
)
from impedance_modules.diagnosis.model_selection.forward_selection import Selector
from impedance_modules.diagnosis.result import Standing


def term(key: str, *groups: int, effect: str = "viscous_friction", port: str = "actuator") -> SimpleNamespace:
    candidate = SimpleNamespace(effect=SimpleNamespace(id=effect), key=key, joints=(key,), port=port)
    return SimpleNamespace(key=(effect, key, port), groups=groups, candidate=candidate)


@pytest.mark.parametrize(
    ("before", "now", "displaced"),
    [
        (0.5, 0.5, False),
        (2.0, 2.0, False),
        (2.0, 2.5, True),
        (0.5, 1.05, False),
        (0.5, 1.5, True),
        (-0.5, -1.5, True),
    ],
)
def test_a_term_is_displaced_if_it_leaves_its_bounds_or_goes_farther(
    before: float, now: float, displaced: bool
) -> None:
    """Bounds -1 and 1, a spread of 0.1: beyond by less than the spread is nothing."""
    own = SimpleNamespace(
        shaped=SimpleNamespace(size=1, lower=np.array([-1.0]), upper=np.array([1.0])),
        layout=SimpleNamespace(scale=np.ones(1)),
    )
    whole = SimpleNamespace(inverse=np.array([[0.01]]), coefficients=np.array([before]))
    model_fit = SimpleNamespace(model=[own], starts=[0], whole=whole)
    assert candidate_trial._displaced(model_fit, np.array([now])) is (own if displaced else None)


@pytest.mark.parametrize(
    ("groups", "tried"),
    [
        ([(0,), (1,), (1,)], [1, 2]),
        ([(0,), (2,), (1,)], []),
        ([(0, 1), (1, 2), (1,)], [0, 1, 2]),
        ([(0,)], [0]),
    ],
)
def test_causes_that_share_a_residual_with_the_last_are_exchanged_and_then_it(
    groups: list[tuple[int, ...]], tried: list[int]
) -> None:
    seen: list[int] = []

    def better(model: list, index: int) -> list:
        seen.append(index)
        return model

    model = [term(f"joint{index}", *own) for index, own in enumerate(groups)]
    assert Selector._exchange(SimpleNamespace(_better=better), model) is model
    assert seen == tried


def test_what_is_removed_is_remembered_and_the_search_goes_on(monkeypatch: pytest.MonkeyPatch) -> None:
    first, second, third = term("elbow"), term("wrist"), term("shoulder")
    added = [[first, second, third], [first, third]]
    kept = [[first, third], [first, third]]
    monkeypatch.setattr(forward_selection, "geared_start_model", lambda *rest: ())
    monkeypatch.setattr(forward_selection, "merge_delays", lambda model, *rest: model)
    monkeypatch.setattr(forward_selection, "eliminate_backward", lambda *rest: kept.pop(0))
    begun: list[list] = []

    def add_causes(model: list, progress: object) -> tuple[list, None]:
        begun.append(model)
        return added.pop(0), None

    selector = SimpleNamespace(
        model_fit=lambda model: None, trials=None, rejection_reason=None, refiner=None, _removals=Counter()
    )
    selector._add_causes, selector.simplest, selector.one_for_two = add_causes, list, list
    gone: list[list] = []
    selector.reshaped = lambda model, removed: gone.append(removed) or model
    selector.go_on = partial(Selector.go_on, selector)
    found = Selector.run(selector, lambda text: None)
    assert begun == [[], [first, third]] and found.causes == (first, third)
    assert selector._removals == Counter({second.key: 1}) and gone == [[second]]
    added, kept = [[first, third]], [[first, third]]
    assert selector.go_on([first], lambda text: None).causes == (first, third) and begun[2:] == [[first]]


@pytest.mark.parametrize(
    ("stiff", "joint", "free", "reach", "ahead", "reason", "taken"),
    [
        (False, "elbow", 1, 1.0, 9.9, None, "torque_offset"),
        (True, "elbow", 1, 1.0, 9.9, None, "parallel_spring"),
        (False, "wrist", 1, 1.0, 9.9, None, "parallel_spring"),
        (False, "elbow", 2, 1.0, 9.9, None, "parallel_spring"),
        (False, "elbow", 1, 0.98, 9.9, None, "parallel_spring"),
        (False, "elbow", 1, 1.0, 10.1, None, "parallel_spring"),
        (False, "elbow", 1, 1.0, 9.9, "helps nowhere", "parallel_spring"),
    ],
)
def test_a_simpler_law_on_the_same_joint_takes_the_place_of_one_with_numbers_that_may_be_chance(
    monkeypatch: pytest.MonkeyPatch,
    *,
    stiff: bool,
    joint: str,
    free: int,
    reach: float,
    ahead: float,
    reason: str | None,
    taken: str,
) -> None:
    """A spring that was found beside a cause that is gone: its stiffness may be none, and an offset explains it.

    It stays if it is ahead by 5 nats of samples of which two say as much as one.
    """

    def trial(effect: str, joint: str, free: int, reach: float) -> SimpleNamespace:
        one = term(joint, 0, effect=effect)
        one.layout = SimpleNamespace(free=free)
        return SimpleNamespace(term=one, reach_on=lambda groups: reach)

    other, own = term("base", 0, 1), trial("parallel_spring", "elbow", 2, 1.0)
    offset = trial("torque_offset", joint, free, reach)
    monkeypatch.setattr(forward_selection, "beyond_simpler", lambda fit, refiner, index: stiff or index == 0)
    monkeypatch.setattr(forward_selection, "try_term", lambda rest, one: own)
    monkeypatch.setattr(forward_selection, "penalised_gain", lambda one: 1.0)
    monkeypatch.setattr(forward_selection, "refit", lambda one: one)
    monkeypatch.setattr(forward_selection, "correlation_surplus", lambda refitted, groups: 2.0)
    monkeypatch.setattr(forward_selection, "further_gain", lambda richer, simpler: ahead)
    selector = SimpleNamespace(
        model_fit=list, refiner=None, trials=lambda rest: [offset], rejection_reason=lambda one: reason
    )
    found = Selector.simplest(selector, [other, own.term])
    assert [one.key[0] for one in found] == ["viscous_friction", taken]


def test_the_best_order_that_holds_elsewhere_explains(monkeypatch: pytest.MonkeyPatch) -> None:
    """The order with most gain fails on held-out recordings; of the others the better one counts."""
    gains = {1.0: 300.0, 2.0: 500.0, 3.0: 400.0, 4.0: 900.0}
    monkeypatch.setattr(lack_of_fit, "_orders", lambda positions: np.array([*gains]))
    monkeypatch.setattr(lack_of_fit, "_modulated", lambda evidence, index, place, phase: float(phase[0]))
    monkeypatch.setattr(lack_of_fit, "_fit", lambda evidence, blocks, g: (gains[blocks[0]], None, None))
    monkeypatch.setattr(lack_of_fit, "_validated", lambda evidence, blocks, *rest: blocks[0] != 4.0)
    item = SimpleNamespace(tree=SimpleNamespace(joints=["elbow"]), position=np.ones((5, 1)))
    evidence = SimpleNamespace(model_fit=SimpleNamespace(counts=[1000.0]), prepared=[item])
    part = lack_of_fit._explained_by_variation(evidence, 0, term("elbow", 0))
    left = 500.0 - np.log(1000.0) - np.log(4.0)
    assert part == pytest.approx(1.0 - np.exp(-2.0 * left / 1000.0))


def test_what_other_causes_hold_is_no_rival(monkeypatch: pytest.MonkeyPatch) -> None:
    """The others are tried in the cause's place; those that fit as well are named, those that do not have a reason.

    A richer law that fits best as the cause reverses is tried so. The cause leads the best of these; one of
    which it is a special case does not count. The same effect at another place is no other name: it is told as
    a place.
    """
    cause, other = term("elbow", 0), term("wrist", 1)
    offered = [term("elbow", 0, effect=effect) for effect in ("equal", "worse", "larger")] + [other, cause]
    there = term("elbow", 0, port="sensor")
    offered.append(there)
    gains = {cause.key: 100.0} | dict(
        zip([one.key for one in offered], (99.0, 30.0, 98.0, 97.0, 100.0, 99.5), strict=True)
    )
    monkeypatch.setattr(rivals, "penalised_gain", lambda trial: gains[trial.term.key])
    monkeypatch.setattr(rivals, "contains", lambda rival, own: rival.term.candidate.effect.id == "larger")
    monkeypatch.setattr(rivals, "promising", lambda ranked, count: ranked)
    likelier = SimpleNamespace(term=term("elbow", 0, effect="richer"))
    gains[likelier.term.key] = 20.0
    monkeypatch.setattr(rivals, "richer_laws", lambda model_fit, own, refiner: [likelier])
    monkeypatch.setattr(rivals, "try_term", lambda model_fit, own: SimpleNamespace(term=own))
    asked: list[float] = []

    def as_good(own: SimpleNamespace, rival: SimpleNamespace, lead: object, decided: float) -> bool:
        asked.append(decided)
        return bool(rival.term.candidate.effect.id == "equal" or rival.term is there)

    monkeypatch.setattr(rivals, "_equal", as_good)
    monkeypatch.setattr(rivals, "_open", lambda rival, own: True)
    monkeypatch.setattr(rivals, "refit", lambda own: own.term)
    monkeypatch.setattr(rivals, "correlation_surplus", lambda refitted, groups: 3.0)
    monkeypatch.setattr(rivals, "_named", lambda candidate, why: (candidate.effect.id, candidate.key))
    monkeypatch.setattr(rivals, "_reason", lambda own, rival: "worse")
    layouts = [SimpleNamespace(shaped=SimpleNamespace(key=one.key), term=one) for one in offered]
    selector = SimpleNamespace(
        model_fit=lambda rest: rest,
        screen=SimpleNamespace(rank=lambda model_fit: layouts),
        trial=lambda model_fit, layout: SimpleNamespace(term=layout.term),
        refined=lambda model_fit, trials: trials,
        unphysical=lambda rival: None,
        refiner=None,
    )
    found = rivals.judge_rivals(selector, [cause, other], cause, lambda fit: 0.0)
    assert found.equal == (("equal", "elbow"),)
    assert found.elsewhere == ("sensor",)
    assert found.lost == (("worse", "elbow"), ("larger", "elbow"), ("richer", "elbow"))
    assert found.standing == Standing(100.0, 70.0)
    assert set(asked) == {3.0 * rivals.DECIDED}


def test_of_two_trials_of_one_candidate_the_likelier_one_counts(monkeypatch: pytest.MonkeyPatch) -> None:
    coarse, fine, other = (SimpleNamespace(term=term(key, 0), gain=gain) for key, gain in
                           (("elbow", 1.0), ("elbow", 2.0), ("wrist", 3.0)))  # fmt: skip
    monkeypatch.setattr(rivals, "penalised_gain", lambda trial: trial.gain)
    assert rivals.best_of_names([coarse, other], [fine]) == [fine, other]
    assert rivals.best_of_names([fine, other], [coarse]) == [fine, other]
    assert rivals.best_of_names([other], [coarse]) == [other, coarse]


@pytest.mark.parametrize("undecided", [False, True])
def test_a_rival_that_cannot_be_is_none_unless_nothing_about_it_is_seen(monkeypatch, undecided: bool) -> None:
    monkeypatch.setattr(rivals, "_equal", lambda own, rival, lead, decided: True)
    monkeypatch.setattr(rivals, "_open", lambda rival, own: undecided)
    selector = SimpleNamespace(unphysical=lambda rival: f"{rival} is a command's noise")
    reason = rivals._lost(selector, "cause", "lag", lambda rival: 0.0, 5.0)
    assert reason == (None if undecided else "lag is a command's noise")


@pytest.mark.parametrize(("together", "alone", "found"), [(0.2, 1.0, 3), (0.2, 0.5, 0), (0.4, 2.0, 0)])
def test_the_laws_of_a_drive_begin_together_if_no_single_one_does_nearly_as_much(
    monkeypatch: pytest.MonkeyPatch, together: float, alone: float, found: int
) -> None:
    """Of 1 that the model leaves, all of them leave ``together``, the best one ``alone``."""
    laws = [term("elbow", 0, effect=effect) for effect in ("dry", "viscous", "rotor")]
    monkeypatch.setattr(
        geared_start, "_drive_laws", lambda model_fit: {"elbow": [[SimpleNamespace(groups=(0,))]]}
    )
    monkeypatch.setattr(geared_start, "_best", lambda *rest: (together, laws))
    monkeypatch.setattr(geared_start, "_all_pass", lambda *rest: True)
    model_fit = SimpleNamespace(unseen={0: {0: np.array([1.0])}})
    single = [SimpleNamespace(term=laws[0], unseen={0: {0: np.array([np.sqrt(alone)])}})]
    started = geared_start.geared_start_model(
        model_fit, lambda terms: None, lambda fit: single, lambda trial: None
    )
    assert started == tuple(laws[:found])


@pytest.mark.parametrize(
    ("port", "gain", "reason", "exchanged"),
    [
        ("actuator", 71.0, None, True),
        ("actuator", 69.0, None, False),
        ("actuator", 71.0, "harms", False),
        ("link", 71.0, None, False),
    ],
)
def test_one_law_takes_the_place_of_two_if_it_is_likelier_than_both(
    monkeypatch, port, gain, reason, exchanged
):
    """Both are 72 nats likelier than neither, for a penalty of 7; one law costs 5. Other causes stay."""
    friction, offset = (
        term("elbow", 0, effect="coulomb_friction"),
        term("elbow", 0, effect="torque_offset", port=port),
    )
    other = term("wrist", 1, effect="torque_offset")
    one = term("elbow", 0, effect="asymmetric_friction")
    penalty = {id(friction): 4.0, id(offset): 3.0, id(one): 5.0}
    likelihood = {id(friction): 42.0, id(offset): 30.0, id(other): 0.0, id(one): gain}

    def fitted(model):
        return SimpleNamespace(
            model=list(model), log_likelihood=np.array([sum(likelihood[id(m)] for m in model)])
        )

    selector = Selector.__new__(Selector)
    shaped = [
        SimpleNamespace(shaped=SimpleNamespace(key=made.key, candidate=made.candidate), term=made)
        for made in (friction, offset, one)
    ]
    selector.design = SimpleNamespace(layouts=shaped)
    monkeypatch.setattr(Selector, "model_fit", lambda self, model: fitted(model))
    monkeypatch.setattr(
        Selector, "trial", lambda self, fit, layout: SimpleNamespace(term=layout.term, model_fit=fit)
    )
    monkeypatch.setattr(Selector, "refined", lambda self, fit, trials: list(trials))
    monkeypatch.setattr(Selector, "rejection_reason", lambda self, trial: reason)
    monkeypatch.setattr(forward_selection, "try_term", lambda fit, made: SimpleNamespace(term=made))
    monkeypatch.setattr(
        forward_selection, "refit", lambda trial: fitted([trial.term, *trial.model_fit.model])
    )
    monkeypatch.setattr(forward_selection, "bic_penalty", lambda trial: penalty[id(trial.term)])
    monkeypatch.setattr(forward_selection, "penalised_gain", lambda trial: gain - penalty[id(trial.term)])
    found = selector.one_for_two([friction, other, offset])
    assert found == ([one, other] if exchanged else [friction, other, offset])


@pytest.mark.parametrize(("removed", "shape"), [((0,), 0.06), ((1,), 0.28)])
def test_a_shape_that_another_cause_had_bent_is_found_anew(
    monkeypatch: pytest.MonkeyPatch, removed: tuple[int, ...], shape: float
) -> None:
    """A lag beside a controller's gain went to 0.28 s; without the gain 0.06 s is likelier. Others stay."""

    def lag(time: float) -> SimpleNamespace:
        one = term("elbow", 0, effect="actuator_lag")
        one.generic, one.shaped, one.gain = False, SimpleNamespace(shape={"T": time}), -abs(time - 0.06)
        return one

    bent, other = lag(0.28), term("wrist", 1)
    other.generic, other.shaped = False, SimpleNamespace(shape={})
    layouts = [SimpleNamespace(shaped=SimpleNamespace(key=bent.key), made=lag(time)) for time in (0.01, 0.06)]
    layouts.append(SimpleNamespace(shaped=SimpleNamespace(key=other.key), made=other))
    monkeypatch.setattr(forward_selection, "_moves", lambda one: bool(one.shaped.shape))

    def tried(one: SimpleNamespace) -> SimpleNamespace:
        return SimpleNamespace(term=one, gain=one.gain, outside=False)

    monkeypatch.setattr(forward_selection, "try_term", lambda rest, one: tried(one))
    selector = SimpleNamespace(
        model_fit=lambda model: SimpleNamespace(model=tuple(model)),
        design=SimpleNamespace(layouts=layouts),
        trial=lambda rest, layout: tried(layout.made),
        refined=lambda rest, trials: trials,
    )
    kept = Selector.reshaped(selector, [bent, other], [term("knee", *removed)])
    assert kept[0].shaped.shape["T"] == shape and kept[1] is other


@pytest.mark.parametrize(
    ("moved", "outside", "time"), [(9.9, False, 15.0), (9.9, True, 36.0), (10.1, True, 15.0)]
)
def test_of_two_shapes_the_one_with_physical_numbers_is_kept(
    monkeypatch: pytest.MonkeyPatch, moved: float, outside: bool, time: float
) -> None:
    """On the grid a friction fades to less than none in 36 s; in 15 s it does not, and fits about as well."""

    def made(seconds: float, gain: float, outside: bool) -> SimpleNamespace:
        fading = SimpleNamespace(seconds=seconds, generic=False, gain=gain, outside=outside)
        in_sample = SimpleNamespace(gain=gain)
        return SimpleNamespace(term=fading, gain=gain, outside=outside, in_sample=in_sample)

    monkeypatch.setattr(forward_selection, "_moves", lambda one: True)
    other = made(15.0, moved, outside)
    monkeypatch.setattr(forward_selection, "try_term", lambda fit, one: other)
    selector = SimpleNamespace(refiner=SimpleNamespace(refine=lambda fit, one: other.term))
    (kept,) = Selector.refined(selector, None, [made(36.0, 10.0, True)])
    assert kept.term.seconds == time
