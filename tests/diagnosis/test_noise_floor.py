# SPDX-License-Identifier: BSD-3-Clause
"""Noise of recordings: beside a flexible model, beside a knock, and of sensors that are noisier than others."""

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import filtfilt, firwin

from impedance_modules.diagnosis.regression import noise_floor as judged
from impedance_modules.diagnosis.regression import sensor_noise
from impedance_modules.diagnosis.regression.candidates import CandidateRegressor
from impedance_modules.diagnosis.regression.disturbed_moments import Left, fit_robustly, without_disturbed
from impedance_modules.diagnosis.regression.noise_floor import _noise_shares
from impedance_modules.diagnosis.regression.nuisance_columns import NuisanceColumns
from impedance_modules.diagnosis.regression.sensor_noise import (
    SENSOR_NOISE_RATIO,
    _sensor_noise_ratio,
    read_noise,
    sensor_powers,
)
from impedance_modules.diagnosis.regression.whitening import ORDER, Whitening, spectrum, whitening_of
from impedance_modules.diagnosis.residuals.band import CommonBand

GROUP = ("link", 0)
SIZE = 0.3
RATE = 50.0
TIME = np.arange(0.0, 28.0, 1.0 / RATE)
FLEXIBLE = np.column_stack([np.sin(k * TIME) for k in range(1, 30)] + [np.cos(k * TIME) for k in range(30)])


def whitening_by(noise: np.ndarray, X: np.ndarray, made: np.ndarray, monkeypatch) -> Whitening:
    """Weak floor of one recording's residual beside columns, its positions' noise made up."""
    monkeypatch.setattr(judged, "made_by_positions", lambda *_: SimpleNamespace(of=lambda _: made))
    item = SimpleNamespace(
        band=SimpleNamespace(cutoff=4.0, step=20, rate=200.0),
        log=SimpleNamespace(effort=None, effort_steps=None),
        signals=SimpleNamespace(n=1),
        effort_jumps=np.zeros((1, 1)),
        samples=len(noise),
    )
    nuisance = NuisanceColumns((GROUP,), 0, (np.zeros(0, int),), ((np.zeros((len(noise), 0)),),), {})
    regressor = CandidateRegressor(None, {}, ("generic", "link.0", "random"), [{GROUP: X}])
    return judged.noise_by_smoothness([[noise]], [item], nuisance, [regressor], [0])


def floor_of(noise: np.ndarray, X: np.ndarray, made: np.ndarray, monkeypatch) -> float:
    """Its rms."""
    return float(whitening_by(noise, X, made, monkeypatch).rms[0, 0])


@pytest.mark.parametrize("columns", [5, 60, 300])
def test_noise_is_judged_alike_by_few_and_by_many_columns(columns: int, monkeypatch) -> None:
    """82 samples of one short run were once explained by 150 columns, and the floor was a third of the noise."""
    random = np.random.default_rng(columns)
    drawn = [(random.normal(scale=SIZE, size=82), random.normal(size=(82, columns))) for _ in range(20)]
    found = [floor_of(noise, X, np.zeros(82), monkeypatch) for noise, X in drawn]
    assert np.median(found) == pytest.approx(SIZE, rel=0.25)


def test_a_column_that_holds_the_noise_does_not_hide_it(monkeypatch) -> None:
    """An acceleration is differentiated noise, and so is the residual: an inertia's column would take it all."""
    random = np.random.default_rng(7)
    noise, other = random.normal(scale=SIZE, size=(2, 400))
    assert floor_of(noise, noise[:, None], 0.0 * noise, monkeypatch) < 0.1 * SIZE
    assert floor_of(noise, noise[:, None], other, monkeypatch) == pytest.approx(SIZE, rel=0.1)


def test_jumps_at_unknown_moments_are_noise_however_well_columns_follow_them(monkeypatch) -> None:
    random = np.random.default_rng(8)
    noise, jumps = random.normal(scale=SIZE, size=(2, 400))
    monkeypatch.setattr(judged, "jump_noise", lambda *_: 2.0 * jumps)
    found = floor_of(noise, noise[:, None], 0.0 * noise, monkeypatch)
    assert found == pytest.approx(2.0 * SIZE, rel=0.1)


def test_noise_where_the_motion_is_stays_as_white_as_elsewhere(monkeypatch) -> None:
    """A flexible model takes slow noise away; a whitening of what is left would call slow noise a finding."""
    random = np.random.default_rng(9)
    ratios = []
    for _ in range(6):
        noise, fresh = random.normal(scale=SIZE, size=(2, len(TIME)))
        whitening = whitening_by(noise, FLEXIBLE, np.zeros(len(TIME)), monkeypatch)
        power = np.abs(np.fft.rfft(whitening.apply(fresh, 0, 0))) ** 2
        frequency = np.fft.rfftfreq(len(TIME) - ORDER, 1.0 / RATE)
        ratios.append(
            np.mean(power[frequency < 3.0]) / np.mean(power[(frequency > 6.0) & (frequency < 18.0)])
        )
    assert np.mean(ratios) == pytest.approx(1.0, abs=0.2)


