# SPDX-License-Identifier: BSD-3-Clause
"""The robot of this benchmark: one arm of the tests' six-joint robot, of which three joints move."""

from __future__ import annotations

import shutil
from pathlib import Path

import yaml

SOURCE = Path(__file__).parents[2] / "tests" / "robots" / "six_joint_pair"
NAME = "three_joint_arm"
MOVING = ("turn", "lift", "bend")
LOCKED = ("roll", "tilt", "spin")
TURN_STIFFNESS = 1500.0
"""Stiffness of the joint that is rigid in the tests' robot [N.m/rad]: its effort would jump with every command."""

POSITION_NOISE, EFFORT_NOISE = 2.0e-5, 0.05
"""Noise of the sensors [rad, N.m]."""


def write_robot(parent: Path) -> Path:
    """Writes the robot's folder below ``parent`` and returns it; nothing is written where it is already.

    An effort sensor does not see what a spring's own damping passes on: here the springs have none.
    """
    folder = parent / NAME
    if (folder / "robot.yaml").is_file():
        return folder
    shutil.copytree(SOURCE, folder, dirs_exist_ok=True)
    data = yaml.safe_load((folder / "robot.yaml").read_text())
    joints = {kind: _of_one_arm(values) for kind, values in data["joints"].items()}
    joints["spring_stiffness"]["turn"] = TURN_STIFFNESS
    joints["spring_damping"] = dict.fromkeys(MOVING, 0)
    still = [f"port_{name}" for name in LOCKED] + [f"starboard_{name}" for name in (*MOVING, *LOCKED)]
    limb = {"hand": "port_palm", "joints": {name: f"port_{name}" for name in MOVING}}
    data |= {"name": NAME, "limbs": {"port": limb}, "joints": joints, "locked": dict.fromkeys(still, 0.0)}
    data["sensors"] |= {"position_noise": POSITION_NOISE, "effort_noise": EFFORT_NOISE}
    data["collision"]["pairs"] = [["port_flange", "post"]]
    del data["mirror"]
    (folder / "robot.yaml").write_text(yaml.safe_dump(data, sort_keys=False))
    return folder


def _of_one_arm(values: dict[str, object]) -> dict[str, object]:
    return {name: value for name, value in values.items() if name in MOVING}
