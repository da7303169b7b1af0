# SPDX-License-Identifier: BSD-3-Clause
"""A segment of a recording begins in the middle of a motion: bristles are bent there, and filters have not settled."""

from dataclasses import fields, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from impedance_modules.diagnosis.data.log import PATH_BEFORE, Log
from impedance_modules.effects.recorded_signals import lagged
from tests.diagnosis.test_diagnosis import JOINTS, RATE, answer, motion, torque
from tests.support.effect_recordings import record
from tests.support.recordings import columns_of, save

STEP = 1.0 / RATE


@settings(max_examples=50, deadline=None)
@given(
    seed=st.integers(0, 9999), constant=st.floats(0.002, 2.0), cut=st.integers(1, 180), uneven=st.booleans()
)
def test_a_lag_that_starts_with_what_it_gave_goes_on_as_it_did(seed, constant, cut, uneven):
    random = np.random.default_rng(seed)
    steps = np.full(200, STEP) * (random.uniform(0.5, 1.5, 200) if uneven else 1.0)
    time, values = np.cumsum(steps), random.normal(size=200)
    whole = lagged(values, time, constant)
    part = lagged(values[cut:], time[cut:], constant, float(whole[cut]))
    np.testing.assert_allclose(part, whole[cut:], atol=1e-12)


def log_of(position):
    return Log("log", "log", RATE, position, None, None, None, None, None, "none")


@pytest.mark.parametrize("first", [0, 7, 1200, 3600])
def test_a_part_keeps_the_last_half_minute_of_the_path_before_it(first):
    position = np.random.default_rng(0).normal(size=(4000, 2))
    path = log_of(position).part(first, 4000).path_before
    if first == 0:
        assert path is None
    else:
        np.testing.assert_array_equal(path, position[max(0, first - round(PATH_BEFORE * RATE)) : first])


@settings(max_examples=20, deadline=None)
@given(
    first=st.integers(1, 700),
    stretch=st.floats(0.1, 1.0),
    exponent=st.floats(1.0, 2.0),
    motor_side=st.booleans(),
)
def test_bristles_of_a_segment_are_bent_by_the_path_before_it(first, stretch, exponent, motor_side):
    whole = record(()).signals
    arrays = {
        place.name: getattr(whole, place.name)[first:]
        for place in fields(whole)
        if np.shape(getattr(whole, place.name))[:1] == (whole.samples,)
    }
    segment = replace(whole, **arrays, path_before=whole.position[:first])
    for joint in range(0, whole.n, 3):
        bent = whole.bristles(joint, stretch, exponent, motor_side=motor_side)[first:]
        found = segment.bristles(joint, stretch, exponent, motor_side=motor_side)
        # Before the segment nobody knows the spring's bend; it is taken as at its beginning.
        away = 0.15 if motor_side else 1e-9
        np.testing.assert_allclose(found, bent, atol=away)


def test_what_lags_is_explained_in_segments_of_one_recording(tmp_path):
    """A filter that has settled would leave tens of times the noise at the beginning of each segment."""
    t, q, v, a = motion(0, 60.0)
    random, tau, reported = np.random.default_rng(1), torque(q, v, a, mass=1.0), v.copy()
    reported[:, 1] = lagged(v[:, 1], t, 0.5)
    tau = tau + random.normal(scale=0.01, size=q.shape)
    q = q + random.normal(scale=1e-6, size=q.shape)
    reported = reported + random.normal(scale=1e-3, size=q.shape)
    path = save(tmp_path, "run", columns_of(t, JOINTS, position=q, velocity=reported, effort=tau))
    code, said = answer(tmp_path, [path])
    assert (code, said["verdict"]) == (0, "explained")
    (cause,) = said["causes"]
    assert (cause["effect"], cause["joints"]) == ("velocity_filter_lag", ["elbow"])
    assert cause["parameters"]["elbow"]["T"]["value"] == pytest.approx(0.5, rel=0.01)
