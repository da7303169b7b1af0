# SPDX-License-Identifier: BSD-3-Clause
"""The brake of a stop: stiff enough to calm, never so stiff that sampling and delay could feed a motion."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from impedance_modules.safety.brake import (
    LARGEST_GAIN,
    UNKNOWN_DELAY,
    Brake,
    BrakeGains,
    apply_brake,
    brake_effort,
    brake_gains,
    make_brake,
    slip_to,
    trusted_motor_damping,
)
from tests.support.both_ways import ways  # noqa: F401

both_ways = pytest.mark.usefixtures("ways")
periods = st.floats(0.5e-3, 0.02)
relaxations = st.floats(1e-4, 10.0)
PHASES = np.linspace(1e-3, np.pi, 3000)


def needed_damping(stiffness: float, relaxation: float, period: float, delay: int) -> float:
    """Least viscous damping of a joint that is passive with this brake, by the condition of Colgate and Schenkel."""
    z = np.exp(1j * PHASES)
    brake = stiffness * (1.0 - 1.0 / z) / (1.0 - np.exp(-period / relaxation) / z) * z ** (-delay)
    return float(np.max(0.5 * period / (1.0 - np.cos(PHASES)) * np.real((1.0 - 1.0 / z) * brake)))


def needed_against_lag(stiffness: float, relaxation: float, lag: float) -> float:
    """The same without sampling, with a motor that follows its command with a first-order lag."""
    w = np.logspace(-2, 5, 3000)
    return float(np.max(-np.real(stiffness * relaxation / (1 + 1j * w * relaxation) / (1 + 1j * w * lag))))


def brake_of(stiffness: float, relaxation: float, period: float, effort_max: float = 1e9) -> Brake:
    return make_brake(
        BrakeGains(np.array([stiffness]), np.array([relaxation])), period, np.array([effort_max])
    )


@given(periods, st.integers(0, 40), st.floats(0.01, 5.0), st.floats(0.01, 10.0))
def test_the_motors_damping_pays_for_sampling_delay_and_the_largest_gain(
    period, delay, damping, inertia
) -> None:
    gains = brake_gains(np.array([damping]), np.array([inertia]), period, delay)
    stiffness, relaxation = float(gains.stiffness[0]), float(gains.relaxation[0])
    unknown = int(UNKNOWN_DELAY / period)
    assert LARGEST_GAIN * needed_damping(stiffness, relaxation, period, delay) <= damping
    assert LARGEST_GAIN * needed_damping(stiffness, relaxation, period, delay + unknown) <= damping * (
        1 + 1e-9
    )
    assert LARGEST_GAIN * needed_against_lag(stiffness, relaxation, UNKNOWN_DELAY) <= damping
    # No stiffer one would do: what is known and not known of the delay uses the damping up.
    spent = LARGEST_GAIN * stiffness * (period * (delay + 1) + UNKNOWN_DELAY)
    assert spent == pytest.approx(damping)


@given(st.floats(0.05, 5.0), st.floats(0.05, 5.0), st.floats(0.0, 0.9))
def test_the_largest_inertia_calms_soonest_and_a_smaller_one_no_later(damping, inertia, part) -> None:
    gains = brake_gains(np.array([damping]), np.array([inertia]), 1e-3, 2)
    K, T = float(gains.stiffness[0]), float(gains.relaxation[0])

    def slowest(body: float, relaxation: float) -> float:
        return float(
            np.max(np.roots([body * relaxation, body + damping * relaxation, damping + K * relaxation]).real)
        )

    decay = slowest(inertia, T)
    assert slowest((1.0 - part) * inertia, T) <= decay * (1 - 1e-5)
    for factor in (0.8, 1.25):
        assert slowest(inertia, factor * T) >= decay * (1 + 1e-5)


@both_ways
def test_a_motor_without_damping_or_without_rotor_gets_zero_torque() -> None:
    damping = trusted_motor_damping(np.array([0.7, 0.0, 0.7]), np.array([0.6, 0.6, 0.0]))
    brake = make_brake(brake_gains(damping, np.ones(3), 1e-3, 2), 1e-3, np.full(3, 50.0))
    effort = np.ones(3)
    apply_brake(brake, np.zeros(3))
    brake_effort(brake, np.array([0.1, 0.2, 0.3]), effort)
    slip_to(brake, effort)
    assert effort[0] < 0.0
    assert effort[1] == effort[2] == 0.0


@both_ways
def test_a_stop_begins_with_zero_torque_wherever_the_motor_stands() -> None:
    brake, effort = brake_of(20.0, 0.1, 1e-3), np.ones(1)
    brake.deflection[:] = 3.0
    apply_brake(brake, np.array([0.7]))
    brake_effort(brake, np.array([0.7]), effort)
    assert effort[0] == 0.0


@both_ways
def test_fast_motion_meets_the_spring_and_slow_motion_a_damper() -> None:
    brake, effort = brake_of(20.0, 0.1, 1e-3), np.zeros(1)
    brake_effort(brake, np.array([0.01]), effort)
    assert effort[0] == pytest.approx(-20.0 * 0.01)
    speed = 0.5
    for k in range(1, 2000):
        brake_effort(brake, np.array([0.01 + speed * 1e-3 * k]), effort)
    assert effort[0] == pytest.approx(-20.0 * 0.1 * speed, rel=0.01)


@both_ways
def test_without_new_samples_the_springs_relax() -> None:
    brake, effort = brake_of(20.0, 0.05, 1e-3), np.zeros(1)
    brake_effort(brake, np.array([0.1]), effort)
    first = effort[0]
    for _ in range(50):
        brake_effort(brake, np.array([0.1]), effort)
    assert effort[0] == pytest.approx(first * np.exp(-1.0))


@both_ways
@pytest.mark.parametrize("seed", range(20))
def test_no_path_and_no_limit_draws_more_than_sampling_explains(seed: int) -> None:
    """Work of torques that are held for a period: at most K/2 sum (step)^2, whatever is taken from them on the way."""
    random = np.random.default_rng(seed)
    K = random.uniform(1.0, 50.0)
    brake, effort = brake_of(K, random.uniform(1e-3, 1.0), 1e-3, random.uniform(0.1, 50.0)), np.zeros(1)
    path = np.cumsum(random.normal(scale=random.uniform(1e-4, 1e-1), size=400))
    apply_brake(brake, path[:1])
    work = 0.0
    for k in range(path.size - 1):
        brake_effort(brake, path[k : k + 1], effort)
        assert abs(effort[0]) <= brake.effort_max[0]
        effort *= random.choice([1.0, random.uniform(0.0, 1.0)])
        slip_to(brake, effort)
        assert effort[0] == pytest.approx(-K * brake.deflection[0])
        work += effort[0] * (path[k + 1] - path[k])
        assert work <= 0.5 * K * np.sum(np.diff(path[: k + 2]) ** 2) + 1e-12
