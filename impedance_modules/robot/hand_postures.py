# SPDX-License-Identifier: BSD-3-Clause
"""Joint angles of postures that a task gives by the pose of a hand.

An image of such an arm takes the mirrored angles. Angles are rounded to a millionth of a radian, so that another
release of a library finds the same ones.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from impedance_modules.errors import BadFile, Problem
from impedance_modules.robot.inverse_kinematics import FoundPosture, FrameGoal, LimbKinematics, elbow_missed
from impedance_modules.robot.model import RobotModel
from impedance_modules.robot.pose import Pose
from impedance_modules.robot.rotation import exp3
from impedance_modules.spec.robot_spec import RobotSpec
from impedance_modules.spec.task import ArmSpec, HandPosture, TaskSpec
from impedance_modules.spec.task_draft import mirrored_posture

DIGITS = 6
"""Of joint angles [rad]."""

PLACED, TURNED = 1e-5, 1e-4
"""How near a posture must bring a hand to its pose [m], [rad]."""

ELBOW_PLACED = 1e-3
"""How near to its angle the elbow must come [rad]."""


def with_joint_angles(task: TaskSpec, robot: RobotSpec) -> TaskSpec:
    """Returns a task whose postures are all joint angles.

    Raises:
        BadFile: A hand's pose, or the elbow's angle, is out of reach: by how much, with its line; every one.
    """
    if not any(arm.by_hand for arm in task.arms.values()):
        return task
    model, problems = RobotModel(robot), list[Problem]()
    solved: dict[str, Mapping[str, float]] = {}
    for name, arm in task.arms.items():
        if arm.by_hand is None or arm.mirror_of is not None:
            continue
        found = find_posture(model, name, arm.by_hand)
        problems += _problems(task, arm, found)
        solved[name] = joint_angles(model, name, found)
    if problems:
        raise BadFile(problems)
    arms = {name: _with_angles(arm, solved, robot) for name, arm in task.arms.items()}
    return replace(task, arms=arms)


def find_posture(model: RobotModel, limb: str, asked: HandPosture) -> FoundPosture:
    """Finds the posture of a limb that brings its hand to a pose, or as near as it comes.

    Where hand and elbow cannot both come to their places, the hand does if it can.
    """
    rotation = np.eye(3) if asked.turn is None else exp3(np.array(asked.turn))
    goal = FrameGoal(
        model.limbs[limb].hand,
        Pose(rotation, np.array(asked.place)),
        oriented=asked.turn is not None,
        elbow=asked.elbow,
    )
    kinematics = LimbKinematics(model, model.limbs[limb], np.zeros(model.n))
    found = kinematics.most_central(goal)
    if asked.elbow is None or not _hand_missed(found):
        return found
    return kinematics.nearest(replace(goal, elbow=None), [found.q])


def joint_angles(model: RobotModel, limb: str, found: FoundPosture) -> dict[str, float]:
    """Gives rounded angles by short joint name [rad], inside the joints' limits."""
    chosen, angles = model.limbs[limb], {}
    low, high = model.column("position_min"), model.column("position_max")
    for short, joint, angle in zip(chosen.short_names, chosen.joints, found.q, strict=True):
        angles[short] = float(np.clip(round(float(angle), DIGITS), low[joint], high[joint])) + 0.0
    return angles


def what_is_missed(found: FoundPosture, asked: HandPosture) -> tuple[str, str]:
    """Says how far hand and elbow stay from what is asked; empty where they come there."""
    hand, elbow = "", ""
    if _hand_missed(found):
        hand = f"the nearest posture leaves {1e3 * found.distance:.1f} mm and {found.angle:.3f} rad"
    elif elbow_missed(found.elbow, asked.elbow) > ELBOW_PLACED:
        nearest = (
            "the elbow lies on the line to the hand" if found.elbow is None else f"{found.elbow:.3f} rad"
        )
        elbow = f"with the hand in place the elbow cannot come to this angle; nearest: {nearest}"
    return hand, elbow


def _hand_missed(found: FoundPosture) -> bool:
    return found.distance > PLACED or found.angle > TURNED


def _problems(task: TaskSpec, arm: ArmSpec, found: FoundPosture) -> list[Problem]:
    if arm.by_hand is None:
        return []
    hand, elbow = what_is_missed(found, arm.by_hand)
    at, problems = ("arms", arm.limb, "posture"), []
    if hand:
        message = f"the hand cannot come to this pose within the joints' ranges: {hand} (valid: a pose within reach)"
        problems.append(task.document.problem((*at, "hand"), message))
    if elbow:
        problems.append(task.document.problem((*at, "elbow"), elbow))
    return problems


def _with_angles(arm: ArmSpec, solved: Mapping[str, Mapping[str, float]], robot: RobotSpec) -> ArmSpec:
    if arm.by_hand is None:
        return arm
    if arm.mirror_of is None or robot.mirror is None:
        return replace(arm, posture=solved[arm.limb])
    return replace(arm, posture=mirrored_posture(solved[arm.mirror_of], robot.mirror))
