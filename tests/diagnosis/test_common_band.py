# SPDX-License-Identifier: BSD-3-Clause
"""One band for all recordings of a data set: clocks that differ by less than a hundredth change no step."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from impedance_modules.diagnosis.data.log import Log
from impedance_modules.diagnosis.regression.sensor_noise import white_noise
from impedance_modules.diagnosis.residuals.band import (
    CommonBand,
    above_noise,
    choose_band,
    deflection_cutoffs,
)
from impedance_modules.effects.recorded_signals import differentiate, low_passed


def log(rate: float, seed: int) -> Log:
    """A joint that moves below 1 Hz, without noise."""
    time = np.arange(int(10.0 * rate)) / rate
    frequency, phase = np.random.default_rng(seed).uniform(0.1, 1.0, (2, 5))
    position = 0.2 * np.sin(2.0 * np.pi * np.outer(time, frequency) + 6.0 * phase).sum(axis=1)[:, None]
    return Log("run", "run", rate, position, None, None, None, None, None, "none")


@settings(max_examples=40, deadline=None)
@given(
    st.sampled_from([50.0, 100.0, 200.0, 250.0, 400.0, 500.0, 1000.0]),
    st.lists(st.floats(-1e-3, 1e-3), min_size=2, max_size=4),
)
def test_recordings_by_different_clocks_keep_the_same_samples(rate, drifts):
    logs = [log(rate * (1.0 + drift), 1) for drift in drifts]
    common = choose_band(logs)
    bands = [common.at(one.rate / common.thinning) for one in logs]
    kept = [band.rate / band.step for band in bands]
    assert max(kept) / min(kept) == pytest.approx(1.0, abs=2.1e-3)
    assert min(kept) >= 2.4 * common.cutoff


@settings(max_examples=40, deadline=None)
@given(
    st.sampled_from([50.0, 100.0, 199.7, 500.0]),
    st.sampled_from([3.0, 7.7, 20.0]),
    st.integers(0, 999),
    st.sampled_from([np.float32, np.float64]),
)
def test_kept_samples_are_those_of_the_whole_filtered_recording(rate, cutoff, seed, kind):
    """Filtered at every sample by another library routine, then every `step`-th; and alone as beside others."""
    common = CommonBand.of(rate, min(cutoff, rate / 5.0))
    band = common.at(rate / common.thinning)
    values = np.random.default_rng(seed).normal(size=(2 * band.margin + 1 + 7 * band.step + seed % 50, 3))
    found = band.condense(values.astype(kind))
    whole = np.array([np.convolve(one, band._taps, mode="valid") for one in values.T]).T
    assert found.dtype == kind
    assert found == pytest.approx(whole[:: band.step], abs=1e-5 if kind is np.float32 else 1e-12)
    np.testing.assert_array_equal(band.condense(values[:, 1].astype(kind)), found[:, 1])


def test_two_clocks_of_two_hundred_hertz():
    """Thinned apart, one keeps every fourth sample and the other every third."""
    apart = [int(rate / (2.5 * 20.0)) for rate in (200.0009, 199.9999)]
    assert apart == [4, 3]
    assert CommonBand.of(199.9999, 20.0).step == CommonBand.of(200.0009, 20.0).step == 4


def test_thinned_samples_keep_the_motion_and_lose_what_would_alias():
    common, time = CommonBand.of(999.95, 20.0), np.arange(4000) / 1000.0
    assert (common.thinning, common.step) == (5, 4)
    slow, fast = np.sin(2.0 * np.pi * 3.0 * time)[:, None], np.sin(2.0 * np.pi * 190.0 * time)[:, None]
    inner = slice(40, -40)
    assert common.thin(slow)[inner] == pytest.approx(slow[::5][inner], abs=2e-5)
    assert np.abs(common.thin(fast)[inner]).max() < 1e-3
    marks = np.zeros(4000, dtype=bool)
    marks[1003] = True
    assert common.thin_mask(marks).sum() == 1 and common.thin_mask(marks)[200]


@pytest.mark.parametrize("rate", [400.0, 500.0, 1000.0])
def test_the_noise_of_a_thinned_sensor_is_read_whole(rate):
    """White noise keeps its density: per sample it is as strong as before, where it is read."""
    noise = 1e-4 * np.random.default_rng(3).standard_normal((int(40.0 * rate), 3))
    common = CommonBand.of(rate, 20.0)
    thinned = common.thin(noise)
    assert white_noise(thinned) == pytest.approx(1e-4 / np.sqrt(common.thinning), rel=0.12)


@pytest.mark.parametrize("rate", [500.0, 1000.0])
def test_what_the_noise_of_positions_makes_of_clean_motion_is_as_strong_as_what_is_read(rate):
    """Accelerations in the band by noise beyond the motion, and by the noise that was added."""
    time = np.arange(int(20.0 * rate)) / rate
    q = np.column_stack([0.3 * np.sin(2.0 * np.pi * f * time) for f in (0.3, 0.5, 0.7)])
    noise = 1e-4 * np.random.default_rng(4).standard_normal(q.shape)
    common = CommonBand.of(rate, 20.0)
    band = common.at(rate / common.thinning)

    def acceleration(values: np.ndarray) -> np.ndarray:
        smooth = band.smooth(values)
        at = np.arange(len(smooth)) / band.rate
        return np.std(band.condense(differentiate(differentiate(smooth, at), at)), axis=0)

    real = acceleration(common.thin(noise))
    read = white_noise(common.thin(q + noise))
    drawn = read * np.random.default_rng(5).standard_normal(common.thin(q).shape)
    assert acceleration(drawn) == pytest.approx(real, rel=0.15)


def noisy_motion(rate: float, seed: int, noise: float):
    """True and read positions (N, 3) of joints that move below 1 Hz; the last one rests."""
    position = np.column_stack([log(rate, seed + joint).position for joint in range(3)])
    position[:, 2] = 0.3
    return position, position + noise * np.random.default_rng(seed).standard_normal(position.shape)


def twice_differentiated(position, rate):
    time = np.arange(len(position)) / rate
    return differentiate(differentiate(position, time), time)


@settings(max_examples=25, deadline=None)
@given(st.sampled_from([50.0, 100.0, 200.0]), st.integers(0, 99), st.sampled_from([1e-5, 1e-4, 5e-4]))
def test_accelerations_above_their_noise_are_the_motions(rate, seed, noise):
    """Nothing is left of a joint at rest, and of noise no more than the motion is worth; what moves is whole."""
    true, read = noisy_motion(rate, seed, noise)
    found = above_noise(read, twice_differentiated(read, rate), rate)
    wrong, motion = found - twice_differentiated(true, rate), twice_differentiated(true, rate)
    inner = slice(len(read) // 20, -(len(read) // 20))
    assert np.abs(found[inner, 2]).max() < 1e-2 * np.abs(twice_differentiated(read, rate)[inner, 2]).max()
    assert np.std(wrong[inner, :2]) < 0.1 * np.std(motion[inner, :2])


def test_accelerations_without_noise_stay_as_they_are():
    true, _ = noisy_motion(200.0, 5, 0.0)
    a = twice_differentiated(true, 200.0)
    assert np.abs(above_noise(true, a, 200.0) - a)[50:-50].max() < 1e-3 * np.abs(a).max()


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("rate", [100.0, 250.0])
def test_a_short_motion_does_not_ring_through_the_rest_of_a_recording(rate: float, seed: int) -> None:
    """Half a second of 5 Hz in 20 s: a steep filter would let it ring for many seconds before and after."""
    random = np.random.default_rng(seed)
    time, at = np.arange(0.0, 20.0, 1.0 / rate), random.uniform(6.0, 14.0)
    inside = np.exp(-0.5 * ((time - at) / 0.15) ** 2)
    slow = 0.3 * np.sin(2.0 * np.pi * 0.2 * time)
    true = (slow + 0.01 * inside * np.sin(2.0 * np.pi * 5.0 * time))[:, None]
    read = true + 3e-5 * random.standard_normal(true.shape)
    found = above_noise(read, twice_differentiated(read, rate), rate)
    wrong = (found - twice_differentiated(true, rate))[:, 0]
    largest = np.abs(twice_differentiated(true, rate)).max()
    assert np.std(wrong[np.abs(time - at) < 0.3]) < 0.2 * largest
    far = (np.abs(time - at) > 2.0) & (time > 1.0) & (time < 19.0)
    assert np.std(wrong[far]) < 0.015 * largest


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 99), st.sampled_from([1e-5, 1e-4]))
def test_the_ends_of_a_recording_are_not_rounded_off(seed, noise):
    """What a filter makes of a kink at the ends would be a twentieth of the acceleration there."""
    true, read = noisy_motion(100.0, seed, noise)
    wrong = above_noise(read, twice_differentiated(read, 100.0), 100.0) - twice_differentiated(true, 100.0)
    for end in (slice(13, 100), slice(-100, -13)):
        assert np.std(wrong[end, :2]) < 0.03 * np.abs(twice_differentiated(true, 100.0)).max()


@pytest.mark.parametrize("seed", range(8))
def test_single_frequencies_of_noise_are_no_load_that_may_be_differentiated(seed):
    """A load at 5 Hz beside noise whose second derivative is as large at 10 Hz; of 600 frequencies some stand out."""
    time = np.arange(int(12.0 * 500.0)) / 500.0
    noise = 0.018 * np.random.default_rng(seed).standard_normal(time.size)
    thinned = CommonBand.of(500.0, 20.0).thin((0.04 * np.sin(2.0 * np.pi * 5.0 * time) + noise)[:, None])
    one = Log("run", "run", 250.0, 0.0 * thinned, None, thinned, None, None, "joint_sensor", "none")
    assert 6.0 < deflection_cutoffs(one)[0] < 10.5


@pytest.mark.parametrize("seed", range(8))
def test_single_frequencies_of_noise_are_no_motion_that_bends_springs(seed):
    """A joint at 1 Hz, its position white noise of 1e-4 rad; the fourth derivative of one frequency at 40 Hz is 2.6e6
    times as large as at 1 Hz, and ended the band at 30 to 50 Hz: the rotors seemed to shake at 10 rad/s^2."""
    time = np.arange(int(20.0 * 500.0)) / 500.0
    noise = 1e-4 * np.random.default_rng(seed).standard_normal(time.size)
    thinned = CommonBand.of(500.0, 20.0).thin((0.5 * np.sin(2.0 * np.pi * time) + noise)[:, None])
    one = Log("run", "run", 250.0, thinned, None, None, None, None, None, "none")
    assert 1.5 < deflection_cutoffs(one)[0] < 15.0


@pytest.mark.parametrize("frequency", [6.0, 6.5, 7.0, 7.5, 8.0])
def test_an_arm_that_swings_on_its_springs_bends_them(frequency):
    """A swing just where the motion ends in noise: cut off there, the rotors lacked half of its acceleration."""
    time = np.arange(int(8.0 * 50.0)) / 50.0
    swing = 2e-3 * np.sin(2.0 * np.pi * frequency * time) * np.hanning(time.size)
    noise = 1e-4 * np.random.default_rng(3).standard_normal(time.size)
    read = (0.3 * np.sin(2.0 * np.pi * 0.4 * time) + swing + noise)[:, None]
    one = Log("run", "run", 50.0, read, None, None, None, None, None, "none")
    passed = low_passed(swing[:, None], 50.0, deflection_cutoffs(one))[:, 0]
    assert passed @ swing > 0.93 * swing @ swing


@pytest.mark.parametrize("rows", [12, 15, 16, 200])
def test_a_segment_of_a_few_rows_is_filtered_by_what_it_has(rows):
    """Of a recording of a few seconds, hardly more rows are left than a filter usually continues at each end."""
    line = np.linspace(-1.0, 2.0, rows)[:, None]
    kept = low_passed(line, 10.0, np.array([1.0]))
    assert low_passed(0.0 * line + 3.0, 10.0, np.array([1.0])) == pytest.approx(0.0 * line + 3.0)
    assert np.abs(kept - line).max() < 0.1 * np.ptp(line)
