# SPDX-License-Identifier: BSD-3-Clause
"""What the hinge of an object, and phases that turn it, must fulfil beyond their schema."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

from impedance_modules.errors import Problem
from impedance_modules.spec.hinge_spec import ANGLE, HINGE
from impedance_modules.spec.task_draft import DraftArm, TaskDraft
from impedance_modules.spec.yaml_tree import KeyPath

AT = ("object", HINGE)


def hinge_problems(draft: TaskDraft) -> Iterator[Problem]:
    """Checks the axis, the stops, and that nothing else is to carry what the bearing carries."""
    if not draft.has(*AT):
        return
    if draft.clean(*AT, "axis") and not any(draft.value(*AT, "axis")):
        message = "an axis of length 0 has no direction; give one, e.g. [0, 0, 1] for a vertical axis"
        yield draft.problem((*AT, "axis"), message)
    yield from _stop_problems(draft)
    if draft.value("object", "carry_weight") is True:
        message = "the hinge's bearing carries the object's weight; leave out 'carry_weight' or 'hinge'"
        yield draft.problem(("object", "carry_weight"), message)


def _stop_problems(draft: TaskDraft) -> Iterator[Problem]:
    """Checks that the stops leave room, and the start between them; numbers at fault are left out."""
    lower = _number(draft, "lower", -math.inf)
    upper = _number(draft, "upper", math.inf)
    angle = _number(draft, ANGLE, 0.0)
    if lower is None or upper is None:
        return
    if lower > upper:
        message = f"the lower stop, {lower:g} rad, is above the upper one, {upper:g} rad"
        yield draft.problem((*AT, "lower"), message)
    elif angle is not None and not lower <= angle <= upper:
        key = (*AT, ANGLE) if draft.has(*AT, ANGLE) else AT
        stop = (
            f"above the upper stop, {upper:g} rad"
            if angle > upper
            else f"below the lower stop, {lower:g} rad"
        )
        yield draft.problem(key, f"the hinge's angle at the start, {angle:g} rad, is {stop}")


def _number(draft: TaskDraft, key: str, omitted: float) -> float | None:
    """Gives a number of the hinge, or what an omitted one means; None for one at fault."""
    if not draft.has(*AT, key):
        return omitted
    return float(draft.value(*AT, key)) if draft.clean(*AT, key) else None


def hinge_target_problems(draft: TaskDraft, at: KeyPath, arms: Mapping[str, DraftArm]) -> Iterator[Problem]:
    """Checks one phase's ``equilibrium`` that turns a hinge: there is one, and nothing else moves what it moves."""
    if HINGE not in draft.keys(*at):
        return
    if not draft.has(*AT):
        message = "this task has no hinge; add 'hinge' to its object, or move the object or springs"
        yield draft.problem((*at, HINGE), message, at="key")
        return
    if "object" in draft.keys(*at):
        message = "'hinge' moves the object's target in this phase already; give one of the two"
        yield draft.problem((*at, "object"), message, at="key")
    yield from _spring_problems(draft, at, arms)


def _spring_problems(draft: TaskDraft, at: KeyPath, arms: Mapping[str, DraftArm]) -> Iterator[Problem]:
    """Finds hand springs of holding arms that have a target of their own."""
    holders = [draft.value("object", "held_by", i) for i in draft.count("object", "held_by")]
    for arm in (arm for arm in arms.values() if arm.name in holders):
        for spring in arm.springs.values():
            target, limb = f"{arm.name}.{spring.name}", draft.limb(arm.name)
            if target in draft.keys(*at) and limb is not None and spring.frame == limb.hand:
                message = f"'{HINGE}' moves '{target}' in this phase already; give one of the two"
                yield draft.problem((*at, target), message, at="key")


def half_turn_problems(draft: TaskDraft) -> Iterator[Problem]:
    """Finds targets half a turn or more away from the last one: the shorter way would be the other way round."""
    before = _number(draft, ANGLE, 0.0)
    if before is None or not draft.has(*AT):
        return
    for i in draft.count("phases"):
        at = ("phases", i, "equilibrium", HINGE, "angle")
        given = draft.value(*at)
        if not draft.clean(*at) or isinstance(given, dict):
            continue
        if abs(given - before) >= math.pi:
            message = (
                f"the hinge's target turns by {abs(given - before):.2f} rad in one phase; valid: less than half a"
                f" turn, {math.pi:.2f} rad; turn it in two phases"
            )
            yield draft.problem(at, message)
        before = float(given)
