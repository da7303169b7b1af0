# SPDX-License-Identifier: BSD-3-Clause
"""Errors in variables: what a column and its residual share of one noise is no cause, what the motion makes is."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from impedance_modules.diagnosis.model_selection.instruments import (
    below,
    beyond_fit,
    beyond_model,
    comes_back,
    follows_load,
    holds_when_slow,
)
from impedance_modules.effects.catalogue import CATALOGUE
from impedance_modules.effects.regressor import Site
from tests.effects.test_effects_catalogue import recording

SAMPLES, SLOW = 1500, 0.1
MOTION = np.cumsum(np.sin(np.arange(SAMPLES) / 9.0)) / 9.0


def fast_noise(random: np.random.Generator) -> np.ndarray:
    """Noise of positions, twice differentiated, of unit power: it grows with the square of the frequency."""
    noise = np.gradient(np.gradient(random.standard_normal(SAMPLES)))
    return noise / noise.std()


def trial(*recordings: tuple[np.ndarray, np.ndarray], key: str = "viscous_friction", port: str = "link"):
    """One column fitted to one residual per recording, beside a model that has nothing."""
    columns = [{0: x[:, None]} for x, _ in recordings]
    left = [[y] for _, y in recordings]
    both = sum(float(x @ y) for x, y in recordings)
    own = np.array([both / sum(float(x @ x) for x, _ in recordings)])
    model_fit = SimpleNamespace(
        fitted=range(len(recordings)),
        weights=np.ones(1),
        ids=[np.zeros(0, dtype=int)],
        rows=[[np.zeros((len(x), 0))] for x, _ in recordings],
        whole=SimpleNamespace(coefficients=np.zeros(0), inverse=np.zeros((0, 0))),
        size=0,
        residuals=lambda coefficients, r: left[r],
    )
    candidate = SimpleNamespace(effect=CATALOGUE[key], port=port)
    term = SimpleNamespace(columns=columns, fixed=[{}] * len(columns), candidate=candidate)
    return SimpleNamespace(
        term=term, model_fit=model_fit, in_sample=SimpleNamespace(own=own, beside=np.zeros(0))
    )


@given(st.integers(0, 2**32 - 1), st.floats(-3.0, 3.0).filter(lambda c: abs(c) > 0.3), st.floats(0.0, 1.0))
@settings(max_examples=40)
def test_what_the_motion_makes_is_confirmed(seed: int, size: float, noise: float) -> None:
    random = np.random.default_rng(seed)
    pair = [(MOTION, size * MOTION + noise * random.standard_normal(SAMPLES)) for _ in range(2)]
    assert comes_back(trial(*pair), [(1, 0)]) and holds_when_slow(trial(*pair), SLOW)


@given(st.integers(0, 2**32 - 1), st.floats(0.3, 1.0))
@settings(max_examples=40)
def test_what_column_and_residual_share_of_one_noise_is_not(seed: int, share: float) -> None:
    """The column is mostly motion, the residual has none of it: the same accelerations' noise is in both."""
    random = np.random.default_rng(seed)
    shared = [fast_noise(random) for _ in range(2)]
    fitted = trial(*((3.0 * MOTION + share * noise, -noise) for noise in shared))
    assert fitted.in_sample.own[0] < 0.0
    assert not comes_back(fitted, [(1, 0)]) and not holds_when_slow(fitted, SLOW)


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=20)
def test_what_is_fast_by_itself_is_left_to_repeats(seed: int) -> None:
    """Ripple of a fast joint: its slow part is next to nothing and says nothing."""
    random = np.random.default_rng(seed)
    ripple = np.sin(2.0 * np.arange(SAMPLES))
    pair = [(ripple, 0.5 * ripple + 0.3 * random.standard_normal(SAMPLES)) for _ in range(2)]
    assert holds_when_slow(trial(*pair), SLOW) and comes_back(trial(*pair), [(1, 0)])


def test_repeats_of_unequal_length_are_compared_where_both_are() -> None:
    short = MOTION[:900]
    assert comes_back(trial((MOTION, MOTION), (short, short)), [(1, 0)])
    other = np.random.default_rng(1).standard_normal(900)
    assert not comes_back(trial((MOTION, other.repeat(2)[:SAMPLES]), (other, MOTION[:900])), [(1, 0)])


@pytest.mark.parametrize("pairs", [[], [(1, 0)]])
def test_nothing_speaks_against_a_cause_that_nothing_shows(pairs: list[tuple[int, int]]) -> None:
    zero = np.zeros(50)
    nothing = trial((zero + 1e-30, zero), (zero + 1e-30, zero))
    assert comes_back(nothing, pairs) and holds_when_slow(nothing, SLOW)


@pytest.mark.parametrize(
    ("key", "port", "free"),
    [
        ("command_delay", "timing", True),
        ("clock_drift", "timing", True),
        ("torque_gain", "actuator", True),
        ("torque_gain", "sensor", False),
        ("viscous_friction", "link", False),
    ],
)
def test_what_follows_the_command_may_follow_its_noise(key: str, port: str, free: bool) -> None:
    one, other = np.random.default_rng(3).standard_normal((2, 800))
    assert comes_back(trial((one, one), (other, other), key=key, port=port), [(1, 0)]) is free


