# SPDX-License-Identifier: BSD-3-Clause
"""What an encoder's grid makes of a motion is known at every speed and rate; slow motions are noisier."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from impedance_modules.diagnosis.data.encoder_grid import (
    DITHER,
    mean_rounding,
    quantisation_step,
    rounding_errors,
    steps_of,
    torque_dither_of,
    torque_steps_of,
)
from impedance_modules.diagnosis.data.log import Log
from impedance_modules.diagnosis.data.nominal_model import model_of_urdf
from impedance_modules.diagnosis.data.rigid_dynamics import BatchedRigidModel, inverse_dynamics
from impedance_modules.diagnosis.regression import sensor_noise
from impedance_modules.diagnosis.residuals.band import CommonBand
from impedance_modules.diagnosis.residuals.preparation import _grid_errors, prepare
from impedance_modules.effects.recorded_signals import differentiate
from tests.support.pressed_recordings import JOINTS, URDF

STEP = 2.0 * np.pi / 16384
GRID = np.array([STEP])
SECONDS = 20.0


def motion(rate: float, size: float, seed: int) -> np.ndarray:
    random = np.random.default_rng(seed)
    time = np.arange(0.0, SECONDS, 1.0 / rate)
    frequency, phase = random.uniform(0.1, 0.6, 5), random.uniform(0.0, 6.28, 5)
    return size * np.sin(2.0 * np.pi * np.outer(time, frequency) + phase).sum(axis=1)


def velocity_noise(errors: np.ndarray, rate: float, cutoff: float) -> float:
    """Rms that position errors (N,) leave in the band of differentiated positions [rad/s]."""
    common = CommonBand.of(rate, cutoff)
    thinned, rate = common.thin(errors[:, None]), rate / common.thinning
    band, time = common.at(rate), np.arange(len(thinned)) / rate
    return float(np.std(band.condense(differentiate(band.smooth(thinned), time))))


@settings(max_examples=60, deadline=None)
@given(
    st.sampled_from([100.0, 200.0, 500.0, 1000.0]),
    st.sampled_from([4.0, 8.0]),
    st.floats(-5.5, 0.0),
    st.integers(0, 10_000),
)
def test_simulated_errors_are_as_strong_in_the_band_as_the_real_ones(rate, cutoff, log_size, seed):
    """Of a joint that moves from 1 mrad to 0.3 rad; white noise is a sixth of what a slow joint has at 1 kHz."""
    q = motion(rate, 0.3 * np.exp(log_size), seed)
    rounded = STEP * np.round(q / STEP)
    real = velocity_noise(rounded - q, rate, cutoff)
    found = [velocity_noise(rounding_errors(rounded[:, None], GRID, s)[:, 0], rate, cutoff) for s in range(3)]
    assert 0.6 < float(np.sqrt(np.mean(np.square(found)))) / real < 2.0


def test_white_noise_would_be_far_too_little_where_a_joint_is_slow():
    q = motion(1000.0, 0.003, 1)
    rounded = STEP * np.round(q / STEP)
    white = STEP / np.sqrt(12.0) * np.random.default_rng(1).standard_normal(len(q))
    real = velocity_noise(rounded - q, 1000.0, 8.0)
    assert velocity_noise(white, 1000.0, 8.0) < 0.4 * real
    assert velocity_noise(rounding_errors(rounded[:, None], GRID, 1)[:, 0], 1000.0, 8.0) > 0.6 * real


def test_no_grid_and_no_motion_have_no_errors():
    smooth, still = motion(200.0, 0.3, 2), np.full(4000, 0.7)
    assert quantisation_step(smooth) == quantisation_step(still) == 0.0
    both = np.column_stack([smooth, still])
    steps = steps_of([{"a": smooth, "b": still}], ["a", "b"])
    assert not steps.any() and not rounding_errors(both, steps, 0).any()
    assert not rounding_errors(both[:, 1:], GRID, 0).any()


def test_a_joint_that_hardly_moves_has_the_step_of_its_other_recordings():
    small, large = (STEP * np.round(motion(200.0, size, 4) / STEP) for size in (0.0005, 0.3))
    assert quantisation_step(small) == 0.0
    steps = steps_of([{"a": small}, {"a": large, "b": large}], ["a", "b"])
    assert steps == pytest.approx([STEP, STEP], rel=1e-4)
    assert rounding_errors(small[:, None], steps[:1], 0).any()


def recorded(size: float, rate: float = 500.0) -> SimpleNamespace:
    """One joint of unit inertia that was rounded, as the residuals know it."""
    q = motion(rate, size, 5)
    errors = rounding_errors(STEP * np.round(q / STEP)[:, None], GRID, 0)
    common = CommonBand.of(rate, 8.0)
    thinned, rate = common.thin(errors), rate / common.thinning
    log = SimpleNamespace(rounding=thinned, rate=rate, samples=len(thinned), effort=None)
    signals = SimpleNamespace(
        n=1, reflected_inertia=np.zeros(1), measures_springs=True, encoder_at_motor=np.zeros(1)
    )
    band = common.at(rate)
    position = band.condense(0.0 * thinned)
    return SimpleNamespace(log=log, signals=signals, band=band, tree=None, position=position)


@pytest.mark.parametrize(("residual", "power"), [("velocity", 4e-7), ("link", 5e-4)])
def test_the_floor_of_a_slow_recording_is_higher_than_that_of_fast_repeats(residual, power, monkeypatch):
    monkeypatch.setattr(sensor_noise, "mass_matrix", lambda _, q: np.ones((len(q), 1, 1)))
    items = [recorded(0.3), recorded(0.3), recorded(0.003)]
    made = [sensor_noise.made_by_grid(item) for item in items]
    own = sensor_noise.position_powers(made, [(residual, 0)])
    ratio = sensor_noise.noise_shares(np.array([power]), own[:2].mean(axis=0), own)
    assert ratio[:2, 0] == pytest.approx(1.0, rel=0.02)
    name = "velocity" if residual == "velocity" else "acceleration"
    fast, slow = (float(np.mean(getattr(made[r], name) ** 2)) for r in (0, 2))
    assert ratio[2, 0] == pytest.approx(np.sqrt((power - fast + slow) / power), rel=0.02)
    assert ratio[2, 0] > 1.15


@settings(max_examples=30, deadline=None)
@given(st.floats(0.1, 3.0), st.floats(-2.0, 2.0), st.floats(DITHER, 0.6), st.integers(0, 10_000))
def test_the_mean_error_of_a_torque_on_a_grid_is_that_of_many_readings(step, level, dither, seed):
    """Read a hundred thousand times with noise of a fifth of a step, or more."""
    torque = step * level
    noise = dither * step * np.random.default_rng(seed).standard_normal(100_000)
    read = step * np.round((torque + noise) / step)
    found = mean_rounding(np.array([[torque]]), np.array([step]), np.array([dither]))[0, 0]
    assert found == pytest.approx(read.mean() - torque, abs=0.02 * step)
    assert mean_rounding(np.array([[torque]]), np.zeros(1), np.array([dither]))[0, 0] == 0.0


@settings(max_examples=20, deadline=None)
@given(st.floats(0.05, 3.0), st.integers(0, 10_000))
def test_the_noise_that_dithers_a_grid_is_found(dither, seed):
    """Of a torque that is at each level equally long; never less than a model's torque is known to."""
    random, step = np.random.default_rng(seed), 0.162
    torque = step * np.linspace(-9.7, 9.7, 20_000)
    read = step * np.round((torque + dither * step * random.standard_normal(len(torque))) / step)
    found = torque_dither_of([{"a": read, "b": read}], ["a", "b"], np.array([step, 0.0]))
    assert found[0] == pytest.approx(max(dither, DITHER), rel=0.1)
    assert found[1] == DITHER