def test_position_noise_is_read_beside_motion() -> None:
    random = np.random.default_rng(8)
    time = np.arange(2000) / 200.0
    motion = 0.5 * np.sin(2.0 * np.pi * np.outer(time, [0.4, 3.0]))
    item = SimpleNamespace(log=SimpleNamespace(position=motion + 1e-5 * random.normal(size=motion.shape)))
    np.testing.assert_allclose(read_noise(item), 1e-5, rtol=0.15)


def recorded_knock(seed: int, knock: float):
    """Noise of one and a knock of half a second, seen through a flexible model; two recordings."""
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
    found = recorded_knock(seed, knock)
    assert found.disturbed
    assert 0.6 < power(found.robust) < 1.5 < power(found.ordinary)


@settings(max_examples=25)
@given(st.integers(0, 10_000))
def test_noise_alone_is_no_knock(seed: int) -> None:
    found = recorded_knock(seed, 0.0)
    assert not found.disturbed
    assert 0.7 < power(found.ordinary) < 1.4


def test_what_is_large_for_long_is_no_knock() -> None:
    y = np.random.default_rng(5).standard_normal(len(TIME)) * np.where(np.sin(TIME) > 0.7, 40.0, 1.0)
    found = fit_robustly(lambda weights: (list(np.split(y, 2)), 0.0), RATE)
    assert not found.disturbed
    assert found.robust is found.ordinary


@settings(max_examples=25)
@given(st.integers(0, 10_000), st.floats(12.0, 60.0), st.integers(0, 17))
def test_a_push_in_one_of_two_repeats_does_not_raise_the_noise(seed: int, push: float, begin: int) -> None:
    """It turns two joints; the third, and what only one joint shows at a moment, are left as they are."""
    random = np.random.default_rng(seed)
    shown = [[np.ones(len(TIME), dtype=bool)] for _ in range(3)]
    shown[1][0][:7] = False
    quiet = [[random.standard_normal(int(masks[0].sum()))] for masks in shown]
    during = (begin <= TIME) & (begin + 0.5 > TIME)
    apart = [[pieces[0].copy()] for pieces in quiet]
    apart[0][0][during] += push
    apart[1][0][during[7:]] -= push
    found = without_disturbed(apart, shown, RATE)
    for pieces, clean in zip(found[:2], quiet[:2], strict=True):
        assert np.mean(pieces[0] ** 2) == pytest.approx(np.mean(clean[0] ** 2), rel=0.15)
    assert np.array_equal(found[2][0], quiet[2][0])
    alone = quiet[0][0] + np.where(during, 7.0, 0.0)
    assert np.array_equal(without_disturbed([[alone], quiet[1], quiet[2]], shown, RATE)[0][0], alone)


@settings(max_examples=25)
@given(st.integers(0, 10_000), st.floats(5.0, 100.0), st.floats(0.02, 0.19))
def test_a_push_does_not_shift_the_other_moments_of_a_difference(
    seed: int, push: float, share: float
) -> None:
    """By the mean of a difference a push of 20 for a sixth of the time would be three times the noise elsewhere."""
    random = np.random.default_rng(seed)
    both = random.standard_normal((2, 2, len(TIME)))
    during = np.arange(len(TIME)) < round(share * len(TIME))
    both[0] += push * during
    shown = np.ones(len(TIME), dtype=bool)
    apart = [[judged._difference(one, other, shown)] for one, other in zip(*both, strict=True)]
    for (rest,) in without_disturbed(apart, [[shown], [shown]], RATE):
        assert np.mean(rest[~during] ** 2) == pytest.approx(1.0, rel=0.35)


def _recordings(*sizes: float, effort: bool = True) -> list[SimpleNamespace]:
    """Two joints that carry a slow load; noise of some size on the first one's sensor, of size one on the other's."""
    random = np.random.default_rng(7)
    time = np.arange(1500) / 100.0
    out = []
    for size in sizes:
        load = np.column_stack([20.0 * np.sin(time), 5.0 * np.cos(3.0 * time)])
        noise = random.standard_normal(load.shape) * [size, 1.0]
        log = SimpleNamespace(effort=load + noise if effort else None)
        out.append(SimpleNamespace(log=log, signals=SimpleNamespace(n=2)))
    return out


