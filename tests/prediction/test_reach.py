# SPDX-License-Identifier: BSD-3-Clause
"""A target that no posture reaches is refused first, with how far it is; one that a posture reaches never is."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from impedance_modules.episode.reader import read_episode
from impedance_modules.robot.inverse_kinematics import FrameGoal, LimbKinematics
from impedance_modules.robot.model import RobotModel
from impedance_modules.robot.pose import Pose
from tests.support.commands import invoke, refusal
from tests.support.paths import CHECKOUT
from tests.support.plant_parts import BAXTER, SIX_JOINTS, spec_of

PLANAR = CHECKOUT / "robots" / "two_planar_arms"
LENGTH = 3.0
"""Of a planar arm: three links of 1 m."""

TASK = """format: 1
name: pull
robot: two_planar_arms
arms:
  right:
    posture: {{shoulder: 0.7, elbow: -1.5, wrist: 0.5}}
    joint_bias: {{stiffness: {{shoulder: 1, elbow: 1, wrist: 1}}, damping_ratio: 1}}
    springs:
      - name: hand
        frame: right_hand
        expressed_in: world
        stiffness: {{x: 20, y: 20}}
        damping_ratio: 1
safety: {{tank: {{initial: 900, max: 900, floor: 0.1}}}}
phases:
  - {{name: stay, duration: 0.2}}
  - {{name: pull, equilibrium: {{right.hand: {{x: {x}, y: {y}}}}}, duration: 8{more}}}
"""


def limb_of(folder: Path, name: str) -> tuple[RobotModel, LimbKinematics, str]:
    model = RobotModel(spec_of(folder))
    limb = model.limbs[name]
    return model, LimbKinematics(model, limb, np.zeros(model.n)), limb.hand


def pose_at(model: RobotModel, name: str, q: np.ndarray) -> Pose:
    whole = np.zeros(model.n)
    whole[model.limbs[name].joints] = q
    return model.pose(whole, model.limbs[name].hand)


@pytest.mark.parametrize(("folder", "limb"), [(BAXTER, "left"), (SIX_JOINTS, "starboard")], ids=str)
@settings(deadline=None, max_examples=25, derandomize=True)
@given(seed=st.integers(0, 10_000))
def test_where_a_hand_has_been_it_can_come_again(folder: Path, limb: str, seed: int) -> None:
    model, kinematics, hand = limb_of(folder, limb)
    random = np.random.default_rng(seed)
    q, start = random.uniform(kinematics.low, kinematics.high, (2, kinematics.low.size))
    goal = FrameGoal(hand, pose_at(model, limb, q))
    found = kinematics.nearest(goal, [start])
    assert found.distance < 1e-6 and found.angle < 1e-6
    place = FrameGoal(hand, goal.pose, oriented=False)
    assert kinematics.nearest(place, [0.5 * (kinematics.low + kinematics.high)]).distance < 1e-6
    assert (found.q >= kinematics.low).all() and (found.q <= kinematics.high).all()
    there = pose_at(model, limb, found.q)
    assert np.linalg.norm(there.translation - goal.pose.translation) < 1e-5
    if kinematics.reaches(goal, start):
        assert found.distance < 1e-3


@settings(deadline=None, max_examples=15)
@given(radius=st.floats(0.5, 6.0), angle=st.floats(-2.5, 2.5))
def test_what_is_left_is_the_distance_to_the_stretched_arm(radius: float, angle: float) -> None:
    _, kinematics, hand = limb_of(PLANAR, "right")
    place = radius * np.array([np.cos(angle), np.sin(angle), 0.0])
    found = kinematics.nearest(FrameGoal(hand, Pose(np.eye(3), place), oriented=False), [np.full(3, 0.3)])
    assert found.distance == pytest.approx(max(0.0, radius - LENGTH), abs=2e-3)


def written(folder: Path, x: float, y: float, more: str = "") -> Path:
    path = folder / "task.yaml"
    path.write_text(TASK.format(x=x, y=y, more=more))
    return path


def test_check_and_run_say_reach_before_joules(tmp_path: Path) -> None:
    """3.34 m away, 340 mm beyond a stretched arm of 3 m."""
    path = written(tmp_path, 3.34, 0.0)
    said = refusal("check", path)
    assert said == refusal("run", path, "--out", tmp_path / "out")
    assert said.startswith(f"{path}:17:44: phases[1].equilibrium.right.hand: phase 'pull': 'right_hand'")
    assert "than 340 mm, at (3.000, 0.000," in said.replace("-0.000", "0.000") and " J" not in said


def test_a_phase_may_pull_beyond_reach_or_say_how_near_is_enough(tmp_path: Path) -> None:
    for more in (", beyond_reach: true", ", until: {reached: {distance: 0.4, angle: 3}}, otherwise: next"):
        done = invoke("check", written(tmp_path, 3.34, 0.0, more))
        assert done.return_value == 0
    assert "comes no nearer to the target of 'right.hand' than 340 mm" in " ".join(done.output.split())
    assert "no nearer" in refusal(
        "check", written(tmp_path, 3.34, 0.0, ", until: {reached: {distance: 0.3, angle: 3}}")
    )


def test_a_run_says_how_far_the_hands_are_from_their_targets(tmp_path: Path) -> None:
    out = tmp_path / "out"
    done = invoke("run", written(tmp_path, 2.0, 0.5), "--out", out)
    assert done.return_value == 0
    summary = json.loads((out / "summary.json").read_text())
    last = summary["phases"][-1]["hands"]["right_hand"]
    assert summary["ended_in"] == {"phase": "pull", "hands": {"right_hand": last}}
    episode = read_episode(out)
    pose, target = (np.asarray(found["right_hand"])[-1] for found in (episode.pose, episode.target))
    assert last["position_error"] == pytest.approx(np.linalg.norm(pose[:3] - target[:3]), abs=1e-12)
    assert np.cos(0.5 * last["orientation_error"]) == pytest.approx(abs(pose[3:] @ target[3:]), abs=1e-9)
    assert last["units"] == "m, rad"
    assert f"{1e3 * last['position_error']:.1f} mm" in done.output