@pytest.mark.parametrize("size", [0.6, 1.4, 6.0, 200.0])
def test_the_grid_of_a_torque_of_few_levels_is_found(size):
    """A torque of half a step to two hundred steps, on a grid of 0.162 N.m."""
    random, step = np.random.default_rng(6), 0.162
    torque = size * step * np.sin(2.0 * np.pi * 0.5 * np.arange(4000) / 200.0)
    read = step * np.round(torque / step + 0.3 * random.standard_normal(4000))
    recordings = [{"a": read, "b": torque}]
    assert torque_steps_of(recordings, ["a", "b"]) == pytest.approx([step, 0.0], rel=1e-6)


@pytest.mark.parametrize("size", [0.6, 6.0, 200.0])
@pytest.mark.parametrize("between", [0.3, 0.6])
def test_the_grid_of_a_log_that_was_interpolated_is_found(size, between):
    """Stamps between two samples, for a part of all rows: their values lie between two levels."""
    random, step = np.random.default_rng(7), 0.162
    torque = size * step * np.sin(2.0 * np.pi * 0.5 * np.arange(4001) / 200.0)
    read = step * np.round(torque / step + 0.3 * random.standard_normal(4001))
    late = np.where(random.random(4000) < between, random.random(4000), 0.0)
    logged = read[:-1] + late * np.diff(read)
    recordings = [{"a": logged, "b": torque[:-1]}]
    assert torque_steps_of(recordings, ["a", "b"]) == pytest.approx([step, 0.0], rel=1e-6)