@given(st.integers(0, 2**32 - 1), st.floats(0.5, 1.0), st.floats(0.1, 2.0))
@settings(max_examples=40)
def test_of_a_command_what_both_repeats_hold_must_come_back(seed: int, share: float, size: float) -> None:
    """A controller's answer to the noise of positions is no gain; a gain that is off acts on motion and noise alike."""
    random = np.random.default_rng(seed)
    shared = [fast_noise(random) for _ in range(2)]
    rest = [0.1 * random.standard_normal(SAMPLES) for _ in range(2)]
    commands = [3.0 * MOTION + share * noise for noise in shared]
    answer = trial(
        *((u, e - noise) for u, e, noise in zip(commands, rest, shared, strict=True)),
        key="torque_gain",
        port="actuator",
    )
    gain = trial(
        *((u, e + size * u) for u, e in zip(commands, rest, strict=True)), key="torque_gain", port="actuator"
    )
    assert not comes_back(answer, [(1, 0)]) and comes_back(gain, [(1, 0)])


def test_a_part_that_the_model_makes_too_counts_for_nothing() -> None:
    one = trial((MOTION, MOTION))
    one.model_fit.ids = [np.zeros(1, dtype=int)]
    one.model_fit.rows = [[0.25 * MOTION[:, None]]]
    one.model_fit.whole.coefficients, one.in_sample.beside = np.array([3.0]), np.array([1.0])
    x, y = beyond_model(one, 0)[0]
    np.testing.assert_allclose(x, MOTION - 0.5 * MOTION)
    np.testing.assert_allclose(y, MOTION)


def test_below_keeps_slow_samples_and_takes_fast_ones() -> None:
    t = np.arange(2000)
    slow, fast = np.sin(2.0 * np.pi * 0.02 * t), np.sin(2.0 * np.pi * 0.3 * t)
    np.testing.assert_allclose(below(slow + fast, 0.1), slow, atol=1e-9)


@given(st.integers(0, 2**32 - 1), st.floats(0.2, 1.5), st.floats(0.2, 2.0))
@settings(max_examples=40)
def test_a_gain_must_show_where_the_motion_needs_torque(seed: int, carried: float, gain: float) -> None:
    """A command u = carried load + noise n: a drive that gives (1 - g) u leaves g u; one that filters n leaves n."""
    random = np.random.default_rng(seed)
    noise = random.standard_normal(SAMPLES)
    command, sensor = carried * MOTION + noise, 0.1 * random.standard_normal(SAMPLES)
    load = trial((MOTION, MOTION)).term
    assert follows_load(trial((command, gain * command + sensor)), load)
    assert not follows_load(trial((command, noise + sensor)), load)


def test_a_limit_that_the_motion_never_reaches_is_left_to_others() -> None:
    """Where nothing of a candidate is made of the torque that is needed, that torque cannot tell."""
    assert follows_load(
        trial((MOTION, MOTION)), SimpleNamespace(columns=[{0: 0.0 * MOTION[:, None]}], fixed=[{}])
    )


@given(st.integers(0, 2**32 - 1), st.floats(-2.0, 2.0))
@settings(max_examples=20)
def test_what_the_model_can_make_of_a_load_confirms_nothing(seed: int, share: float) -> None:
    """Links may be heavier: only what is left of the needed torque beside them is an instrument."""
    random = np.random.default_rng(seed)
    own, link = random.standard_normal((2, SAMPLES))
    one = trial((own, own))
    model_fit = one.model_fit
    model_fit.size, model_fit.ids, model_fit.rows = 1, [np.array([0])], [[link[:, None]]]
    model_fit.whole = SimpleNamespace(coefficients=np.zeros(1), inverse=np.array([[1.0 / (link @ link)]]))
    one.in_sample.beside = np.zeros(1)
    (parts,) = beyond_fit(model_fit, trial((own + share * link, own)).term, one.in_sample.own).values()
    assert parts[0] @ link == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize(
    ("effect", "port"),
    [("torque_gain", "actuator"), ("actuator_lag", "actuator"), ("command_delay", "timing"),
     ("torque_saturation", "actuator")],
)  # fmt: skip
def test_what_is_made_of_a_command_is_made_of_the_needed_torque_as_well(effect: str, port: str) -> None:
    """With the load in the command's place the column is that of a command which is the load."""
    law, s = CATALOGUE[effect], recording()
    site = Site(replace(s, drive=s.rigid, clean_drive=None, assistance=None), "port_lift", port)
    (shape, *_) = law.shapes(site)
    needed = law.by_load(port, shape)
    other = Site(replace(site.signals, drive=s.rigid + 1.0), site.key, port)
    own, same = law.regressor(site, "actuator", shape), law.regressor(other, "actuator", needed)
    np.testing.assert_allclose(same.torque(np.array([0.1])), own.torque(np.array([0.1])))
    assert law.by_load("sensor", shape) is None or effect != "torque_gain"