@pytest.mark.parametrize("size", [1.5, 2.0, 3.0])
def test_noisier_sensors_are_known_by_their_noise_beyond_the_motion(size: float) -> None:
    power = _sensor_noise_ratio(_recordings(1.0, 1.0, size), [(1, 0)])
    np.testing.assert_allclose(power[2], [size**2, 1.0], rtol=0.25)
    np.testing.assert_allclose(power[:2], 1.0)


def test_chance_is_no_noisier_sensor_and_the_ratio_has_an_end() -> None:
    power = _sensor_noise_ratio(_recordings(1.0, 1.0, 1.0, 0.5, 50.0), [(1, 0)])
    np.testing.assert_allclose(power[:4], 1.0)
    assert power[4, 0] == SENSOR_NOISE_RATIO[1]


def test_without_a_measured_torque_all_recordings_are_alike() -> None:
    np.testing.assert_allclose(_sensor_noise_ratio(_recordings(1.0, 9.0, effort=False), [(1, 0)]), 1.0)


def slow(values: np.ndarray) -> np.ndarray:
    """What is below 10 Hz of samples at 100 Hz."""
    return filtfilt(firwin(31, 10.0, fs=100.0), 1.0, values, axis=0)


def sensed(noise: float, *, behind: str) -> SimpleNamespace:
    """A recording at 100 Hz whose torque sensor has white noise; its band ends at 10 Hz where springs are sensors."""
    one = _recordings(noise)[0]
    signals = SimpleNamespace(
        n=2,
        measures_springs=behind == "gear",
        spring_compliance=np.array([0.01, 0.0]),
        reflected_inertia=np.array([0.02, 0.3]),
        motor_damping=np.array([0.5, 0.1]),
    )
    smooth = slow if signals.measures_springs else lambda values: values
    band = SimpleNamespace(smooth=smooth, condense=lambda values: values)
    log = SimpleNamespace(effort=one.log.effort, samples=len(one.log.effort), rate=100.0, effort_steps=None)
    return SimpleNamespace(log=log, signals=signals, band=band)


GROUPS = (("link", 0), ("link", 1), ("actuator", 0), ("actuator", 1), ("velocity", 0), ("whole", 0))


@pytest.mark.parametrize("size", [0.5, 3.0])
def test_noise_of_a_torque_sensor_is_in_every_residual_that_it_enters(size: float) -> None:
    own = sensor_powers([sensed(size, behind="motor"), sensed(2.0 * size, behind="motor")], GROUPS)
    np.testing.assert_allclose(own[0], [size**2, 1.0, size**2, 1.0, 0.0, 0.0], rtol=0.25)
    assert own[1, 0] == pytest.approx(4.0 * own[0, 0], rel=0.3)


def test_a_sensor_that_is_the_spring_tells_of_rotors_what_only_its_noise_does() -> None:
    """I_r c d2n/dt2 + b c dn/dt beside n itself, by differences of noise drawn here."""
    (own,) = sensor_powers([sensed(0.5, behind="gear")], GROUPS)
    noise = slow(0.5 * np.random.default_rng(1).standard_normal(20_000))
    rate = np.gradient(0.01 * noise, 0.01)
    pretended = noise + 0.02 * np.gradient(rate, 0.01) + 0.5 * rate
    assert own[2] == pytest.approx(np.mean(pretended**2), rel=0.3)
    assert own[0] == pytest.approx(np.mean(noise**2), rel=0.3) and own[3] == pytest.approx(own[1])


def test_without_a_sensor_there_is_no_noise_of_one() -> None:
    item = sensed(1.0, behind="motor")
    item.log.effort = None
    assert not sensor_powers([item], GROUPS).any()


def test_what_a_coarse_grid_makes_of_a_slow_torque_is_not_read_beyond_the_motion() -> None:
    """It stands still where nothing moves, and is off by as much."""
    items = [sensed(0.5, behind="motor"), sensed(0.5, behind="motor")]
    items[1].log.effort_steps = np.array([0.0, 0.3])
    own = sensor_powers(items, GROUPS)
    assert not own[:, [1, 3]].any() and (own[:, [0, 2]] > 0.1).all()


def test_a_pair_of_which_hardly_a_row_counts_shows_no_noise_beside_others() -> None:
    """Several samples in a row were lost in one of them: four rows make no spectrum."""
    items = [SimpleNamespace(samples=40)] * 4
    clear = {(0, 0): np.arange(40) < 4}
    masks = judged._shown_twice([(0, 1), (2, 3)], 0, items, clear)
    assert [int(mask.sum()) for mask in masks] == [0, 40]
    assert [mask.all() for mask in judged._shown_twice([(0, 1)], 0, items, clear)] == [True]


