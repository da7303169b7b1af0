# SPDX-License-Identifier: BSD-3-Clause
"""Noise beside a knock: a flexible model bends to it, and one that hardly looks at it does not."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from impedance_modules.diagnosis.regression.noise_floor import Left, fit_robustly

RATE = 50.0
TIME = np.arange(0.0, 28.0, 1.0 / RATE)
FLEXIBLE = np.column_stack([np.sin(k * TIME) for k in range(1, 30)] + [np.cos(k * TIME) for k in range(30)])


def heard(seed: int, knock: float):
    """Noise of one and a knock of half a second, heard through a flexible model; two recordings."""
    y = np.random.default_rng(seed).standard_normal(len(TIME))
    y[np.abs(TIME - 9.0) < 0.25] += knock

    def fit(weights: np.ndarray | None) -> Left:
        root = np.ones(len(y)) if weights is None else np.sqrt(weights)
        solution = np.linalg.lstsq(FLEXIBLE * root[:, None], y * root, rcond=None)[0]
        return list(np.split(y - FLEXIBLE @ solution, 2)), float(FLEXIBLE.shape[1])

    return fit_robustly(fit, RATE)


def power(left: Left) -> float:
    every = np.concatenate(left[0])
    return float(every @ every) / (len(every) - left[1])


@settings(max_examples=25)
@given(st.integers(0, 10_000), st.floats(25.0, 500.0))
def test_a_knock_does_not_raise_the_noise(seed: int, knock: float) -> None:
    found = heard(seed, knock)
    assert found.disturbed
    assert 0.6 < power(found.robust) < 1.5 < power(found.ordinary)


@settings(max_examples=25)
@given(st.integers(0, 10_000))
def test_noise_alone_was_never_struck(seed: int) -> None:
    found = heard(seed, 0.0)
    assert not found.disturbed
    assert 0.7 < power(found.ordinary) < 1.4


def test_what_is_loud_for_long_is_no_knock() -> None:
    y = np.random.default_rng(5).standard_normal(len(TIME)) * np.where(np.sin(TIME) > 0.7, 40.0, 1.0)
    found = fit_robustly(lambda weights: (list(np.split(y, 2)), 0.0), RATE)
    assert not found.disturbed
    assert found.robust is found.ordinary
