# SPDX-License-Identifier: BSD-3-Clause
"""Choosing causes: which of several goes when not all are needed, which are noise, and what may stand behind one."""

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from impedance_modules.diagnosis.model_selection import backward_elimination
from impedance_modules.diagnosis.model_selection.conclusion import compensation_note
from impedance_modules.diagnosis.model_selection.plausibility import comes_back
from impedance_modules.effects.catalogue import CATALOGUE

SPRING, OFFSET, ASYMMETRY = (
    SimpleNamespace(name=name, groups=(group,))
    for name, group in (("spring", 0), ("offset", 2), ("asymmetry", 2))
)
ELIMINATED = {
    "what passes its tests stays": ([SPRING, OFFSET], lambda name, beside: True, ["spring", "offset"]),
    "what fails them goes": ([SPRING, OFFSET], lambda name, beside: name == "spring", ["spring"]),
    # An asymmetry takes over part of an offset's work and is nothing without it: the offset is the cause.
    "what depends on another cause goes before that": (
        [SPRING, OFFSET, ASYMMETRY],
        lambda name, beside: {"offset": "asymmetry" not in beside, "asymmetry": "offset" in beside}.get(name, True),
        ["spring", "offset"],
    ),
    "what another cause replaces goes": (
        [OFFSET, ASYMMETRY],
        lambda name, beside: name != "offset" or "asymmetry" not in beside,
        ["asymmetry"],
    ),
    "what depends on it does not keep a cause that is none": (
        [OFFSET, ASYMMETRY],
        lambda name, beside: name == "asymmetry" and "offset" in beside,
        [],
    ),
}  # fmt: skip
"""A model, whether a cause stands beside others, and what is left of the model."""


@pytest.mark.parametrize("rule", ELIMINATED)
def test_backward_elimination(monkeypatch, rule) -> None:
    model, stands, left = ELIMINATED[rule]
    monkeypatch.setattr(
        backward_elimination, "try_term", lambda beside, one: (one, {other.name for other in beside})
    )

    def objection(trial):
        return None if stands(trial[0].name, trial[1]) else "no"

    found = backward_elimination.eliminate_backward(model, list, objection)
    assert [one.name for one in found] == left


def _trial(*columns: np.ndarray, key=("reflected_inertia", "s0", "actuator")) -> SimpleNamespace:
    """A candidate with one column in two groups of each recording."""
    term = SimpleNamespace(
        key=key,
        candidate=SimpleNamespace(effect=CATALOGUE[key[0]], port=key[2]),
        columns=tuple({0: c[:, None], 2: -0.5 * c[:, None]} for c in columns),
        fixed=({},) * len(columns),
    )
    return SimpleNamespace(term=term, in_sample=SimpleNamespace(own=np.array([-2.0])))


# A cause whose columns do not come back in repeats of one motion is noise, and the arm's answer to it.


@given(st.integers(0, 10_000), st.floats(0.0, 4.0))
def test_what_counts_is_the_part_of_a_column_that_the_motion_makes(seed: int, noise: float) -> None:
    random = np.random.default_rng(seed)
    motion = random.standard_normal(5000)
    trial = _trial(*(motion + noise * random.standard_normal(5000) for _ in range(2)))
    share = 1.0 / (1.0 + noise**2)
    if abs(share - 0.5) > 0.06:
        assert comes_back(trial, [(1, 0)]) is (share > 0.5)


def test_repeats_of_unequal_length_are_compared_where_both_are() -> None:
    motion = np.sin(np.arange(400) / 9.0)
    assert comes_back(_trial(motion, motion[:390]), [(1, 0)])
    assert not comes_back(_trial(motion, -motion[:390]), [(1, 0)])


@pytest.mark.parametrize("pairs", [[], [(1, 0)]])
def test_nothing_speaks_against_a_cause_that_no_repeat_shows(pairs: list[tuple[int, int]]) -> None:
    zero = np.zeros(50)
    assert comes_back(_trial(zero, zero), pairs)


@pytest.mark.parametrize(
    ("key", "free"),
    [
        (("command_delay", "s0", "timing"), True),
        (("torque_gain", "s0", "actuator"), True),
        (("torque_gain", "s0", "sensor"), False),
        (("viscous_friction", "s0", "link"), False),
    ],
)
def test_what_follows_the_command_may_follow_its_noise(key: tuple[str, str, str], free: bool) -> None:
    one, other = np.random.default_rng(3).standard_normal((2, 800))
    assert comes_back(_trial(one, other, key=key), [(1, 0)]) is free


def recording(compensation: str = "robot", residuals: tuple[str, ...] = ("link", "actuator", "velocity")):
    return SimpleNamespace(residuals=residuals, log=SimpleNamespace(gravity_compensation=compensation))


def cause(effect: str, *equivalent: str):
    also = tuple(SimpleNamespace(effect=name) for name in equivalent)
    return SimpleNamespace(effect=effect, joints=("elbow",), equivalent=also)


@pytest.mark.parametrize(
    ("causes", "named"),
    [
        ([cause("crosstalk")], "crosstalk on elbow"),
        ([cause("viscous_friction"), cause("parallel_spring")], None),
        ([cause("parallel_spring"), cause("crosstalk")], None),
        ([cause("torque_offset", "parallel_spring")], "torque_offset on elbow"),
        ([cause("viscous_friction", "coulomb_friction")], None),
        ([], None),
    ],
)
def test_the_note_names_what_such_a_spring_may_be_behind(causes, named) -> None:
    found = compensation_note([recording(), recording()], causes)
    assert len(found) == (named is not None)
    if named is not None:
        assert found[0].startswith(f"{named}: ") and "without effort_command" in found[0]


@pytest.mark.parametrize(
    "other",
    [
        recording("none"),
        recording("command"),
        recording("robot", ("link",)),
        recording("robot", ("actuator",)),
    ],
)
def test_without_commands_sensors_or_compensation_there_is_no_such_spring(other) -> None:
    assert compensation_note([recording(), other], [cause("crosstalk")]) == ()