def test_a_torque_that_is_switched_is_on_no_grid():
    pattern = np.repeat([3.0, 0.0, -3.0, 3.0, -3.0, 0.0, 3.0, -3.0], 60)
    recordings = [{"a": np.tile(pattern, 5), "b": np.tile(np.repeat([2.0, -2.0], 50), 20)}]
    assert not torque_steps_of(recordings, ["a", "b"]).any()


@pytest.mark.parametrize("source", ["motor", "joint_sensor"])
@pytest.mark.parametrize("asked", [True, False])
@pytest.mark.parametrize("wrong", ["model", "drive"])
def test_a_reading_is_rounded_where_what_is_nearer_to_it_says(source: str, asked: bool, wrong: str) -> None:
    """A model without the load that is carried, or a command beside friction, rounds elsewhere than the sensor."""
    random, inertia = np.random.default_rng(3), 0.1
    true, acceleration, off = random.normal(size=(3, 400, 2)) * np.array([1.0, 0.2])
    rotor = inertia * acceleration
    links = true + (0.3 * off if wrong == "model" else 0.01 * off)
    drive = true + rotor + (0.3 * off if wrong == "drive" else 0.01 * off)
    sensed = true + rotor if source == "motor" else true
    steps = np.array([0.5, 0.25])
    read = steps * np.round(sensed / steps)
    signals = SimpleNamespace(drive=drive if asked else None, motor_acceleration=acceleration, effort=read)
    log = SimpleNamespace(effort_source=source, effort_steps=steps, effort_dither=np.full(2, DITHER))
    found = _grid_errors(log, SimpleNamespace(reflected_inertia=np.full(2, inertia)), signals, links)
    by_command = drive if source == "motor" else drive - rotor
    by_model = links + rotor if source == "motor" else links
    best = by_command if asked and wrong == "model" else by_model
    np.testing.assert_allclose(found, mean_rounding(best, log.effort_steps, log.effort_dither))
    if wrong == ("model" if asked else "drive"):
        # What a sensor with little noise adds is where the grid says.
        assert np.corrcoef((read - sensed).ravel(), found.ravel())[0, 1] > 0.6


@pytest.mark.parametrize("step", [0.05, 0.2])
def test_what_a_torques_grid_adds_is_known_beside_accelerations_whose_noise_is_larger_than_a_step(
    step: float,
) -> None:
    random, rate = np.random.default_rng(11), 100.0
    time = np.arange(0.0, SECONDS, 1.0 / rate)
    q = 0.3 * np.sin(2.0 * np.pi * np.outer(time, random.uniform(0.1, 0.4, len(JOINTS))) + 1.0)
    model = model_of_urdf(URDF, JOINTS)
    v = differentiate(q, time)
    torque = inverse_dynamics(model.tree, q, v, differentiate(v, time))
    read = step * np.round((torque + DITHER * step * random.standard_normal(q.shape)) / step)
    position = q + 2e-5 * random.standard_normal(q.shape)
    log = Log(
        *("run", "run", rate, position, None, read, None, None, "joint_sensor", "none"),
        effort_steps=np.full(len(JOINTS), step),
        effort_dither=np.full(len(JOINTS), DITHER),
    )
    band = CommonBand.of(rate, 10.0)
    item = prepare(log, model, BatchedRigidModel.of_tree(URDF, model.tree), band)
    noise = inverse_dynamics(
        model.tree, item.signals.position, item.signals.velocity, item.signals.acceleration
    )
    assert (noise - torque)[:, 0].std() > step
    true = item.band.condense(mean_rounding(torque, log.effort_steps, log.effort_dither))
    for found, expected in zip(item.grid_nuisance.T, true.T, strict=True):
        assert np.corrcoef(found, expected)[0, 1] > 0.85
