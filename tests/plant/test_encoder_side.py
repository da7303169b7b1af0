# SPDX-License-Identifier: BSD-3-Clause
"""A joint whose encoder sits at its motor: what the plant reports, the tank takes for theta, and modes feed back."""

from dataclasses import replace

import numpy as np
import pytest

from impedance_modules.plant.plant import Plant, PlantOptions
from impedance_modules.robot.model import RobotModel
from impedance_modules.safety.motor_port import spring_compliances
from impedance_modules.superposition.elastic_joints import Drives, Sampling, sampled_arm
from tests.support.effect_recordings import start
from tests.support.plant_parts import SIX_JOINTS, exact, spec_of

AT_MOTOR = ("port_lift", "port_turn", "starboard_bend")


def moved() -> RobotModel:
    spec = exact(spec_of(SIX_JOINTS))
    joints = {name: replace(spec.joints[name], encoder="motor") for name in AT_MOTOR}
    return RobotModel(replace(spec, joints={**spec.joints, **joints}))


def test_the_plant_reports_the_rotor_and_moves_the_robots_own_estimates_with_it() -> None:
    plant = Plant(moved(), [], None, PlantOptions(500.0, seed=1, noise=False))
    plant.reset(start(plant.model))
    random = np.random.default_rng(4)
    for _ in range(40):
        plant.advance(plant.start_command + random.uniform(-3.0, 3.0, plant.model.n))
    seen, compliance = plant.sense(), plant.model.spring_compliance()
    at_motor = plant.model.encoder_at_motor
    assert {name for name, there in zip(plant.model.joint_names, at_motor, strict=True) if there} == {
        *AT_MOTOR
    }
    truth = plant.position + np.where(at_motor, compliance * plant.sensed_torque, 0.0)
    assert np.allclose(seen.position, truth, rtol=0.0, atol=1e-9)
    lift = plant.model.joint_names.index("port_lift")
    assert abs(seen.position[lift] - plant.position[lift]) > 1e-4


def test_the_tank_adds_no_twist_to_a_rotor_that_is_read() -> None:
    model = moved()
    own = dict(zip(model.joint_names, spring_compliances(model.joints), strict=True))
    assert all(own[name] == 0.0 for name in AT_MOTOR)
    assert own["starboard_lift"] == pytest.approx(1.0 / 1200.0)


@pytest.mark.parametrize("motor_side", [False, True])
def test_what_modes_feed_back_is_what_the_encoder_reads(motor_side: bool) -> None:
    one, loop = np.ones(1), Sampling(500.0, 1, 2, 0.004, motor_side)
    drives = Drives(800.0 * one, 0.4 * one, 0.5 * one, 0.2 * one)
    motion = np.random.default_rng(2).normal(size=4)
    for side, state in ((False, 0), (True, 1)):
        arm = sampled_arm(
            0.7 * np.eye(1), replace(drives, encoder_at_motor=np.array([side])), loop, None, None
        )
        after = arm.A @ np.concatenate([motion, np.zeros(len(arm.A) - 4)])
        assert arm.position @ after == pytest.approx(after[state])
    if motor_side:  # the rate of a deflection, which the last two states hold, has been read already
        assert not arm.A[-2:, :4].any()
