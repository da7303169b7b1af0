# SPDX-License-Identifier: BSD-3-Clause
"""What the hinge of an object, and phases that turn it, must fulfil beyond their schema."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

from impedance_modules.errors import Problem
from impedance_modules.spec.hinge_spec import HINGE, HingeSpec, build_hinge
from impedance_modules.spec.task_draft import DraftArm, TaskDraft
from impedance_modules.spec.yaml_tree import KeyPath

AT = ("object", HINGE)


def hinge_problems(draft: TaskDraft) -> Iterator[Problem]:
    """Checks the axis, the stops, and that nothing else is to carry what the bearing carries."""
    if not draft.clean(*AT):
        return
    hinge = build_hinge(draft.value(*AT))
    if not any(hinge.axis):
        message = "an axis of length 0 has no direction; give one, e.g. [0, 0, 1] for a vertical axis"
        yield draft.problem((*AT, "axis"), message)
    yield from _stop_problems(draft, hinge)
    if draft.value("object", "carry_weight") is True:
        message = "the hinge's bearing carries the object's weight; leave out 'carry_weight' or 'hinge'"
        yield draft.problem(("object", "carry_weight"), message)


def _stop_problems(draft: TaskDraft, hinge: HingeSpec) -> Iterator[Problem]:
    if hinge.lower > hinge.upper:
        message = f"the lower stop, {hinge.lower:g} rad, is above the upper one, {hinge.upper:g} rad"
        yield draft.problem((*AT, "lower"), message)
    elif not hinge.lower <= hinge.angle <= hinge.upper:
        key = (*AT, "angle") if draft.has(*AT, "angle") else AT
        above = hinge.angle > hinge.upper
        stop = (
            f"above the upper stop, {hinge.upper:g} rad"
            if above
            else f"below the lower stop, {hinge.lower:g} rad"
        )
        yield draft.problem(key, f"the hinge's angle at the start, {hinge.angle:g} rad, is {stop}")


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
    if not draft.clean(*AT):
        return
    before = build_hinge(draft.value(*AT)).angle
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
