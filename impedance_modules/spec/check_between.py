# SPDX-License-Identifier: BSD-3-Clause
"""What springs between two arms must fulfil beyond their schema: two arms, frames that they move, sound matrices."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator

from impedance_modules.errors import Problem, nearest
from impedance_modules.spec.between_spec import BETWEEN, frame_of_arm
from impedance_modules.spec.build_task import build_matrix
from impedance_modules.spec.check_arms import moved_links, not_moved
from impedance_modules.spec.check_springs import matrix_problems
from impedance_modules.spec.task_draft import WORLD, TaskDraft
from impedance_modules.spec.yaml_tree import KeyPath

TAKEN = ("object", "hinge")
"""Targets of phases that are no springs."""


def between_names(draft: TaskDraft) -> tuple[str, ...]:
    """Names of these springs as the file gives them, sound or not."""
    names = (draft.value(BETWEEN, i, "name") for i in draft.count(BETWEEN))
    return tuple(name for name in names if isinstance(name, str))


def between_problems(draft: TaskDraft) -> Iterator[Problem]:
    """Checks every spring between two arms."""
    yield from _name_problems(draft)
    for i in draft.count(BETWEEN):
        at = (BETWEEN, i)
        for place in draft.count(*at, "frames"):
            yield from frame_problems(draft, (*at, "frames", place))
        if draft.value(*at, "expressed_in") != WORLD:
            yield from frame_problems(draft, (*at, "expressed_in"), (WORLD,))
        yield from _same_arm_problems(draft, (*at, "frames"))
        for key in ("stiffness", "damping"):
            if draft.clean(*at, key):
                yield from matrix_problems(draft, (*at, key), build_matrix(draft.value(*at, key)))
        yield from _undamped_problems(draft, at)


def _name_problems(draft: TaskDraft) -> Iterator[Problem]:
    """A phase moves the rest by this name, which must not be that of another target."""
    seen: Counter[str] = Counter()
    for i in draft.count(BETWEEN):
        name = draft.value(BETWEEN, i, "name")
        if not isinstance(name, str):
            continue
        seen[name] += 1
        if seen[name] > 1:
            yield draft.problem((BETWEEN, i, "name"), f"this task already has a spring '{name}' between arms")
        elif name in (*TAKEN, *draft.keys("arms")):
            message = f"'{name}' is something else already: an arm, or a target that phases move"
            yield draft.problem((BETWEEN, i, "name"), message)


def frame_problems(draft: TaskDraft, at: KeyPath, also: tuple[str, ...] = ()) -> Iterator[Problem]:
    """Checks ``ARM.FRAME``: an arm of the file, and a frame that it moves.

    Args:
        draft: The task.
        at: Place of the word.
        also: Other words that would be valid.
    """
    word = draft.value(*at)
    if not isinstance(word, str) or not draft.clean(*at):
        return
    end, arms = frame_of_arm(word), draft.keys("arms")
    if end.limb not in arms:
        valid = (*also, *(f"{arm}.hand" for arm in arms))
        message = f"there is no arm '{end.limb}' in this file{nearest(end.limb, arms)}"
        yield draft.problem(at, message, valid)
        return
    limb = draft.limb(end.limb)
    if draft.urdf is None or limb is None:
        return
    moved = moved_links(draft.urdf, limb)
    if end.frame not in moved:
        valid = (*also, f"{end.limb}.hand", *(f"{end.limb}.{link}" for link in moved))
        yield draft.problem(at, not_moved(end.frame, end.limb, moved, draft.urdf), valid)


def _same_arm_problems(draft: TaskDraft, at: KeyPath) -> Iterator[Problem]:
    words = [draft.value(*at, i) for i in draft.count(*at)]
    if len(words) != 2 or not all(isinstance(word, str) for word in words):
        return
    first, second = (frame_of_arm(word) for word in words)
    holders = draft.value("object", "held_by") or ()
    if first.limb == second.limb:
        message = f"both frames are moved by '{first.limb}'; this spring is between two arms"
        yield draft.problem((*at, 1), message)
    elif (first.limb in holders) != (second.limb in holders):
        message = f"of '{first.limb}' and '{second.limb}' one holds the object and the other does not"
        valid = ("a spring between two arms that both hold it", "or between two that do not")
        yield draft.problem(at, message, valid)


def _undamped_problems(draft: TaskDraft, at: KeyPath) -> Iterator[Problem]:
    """Two arms on an undamped spring swing against each other."""
    if (
        draft.clean(*at, "stiffness")
        and not draft.has(*at, "damping")
        and not draft.has(*at, "damping_ratio")
    ):
        message = "nothing damps the arms' relative motion; give damping_ratio or damping"
        yield draft.problem((*at, "stiffness"), message, at="key")
