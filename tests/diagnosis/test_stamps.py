# SPDX-License-Identifier: BSD-3-Clause
"""Whatever happened to time stamps, clean samples leave the steps from file to even rows with their noise only."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from impedance_modules.diagnosis.data.log import Log
from impedance_modules.diagnosis.data.stamps import _counted, resampled, sampling_times, uniform_time
from impedance_modules.diagnosis.data.time_base import unify_rates
from impedance_modules.errors import BadInput

SECONDS = 12.0
TORQUE_NOISE = 0.02


@dataclass
class Motion:
    """A smooth motion of three joints and the torque that belongs to it, at any time."""

    seed: int

    def __post_init__(self) -> None:
        random = np.random.default_rng(self.seed)
        self.frequency = random.uniform(0.1, 2.0, (3, 5))
        self.size, self.phase = random.uniform(0.05, 0.3, (3, 5)), random.uniform(0.0, 6.28, (3, 5))

    def _sum(self, time: np.ndarray, faster: float) -> np.ndarray:
        angle = 2.0 * np.pi * faster * self.frequency[:, None] * time[None, :, None] + self.phase[:, None]
        return np.einsum("jk,jtk->tj", self.size, np.sin(angle))

    def position(self, time: np.ndarray) -> np.ndarray:
        return self._sum(time, 1.0)

    def torque(self, time: np.ndarray) -> np.ndarray:
        return 5.0 * self._sum(time, 1.7)


def even(rate, random):
    time = np.arange(round(SECONDS * rate)) / rate
    return time, time


def jitter(part):
    def stamp(rate, random):
        time, _ = even(rate, random)
        return time, time + part / rate * random.standard_normal(len(time)).clip(-2.5, 2.5)

    return stamp


def microseconds(size):
    return lambda rate, random: jitter(1e-6 * size * rate)(rate, random)


def uneven(part):
    """Samples really taken at uneven times, stamped right."""

    def stamp(rate, random):
        time, _ = even(rate, random)
        time = time + part / rate * random.uniform(-1.0, 1.0, len(time))
        return time, time

    return stamp


def dropped(part, jittered):
    def stamp(rate, random):
        time, _ = even(rate, random)
        time = time[random.random(len(time)) > part]
        return time, time + jittered / rate * random.standard_normal(len(time))

    return stamp


def held_back(rows):
    """A logger that gets its samples in bursts, and stamps them when it does."""

    def stamp(rate, random):
        time, _ = even(rate, random)
        index = np.arange(len(time))
        last = time[np.minimum((index // rows + 1) * rows, len(time) - 1)]
        return time, last + index % rows * 0.01 / rate

    return stamp


def drifting(rate, random):
    time, _ = even(rate, random)
    return time, time + 0.2 / rate * np.sin(time)


def a_late_row(rate, random):
    time, _ = even(rate, random)
    late = np.where(random.random(len(time)) < 0.02, 0.7 / rate, 0.0)
    return time, time + late


FAULTS = {
    "none": even,
    "jitter of 0.4 %": jitter(0.004),
    "jitter of 30 us": microseconds(30.0),
    "jitter of 5 %": jitter(0.05),
    "jitter of 15 %": jitter(0.15),
    "uneven by 15 %": uneven(0.15),
    "uneven by 40 %": uneven(0.4),
    "a fiftieth lost": dropped(0.02, 0.0),
    "a fiftieth lost, jitter of 5 %": dropped(0.02, 0.05),
    "bursts of four": held_back(4),
    "bursts of ten": held_back(10),
    "a clock that wanders": drifting,
    "single rows written late": a_late_row,
}
UNKNOWABLE = {"a clock that wanders": 0.2, "bursts of four": 0.1, "bursts of ten": 0.3}
"""Error of time that no look at the samples can find, in steps: the logger's clock is the only one there is."""

RATES = (50.0, 100.0, 250.0, 500.0, 1000.0)
NOISES = {"white": 1e-4, "grid": 3.8e-4}
CASES = [(fault, rate, noise) for fault in FAULTS for rate in RATES for noise in NOISES]


def noisy(position, noise, random):
    if noise == "grid":
        return NOISES["grid"] * np.round(position / NOISES["grid"])
    return position + NOISES["white"] * random.standard_normal(position.shape)


