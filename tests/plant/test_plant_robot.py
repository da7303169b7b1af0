# SPDX-License-Identifier: BSD-3-Clause
"""The robot's side of the plant: late commands, coarse sensors, own modes, joints of three kinds, effects."""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from impedance_modules.effects.joint_motion import JointMotion
from impedance_modules.errors import BadInput, NotConnected
from impedance_modules.plant.motor_commands import CommandQueue, Mode, Order, delay_periods
from impedance_modules.plant.plant import PlantOptions, divide
from impedance_modules.spec.robot_spec import TimingSpec
from tests.support.plant_parts import (
    BAXTER,
    PERFECT,
    SIX_JOINTS,
    WEIGHTLESS,
    exact,
    idle,
    in_both_hands,
    middle,
    plane,
    plant,
    posture,
    spec_of,
    started,
    undamped,
    with_every,
)

ROBOT = exact(spec_of(BAXTER))


def order(value: float) -> Order:
    return Order(Mode.TORQUE, np.full(1, value))


@given(delay=st.floats(0.0, 0.02), rate=st.floats(100.0, 2000.0))
def test_a_command_acts_whole_periods_later_and_never_early(delay, rate) -> None:
    timing = TimingSpec(rate, 1.0, 1e4, delay, 1.0)
    line = CommandQueue(timing, rate, order(-1.0))
    periods = line.delay
    assert delay - 1e-9 <= periods / rate < delay + 1.0 / rate
    acted = [line.exchange(order(float(k))).effort[0] for k in range(periods + 5)]
    assert acted == [-1.0] * periods + [0.0, 1.0, 2.0, 3.0, 4.0]


@pytest.mark.parametrize(
    ("delay", "rate", "periods"), [(0.002, 1000.0, 2), (0.002, 500.0, 1), (0.002, 800.0, 2)]
)
def test_delay_rounds_up_to_whole_periods(delay, rate, periods) -> None:
    assert delay_periods(TimingSpec(rate, 1.0, 1e4, delay, 1.0), rate) == periods


def test_the_plant_moves_exactly_when_the_command_arrives() -> None:
    """Two periods of delay on Baxter at 1 kHz: the motor stands still for two and moves in the third."""
    subject = started(replace(spec_of(BAXTER), sensors=PERFECT), gravity=WEIGHTLESS, at=middle)
    start = subject.motor_position
    for period in range(3):
        subject.advance(np.full(subject.model.n, 1.0))
        moved = np.abs(subject.motor_position - start).max()
        assert (moved > 0.0) == (period == 2)
    assert subject.delay == 2


@given(rate=st.floats(100.0, 2000.0), step=st.floats(5e-5, 1e-3))
def test_loops_and_steps_fill_the_period(rate, step) -> None:
    division = divide(PlantOptions(rate=rate, seed=0, step=step))
    assert division.loops * division.steps * division.step == pytest.approx(1.0 / rate)
    assert division.loop <= 1.0e-3 * (1 + 1e-9)
    assert division.step <= step * (1 + 1e-9)


def test_reports_sit_on_the_sensors_grid() -> None:
    subject = started(spec_of(BAXTER))
    sensors = subject.model.spec.sensors
    for _ in range(50):
        subject.advance(subject.start_command + 1.0)
        state = subject.sense()
        grids = ((state.position, sensors.position_resolution), (state.effort, sensors.effort_resolution))
        for value, grid in grids:
            np.testing.assert_allclose(value / grid, np.round(value / grid), atol=1e-6)
        spread = 6.0 * sensors.position_noise + sensors.position_resolution
        assert np.abs(state.position - subject.position).max() < spread
    assert not state.position.flags.writeable


def run(seed: int, noise: bool) -> np.ndarray:
    subject = started(spec_of(BAXTER), seed=seed, noise=noise)
    rows = []
    for _ in range(30):
        state = subject.sense()
        rows.append(np.concatenate([state.position, state.velocity, state.effort]))
        subject.advance(-5.0 * state.velocity)
    return np.array(rows)


def test_the_same_seed_gives_the_same_run_bit_by_bit() -> None:
    np.testing.assert_array_equal(run(3, True), run(3, True))
    assert np.abs(run(3, True) - run(4, True)).max() > 0.0
    np.testing.assert_array_equal(run(3, False), run(4, False))


def test_a_second_reset_starts_the_same_run_again() -> None:
    spec = ROBOT
    subject = plant(spec, held=in_both_hands(spec, squeeze=15.0))
    ends = []
    for _ in range(2):
        subject.reset(posture(subject.model))
        for _ in range(40):
            subject.advance(np.ones(subject.model.n))
        where = subject.object_pose.translation
        ends.append((subject.position, subject.motor_velocity, where, subject.motor_work))
    for first, second in zip(*ends, strict=True):
        np.testing.assert_array_equal(first, second)


