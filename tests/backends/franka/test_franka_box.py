# SPDX-License-Identifier: BSD-3-Clause
"""Two FR3 carry a box: the built-in plant, MuJoCo and simulated arms over the maker's protocol agree."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from xml.etree import ElementTree

import numpy as np
import pytest

from benchmarks.backends.fr3_box import PATCH, BoxRun, Pace, is_like, run_on_arms, run_simulated
from impedance_modules.robot.model import RobotModel
from impedance_modules.runs.verify import verify
from impedance_modules.spec.patch_file import read_patch
from impedance_modules.spec.robot_reader import read_robot
from tests.support.franka_robot import assets
from tests.support.franka_simulator import NO_FRANKA
from tests.support.paths import CHECKOUT

needs_arms = pytest.mark.skipif(bool(NO_FRANKA), reason=NO_FRANKA)

RATE, SLOWER = 200.0, 4.0
"""Of the control loop [Hz], and how much slower than real time the arms' clock goes: for two cores that are shared."""


@pytest.fixture(scope="module")
def plant(tmp_path_factory: pytest.TempPathFactory) -> BoxRun:
    return run_simulated(tmp_path_factory.mktemp("plant") / "run", "sim", RATE, 0)


def moved(run: BoxRun, away: float) -> BoxRun:
    """The run, its hands some way along y [m]."""
    pose = {
        hand: values + np.array([0.0, away, 0.0, 0.0, 0.0, 0.0, 0.0])
        for hand, values in run.episode.pose.items()
    }
    return BoxRun(replace(run.episode, pose=MappingProxyType(pose)), run.summary)


@pytest.mark.long
def test_mujoco_carries_the_box_as_the_plant_does(plant: BoxRun, tmp_path: Path) -> None:
    other = run_simulated(tmp_path / "run", "mujoco", RATE, 0)
    assert is_like(plant, other)
    assert not is_like(plant, moved(plant, 0.0051)) and not is_like(plant, moved(plant, -0.0051))
    assert is_like(plant, moved(plant, 0.0049))
    fewer = {**other.summary, "phases": other.summary["phases"][::-1]}
    assert not is_like(plant, BoxRun(other.episode, fewer))


@needs_arms
@pytest.mark.realtime
def test_simulated_arms_carry_the_box_as_the_plant_does(plant: BoxRun, tmp_path: Path) -> None:
    arms = run_on_arms(tmp_path, RATE, Pace(SLOWER))
    assert arms.summary["ending"] == "done" and arms.episode.metadata["backend"] == "franka"
    assert is_like(plant, arms)
    assert verify(arms.episode, lambda _: None).samples == len(arms.episode)
    # Not the plant's recording in another name: sensors without noise, and a box that was handed over.
    for hand, path in arms.episode.pose.items():
        assert np.abs(path[:100, :3] - plant.episode.pose[hand][:100, :3]).max() > 0.0


@needs_arms
def test_friction_rotors_and_damping_are_those_of_the_simulator() -> None:
    tree = ElementTree.parse(assets() / "fr3.xml").getroot()
    usual = tree.find("./default/default[@class='fr3']/joint")
    assert usual is not None
    spec = read_robot(CHECKOUT / "robots" / "fr3-pair")
    model = RobotModel(spec)
    (effect,) = read_patch(PATCH).effects
    assert sorted(effect.joints) == sorted(model.joint_names)
    rotors, damping = model.column("reflected_inertia"), model.column("motor_damping")
    for i, joint in enumerate(model.joint_names):
        theirs = tree.find(f".//joint[@name='{joint.partition('_')[2]}']")
        assert theirs is not None
        numbers = {**usual.attrib, **theirs.attrib}
        assert effect.parameters[joint]["fc"].value == float(numbers["frictionloss"])
        assert rotors[i] == float(numbers["armature"]) and damping[i] == float(numbers["damping"])
