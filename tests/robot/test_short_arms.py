# SPDX-License-Identifier: BSD-3-Clause
"""Arms of one, two or three joints are checked, analysed and run like any other."""

import json
import shutil
from pathlib import Path

import pytest
import yaml
from click.testing import CliRunner

from impedance_modules.cli.main import impedance
from tests.support.paths import SIX_JOINT_PAIR

POSTURE = {"turn": 0.13, "lift": 0.3, "bend": -0.8}
HOLD = """
format: 1
name: short-arm
robot: short
arms:
  port:
    posture: {posture}
    joint_bias: {{stiffness: {stiffness}, damping_ratio: 0.7}}
safety: {{tank: {{initial: 3, max: 5, floor: 0.5}}}}
phases: [{{name: hold, duration: 0.5}}]
"""


def short_robot(folder: Path, joints: int) -> Path:
    """The port arm of the test robot with all but its first joints locked, and a task that holds it."""
    robot = folder / "robots" / "short"
    shutil.copytree(SIX_JOINT_PAIR, robot)
    file = robot / "robot.yaml"
    written = yaml.safe_load(file.read_text())
    names = list(POSTURE)[:joints]
    port, starboard = (written["limbs"][limb]["joints"] for limb in ("port", "starboard"))
    locked = [joint for short, joint in port.items() if short not in names] + list(starboard.values())
    written["limbs"] = {"port": {"hand": "port_palm", "joints": {name: port[name] for name in names}}}
    written["locked"] = {joint: 0.0 for joint in locked}
    written["joints"] = {
        key: {name: value for name, value in values.items() if name in names}
        for key, values in written["joints"].items()
    }
    del written["mirror"]
    written["collision"]["pairs"] = []
    file.write_text(yaml.safe_dump(written, sort_keys=False))
    posture, stiffness = {name: POSTURE[name] for name in names}, dict.fromkeys(names, 20.0)
    (folder / "short-arm.yaml").write_text(HOLD.format(posture=posture, stiffness=stiffness))
    return folder / "short-arm.yaml"


@pytest.mark.parametrize("joints", [1, 2, 3])
def test_an_arm_of_few_joints_holds_its_posture(tmp_path: Path, joints: int) -> None:
    task = short_robot(tmp_path, joints)
    out = tmp_path / "out"
    for verb, *options in (["check"], ["analyze"], ["run", "--out", str(out)]):
        result = CliRunner().invoke(impedance, [verb, str(task), *options], standalone_mode=False)
        assert result.exception is None and not result.return_value, (verb, result.exception)
    assert json.loads((out / "summary.json").read_text())["ending"] == "done"
