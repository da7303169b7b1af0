# SPDX-License-Identifier: BSD-3-Clause
"""What an arm's part of a task must fulfil beyond its schema: joints, limits, frames, mirror images."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

from impedance_modules.errors import Problem, nearest
from impedance_modules.spec.robot_spec import JointSpec, LimbSpec
from impedance_modules.spec.task_draft import WORLD, DraftArm, TaskDraft, given_by_hand, mirrored_frames
from impedance_modules.spec.urdf import UrdfFacts
from impedance_modules.spec.yaml_tree import KeyPath


def arm_problems(draft: TaskDraft, arms: Mapping[str, DraftArm]) -> Iterator[Problem]:
    """Checks every arm against the robot."""
    for name in draft.keys("arms"):
        yield from _limb_problems(draft, name)
        if draft.has("arms", name, "mirror"):
            yield from _mirror_problems(draft, name)
        elif not draft.has("arms", name, "springs") and not draft.has("arms", name, "joint_bias"):
            message = "the arm has neither springs nor a joint bias, so nothing would hold it"
            yield draft.problem(("arms", name), message, at="key")
    for arm in arms.values():
        yield from _posture_problems(draft, arm)
        if arm.mirror_of is None:
            yield from _joint_bias_problems(draft, arm)
            yield from _frame_problems(draft, arm)


def _limb_problems(draft: TaskDraft, name: str) -> Iterator[Problem]:
    if draft.robot is not None and name not in draft.robot.limbs and ("arms", name) not in draft.broken:
        limbs = tuple(draft.robot.limbs)
        message = f"the robot '{draft.robot.name}' has no limb '{name}'{nearest(name, limbs)}"
        yield draft.problem(("arms", name), message, limbs, at="key")


def _mirror_problems(draft: TaskDraft, name: str) -> Iterator[Problem]:
    """An image needs a robot that says how, and an original that is written out."""
    at = ("arms", name, "mirror")
    if not draft.clean(*at):
        return
    original = draft.value(*at)
    written = tuple(arm for arm in draft.keys("arms") if not draft.has("arms", arm, "mirror"))
    if original == name:
        yield draft.problem(at, "an arm cannot be its own mirror image", written)
    elif original in draft.keys("arms") and original not in written:
        yield draft.problem(
            at, f"'{original}' is itself a mirror image; name an arm that is written out", written
        )
    elif original not in written:
        yield draft.problem(
            at, f"there is no arm '{original}' in this file{nearest(original, written)}", written
        )
    elif draft.robot is not None and draft.robot.mirror is None:
        yield draft.problem(
            at, f"the robot '{draft.robot.name}' has no 'mirror' in its file; write this arm out"
        )
    elif _without_signs(draft) and name not in draft.images and draft.robot is not None:
        message = (
            f"the joint angles of '{original}' have no mirror image: no joint signs make the arms of"
            f" '{draft.robot.name}' images of each other; write this arm out, or name a posture that its file has"
        )
        yield draft.problem(at, message)
    else:
        yield from _image_problems(draft, name, original)


def _without_signs(draft: TaskDraft) -> bool:
    """Whether no joint signs make one arm of the robot the image of the other."""
    mirror = None if draft.robot is None else draft.robot.mirror
    return mirror is not None and not mirror.joint_sign


def _image_problems(draft: TaskDraft, name: str, original: str) -> Iterator[Problem]:
    """Every frame that the original's springs name must have an image."""
    source, image = draft.limb(original), draft.limb(name)
    if draft.urdf is None or source is None or image is None:
        return
    frames = mirrored_frames(source, image, draft.urdf)
    for i in draft.count("arms", original, "springs"):
        for key in ("frame", "expressed_in"):
            frame = draft.value("arms", original, "springs", i, key)
            if isinstance(frame, str) and frame in draft.urdf.links and frame not in frames:
                message = (
                    f"'{frame}' ({key} of the spring at {original}.springs[{i}]) has no mirror image in "
                    f"the limb '{name}'; write this arm out"
                )
                yield draft.problem(("arms", name, "mirror"), message, sorted(frames))


