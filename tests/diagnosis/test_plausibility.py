# SPDX-License-Identifier: BSD-3-Clause
"""A cause whose columns do not come back in repeats of one motion is noise, and the arm's answer to it."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from impedance_modules.diagnosis.model_selection.plausibility import comes_back
from impedance_modules.effects.catalogue import CATALOGUE


def _trial(
    *columns: np.ndarray, key: tuple[str, str, str] = ("reflected_inertia", "s0", "actuator")
) -> SimpleNamespace:
    """A candidate with one column in two groups of each recording."""
    term = SimpleNamespace(
        key=key,
        candidate=SimpleNamespace(effect=CATALOGUE[key[0]], port=key[2]),
        columns=tuple({0: c[:, None], 2: -0.5 * c[:, None]} for c in columns),
        fixed=({},) * len(columns),
    )
    return SimpleNamespace(term=term, in_sample=SimpleNamespace(own=np.array([-2.0])))


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
