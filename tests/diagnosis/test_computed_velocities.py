# SPDX-License-Identifier: BSD-3-Clause
"""Velocities that were differenced from the logged positions are known from those that a robot has estimated."""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.signal import lfilter

from impedance_modules.diagnosis.data.computed_velocities import computed_joints
from tests.diagnosis.test_diagnosis import JOINTS, answer, torque
from tests.diagnosis.test_diagnosis import motion as swings
from tests.support.recordings import columns_of, save

RATES = (50.0, 100.0, 250.0, 1000.0)
FINE = 1e-3  # s, the clock of the robot's own estimator


def motion(time):
    slow, fast = 2.0 * np.pi * 0.7, 2.0 * np.pi * 2.1
    position = 0.6 * np.sin(slow * time) + 0.2 * np.sin(fast * time + 1.0)
    return position, 0.6 * slow * np.cos(slow * time) + 0.2 * fast * np.cos(fast * time + 1.0)


def filtered(values, period, constant=0.01):
    out, state = np.zeros_like(values), 0.0
    for row, value in enumerate(values):
        state += (1.0 - np.exp(-period / constant)) * (value - state)
        out[row] = state
    return out


def measured(position, noise, kind, random):
    return (
        position + random.normal(0.0, noise, len(position))
        if kind == "white"
        else noise * np.round(position / noise)
    )


@pytest.fixture(
    params=[(rate, noise, kind) for rate in RATES for noise in (1e-5, 1e-3) for kind in ("white", "grid")]
)
def recording(request):
    rate, noise, kind = request.param
    random = np.random.default_rng(int(rate))
    time = np.arange(int(10.0 * rate)) / rate
    return time, measured(motion(time)[0], noise, kind, random), (noise, kind, random)


def computed(velocity, position, time):
    """Beside the joint stands one that does not move, and tells nothing."""
    still = np.zeros(len(time))
    told = computed_joints(np.column_stack([velocity, still]), np.column_stack([position, still]), time)
    assert told[0] == told[1]  # it goes with the other
    return told[0]


def test_differences_are_known(recording):
    time, q, (_, _, random) = recording
    step = time[1]
    backward = np.diff(q, prepend=q[0]) / step
    stamps = time + random.uniform(-0.2, 0.2, len(time)) * step
    for velocity, at in (
        (backward, time),
        (np.roll(backward, -1), time),
        (np.gradient(q, time), time),
        (np.gradient(q, stamps), stamps),
        (np.gradient(q, time), stamps),  # stamped late, differenced by the clock
    ):
        assert computed(velocity, q, at)
    lost = np.sort(random.permutation(len(time))[: int(0.95 * len(time))])
    assert computed(np.gradient(q, time)[lost], q[lost], time[lost])


def test_estimates_are_left_alone(recording):
    time, q, (noise, kind, random) = recording
    true = motion(time)[1]
    fine = np.arange(0.0, 10.0, FINE)
    inside = filtered(np.gradient(measured(motion(fine)[0], noise, kind, random), FINE), FINE)
    lagged = filtered(np.diff(q, prepend=q[0]) / time[1], time[1])  # a lag is something to be found
    for velocity in (true, true + random.normal(0.0, 1e-3, len(time)), np.interp(time, fine, inside), lagged):
        assert not computed(velocity, q, time)


def test_rows_that_waited_in_a_buffer_are_judged_by_their_mean_step(recording):
    time, q, (noise, kind, random) = recording
    step = time[1]
    written = 7 * (np.arange(len(time)) // 7 + 1)
    stamps = written * step + 0.02 * step * (np.arange(len(time)) % 7)
    assert computed(np.gradient(q, time), q, stamps)
    fine = np.arange(0.0, 10.0, FINE)
    inside = filtered(np.gradient(measured(motion(fine)[0], noise, kind, random), FINE), FINE)
    assert not computed(np.interp(time, fine, inside), q, stamps)


def test_each_joint_is_judged_by_itself_and_a_still_one_goes_with_all_others_only(recording):
    time, q, _ = recording
    still = np.zeros(len(time))
    velocities = np.column_stack([np.gradient(q, time), motion(time)[1], still])
    told = computed_joints(velocities, np.column_stack([q, q, still]), time)
    assert told.tolist() == [True, False, False]


def test_positions_without_noise_tell_nothing():
    time = np.arange(1000) / 100.0
    assert not computed_joints(np.zeros((1000, 1)), np.zeros((1000, 1)), time).any()


@pytest.mark.parametrize("rate", [50.0, 200.0])
def test_a_lag_of_one_joint_among_differences_is_of_that_joint_alone(tmp_path, rate):
    """Its filter runs in steps, half a row from the law; what the common delay makes of that is no lag of others."""
    paths = []
    for kind in range(4):
        random = np.random.default_rng(kind)
        t, q, v, a = swings(kind, 15.0)
        fine = np.arange(0.0, t[-1], 1.0 / rate)
        q, v, a = (CubicSpline(t, values)(fine) for values in (q, v, a))
        tau = torque(q, v, a, mass=1.0) + random.normal(scale=0.02, size=q.shape)
        read = q + random.normal(scale=1e-5, size=q.shape)
        reported = np.gradient(read, fine, axis=0)
        share = 1.0 - np.exp(-1.0 / (rate * 0.03))
        reported[:, 1] = lfilter([share], [1.0, share - 1.0], reported[:, 1])
        columns = columns_of(fine, JOINTS, position=read, velocity=reported, effort=tau)
        paths.append(save(tmp_path, f"run{kind}", columns))
    _, said = answer(tmp_path, paths)
    (cause,) = said["causes"]
    assert (cause["effect"], cause["joints"]) == ("velocity_filter_lag", ["elbow"])
    assert cause["parameters"]["elbow"]["T"]["value"] == pytest.approx(0.03, abs=0.6 / rate)
    assert any("velocities of shoulder are differences" in words for words in said["data"]["warnings"])
