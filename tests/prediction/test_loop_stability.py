# SPDX-License-Identifier: BSD-3-Clause
"""The linear loop model against the plant: where it says that an arm goes unstable, the arm does."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from impedance_modules.modules.damping import endpoint_damping, joint_damping
from impedance_modules.modules.mobility import mobility
from impedance_modules.modules.motor_velocity import begin_at, estimate_motor_velocity, motor_velocity
from impedance_modules.plant.plant import Plant, PlantOptions
from impedance_modules.robot.model import RobotModel
from impedance_modules.spec.robot_reader import read_robot
from impedance_modules.superposition.elastic_joints import drives_of, sampled_arm, sampling_of
from impedance_modules.superposition.sampled_loop import Gains, highest_stable_stiffness, spectral_radius
from tests.support.arm_samples import hand_of

RATE = 1000.0
POSTURE = np.array([0.6, -0.5, 0.1, 1.4, 0.2, 0.7, 0.0])
JOINT_STIFFNESS = np.array([10.0, 30, 5, 5, 5, 20, 10])
END_STIFFNESS = np.diag([300.0, 300, 300, 10, 10, 10])


@cache
def quiet_baxter() -> RobotModel:
    """Without quantisation and noise, which would hide a slow growth; delay and velocity lag stay."""
    robot = read_robot("baxter")
    names = ("position_resolution", "effort_resolution", "position_noise", "effort_noise")
    return RobotModel(replace(robot, sensors=replace(robot.sensors, **dict.fromkeys(names, 0.0))))


class Loop:
    """One arm's springs and dampers, as the linear model and as the plant see them."""

    def __init__(self, ratio: float, motor_side: bool) -> None:
        self.model, self.motor_side = quiet_baxter(), motor_side
        limb = next(iter(self.model.limbs.values()))
        self.joints, self.q = limb.joints, np.zeros(self.model.n)
        self.q[self.joints] = POSTURE
        _, J, inverse = hand_of(self.model, limb, self.q)
        inertia = np.linalg.inv(inverse)
        (D,) = endpoint_damping([END_STIFFNESS], [ratio], mobility(J, inverse))
        self.fixed = Gains(np.diag(JOINT_STIFFNESS), joint_damping(JOINT_STIFFNESS, inertia, ratio))
        self.scaled = Gains(J.T @ END_STIFFNESS @ J, J.T @ D @ J)
        drives = drives_of(self.model, self.joints)
        sampling = sampling_of(self.model.spec, RATE, motor_side)
        self.arm = sampled_arm(inertia, drives, sampling, None, None)

    def gains(self, scale: float) -> Gains:
        stiffness = self.fixed.stiffness + scale * self.scaled.stiffness
        return Gains(stiffness, self.fixed.damping + np.sqrt(scale) * self.scaled.damping)

    def growth(self, scale: float, first: int, last: int) -> float:
        """Pushes the plant once; by how much its motion grows per period from one to another of them."""
        gains = self.gains(scale)
        plant = Plant(self.model, (), None, PlantOptions(RATE, 0, noise=False, gravity=(0.0, 0.0, 0.0)))
        plant.reset(self.q)
        lag = self.model.spec.sensors.velocity_filter
        motor = motor_velocity(self.model.spring_compliance()[self.joints], 1.0 / RATE, lag)
        size = []
        for k in range(last + 300):
            state = plant.sense()
            offset, velocity = state.position[self.joints] - POSTURE, state.velocity[self.joints]
            if k == 0:
                begin_at(motor, velocity, state.effort[self.joints])
            else:
                estimate_motor_velocity(motor, velocity, state.effort[self.joints])
            command = np.zeros(self.model.n)
            damped = motor.velocity if self.motor_side else velocity
            command[self.joints] = -gains.stiffness @ offset - gains.damping @ damped + 0.01 * (k < 5)
            plant.advance(command)
            size.append(float(np.linalg.norm(offset)))
        return float((max(size[last:]) / max(size[first : first + 300])) ** (1.0 / (last - first)))


def test_the_plant_loses_stability_where_the_model_says() -> None:
    loop = Loop(0.7, motor_side=True)
    limit = highest_stable_stiffness(loop.arm, loop.fixed, loop.scaled, 1e3)
    assert limit is not None and limit * 300.0 > 900.0
    # Near the limit growth is slow: first let everything else die out.
    for scale in (0.9, 1.1):
        found = loop.growth(scale * limit, 5000, 7000)
        assert (found < 1.0) == (scale < 1.0)
        assert found == pytest.approx(spectral_radius(loop.arm, loop.gains(scale * limit)), abs=1e-4)


@pytest.mark.parametrize("scale", [1.0, 2.0])
def test_damping_the_links_grows_as_fast_as_the_model_says(scale: float) -> None:
    loop = Loop(0.7, motor_side=False)
    predicted = spectral_radius(loop.arm, loop.gains(scale))
    assert predicted > 1.003
    # The growth is large; beyond the first second the arm leaves the linear range.
    assert loop.growth(scale, 700, 1300) == pytest.approx(predicted, abs=8e-4)
