# SPDX-License-Identifier: BSD-3-Clause
"""What the phases of a task must fulfil beyond their schema: targets, limits, changed springs."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

from impedance_modules.errors import Problem, nearest
from impedance_modules.spec.build_task import build_axes, build_matrix, build_numbers
from impedance_modules.spec.check_arms import joint_name_problems, limit_problems
from impedance_modules.spec.check_between import between_names
from impedance_modules.spec.check_grippers import gripper_problems
from impedance_modules.spec.check_hinge import hinge_target_problems
from impedance_modules.spec.check_paths import path_problems
from impedance_modules.spec.check_set_points import set_point_problems
from impedance_modules.spec.check_springs import (
    UndampedAxis,
    joined_axes,
    matrix_problems,
    springs_complete,
    undamped_axes,
)
from impedance_modules.spec.check_submovements import submovement_problems
from impedance_modules.spec.hinge_spec import HINGE
from impedance_modules.spec.path_spec import PATH
from impedance_modules.spec.task import SpringSpec
from impedance_modules.spec.task_draft import DraftArm, TaskDraft, spring_names
from impedance_modules.spec.yaml_tree import KeyPath

OBJECT = "object"


def phase_problems(draft: TaskDraft, arms: Mapping[str, DraftArm]) -> Iterator[Problem]:
    """Checks every phase, and the springs as the phases change them."""
    springs = tuple(f"{arm}.{name}" for arm in draft.keys("arms") for name in spring_names(draft, arm))
    yield from _name_problems(draft)
    for i in draft.count("phases"):
        at = ("phases", i)
        yield from _equilibrium_problems(draft, (*at, "equilibrium"), (*springs, *between_names(draft)))
        for target in draft.keys(*at, "equilibrium"):
            yield from submovement_problems(draft, at, target)
            yield from path_problems(draft, at, target)
        yield from _twice_moved_problems(draft, (*at, "equilibrium"), arms)
        yield from hinge_target_problems(draft, (*at, "equilibrium"), arms)
        yield from _posture_problems(draft, (*at, "posture"))
        for key in ("axes", "stiffness"):
            for target in draft.keys(*at, key):
                if target in between_names(draft):
                    message = (
                        f"'{target}' is between two arms: phases move its rest, its gains stay as declared"
                    )
                    yield draft.problem((*at, key, target), message, springs, at="key")
                elif target not in springs:
                    message = f"there is no spring '{target}'{nearest(target, springs)}"
                    yield draft.problem((*at, key, target), message, springs, at="key")
        for target in draft.keys(*at, "stiffness"):
            if draft.clean(*at, "stiffness", target):
                matrix = build_matrix(draft.value(*at, "stiffness", target))
                yield from matrix_problems(draft, (*at, "stiffness", target), matrix)
        yield from _until_problems(draft, at)
        yield from _blend_problems(draft, at)
    yield from gripper_problems(draft)
    yield from set_point_problems(draft, arms, springs)
    for arm in arms.values():
        yield from _changed_spring_problems(draft, arm)


def _blend_problems(draft: TaskDraft, at: KeyPath) -> Iterator[Problem]:
    """Gains that are still coming in when the phase ends would never be in force."""
    if draft.clean(*at, "blend") and draft.clean(*at, "duration"):
        blend, duration = float(draft.value(*at, "blend")), float(draft.value(*at, "duration"))
        if blend > duration:
            message = f"the gains come in over {blend:g} s, the phase lasts {duration:g} s"
            yield draft.problem((*at, "blend"), message, (f"up to {duration:g}",))


def _name_problems(draft: TaskDraft) -> Iterator[Problem]:
    seen: dict[str, int] = {}
    for i in draft.count("phases"):
        name = draft.value("phases", i, "name")
        if isinstance(name, str) and name in seen:
            message = f"phases[{seen[name]}] already has the name '{name}'"
            yield draft.problem(("phases", i, "name"), message)
        elif isinstance(name, str):
            seen[name] = i


def _equilibrium_problems(draft: TaskDraft, at: KeyPath, springs: tuple[str, ...]) -> Iterator[Problem]:
    targets = (*springs, OBJECT) if draft.has(OBJECT) else springs
    for target in draft.keys(*at):
        if target == HINGE:
            yield from _sine_problems(draft, (*at, target, "angle", "sine", "frequency"))
            continue
        if target == OBJECT and not draft.has(OBJECT):
            message = "this task has no object; add 'object' to the file, or move springs"
            yield draft.problem((*at, target), message, targets, at="key")
        elif target not in targets:
            message = f"there is no target '{target}'{nearest(target, targets)}"
            yield draft.problem((*at, target), message, targets, at="key")
        for axis in draft.keys(*at, target):
            yield from _sine_problems(draft, (*at, target, axis, "sine", "frequency"))


def _twice_moved_problems(draft: TaskDraft, at: KeyPath, arms: Mapping[str, DraftArm]) -> Iterator[Problem]:
    """An object target moves the hand springs of its arms; they cannot have another target as well."""
    holders = [draft.value(OBJECT, "held_by", i) for i in draft.count(OBJECT, "held_by")]
    if OBJECT not in draft.keys(*at):
        return
    for arm in (arm for arm in arms.values() if arm.name in holders):
        for spring in arm.springs.values():
            target, limb = f"{arm.name}.{spring.name}", draft.limb(arm.name)
            if target in draft.keys(*at) and limb is not None and spring.frame == limb.hand:
                message = f"'object' moves '{target}' in this phase already; give one of the two"
                yield draft.problem((*at, target), message, at="key")


def _sine_problems(draft: TaskDraft, at: KeyPath) -> Iterator[Problem]:
    """A sampled motion cannot follow half its rate (Nyquist) or more."""
    if draft.robot is None or not draft.clean(*at):
        return
    frequency, highest = float(draft.value(*at)), draft.robot.timing.rate / 2.0
    if frequency >= highest:
        message = f"{frequency:g} Hz is not below half the control rate, {highest:g} Hz"
        yield draft.problem(at, message)


def _posture_problems(draft: TaskDraft, at: KeyPath) -> Iterator[Problem]:
    names = draft.keys("arms")
    for arm in draft.keys(*at):
        if arm not in names:
            message = f"there is no arm '{arm}' in this file{nearest(arm, names)}"
            yield draft.problem((*at, arm), message, names, at="key")
            continue
        original = str(draft.value("arms", arm, "mirror")) if draft.has("arms", arm, "mirror") else arm
        if not draft.has("arms", original, "joint_bias"):
            message = f"the arm '{arm}' has no joint_bias, so a new posture would do nothing"
            yield draft.problem((*at, arm), message, at="key")
        limb = draft.limb(arm)
        if limb is not None:
            yield from joint_name_problems(draft, (*at, arm), limb)
            sound = {j: draft.value(*at, arm, j) for j in draft.keys(*at, arm) if draft.clean(*at, arm, j)}
            yield from limit_problems(draft, build_numbers(sound), limb, (*at, arm))


def _until_problems(draft: TaskDraft, at: KeyPath) -> Iterator[Problem]:
    target = draft.value(*at, "until", "contact", "target")
    names = draft.keys("arms")
    valid = (*names, OBJECT) if draft.has(OBJECT) else names
    if isinstance(target, str) and target not in valid:
        missing = (
            "this task has no object"
            if target == OBJECT
            else f"there is no arm '{target}'{nearest(target, valid)}"
        )
        yield draft.problem((*at, "until", "contact", "target"), missing, valid)
    yield from _smooth_problems(draft, (*at, "until", "smooth"))
    if draft.clean(*at, "until", "reached") and not _moves_somewhere(draft, (*at, "equilibrium")):
        message = (
            "nothing can be reached: the phase gives no equilibrium with a plain number, submovements or path"
        )
        yield draft.problem((*at, "until", "reached"), message, at="key")


def _smooth_problems(draft: TaskDraft, at: KeyPath) -> Iterator[Problem]:
    """Checks whose hand rubs, and that it does so along the surface."""
    names = draft.keys("arms")
    target = draft.value(*at, "target")
    if isinstance(target, str) and target not in names:
        message = f"there is no arm '{target}'{nearest(target, names)}"
        yield draft.problem((*at, "target"), message, names)
    if draft.clean(*at):
        along, normal = draft.value(*at, "along"), draft.value(*at).get("normal", "z")
        if along[-1] == normal[-1]:
            message = f"strokes along {along} do not run along a surface whose normal is {normal}"
            yield draft.problem((*at, "along"), message)
        if draft.value(*at)["by"] == "friction" and "friction_below" in draft.value(*at):
            message = "the coefficient of friction has its bound in 'below' already"
            yield draft.problem((*at, "friction_below"), message, ("by: spectrum",), at="key")


def _moves_somewhere(draft: TaskDraft, at: KeyPath) -> bool:
    given = [
        (axis, draft.value(*at, target, axis))
        for target in draft.keys(*at)
        for axis in draft.keys(*at, target)
    ]
    return any(axis == PATH or not isinstance(coordinate, dict) for axis, coordinate in given)


def _changed_spring_problems(draft: TaskDraft, arm: DraftArm) -> Iterator[Problem]:
    """Follows an arm's springs through the phases and reports each axis once, where it becomes undamped."""
    limb = draft.limb(arm.name)
    if limb is None or not springs_complete(draft, arm, limb):
        return
    springs = dict(arm.springs)
    known = set(undamped_axes(arm, limb, springs))
    for i in draft.count("phases"):
        springs = {k: _changed_spring(draft, i, arm.name, spring) for k, spring in springs.items()}
        found = list(undamped_axes(arm, limb, springs))
        for free in joined_axes(free for free in found if free not in known):
            yield draft.problem(
                _cause(draft, i, f"{arm.name}.{springs[free.spring].name}", free), free.message
            )
        known.update(found)


def _changed_spring(draft: TaskDraft, phase: int, arm: str, spring: SpringSpec) -> SpringSpec:
    target = f"{arm}.{spring.name}"
    if draft.clean("phases", phase, "stiffness", target):
        spring = replace(spring, stiffness=build_matrix(draft.value("phases", phase, "stiffness", target)))
    if draft.clean("phases", phase, "axes", target):
        changed = build_axes(draft.value("phases", phase, "axes", target))
        spring = replace(spring, axes={**spring.axes, **changed})
    return spring


def _cause(draft: TaskDraft, phase: int, target: str, free: UndampedAxis) -> KeyPath:
    """The override that made an axis undamped."""
    changed = ("phases", phase, "axes", target, free.axis)
    if draft.has(*changed):
        return changed
    return ("phases", phase, "stiffness", target)
