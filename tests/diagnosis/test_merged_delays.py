# SPDX-License-Identifier: BSD-3-Clause
"""Three joints that are delayed have one reason, a delayed bus, where that explains the recordings about as well."""

from types import SimpleNamespace

import numpy as np
import pytest

from impedance_modules.diagnosis.model_selection import backward_elimination
from impedance_modules.diagnosis.model_selection.backward_elimination import merge_delays
from impedance_modules.effects.catalogue import CATALOGUE

WEIGHTS = np.array([1.0, 0.5])


def term(effect: str, joint: str, time: float = 0.01) -> SimpleNamespace:
    candidate = SimpleNamespace(effect=CATALOGUE[effect], key=joint)
    return SimpleNamespace(key=(effect, joint, "timing"), candidate=candidate, time=time)


def layout(effect: str, joint: str, time: float) -> SimpleNamespace:
    return SimpleNamespace(
        shaped=SimpleNamespace(candidate=term(effect, joint).candidate), made=term(effect, joint, time)
    )


GRID = [
    layout("command_delay", "c", 0.008), layout("command_delay", "c", 0.012), layout("command_delay", "d", 0.010),
    layout("actuator_lag", "c", 0.010), SimpleNamespace(shaped=SimpleNamespace(candidate=None)),
]  # fmt: skip
"""Delays of joint c and d on a grid, a lag, and a generic regressor."""


@pytest.fixture
def merged(monkeypatch):
    """Merges; a delay of joint c is best at 12 ms, and in a lag's place leaves a loss [nats] more."""
    monkeypatch.setattr(backward_elimination, "term_of", lambda design, one: one.made)

    def try_term(fit, one):
        assert all(other.key != ("actuator_lag", one.key[1], "timing") for other in fit.model)
        return SimpleNamespace(term=one, in_sample=SimpleNamespace(gain=-abs(one.time - 0.0121)))

    monkeypatch.setattr(backward_elimination, "try_term", try_term)

    def run(model: list, loss: float, grid=GRID, mixed: float = 0.0) -> list[tuple[str, str, float]]:
        def make(chosen):
            lags = sum(one.key[0] == "actuator_lag" for one in chosen)
            less = 4.0 * mixed if lags in (1, len(chosen)) else 0.0
            left = np.array([100.0, 50.0 - 4.0 * loss * lags - less])
            return SimpleNamespace(
                model=chosen, left=left, weights=WEIGHTS, design=SimpleNamespace(layouts=grid)
            )

        refiner = SimpleNamespace(refine=lambda fit, one: term(one.key[0], one.key[1], one.time + 1e-4))
        return [(one.key[0], one.key[1], one.time) for one in merge_delays(model, make, refiner)]

    return run


def given(model: list) -> list[tuple[str, str, float]]:
    return [(one.key[0], one.key[1], one.time) for one in model]


DELAYED = [term("command_delay", "a"), term("command_delay", "b"), term("actuator_lag", "c")]


@pytest.mark.parametrize("loss", [-1.0, 0.0, 4.9])
def test_a_lag_beside_two_delays_becomes_the_best_delay(merged, loss: float) -> None:
    model = [DELAYED[0], DELAYED[2], DELAYED[1], term("viscous_friction", "c")]
    expected = given(model)
    expected[1] = ("command_delay", "c", 0.0121)
    assert merged(model, loss) == expected


def test_a_lag_that_explains_clearly_more_stays(merged) -> None:
    assert merged(DELAYED, 5.1) == given(DELAYED)


@pytest.mark.parametrize(
    "model",
    [
        DELAYED[1:],
        [term("actuator_lag", joint) for joint in "abc"],
        [*DELAYED[:2], term("viscous_friction", "c")],
        [DELAYED[0], term("command_delay", "c"), DELAYED[2], term("viscous_friction", "b")],
        [*DELAYED[:2], term("command_delay", "c"), term("actuator_lag", "c")],
        [],
    ],
)  # fmt: skip
def test_without_a_common_reason_nothing_is_merged(merged, model) -> None:
    assert merged(model, 0.0) == given(model)


def test_without_a_delay_among_the_candidates_a_lag_stays(merged) -> None:
    assert merged(DELAYED, 0.0, GRID[2:]) == given(DELAYED)


def test_lags_are_exchanged_together_where_each_alone_would_lose(merged):
    joints = "cd"
    model = [
        term("command_delay", "a"),
        term("command_delay", "b"),
        *(term("actuator_lag", j) for j in joints),
    ]
    found = merged(model, loss=1.0, mixed=-100.0)
    assert [name for name, _, _ in found] == ["command_delay"] * 4
