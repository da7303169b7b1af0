# SPDX-License-Identifier: BSD-3-Clause
"""The filter's limits are those of the robot file: number by number, read from the file as text."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from impedance_modules.control.assembly import assemble
from impedance_modules.safety.limits import braking_deceleration, limits_of
from impedance_modules.spec.robot_reader import read_robot
from tests.support.paths import CHECKOUT, TESTS

ROBOTS = {"baxter": CHECKOUT / "robots" / "baxter", "six_joint_pair": TESTS / "robots" / "six_joint_pair"}


def numbers(robot: Path, what: str) -> list[Any]:
    """The values of one table in robot.yaml, in the order of all limbs' joints."""
    text = yaml.safe_load((robot / "robot.yaml").read_text())
    table = text["joints"][what]
    joints = [pair for limb in text["limbs"].values() for pair in limb["joints"].items()]
    return [table[full] if full in table else table[short] for short, full in joints]


@pytest.mark.parametrize("name", ROBOTS)
@pytest.mark.parametrize("rate", [1000.0, 250.0, 80.0])
def test_limits_are_those_of_the_robot_file(name: str, rate: float) -> None:
    robot = ROBOTS[name]
    spec = read_robot(robot)
    joints = [spec.joints[full] for full in joint_names(robot)]
    braking, rotors = np.linspace(5.0, 30.0, len(joints)), np.linspace(0.1, 0.6, len(joints))
    found = limits_of(
        joints, spec.timing, rate=rate, reflected_inertia=rotors, deceleration=braking, margin=0.03
    )
    ends = np.array(numbers(robot, "position"))
    assert found.position_min.tolist() == ends[:, 0].tolist()
    assert found.position_max.tolist() == ends[:, 1].tolist()
    assert found.velocity_max.tolist() == numbers(robot, "velocity")
    assert found.effort_max.tolist() == numbers(robot, "effort")
    assert found.effort_rate_max.tolist() == numbers(robot, "effort_rate")
    assert found.return_speed == pytest.approx(0.1 * np.array(numbers(robot, "velocity")))
    assert found.deceleration.tolist() == braking.tolist()
    assert (found.margin, found.separation_speed, found.separation_acceleration) == (0.03, 0.1, 5.0)
    delay = yaml.safe_load((robot / "robot.yaml").read_text())["timing"]["command_delay"]
    assert (found.period, found.delay) == (1.0 / rate, delay)
    rise = np.max(np.array(numbers(robot, "effort")) / np.array(numbers(robot, "effort_rate")))
    assert found.horizon == pytest.approx(max(5.0 / rate + delay, 2.0 * rise))
    assert found.pair_horizon == pytest.approx(max(5.0 / rate + delay, rise))
    springs = numbers(robot, "spring_stiffness")
    assert found.compliance == pytest.approx([0.0 if k == "rigid" else 1.0 / k for k in springs])
    assert found.reflected_inertia.tolist() == rotors.tolist()
    assert found.approach_time == pytest.approx(max(0.2, 4.0 * found.pair_horizon))


def joint_names(robot: Path) -> list[str]:
    text = yaml.safe_load((robot / "robot.yaml").read_text())
    return [full for limb in text["limbs"].values() for full in limb["joints"].values()]


def test_braking_takes_half_the_torque_against_the_joints_own_inertia() -> None:
    found = braking_deceleration(np.array([50.0, 15.0]), np.array([2.0, 0.5]))
    assert found.tolist() == [12.5, 15.0]


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        ({"margin": -0.01}, "margin must not be negative"),
        ({"deceleration": np.zeros(14)}, "deceleration"),
        ({"look_ahead": 0, "rate": 10.0}, "horizon"),
    ],
)
def test_limits_that_make_no_sense_are_refused(wrong: dict[str, Any], says: str) -> None:
    spec = read_robot("baxter")
    every = np.ones(14)
    given = {"rate": 100.0, "reflected_inertia": every, "deceleration": 20.0 * every, "margin": 0.03} | wrong
    with pytest.raises(ValueError, match=says):
        limits_of(tuple(spec.joints.values()), spec.timing, **given)


def test_a_run_is_assembled_with_the_limits_of_its_robot() -> None:
    assembly = assemble("press-box", effects=None, rate=None, scale=1.0, arm=None)
    robot, limits, tank = ROBOTS["baxter"], assembly.limits, assembly.tank
    assert limits.effort_max.tolist() == numbers(robot, "effort")
    assert limits.velocity_max.tolist() == tank.speed_bound.tolist() == numbers(robot, "velocity")
    assert (1.0 / tank.compliance).tolist() == pytest.approx(numbers(robot, "spring_stiffness"))
    assert limits.margin == assembly.robot.collision.margin
    assert (tank.period, tank.delay, tank.hold) == (0.001, 2, 0.001)