def test_velocity_lags_by_the_filters_time_constant() -> None:
    """Under a constant acceleration a first-order estimate is late by its time constant."""
    spec = undamped(spec_of(BAXTER))
    spec = replace(spec, sensors=replace(PERFECT, velocity_filter=0.0135))
    subject = started(spec, gravity=WEIGHTLESS, at=middle)
    subject.place(np.full(subject.model.n, 0.2), np.zeros(subject.model.n))
    idle(subject, 14)
    share = subject.sense().velocity / subject.velocity
    np.testing.assert_allclose(share, 1.0 - np.exp(-14e-3 / 0.0135), atol=0.02)


def test_missing_commands_make_the_robot_hold_after_its_time_out() -> None:
    spec = replace(ROBOT, timing=TimingSpec(1000.0, 100.0, 1000.0, 0.0, 0.05))
    subject = started(spec)
    subject.advance(np.full(subject.model.n, 2.0))
    modes = []
    for _ in range(60):
        subject.advance(None)
        modes.append(subject.mode)
    assert modes[:50] == [Mode.TORQUE] * 50
    assert modes[50:] == [Mode.HOLD] * 10
    subject.advance(np.zeros(subject.model.n))
    assert subject.mode is Mode.TORQUE


def test_hold_stops_a_moving_loaded_robot_and_keeps_it() -> None:
    """Motor-side and passive: it comes to rest near where the order arrived, object and all."""
    spec = ROBOT
    subject = started(spec, held=in_both_hands(spec, squeeze=15.0))
    for _ in range(150):
        subject.advance(subject.start_command + 2.0)
    assert np.abs(subject.velocity).max() > 0.1
    where = subject.position
    subject.hold()
    for _ in range(2000):
        subject.advance(None)
    assert subject.mode is Mode.HOLD
    assert np.abs(subject.velocity).max() < 2e-3
    assert np.abs(subject.position - where).max() < 0.02
    assert np.abs(subject.state.joints["command"]).max() == 0.0


def test_release_leaves_only_the_weight_carried() -> None:
    subject = started(ROBOT)
    subject.release()
    for _ in range(300):
        subject.advance(None)
    assert subject.mode is Mode.RELEASE
    assert np.abs(subject.velocity).max() < 1e-6
    np.testing.assert_allclose(subject.load, subject.model.gravity(subject.position), atol=1e-6)


def test_nobody_carries_the_weight_twice() -> None:
    """A robot that leaves gravity to the command starts with it in the command."""
    for who, expected in (("robot", 0.0), ("command", 1.0), ("none", 1.0)):
        subject = started(replace(ROBOT, gravity_compensation=who))
        weight = subject.model.gravity(posture(subject.model))
        np.testing.assert_allclose(subject.start_command, expected * weight, atol=1e-9)
        idle(subject, 50)
        assert np.abs(subject.velocity).max() < 1e-6


@pytest.mark.parametrize("folder", [BAXTER, SIX_JOINTS])
def test_ideal_joints_turn_torque_into_load_at_once(folder) -> None:
    """I_r = 0: the load is the command, theta = q + tau / K, and work of the command is tau . dtheta."""
    spec = with_every(exact(spec_of(folder)), reflected_inertia=0.0)
    subject = started(spec, gravity=WEIGHTLESS, at=middle)
    n, compliance = subject.model.n, subject.model.spring_compliance()
    rng, booked = np.random.default_rng(5), 0.0
    for _ in range(30):
        before, command = subject.motor_position, 0.2 * rng.normal(size=n)
        subject.advance(command)
        np.testing.assert_array_equal(subject.sense().effort, command)
        expected = subject.position + compliance * command
        np.testing.assert_allclose(subject.motor_position, expected, atol=1e-14)
        booked += float(command @ (subject.motor_position - before))
        assert subject.motor_work == pytest.approx(booked, rel=1e-9, abs=1e-12)


@pytest.mark.parametrize("folder", [BAXTER, SIX_JOINTS])
def test_the_motor_port_is_seen_from_outside(folder) -> None:
    """theta = q + effort / K_sea without spring damping; work is tau . dtheta: what a ledger computes."""
    subject = started(with_every(exact(spec_of(folder)), spring_damping=0.0), at=middle)
    compliance, booked = subject.model.spring_compliance(), 0.0
    rng = np.random.default_rng(2)

    def seen() -> np.ndarray:
        state = subject.sense()
        return state.position + compliance * state.effort

    for _ in range(100):
        before, command = seen(), rng.normal(size=subject.model.n)
        subject.advance(command)
        np.testing.assert_allclose(seen(), subject.motor_position, atol=1e-12)
        booked += float(command @ (seen() - before))
    assert subject.motor_work == pytest.approx(booked, rel=1e-9)
    assert abs(booked) > 1e-3