def accelerations(position, rate):
    return np.diff(position, 2, axis=0) * rate**2


def brought_to_even_times(fault, rate, noise, seed=3):
    """Errors (rms) at even times of position, acceleration, and command less effort; bounds of first and last."""
    random, motion = np.random.default_rng(seed), Motion(seed)
    taken, stamps = FAULTS[fault](rate, random)
    position = noisy(motion.position(taken), noise, random)
    effort = motion.torque(taken) + TORQUE_NOISE * random.standard_normal(position.shape)
    times = sampling_times(stamps, position)
    rows, found_rate = uniform_time(times, "log", [])
    assert found_rate == pytest.approx(rate, rel=2e-3)
    q, e = (
        resampled(values, times, rows, kind) for values, kind in ((position, "position"), (effort, "effort"))
    )
    u = resampled(motion.torque(taken), times, rows, "effort_command")
    inner = slice(10, -10)
    # No stamp tells how late all of them are together: the time that fits best counts.
    shift = 0.0
    for _ in range(3):
        true = motion.position(rows + shift)
        speed = np.gradient(true, rows, axis=0)
        shift += float(np.sum((q - true) * speed) / np.sum(speed**2))
    true = motion.position(rows + shift)
    wrong = accelerations(q, found_rate) - accelerations(true, found_rate)
    left = [float(np.sqrt(np.mean(values[inner] ** 2))) for values in (q - true, wrong, u - e)]
    # Between two rows a command is taken as straight.
    bend = float(np.sqrt(np.mean(accelerations(motion.torque(rows), 1.0) ** 2))) / 12.0
    size = NOISES["white"] if noise == "white" else NOISES["grid"] / np.sqrt(12.0)
    rubber = (UNKNOWABLE.get(fault, 0.0) + 0.02) / rate * float(np.sqrt(np.mean(speed**2)))
    return left, (1.25 * size + rubber, 1.1 * TORQUE_NOISE + bend)


@pytest.mark.parametrize("place", [0.02, 0.1, 0.5, 0.97])
@pytest.mark.parametrize("lost", [1, 3])
def test_one_lost_row_is_counted_wherever_it_is(place, lost):
    random, time = np.random.default_rng(2), np.arange(3000) / 250.0
    first = round(place * len(time))
    taken = np.delete(time, slice(first, first + lost))
    stamps = taken + 0.05 / 250.0 * random.standard_normal(len(taken))
    times = sampling_times(stamps, noisy(Motion(2).position(taken), "white", random))
    assert np.abs(times - taken).max() < 0.01 / 250.0


@settings(max_examples=60, deadline=None)
@given(
    seed=st.integers(0, 9999),
    jitter_part=st.floats(0.0, 0.08),
    lost_part=st.floats(0.0, 0.01),
    late_part=st.floats(0.0, 0.02),
    ppm=st.floats(-50.0, 50.0),
)
def test_a_row_that_was_stamped_late_is_no_lost_row(seed, jitter_part, lost_part, late_part, ppm):
    """Rows late by up to 1.4 steps, and those behind them that queue, between rows that were lost.

    Whether the row before a lost one was late, or is the lost one's neighbour on the other side, no stamp can tell.
    """
    random, step = np.random.default_rng(seed), 0.002 * (1.0 + 1e-6 * ppm)
    whole = np.arange(4000)
    rows = whole[random.random(len(whole)) >= lost_part]
    late = jitter_part * random.standard_normal(len(rows)).clip(-2.5, 2.5)
    for k in np.flatnonzero((random.random(len(rows) - 2) < late_part) & (np.diff(rows)[1:] == 1)) + 1:
        late[k] += random.uniform(0.0, 1.4)
    # A stamp is later than that of the row before.
    stamps = np.maximum.accumulate(step * (rows + late) - 1e-5 * np.arange(len(rows)))
    stamps = stamps + 1e-5 * np.arange(len(rows))
    counted = _counted(stamps)
    np.testing.assert_array_equal(counted - counted[50], (rows - rows[50]).astype(float))


@pytest.mark.parametrize(("fault", "rate", "noise"), CASES)
def test_clean_samples_leave_with_their_noise_only(fault, rate, noise):
    (position, acceleration, torque), bounds = brought_to_even_times(fault, rate, noise)
    (_, usual, _), _ = brought_to_even_times("none", rate, noise)
    assert position < bounds[0]
    assert acceleration < 1.2 * usual
    assert torque < bounds[1]


