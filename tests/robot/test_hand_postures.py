# SPDX-License-Identifier: BSD-3-Clause
"""Postures by the pose of a hand: the joint angles bring it there, and what is out of reach is told with its line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from impedance_modules.control.assembly import assemble
from impedance_modules.robot.hand_postures import find_posture, joint_angles
from impedance_modules.robot.inverse_kinematics import LimbKinematics, elbow_missed
from impedance_modules.robot.model import RobotModel
from impedance_modules.robot.pose import Pose
from impedance_modules.robot.rotation import log3
from impedance_modules.spec.task import HandPosture
from tests.support.commands import invoke, refusal
from tests.support.paths import CHECKOUT, TESTS
from tests.support.plant_parts import BAXTER, SIX_JOINTS, spec_of

PANDA = CHECKOUT / "robots" / "panda"

TASK = (TESTS / "data" / "hand-posture.yaml").read_text()
HAND, ELBOW = "{x: 0.75, y: -0.3, z: 0.15, rx: 0, ry: 3.14159, rz: 0}", ", elbow: 1.2"


def asked_at(
    model: RobotModel, limb: str, q: np.ndarray, elbow: float | None = None
) -> tuple[HandPosture, Pose]:
    """What asks for the pose of the hand at q (k,) [rad]."""
    whole = np.zeros(model.n)
    whole[model.limbs[limb].joints] = q
    pose = model.pose(whole, model.limbs[limb].hand)
    return HandPosture(tuple(pose.translation), tuple(log3(pose.rotation)), elbow), pose


@pytest.mark.parametrize(
    ("folder", "limb"), [(BAXTER, "left"), (SIX_JOINTS, "port"), (PANDA, "right")], ids=str
)
@settings(deadline=None, max_examples=4, derandomize=True)
@given(seed=st.integers(0, 10_000))
def test_the_angles_bring_hand_and_elbow_where_they_are_asked(folder: Path, limb: str, seed: int) -> None:
    model = RobotModel(spec_of(folder))
    kinematics = LimbKinematics(model, model.limbs[limb], np.zeros(model.n))
    random = np.random.default_rng(seed)
    # Well inside the ranges: at their ends another branch of postures may be the only one left.
    middle, half = 0.5 * (kinematics.low + kinematics.high), 0.5 * (kinematics.high - kinematics.low)
    q = middle + 0.6 * half * random.uniform(-1.0, 1.0, middle.size)
    elbow = kinematics.elbow_angle(q, model.limbs[limb].hand)
    asked, pose = asked_at(model, limb, q, elbow)
    found = find_posture(model, limb, asked)
    angles = np.array(list(joint_angles(model, limb, found).values()))
    assert (angles >= kinematics.low).all() and (angles <= kinematics.high).all()
    _, there = asked_at(model, limb, angles)
    assert np.linalg.norm(there.translation - pose.translation) < 2e-5
    assert np.linalg.norm(log3(there.rotation @ pose.rotation.T)) < 2e-4
    assert elbow_missed(kinematics.elbow_angle(angles, model.limbs[limb].hand), elbow) < 2e-3


def test_an_elbow_hangs_at_zero_and_turns_by_the_right_hand_rule() -> None:
    model = RobotModel(spec_of(BAXTER))
    limb = model.limbs["right"]
    kinematics = LimbKinematics(model, limb, np.zeros(model.n))
    for angle in (0.0, 0.5, -0.5):
        found = find_posture(model, "right", HandPosture((0.7, -0.3, 0.2), None, angle))
        whole = np.zeros(model.n)
        whole[limb.joints] = found.q
        shoulder, elbow, hand = (
            model.pose(whole, frame).translation
            for frame in ("right_upper_shoulder", "right_lower_elbow", "right_hand")
        )
        assert elbow_missed(kinematics.elbow_angle(found.q, limb.hand), angle) < 1e-6
        along = (hand - shoulder) / np.linalg.norm(hand - shoulder)
        across = elbow - shoulder - (elbow - shoulder) @ along * along
        assert across[2] < 0.0, "the elbow is below the line"
        aside = across @ np.cross(along, [0.0, 0.0, -1.0])
        assert np.sign(aside) == np.sign(angle) or abs(aside) < 1e-6 > abs(angle)


def written(folder: Path, hand: str = HAND, elbow: str = ELBOW) -> Path:
    path = folder / "task.yaml"
    path.write_text(TASK.replace(HAND, hand).replace(ELBOW, elbow))
    return path


def test_a_task_by_hand_is_the_task_by_its_angles(tmp_path: Path) -> None:
    path = written(tmp_path, elbow="")
    printed = yaml.safe_load(invoke("ik", path).output)
    by_hand = assemble(str(path), effects=None, rate=None, scale=1.0, arm=None)
    text = path.read_text().replace(f"{{hand: {HAND}}}", str(printed["right"]["posture"]).replace("'", ""))
    (tmp_path / "angles.yaml").write_text(text)
    by_angles = assemble(str(tmp_path / "angles.yaml"), effects=None, rate=None, scale=1.0, arm=None)
    assert by_hand.modules.posture.tolist() == by_angles.modules.posture.tolist()
    right, left = (by_hand.model.pose(by_hand.modules.posture, f"{side}_hand") for side in ("right", "left"))
    assert right.translation == pytest.approx([0.75, -0.3, 0.15], abs=2e-5)
    assert left.translation == pytest.approx(right.translation * [1.0, -1.0, 1.0], abs=1e-3)
    out = tmp_path / "out"
    assert invoke("run", path, "--out", out).return_value == 0
    assert "every torque bit-equal" in invoke("replay", out, "--verify").output


def test_what_is_out_of_reach_is_told_with_line_and_distance(tmp_path: Path) -> None:
    far = written(tmp_path, "{x: 2.75, y: -0.3, z: 0.15}")
    said = refusal("check", far)
    assert said == refusal("run", far, "--out", tmp_path / "out") == refusal("ik", far)
    assert said.startswith(f"{far}:8:21: arms.right.posture.hand: the hand cannot come to this pose")
    missing = refusal("check", written(tmp_path, "{x: 0.7, y: -0.3}"))
    assert "arms.right.posture.hand.z: missing key 'z'" in missing
    assert "radians, not degrees" in refusal("check", written(tmp_path, elbow=", elbow: 90"))
    assert "leaves" in refusal("ik", "baxter", "--arm", "right", "--hand", "3,0,0")


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("baxter", "--arm", "left", "--hand", "1,2"), "not three or six numbers"),
        (("baxter", "--hand", "1,2,3"), "--arm is missing"),
        (("baxter", "--arm", "rigth", "--hand", "1,2,3"), "did you mean 'right'?"),
        (("baxter", "--elbow", "1"), "go with --hand"),
        (("gone", "--hand", "1,2,3"), "there is no robot 'gone'"),
    ],
    ids=str,
)
def test_bad_options(words: tuple[str, ...], says: str) -> None:
    assert says in refusal("ik", *words)
