# SPDX-License-Identifier: BSD-3-Clause
"""What the gripper orders of a task must fulfil: the robot has the gripper, and it can do what is asked."""

from __future__ import annotations

from collections.abc import Generator, Iterator

from impedance_modules.errors import BadInput, Problem, nearest
from impedance_modules.spec.document import scan_document
from impedance_modules.spec.gripper_spec import CLOSE, WIDTH, GripperSpec
from impedance_modules.spec.locate import ROBOT_FILE, find_robot, list_robots
from impedance_modules.spec.task_draft import TaskDraft
from impedance_modules.spec.yaml_tree import KeyPath


def gripper_problems(draft: TaskDraft) -> Iterator[Problem]:
    """Checks every order and every condition of grippers, phase by phase."""
    ordered: set[str] = set()
    for i in draft.count("phases"):
        orders, waits = ("phases", i, "grippers"), ("phases", i, "until", "gripper")
        for arm in draft.keys(*orders):
            ordered.add(arm)
            gripper = yield from _of_arm(draft, (*orders, arm))
            if gripper is not None and draft.clean(*orders, arm):
                yield from _range_problems(draft, (*orders, arm), arm, gripper)
        for arm in draft.keys(*waits):
            gripper = yield from _of_arm(draft, (*waits, arm))
            if gripper is not None and arm not in ordered:
                message = f"nothing has been ordered of the gripper of '{arm}' up to this phase"
                yield draft.problem((*waits, arm), message, (f"grippers: {{{arm}: ...}}",), at="key")
        if draft.has("playback") and (draft.has(*orders) or draft.has(*waits)):
            message = "the robot's own playback of a joint path orders no grippers"
            yield draft.problem(
                orders if draft.has(*orders) else waits, message, ("a task without 'playback'",), at="key"
            )


def _of_arm(draft: TaskDraft, at: KeyPath) -> Generator[Problem, None, GripperSpec | None]:
    """Finds the gripper that a key names, and says where there is none."""
    arm, arms = str(at[-1]), draft.keys("arms")
    if arm not in arms:
        yield draft.problem(at, f"there is no arm '{arm}' in this file{nearest(arm, arms)}", arms, at="key")
        return None
    limb = draft.limb(arm)
    if limb is None or draft.robot is None:
        return None
    if limb.gripper is None:
        message = f"the limb '{arm}' of robot '{draft.robot.name}' has no gripper"
        valid = f"no such key, or a robot that has one: {', '.join(robots_with_grippers())}"
        yield draft.problem(at, message, (valid,), at="key")
    return limb.gripper


def _range_problems(draft: TaskDraft, at: KeyPath, arm: str, gripper: GripperSpec) -> Iterator[Problem]:
    """Checks that width, force and speed are within what the gripper can."""
    given = draft.value(*at)
    if not isinstance(given, dict):
        return
    if (CLOSE in given) == (WIDTH in given):
        yield draft.problem(
            at, "an order is one motion", ("open", "close: {force: ...}", "width: ..."), at="key"
        )
        return
    if CLOSE in given and "speed" in given:
        yield draft.problem(
            (*at, "speed"), "the speed of closing stands beside its force", ("close: {force, speed}",)
        )
    bounds = {
        (WIDTH,): (gripper.narrowest, gripper.widest, "m"),
        (CLOSE, "force"): (0.0, gripper.force, "N"),
        ("speed",): (0.0, gripper.speed, "m/s"),
        (CLOSE, "speed"): (0.0, gripper.speed, "m/s"),
    }
    for key, (low, high, unit) in bounds.items():
        value = draft.value(*at, *key)
        if value is not None and not low <= float(value) <= high:
            message = f"{float(value):g} {unit} is outside what the gripper of '{arm}' ({gripper.kind}) can"
            yield draft.problem((*at, *key), message, (f"{low:g} to {high:g} {unit}",))


def robots_with_grippers() -> tuple[str, ...]:
    """Names the shipped robots of which some limb has a gripper."""
    return tuple(name for name in list_robots() if _has_gripper(name))


def _has_gripper(name: str) -> bool:
    try:
        data = scan_document(find_robot(name) / ROBOT_FILE).data
    except BadInput:
        return False
    limbs = data.get("limbs")
    return isinstance(limbs, dict) and any(
        "gripper" in limb for limb in limbs.values() if isinstance(limb, dict)
    )