def test_a_rigid_joints_effort_is_the_torque_behind_its_rotor() -> None:
    """tau_s = tau_m - D v - I_r v': what the links alone need, by their own inverse dynamics."""
    subject = started(exact(spec_of(SIX_JOINTS)), gravity=WEIGHTLESS, at=middle)
    rigid = [i for i, joint in enumerate(subject.model.joints) if joint.spring_stiffness is None]
    assert rigid
    for _ in range(20):
        subject.advance(np.full(subject.model.n, 3.0))
    before, effort = subject.velocity, subject.sense().effort
    subject.advance(np.full(subject.model.n, 3.0))
    after = subject.sense().effort
    acceleration = (subject.velocity - before) / 1e-3
    for i in rigid:
        joint = subject.model.joints[i]
        expected = 3.0 - joint.motor_damping * 0.5 * (before[i] + subject.velocity[i])
        expected -= joint.reflected_inertia * acceleration[i]
        assert 0.5 * (effort[i] + after[i]) == pytest.approx(expected, abs=2e-2)
    np.testing.assert_array_equal(subject.motor_position[rigid], subject.position[rigid])


def test_stops_end_the_motion_at_the_limits() -> None:
    subject = started(ROBOT, gravity=WEIGHTLESS, at=middle)
    before = subject.energy()
    for _ in range(3000):
        subject.advance(0.15 * subject.model.column("effort_max"))
    beyond = subject.position - subject.model.column("position_max")
    assert 0.0 < beyond.max() < 0.02
    assert subject.energy().dissipated(before)["stops"] > 0.0
    assert abs(subject.energy().imbalance(before)) < 1e-3 * subject.motor_work


@dataclass
class Viscous:
    """Viscous friction, written as an effect."""

    coefficient: float
    port: Literal["motor", "link"]
    settled: int = 0

    def torque(self, motion: JointMotion) -> np.ndarray:
        speed = motion.motor_velocity if self.port == "motor" else motion.velocity
        return -self.coefficient * speed

    def settle(self, motion: JointMotion) -> None:
        self.settled += 1


def test_an_effect_at_the_motor_is_the_same_as_the_robots_own_damping() -> None:
    perturbed = plant(undamped(spec_of(BAXTER)), gravity=WEIGHTLESS)
    effect = Viscous(0.7, "motor")
    perturbed.torques.append(effect)
    own = plant(with_every(undamped(spec_of(BAXTER)), motor_damping=0.7), gravity=WEIGHTLESS)
    rng = np.random.default_rng(0)
    commands = rng.normal(size=(40, 14))
    for subject in (perturbed, own):
        subject.reset(middle(subject.model))
    before = perturbed.energy()
    for command in commands:
        perturbed.advance(command)
        own.advance(command)
    np.testing.assert_allclose(perturbed.position, own.position, atol=1e-13)
    assert perturbed.energy().effect_work == pytest.approx(-own.energy().motor_loss, rel=1e-9)
    assert abs(perturbed.energy().imbalance(before)) < 1e-9
    assert effect.settled == 160


def test_a_period_in_one_call_is_its_stages_one_by_one() -> None:
    """Box on a table, pushed about: the same run with an effect of nothing asked at every stage, to the last bit."""
    spec, held = spec_of(BAXTER), in_both_hands(spec_of(BAXTER), squeeze=15.0)
    bare = plant(spec, [], held)
    bare.reset(middle(bare.model))
    table = plane(float(bare.object_pose.translation[2]) - 0.0995)
    ends = []
    for effects in ([], [Viscous(0.0, "motor")]):
        subject = plant(spec, [table], held)
        subject.torques.extend(effects)
        subject.reset(middle(subject.model))
        pressed, rng = 0.0, np.random.default_rng(3)
        for _ in range(100):
            subject.advance(subject.start_command + rng.normal(size=subject.model.n))
            pressed = max(pressed, subject.contact_wrench("object")[2])
        assert pressed > 1.0
        ends.append(subject.state.start.whole.copy())
    np.testing.assert_array_equal(*ends)


def test_an_effect_at_the_link_is_another_physics() -> None:
    results = []
    for port in ("motor", "link"):
        subject = plant(undamped(spec_of(BAXTER)), gravity=WEIGHTLESS)
        subject.torques.append(Viscous(0.7, port))
        subject.reset(middle(subject.model))
        before = subject.energy()
        for _ in range(40):
            subject.advance(np.ones(14))
        assert abs(subject.energy().imbalance(before)) < 1e-9
        results.append(subject.position)
    assert np.abs(results[0] - results[1]).max() > 1e-6


@settings(max_examples=20)
@given(st.integers(0, 13), st.sampled_from([float("nan"), float("inf"), -float("inf")]))
def test_a_torque_that_is_no_number_is_refused(joint, value) -> None:
    command = np.zeros(14)
    command[joint] = value
    with pytest.raises(BadInput, match="14 finite numbers"):
        REFUSING.advance(command)


REFUSING = started(ROBOT)


def test_misuse_is_explained() -> None:
    fresh = plant(ROBOT)
    with pytest.raises(NotConnected, match="reset"):
        fresh.sense()
    with pytest.raises(BadInput, match="above 0"):
        PlantOptions(rate=0.0, seed=0)
    with pytest.raises(BadInput, match="did you mean"):
        REFUSING.contact_wrench("left_hnad")
    with pytest.raises(BadInput, match="robot, command, none"):
        plant(replace(ROBOT, gravity_compensation="perhaps"))