@pytest.mark.parametrize(("rate", "longest"), [(200.0, 4), (500.0, 10), (1000.0, 18)])
@settings(max_examples=25, deadline=None)
@given(data=st.data(), seed=st.integers(0, 999), first=st.integers(25, 550))
def test_samples_across_a_gap_are_as_good_as_those_beside_it(rate, longest, data, seed, first):
    """A spline through the two noisy samples beside a gap of 15 would be wrong by several times their noise."""
    random, motion = np.random.default_rng(seed), Motion(seed)
    noise, lost, whole = 0.01, data.draw(st.integers(2, longest)), np.arange(600) / rate
    taken = np.delete(whole, slice(first, first + lost))
    read = motion.position(taken) + noise * random.standard_normal((len(taken), 3))
    filled = resampled(read, taken, whole, "position")
    # What a polynomial of third order leaves of the motion, over all that it goes through.
    fourth = np.sum(motion.size * (2.0 * np.pi * motion.frequency) ** 4)
    bend = fourth * (1.5 * (lost + 3) / rate) ** 4 / 24.0
    assert np.abs(filled - motion.position(whole)).max() < 5.0 * noise + bend


@settings(max_examples=30, deadline=None)
@given(
    seed=st.integers(0, 9999),
    part=st.floats(0.05, 0.3),
    rate=st.sampled_from([100.0, 250.0, 1000.0]),
    louder=st.floats(0.5, 6.0),
    unevenly=st.booleans(),
)
def test_all_rows_together_tell_whether_samples_were_taken_at_their_stamps(
    seed, part, rate, louder, unevenly
):
    """In each row the lateness is hidden by noise up to six times as large; no roughness tells it then."""
    random, motion = np.random.default_rng(seed), Motion(seed)
    taken, stamps = (uneven if unevenly else jitter)(part)(rate, random)
    position = motion.position(taken)
    hidden = np.gradient(position, taken, axis=0).std() * np.std(stamps - even(rate, random)[0])
    position = position + louder * hidden * random.standard_normal(position.shape)
    assert (sampling_times(stamps, position) is stamps) is unevenly


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 999), part=st.floats(0.002, 0.15), rate=st.sampled_from(RATES))
def test_rows_that_are_counted_keep_their_numbers(seed, part, rate):
    """Nothing is interpolated where samples were taken evenly: a command stays in the row of its effort."""
    random, motion = np.random.default_rng(seed), Motion(seed)
    taken, stamps = jitter(part)(rate, random)
    position = noisy(motion.position(taken), "white", random)
    times = sampling_times(stamps, position)
    rows, _ = uniform_time(times, "log", [])
    command = random.standard_normal(position.shape)
    np.testing.assert_array_equal(resampled(command, times, rows, "effort_command"), command)
    np.testing.assert_array_equal(resampled(position, times, rows, "position"), position)


def test_stamps_in_bursts_with_a_pause_between_are_refused():
    time = np.concatenate([np.arange(600), 1400 + np.arange(600)]) / 500.0
    position = np.sin(time)[:, None]
    with pytest.raises(BadInput, match=r"a gap of 1\.6 s"):
        uniform_time(sampling_times(time, position), "log", [])


def clean_log(rate, motion, name):
    time = np.arange(round(SECONDS * rate)) / rate
    q, u = motion.position(time), motion.torque(time)
    return Log(name, name, rate, q, None, u, u, None, "joint_sensor", "none")


@pytest.mark.parametrize(("fast", "slow"), [(1000.0, 250.0), (500.0, 460.0), (333.0, 100.0)])
def test_recordings_of_several_rates_keep_what_the_lowest_can_show(fast, slow):
    motion = Motion(5)
    high, low = clean_log(fast, motion, "fast"), clean_log(slow, motion, "slow")
    found, same = unify_rates([high, low], [])
    assert same is low and found.rate == slow
    inner = slice(round(slow), -round(slow))
    time = np.arange(found.samples) / slow
    for values, true in ((found.position, motion.position(time)), (found.effort, motion.torque(time))):
        assert np.abs(values - true)[inner].max() < 1e-5