@pytest.mark.parametrize("sensor", [0.0, 0.3, 2.0])
def test_without_repeats_a_recording_with_more_inertia_has_more_noise(sensor: float) -> None:
    """Noise of positions times an inertia of 1, 2 and 3, beside that of a sensor; the third is held out."""
    random, inertia = np.random.default_rng(8), np.array([1.0, 2.0, 3.0])
    pieces = [m * random.standard_normal(4000) + sensor * random.standard_normal(4000) for m in inertia]
    share = _noise_shares([pieces[:2]], np.zeros(1), (inertia**2)[:, None], [(0, 1)])
    mean = np.sqrt(np.mean([np.mean(piece**2) for piece in pieces[:2]]))
    floor = 0.12 if sensor == 0.0 else 0.06  # a twentieth of the noise is always taken to be the sensor's
    assert mean * share[:, 0] == pytest.approx([np.std(piece) for piece in pieces], rel=floor)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_noise_that_rises_up_to_the_bands_filter_is_white_there_too(seed: int) -> None:
    """Noise of positions, differentiated four times and cut off at the end of the band: an autoregression of
    the fourth order follows it to a factor of three; continued as it is before the end, it stood out by four.
    """
    edge, random = 0.35, np.random.default_rng(seed)
    taps = firwin(41, edge, fs=1.0, window=("kaiser", 4.0))
    rising = [np.diff(random.standard_normal(1500), n=4) for _ in range(4)]
    noise = [np.convolve(piece, taps, mode="valid") for piece in rising]
    floor = whitening_of(
        [noise], np.ones((1, 1)), edge=edge, lost=np.zeros(1), assumed=np.zeros(1), weak=False
    )
    frequency, density = spectrum([np.asarray(floor.apply(piece, 0, 0)) for piece in noise])
    inside = density[frequency <= edge]
    assert inside.max() < 3.0 * np.mean(inside)


def _swaying(inertia: float, sway: float, seed: int) -> SimpleNamespace:
    """One joint of some inertia: one motion that all repeat, and a sway of its own [rad], beside noise of 1e-6 rad."""
    random = np.random.default_rng(seed)
    common, rate = CommonBand.of(200.0, 10.0), 200.0
    time, band = np.arange(4000) / rate, common.at(rate)
    q = 0.3 * np.sin(2.0 * time) + sway * np.sin(2.0 * np.pi * 5.0 * time + random.uniform(0.0, 6.0))
    log = SimpleNamespace(
        position=(q + 1e-6 * random.standard_normal(len(q)))[:, None], rounding=None, rate=rate,
        samples=len(q), effort=np.full((len(q), 1), 1.0) + 0.01 * random.standard_normal((len(q), 1)), group="one",
        effort_steps=None,
    )  # fmt: skip
    signals = SimpleNamespace(
        n=1,
        acceleration=np.gradient(np.gradient(q, time), time)[:, None],
        reflected_inertia=np.zeros(1),
        measures_springs=True,
        spring_compliance=np.zeros(1),
        encoder_at_motor=np.zeros(1),
    )
    position = band.condense(np.full((len(q), 1), inertia))
    jumps = np.zeros((len(q), 1))
    return SimpleNamespace(
        log=log,
        signals=signals,
        band=band,
        tree=None,
        position=position,
        samples=len(position),
        effort_jumps=jumps,
    )


@pytest.mark.parametrize("sway", [0.0, 0.02])
def test_repeats_that_sway_by_themselves_do_not_lower_the_floor_elsewhere(monkeypatch, sway: float) -> None:
    """A sensor's noise is alike at all poses. What the arm truly did is in the model's torque, and no noise."""
    monkeypatch.setattr(sensor_noise, "mass_matrix", lambda _, q: q[:, :, None])
    items = [_swaying(1.0, sway, 1), _swaying(1.0, sway, 2), _swaying(0.2, sway, 3)]
    random = np.random.default_rng(4)
    left = [[0.01 * random.standard_normal(item.samples)] for item in items]
    nuisance = SimpleNamespace(groups=(GROUP,))
    floor = judged.noise_by_repeats(left, items, nuisance, [(1, 0)])
    assert floor.rms[:, 0] == pytest.approx(0.01, rel=0.15)
    # Repeats of one motion jump at the same rows and do not show it; the floor is what jumps make, at least.
    monkeypatch.setattr(
        judged, "jump_noise", lambda item, *_: 0.05 * np.random.default_rng(6).standard_normal(item.samples)
    )
    assert judged.noise_by_repeats(left, items, nuisance, [(1, 0)]).rms[:2, 0] == pytest.approx(0.05, rel=0.2)
