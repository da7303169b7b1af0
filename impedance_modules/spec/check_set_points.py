# SPDX-License-Identifier: BSD-3-Clause
"""What the targets of live set-points, and the phases that listen to them, must fulfil beyond their schema."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from impedance_modules.errors import Problem, nearest
from impedance_modules.spec.check_between import between_names
from impedance_modules.spec.hinge_spec import HINGE
from impedance_modules.spec.task_draft import DraftArm, TaskDraft

OBJECT = "object"
SET_POINTS = "set_points"


def set_point_problems(
    draft: TaskDraft, arms: Mapping[str, DraftArm], springs: tuple[str, ...]
) -> Iterator[Problem]:
    """Checks that the targets exist, that each has one master only, and that some phase listens to them.

    Args:
        draft: The task.
        arms: Of it.
        springs: All ``<arm>.<spring>``.
    """
    listening = [i for i in draft.count("phases") if draft.value("phases", i, "listen") is True]
    if not draft.has(SET_POINTS):
        for i in listening:
            message = (
                "there are no limits for set-points: a phase that listens needs 'set_points' in the file"
            )
            yield draft.problem(("phases", i, "listen"), message, at="key")
        return
    if not listening:
        message = "no phase listens to set-points; give a phase 'listen: true'"
        yield draft.problem((SET_POINTS,), message, at="key")
    if draft.has("playback"):
        message = "a task that is played back follows a joint path, not set-points; give one of the two"
        yield draft.problem((SET_POINTS,), message, at="key")
    yield from _target_problems(draft, arms, springs)
    yield from _lag_problems(draft)
    for i in listening:
        yield from _moved_twice_problems(draft, i, _held_springs(draft, arms))


def _target_problems(
    draft: TaskDraft, arms: Mapping[str, DraftArm], springs: tuple[str, ...]
) -> Iterator[Problem]:
    valid = (*springs, OBJECT) if draft.has(OBJECT) else springs
    given, held = draft.keys(SET_POINTS, "targets"), _held_springs(draft, arms)
    for target in given:
        at = (SET_POINTS, "targets", target)
        if target in between_names(draft):
            message = f"'{target}' is between two arms: phases move its rest, set-points do not; stream a hand's target"
            yield draft.problem(at, message, valid, at="key")
        elif target not in valid:
            yield draft.problem(at, f"there is no target '{target}'{nearest(target, valid)}", valid, at="key")
        elif OBJECT in given and target in held:
            message = f"'object' moves '{target}' already; give one of the two"
            yield draft.problem(at, message, at="key")
        elif target in held and draft.has(OBJECT, HINGE):
            message = (
                f"the hand of '{target}' holds an object on a hinge, which only the hinge's angle may move"
            )
            yield draft.problem(at, message, at="key")
        elif target == OBJECT and draft.has(OBJECT, HINGE):
            message = "an object on a hinge is moved by the hinge's angle, not by set-points"
            yield draft.problem(at, message, at="key")


def _held_springs(draft: TaskDraft, arms: Mapping[str, DraftArm]) -> tuple[str, ...]:
    """Lists the hand springs of the arms that hold the object."""
    holders = [draft.value(OBJECT, "held_by", i) for i in draft.count(OBJECT, "held_by")]
    found = []
    for arm in (arm for arm in arms.values() if arm.name in holders):
        limb = draft.limb(arm.name)
        found += [
            f"{arm.name}.{s.name}" for s in arm.springs.values() if limb is not None and s.frame == limb.hand
        ]
    return tuple(found)


def _lag_problems(draft: TaskDraft) -> Iterator[Problem]:
    """An equilibrium cannot come to its speed within a few control periods: a jump is no motion."""
    at = (SET_POINTS, "lag")
    if draft.robot is None or not draft.clean(*at):
        return
    lag, period = float(draft.value(*at)), 1.0 / draft.robot.timing.rate
    if lag < 3.0 * period:
        message = f"{lag:g} s is less than three control periods of {period:g} s"
        yield draft.problem(at, message)


def _moved_twice_problems(draft: TaskDraft, phase: int, held: tuple[str, ...]) -> Iterator[Problem]:
    """A phase that listens must not move what set-points move."""
    at = ("phases", phase, "equilibrium")
    given = draft.keys(SET_POINTS, "targets")
    for target in draft.keys(*at):
        same = target in given or (target in held and OBJECT in given)
        carrier = target == OBJECT and any(name in held for name in given)
        if same or carrier:
            message = f"this phase listens, so set-points move '{target}'; leave one of the two out"
            yield draft.problem((*at, target), message, at="key")