def _posture_problems(draft: TaskDraft, arm: DraftArm) -> Iterator[Problem]:
    limb = draft.limb(arm.name)
    if limb is None or given_by_hand(draft, arm.mirror_of or arm.name):
        return
    if arm.mirror_of is None:
        yield from joint_name_problems(draft, arm.path("posture"), limb)
        for joint in limb.joints:
            if draft.keys(*arm.path("posture")) and not draft.has(*arm.path("posture", joint)):
                message = f"missing joint '{joint}': a posture gives every joint of the limb, in rad"
                yield draft.problem(arm.path("posture", joint), message, tuple(limb.joints), at="key")
    yield from limit_problems(draft, arm.posture, limb, arm.path("posture"))


def _joint_bias_problems(draft: TaskDraft, arm: DraftArm) -> Iterator[Problem]:
    limb = draft.limb(arm.name)
    if limb is not None:
        for key in ("stiffness", "damping"):
            yield from joint_name_problems(draft, arm.path("joint_bias", key), limb)


def joint_name_problems(draft: TaskDraft, path: KeyPath, limb: LimbSpec) -> Iterator[Problem]:
    """Checks that the keys of a mapping are short joint names of a limb."""
    known = tuple(limb.joints)
    for joint in draft.keys(*path):
        if joint not in known:
            message = f"the limb '{limb.name}' has no joint '{joint}'{nearest(joint, known)}"
            yield draft.problem((*path, joint), message, known, at="key")


def limit_problems(
    draft: TaskDraft, angles: Mapping[str, float], limb: LimbSpec, parent: KeyPath
) -> Iterator[Problem]:
    """Checks joint angles [rad] by short joint name against the robot's limits."""
    for short, angle in angles.items():
        joint = None if draft.robot is None else draft.robot.joints.get(limb.joints.get(short, ""))
        if joint is not None and not joint.position_min <= angle <= joint.position_max:
            message = (
                f"{angle:g} rad is outside the limits of '{joint.name}', {joint.position_min:g} to "
                f"{joint.position_max:g} rad{_degrees_hint(angle, joint)}"
            )
            yield draft.problem((*parent, short), message)


def _degrees_hint(angle: float, joint: JointSpec) -> str:
    """Says so where an angle only makes sense in degrees."""
    far = abs(angle) > 2.0 * max(abs(joint.position_min), abs(joint.position_max))
    if far and joint.position_min <= math.radians(angle) <= joint.position_max:
        return f"; are these degrees? {angle:g} deg = {math.radians(angle):.4g} rad"
    return ""


def _frame_problems(draft: TaskDraft, arm: DraftArm) -> Iterator[Problem]:
    limb = draft.limb(arm.name)
    if draft.urdf is None or limb is None:
        return
    moved = moved_links(draft.urdf, limb)
    axes = (WORLD, *draft.urdf.links)
    for i in draft.count(*arm.path("springs")):
        at = arm.path("springs", i)
        frame, expressed_in = draft.value(*at, "frame"), draft.value(*at, "expressed_in")
        if isinstance(frame, str) and frame not in moved:
            yield draft.problem((*at, "frame"), not_moved(frame, arm.name, moved, draft.urdf), moved)
        if isinstance(expressed_in, str) and expressed_in not in axes:
            message = f"there is no frame '{expressed_in}'{nearest(expressed_in, axes)}"
            yield draft.problem((*at, "expressed_in"), message, axes)


def moved_links(urdf: UrdfFacts, limb: LimbSpec) -> tuple[str, ...]:
    """Links that a joint of the limb moves, in the URDF's order."""
    joints = set(limb.joints.values())
    return tuple(link for link in urdf.links if joints & set(urdf.moving_joints(link)))


def not_moved(frame: str, arm: str, moved: tuple[str, ...], urdf: UrdfFacts) -> str:
    """Says that a frame is not moved by an arm, or not there at all."""
    if frame in urdf.links:
        return f"the frame '{frame}' is not moved by the arm '{arm}'{nearest(frame, moved)}"
    return f"the robot has no frame '{frame}'{nearest(frame, moved)}"
