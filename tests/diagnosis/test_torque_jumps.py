# SPDX-License-Identifier: BSD-3-Clause
"""Whoever records a torque that jumps, and slowly, is told; smooth torques, noise, grids and rests are not."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from impedance_modules.diagnosis.data.torque_jumps import FAST, JUMPS_MIN, jump_notes, jump_sizes, jumps

SECONDS = 20.0


def smooth(rate: float, rng: np.random.Generator, joints: int = 3) -> np.ndarray:
    """Torques (N, joints) of motions up to 1.5 Hz, which rest now and then [N.m]."""
    time = np.arange(0.0, SECONDS, 1.0 / rate)
    tones = sum(
        rng.uniform(1.0, 5.0, joints) * np.sin(2 * np.pi * rng.uniform(0.1, 1.5, joints) * time[:, None])
        for _ in range(4)
    )
    return np.asarray(tones * np.clip(1.2 + np.sin(2 * np.pi * 0.1 * time), 0.0, 1.0)[:, None])


def of_policy(rate: float, rng: np.random.Generator, joints: int = 3) -> np.ndarray:
    """Torques (N, joints) of a stiff joint that follows a target which is renewed twenty times a second [N.m]."""
    time = np.arange(0.0, SECONDS, 1.0 / rate)
    since = time % 0.05
    size = rng.uniform(2.0, 6.0, (int(SECONDS / 0.05) + 1, joints))[np.floor(time / 0.05).astype(int)]
    return smooth(rate, rng, joints) + size * np.exp(-since / 0.01)[:, None]


@settings(max_examples=60, deadline=None)
@given(
    st.integers(0, 10_000), st.sampled_from([50.0, 100.0, 200.0, 250.0, 1000.0]), st.sampled_from([0.01, 0.1])
)
def test_smooth_torques_with_noise_do_not_jump(seed: int, rate: float, noise: float) -> None:
    rng = np.random.default_rng(seed)
    torque = smooth(rate, rng)
    assert jumps(torque + noise * rng.standard_normal(torque.shape)) < JUMPS_MIN


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10_000), st.sampled_from([100.0, 200.0, 250.0]))
def test_torques_of_a_held_target_do(seed: int, rate: float) -> None:
    rng = np.random.default_rng(seed)
    torque = of_policy(rate, rng)
    assert jumps(torque + 0.01 * rng.standard_normal(torque.shape)) > JUMPS_MIN


def test_a_torque_that_stands_still_on_its_grid_says_nothing() -> None:
    slow = 0.001 * smooth(500.0, np.random.default_rng(1))
    assert jumps(np.round(slow / 0.02) * 0.02) == 0.0


@pytest.mark.parametrize(("rate", "told"), [(100.0, True), (FAST, False), (1000.0, False)])
def test_a_low_rate_is_told_with_the_recording_and_what_would_do(rate: float, told: bool) -> None:
    rng = np.random.default_rng(2)
    target = {"position_command": None, "samples": round(SECONDS * rate)}
    calm = SimpleNamespace(name="calm", rate=rate, command=smooth(rate, rng), effort=None, **target)
    calm.command = calm.command + 0.01 * rng.standard_normal(calm.command.shape)
    jumping = SimpleNamespace(name="held", rate=rate, command=None, effort=of_policy(rate, rng), **target)
    notes = jump_notes([calm, jumping])
    assert len(notes) == int(told)
    if told:
        assert notes[0].startswith("held: torques jump, and at 100 Hz")
        assert "400 Hz" in notes[0] and "calm" not in notes[0]
        calm.rate = 50.0  # a slower one that does not jump changes nothing
        assert jump_notes([calm, jumping]) == notes
        jumping.position_command = np.repeat(rng.normal(size=(400, 3)), round(0.05 * rate), axis=0)
        assert jump_notes([calm, jumping]) == ()  # where the target is recorded it is known what jumps


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10_000), st.sampled_from([100.0, 200.0, 240.0]))
def test_jumps_without_a_recorded_target_are_where_it_was_renewed(seed: int, rate: float) -> None:
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, SECONDS, 1.0 / rate)
    torque = (
        smooth(rate, rng)
        + 8.0 * rng.standard_normal((400, 3)).repeat(round(0.05 * rate), axis=0)[: time.size]
    )
    log = SimpleNamespace(position_command=None, samples=time.size)
    found = jump_sizes(log, torque)
    renewed = np.arange(time.size) % round(0.05 * rate) == 0
    largest = np.abs(found).argmax(axis=0)
    assert np.abs(found[renewed]).sum() > 3.0 * np.abs(found[~renewed]).sum() and renewed[largest].all()
    # One smooth torque in some thousands has a second difference that just stands out.
    assert np.abs(jump_sizes(log, smooth(rate, rng))).max() < 0.01
