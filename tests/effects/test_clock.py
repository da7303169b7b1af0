# SPDX-License-Identifier: BSD-3-Clause
"""Streams with a clock of their own are found however far they have run away."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from impedance_modules.effects.catalogue import CATALOGUE
from impedance_modules.effects.regressor import Site
from impedance_modules.effects.residual_kinds import Residual
from tests.effects.test_effects_catalogue import at_rest, recording


def tones(random: np.random.Generator, joints: int) -> Callable[[np.ndarray], np.ndarray]:
    """Some tones below 2 Hz at each joint, as a function of time."""
    hz, phases = random.uniform(0.3, 2.0, (2, joints)), random.uniform(0.0, 6.0, (2, joints))
    return lambda t: np.asarray(np.sin(2.0 * np.pi * hz * t[:, None, None] + phases).sum(axis=1))


def found_step_by_step(
    site: Site, residual: Residual, start: dict[str, float], changed: np.ndarray
) -> dict[str, float]:
    """A clock's numbers by a few steps from a shape, as the regression does them, away from a recording's ends."""
    clock, shape = CATALOGUE["clock_drift"], start
    for _ in range(6):
        found = clock.regressor(site, residual, shape)
        assert found is not None
        inner = slice(100, -100)
        columns = found.columns[inner].reshape(-1, found.columns.shape[2])
        numbers, *_ = np.linalg.lstsq(columns, (changed - found.fixed)[inner].ravel(), rcond=None)
        values = clock.values(numbers, shape, site)
        shape = clock.next_shape(values, shape)
    again, _ = clock.coefficients(values, site)
    np.testing.assert_array_equal(again, np.zeros(len(numbers)))
    assert clock.values(again, shape, site) == pytest.approx(values)
    return values


@given(st.integers(0, 2**32 - 1), st.floats(-5e-3, 5e-3), st.sampled_from([1.0, 3.0]))
@settings(max_examples=10, deadline=None)
def test_a_clock_that_has_run_away_by_a_tenth_of_a_second_is_found(
    seed: int, drift: float, stream: float
) -> None:
    """Readings or velocities at t show what was at t / (1 + c): after 30 s that is 0.15 s ago.

    To first order in c alone the rate would come out a third too small.
    """
    s = recording()
    at, time = tones(np.random.default_rng(seed), s.n), np.arange(3000) / 100.0
    if stream == 1.0:
        run, residual = at_rest(s, time, drive=at(time)), "actuator"
        changed = at(time) - at(time / (1.0 + drift))
    else:
        run, residual = at_rest(s, time, spring_compliance=np.zeros(s.n)), "velocity"
        run = replace(run, velocity=at(time))
        changed = at(time / (1.0 + drift)) - at(time)
    values = found_step_by_step(Site(run, "log", "timing"), residual, {"apart": stream, "ppm": 0.0}, changed)
    assert values["ppm"] == pytest.approx(1e6 * drift, rel=0.01, abs=2.0)


@given(st.integers(0, 2**32 - 1), st.sampled_from([("actuator", -1.0), ("link", 1.0), ("drive", -1.0)]))
@settings(max_examples=10, deadline=None)
def test_efforts_with_a_clock_of_their_own_are_found(seed: int, residual: tuple[Residual, float]) -> None:
    """Efforts at t show what was at (t - T) / (1 + c): rate and age from what that changes in a residual."""
    name, sign = residual
    random = np.random.default_rng(seed)
    drift, late = float(random.uniform(-1e-3, 1e-3)), float(random.uniform(-0.05, 0.05))
    s = recording()
    given_at, time = tones(random, s.n), np.arange(1200) / 100.0
    shown = given_at((time - late) / (1.0 + drift))
    source = "motor" if name == "drive" else "joint_sensor"
    late_one = at_rest(s, time, drive=np.zeros((time.size, s.n)), effort=shown, effort_source=source)
    changed = sign * (shown - given_at(time))
    start = {"apart": 2.0, "ppm": 0.0, "T": 0.0}
    values = found_step_by_step(Site(late_one, "log", "timing"), name, start, changed)
    assert values["ppm"] == pytest.approx(1e6 * drift, rel=0.02, abs=10.0)
    assert values["T"] == pytest.approx(late, rel=0.02, abs=1e-4)
