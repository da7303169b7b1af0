# SPDX-License-Identifier: BSD-3-Clause
"""What obstacles must fulfil beyond their schema: different names, a size that fits the shape, frames of arms."""

from __future__ import annotations

from collections.abc import Iterator

from impedance_modules.errors import Problem
from impedance_modules.spec.check_between import frame_problems
from impedance_modules.spec.obstacle_spec import LENGTHS, OBSTACLES
from impedance_modules.spec.task_draft import TaskDraft

MEANING = {
    "sphere": "size: [diameter]",
    "capsule": "size: [diameter, length]",
    "box": "size: [x, y, z]",
    "plane": "no size",
}


def obstacle_problems(draft: TaskDraft) -> Iterator[Problem]:
    """Checks every obstacle."""
    names = [draft.value(OBSTACLES, i, "name") for i in draft.count(OBSTACLES)]
    for i in draft.count(OBSTACLES):
        at = (OBSTACLES, i)
        if isinstance(names[i], str) and names[i] in names[:i]:
            yield draft.problem((*at, "name"), f"this task already has an obstacle '{names[i]}'")
        for place in draft.count(*at, "guards"):
            yield from frame_problems(draft, (*at, "guards", place))
        shape = draft.value(*at, "shape")
        if not draft.clean(*at, "shape") or (draft.has(*at, "size") and not draft.clean(*at, "size")):
            continue
        given, needed = len(draft.count(*at, "size")), LENGTHS[shape]
        if given != needed:
            key = "size" if draft.has(*at, "size") else "shape"
            message = f"the size does not fit a {shape}: {given} lengths are given, {needed} needed"
            yield draft.problem((*at, key), message, (MEANING[shape],))
