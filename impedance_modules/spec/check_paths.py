# SPDX-License-Identifier: BSD-3-Clause
"""What the path of a target must fulfil beyond its schema, before the recording is opened."""

from __future__ import annotations

from collections.abc import Iterator

from impedance_modules.errors import Problem
from impedance_modules.spec.check_between import between_names
from impedance_modules.spec.path_spec import PATH
from impedance_modules.spec.task_draft import TaskDraft
from impedance_modules.spec.yaml_tree import KeyPath


def path_problems(draft: TaskDraft, phase: KeyPath, target: str) -> Iterator[Problem]:
    """Checks one target's path: nothing else moves the target, and an object's path says whose it is."""
    holder = (*phase, "equilibrium", target)
    at = (*holder, PATH)
    if not draft.has(*at):
        return
    for other in draft.keys(*holder):
        if other != PATH:
            message = f"the path of a recording moves '{target}' as a whole; leave '{other}' or the path out"
            yield draft.problem((*holder, other), message, at="key")
    if target in between_names(draft):
        message = f"'{target}' is between two arms: a path is one of recorded poses in the world; move a hand's target"
        yield draft.problem(at, message, at="key")
    if target == "object" and not draft.has(*at, "frame"):
        message = "an object has no frame of the robot; say whose recorded poses its target takes"
        yield draft.problem((*at, "frame"), message, ("frame: NAME",), at="key")
    if draft.clean(*at, "from") and draft.clean(*at, "to"):
        first, last = float(draft.value(*at, "from")), float(draft.value(*at, "to"))
        if first >= last:
            message = f"the path ends at {last:g} s of the recording, before it begins, at {first:g} s"
            yield draft.problem((*at, "to"), message)
