# SPDX-License-Identifier: BSD-3-Clause
"""The joints' own torque loop on the plant: lighter rotors, the commanded torque in the springs, closed energy."""

from dataclasses import replace

import numpy as np
import pytest

from impedance_experiments.torque_loop_joint import measured_inertia
from impedance_modules.plant.plant import Plant
from impedance_modules.spec.robot_spec import InnerTorqueLoopSpec, RobotSpec
from impedance_modules.superposition.elastic_joints import drives_of, sampled_arm, sampling_of
from tests.support.plant_parts import BAXTER, WEIGHTLESS, exact, middle, posture, spec_of, started

RIGHT_W1 = "right_w1"


def looped(gain: float, delay: float = 0.0) -> RobotSpec:
    return replace(exact(spec_of(BAXTER)), inner_torque_loop=InnerTorqueLoopSpec(gain, delay))


def in_springs(subject: Plant) -> np.ndarray:
    return np.asarray(subject.sensed_torque)


@pytest.mark.parametrize("gain", [0.5, 1.5])
def test_a_link_meets_a_rotor_that_is_lighter_by_one_plus_the_gain(gain: float) -> None:
    joint = spec_of(BAXTER).joints[RIGHT_W1]
    met = measured_inertia(joint, InnerTorqueLoopSpec(gain, 0.0))
    assert met == pytest.approx(joint.reflected_inertia / (1.0 + gain), rel=0.02)


@pytest.mark.parametrize("delay", [0.0, 0.001])
def test_at_rest_the_springs_carry_what_was_commanded_and_the_loop_adds_nothing(delay: float) -> None:
    subject = started(looped(0.6, delay), at=posture)
    at_rest = in_springs(subject).copy()
    for _ in range(200):
        subject.advance(np.zeros(subject.model.n))
    assert in_springs(subject) == pytest.approx(at_rest, abs=1e-6)
    assert np.abs(subject.velocity).max() < 1e-6


def test_a_loop_of_no_gain_changes_no_bit() -> None:
    runs = []
    for spec in (exact(spec_of(BAXTER)), looped(0.0)):
        subject = started(spec, at=middle)
        for k in range(50):
            subject.advance(np.full(subject.model.n, 0.3 * np.sin(0.1 * k)))
        runs.append(subject.state.start.whole.copy())
    n = subject.model.n
    assert np.array_equal(runs[0][: 4 * n], runs[1][: 4 * n])


def test_the_energy_of_a_looped_robot_balances() -> None:
    """What the loop puts into the motors is booked as the robot's own work."""
    subject = started(looped(1.0, 0.001), at=middle, gravity=WEIGHTLESS)
    before = subject.energy()
    random = np.random.default_rng(3)
    for _ in range(500):
        subject.advance(random.uniform(-2.0, 2.0, subject.model.n))
    after = subject.energy()
    turned_over = sum(after.dissipated(before).values()) + abs(after.command_work) + abs(after.robot_work)
    assert abs(after.robot_work) > 1e-3
    assert abs(after.imbalance(before)) < 1e-5 * turned_over


def test_the_robots_own_hold_switches_the_loop_off() -> None:
    """Held, a looped robot and one without a loop are the same from then on."""
    ends = []
    for spec in (exact(spec_of(BAXTER)), looped(2.0)):
        subject = started(spec, at=middle)
        subject.hold()
        for _ in range(300):
            subject.advance(None)
        ends.append(subject.position)
    assert ends[0] == pytest.approx(ends[1], abs=1e-9)


def test_the_sampled_model_grows_as_the_plant_does() -> None:
    """Angles under a constant torque, by ``sampled_arm`` with an inner loop and on the plant."""
    spec = looped(1.2, 0.002)
    subject = started(spec, at=posture, gravity=WEIGHTLESS)
    model = subject.model
    limb = next(iter(model.limbs.values()))
    joints = limb.joints
    q = subject.position.copy()
    inertia = model.mass_matrix(q)[np.ix_(joints, joints)]
    arm = sampled_arm(inertia, drives_of(model, joints), sampling_of(spec, 1000.0, False), None, None)
    push = np.full(joints.size, 1e-4)
    state, command = np.zeros(len(arm.A)), np.zeros(model.n)
    command[joints] = push
    for _ in range(subject.delay):
        subject.advance(command)
    for _ in range(30):
        subject.advance(command)
        state = arm.A @ state + arm.B @ push
    assert subject.position[joints] - q[joints] == pytest.approx(arm.position @ state, rel=2e-3, abs=1e-12)
