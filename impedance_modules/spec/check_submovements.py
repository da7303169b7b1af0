# SPDX-License-Identifier: BSD-3-Clause
"""What the submovements of a phase's targets must fulfil beyond their schema."""

from __future__ import annotations

from collections.abc import Iterator

from impedance_modules.errors import Problem
from impedance_modules.spec.submovement_spec import SUBMOVEMENTS, too_short
from impedance_modules.spec.task import AXES
from impedance_modules.spec.task_draft import TaskDraft
from impedance_modules.spec.yaml_tree import KeyPath


def submovement_problems(draft: TaskDraft, phase: KeyPath, target: str) -> Iterator[Problem]:
    """Checks the submovements of one target.

    Each must end within its phase and be long enough for the control. No coordinate may be sent to a place and moved
    by a submovement as well, and an orientation not in part: rotation vectors of two laws have no common coordinates.
    """
    at = (*phase, "equilibrium", target, SUBMOVEMENTS)
    places = draft.count(*at)
    for i in places:
        yield from _time_problems(draft, phase, (*at, i))
    moved = {axis for i in places for axis in draft.keys(*at, i, "by")}
    turned = sorted(moved & set(AXES[3:]))
    for axis in draft.keys(*phase, "equilibrium", target):
        if axis in moved:
            message = f"submovements move '{axis}' of '{target}' already; give one of the two"
            yield draft.problem((*phase, "equilibrium", target, axis), message, at="key")
        elif axis in AXES[3:] and turned:
            message = (
                f"submovements turn '{target}' already, by {', '.join(turned)}; an orientation is given either by"
                " coordinates or by submovements, as a whole"
            )
            yield draft.problem((*phase, "equilibrium", target, axis), message, at="key")


def _time_problems(draft: TaskDraft, phase: KeyPath, at: KeyPath) -> Iterator[Problem]:
    if not draft.clean(*at, "duration"):
        return
    duration = float(draft.value(*at, "duration"))
    if draft.robot is not None and (why := too_short(duration, draft.robot.timing.rate)) is not None:
        yield draft.problem((*at, "duration"), why)
    if draft.clean(*at, "start") and draft.clean(*phase, "duration"):
        end, over = float(draft.value(*at, "start")) + duration, float(draft.value(*phase, "duration"))
        if end > over + 1e-9:
            message = f"this submovement ends {end:g} s into its phase, which lasts {over:g} s"
            yield draft.problem((*at, "duration"), message, (f"an end at {over:g} s at the latest",))
