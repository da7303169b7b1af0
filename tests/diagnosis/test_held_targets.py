# SPDX-License-Identifier: BSD-3-Clause
"""Targets that are held: found at any rate, and what their jerks do to a recording is no finding."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from impedance_modules.diagnosis.data.held_targets import jumps_of_target, renewal_rate, renewals
from impedance_modules.diagnosis.data.log import Log
from impedance_modules.diagnosis.regression.jumped_torques import jump_column, jump_noise
from impedance_modules.diagnosis.residuals.band import BAND_MIN, choose_band, renewal_note

SECONDS = 20.0


def path(time: np.ndarray, seed: int) -> np.ndarray:
    """Positions (N, 2) of a motion below 1 Hz [rad]."""
    rng = np.random.default_rng(seed)
    tones = (
        rng.uniform(0.2, 0.5, 2) * np.sin(6.28 * rng.uniform(0.2, 1.0, 2) * time[:, None]) for _ in range(3)
    )
    return np.asarray(sum(tones))


def log(rate: float, seed: int, hold: float | None, late: float = 0.0) -> Log:
    """A recording whose target is the path, held for some time [s]; ``late``: when the first row is taken [s]."""
    time = late + np.arange(round(SECONDS * rate)) / rate
    aimed = path(time if hold is None else hold * np.floor(time / hold + 1e-9), seed)
    return Log("run", "run", rate, path(time, seed), None, None, None, aimed, None, "none")


@settings(max_examples=60, deadline=None)
@given(
    st.integers(0, 999),
    st.sampled_from([100.0, 200.0, 250.0, 500.0, 1000.0]),
    st.sampled_from([0.05, 0.08, 0.1]),
    st.floats(0.0, 0.01),
)
def test_a_held_target_is_found_with_its_frequency(seed, rate, hold, late):
    held = log(rate, seed, hold, late)
    assert renewal_rate(held) == pytest.approx(1.0 / hold, rel=0.26 if rate < 200.0 else 0.06)
    assert renewals(held).mean() == pytest.approx(1.0 / hold / rate, rel=0.1)


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 999), st.sampled_from([50.0, 100.0, 200.0, 1000.0]))
def test_a_target_that_moves_all_the_time_or_rests_between_motions_is_not_held(seed, rate):
    moving = log(rate, seed, None)
    assert not renewals(moving).any() and renewal_rate(moving) == 0.0
    resting = moving.position_command.copy()
    resting[len(resting) // 4 : len(resting) // 2] = resting[len(resting) // 4]
    resting[-len(resting) // 4 :] = resting[-len(resting) // 4]
    paused = Log("run", "run", rate, moving.position, None, None, None, resting, None, "none")
    assert renewal_rate(paused) == 0.0


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 999), st.sampled_from([100.0, 200.0, 1000.0]), st.sampled_from([0.05, 0.1]))
def test_the_band_ends_before_the_frequency_of_renewals(seed, rate, hold):
    alone = choose_band([log(rate, seed, None)])
    among = choose_band([log(rate, seed, None), log(rate, seed, hold)])
    assert among.cutoff <= 0.64 / hold
    assert BAND_MIN <= among.cutoff <= alone.cutoff


def test_who_is_compared_in_a_narrower_band_is_told_why_and_how_wide():
    logs = [log(200.0, 7, 0.08)]
    common = choose_band(logs)
    (note,) = renewal_note(logs, common)
    assert "renewed 12.5 times a second" in note and f"below {common.cutoff:.3g} Hz" in note
    moving = [log(200.0, 7, None)]
    assert renewal_note(moving, choose_band(moving)) == ()


def test_rare_steps_of_a_target_change_no_band():
    steps = [log(200.0, 3, None), log(200.0, 3, 1.0)]
    assert choose_band(steps).cutoff == choose_band(steps[:1]).cutoff


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 999), st.sampled_from([50.0, 100.0, 200.0, 500.0]), st.sampled_from([0.08, 0.1]))
def test_torques_jump_where_a_held_target_is_renewed_in_proportion_to_its_steps(seed, rate, hold):
    """Also where much else happens between two rows, as it does at a low rate."""
    held, stiffness = log(rate, seed, hold), np.array([40.0, 300.0])
    rng, rows = np.random.default_rng(seed), held.samples
    torque = stiffness * (held.position_command - held.position) + 0.1 * rng.standard_normal((rows, 2))
    found, renewed = jumps_of_target(held, torque), renewals(held)
    assert not found[~renewed].any()
    steps = np.diff(held.position_command, axis=0, prepend=held.position_command[:1])
    assert found[renewed] == pytest.approx((stiffness * steps)[renewed], rel=0.35, abs=1e-9)


def test_without_a_held_target_nothing_is_known_to_jump():
    moving = log(200.0, 4, None)
    assert not jumps_of_target(moving, 100.0 * moving.position_command).any()
    unknown = replace(moving, position_command=None)
    assert not jumps_of_target(unknown, 100.0 * moving.position).any()


@pytest.mark.parametrize("residual", ["drive", "motor"])
def test_jumps_at_unknown_moments_make_a_column_and_a_noise_of_their_size(residual):
    """With all instants alike a residual is the column; with instants by chance it is as strong as the noise."""
    held = log(200.0, 5, 0.08)
    jumps = jumps_of_target(held, 100.0 * (held.position_command - held.position))
    none = np.zeros_like(jumps)
    band = choose_band([held]).at(held.rate)
    item: Any = SimpleNamespace(
        command_jumps=jumps if residual == "drive" else none,
        effort_jumps=jumps if residual == "motor" else none,
        band=band,
        samples=band.kept(len(jumps)),
    )
    for joint in (0, 1):
        assert jump_column(item, (residual, joint)) == pytest.approx(band.condense(jumps[:, joint]))
    early = np.random.default_rng(9).uniform(-0.5, 0.5, jumps.shape)
    made = band.condense(early * jumps)[:, 0]
    assert np.std(jump_noise(item, (residual, 0), 1)) == pytest.approx(np.std(made), rel=0.25)
    for other in ("velocity", "motor" if residual == "drive" else "drive"):
        assert not jump_column(item, (other, 0)).any() and not jump_noise(item, (other, 0), 1).any()
