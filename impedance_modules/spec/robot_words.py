# SPDX-License-Identifier: BSD-3-Clause
"""Words by which a task names no joint and no link of its robot, so that it runs on several.

    posture: NAME                   a posture that the robot file names
    frame: hand, expressed_in: hand the limb's hand; LIMB.hand where a frame is named with its arm
    stiffness_per_effort: k         joint stiffness k times the joint's largest torque

They are replaced by what the robot file says before anything else is checked, each where it stands.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from copy import deepcopy
from dataclasses import dataclass, field, replace
from typing import Any

from impedance_modules.errors import Problem, nearest
from impedance_modules.spec.document import Document
from impedance_modules.spec.robot_spec import LimbSpec, RobotSpec
from impedance_modules.spec.yaml_tree import KeyPath

HAND = "hand"
"""A limb's hand, as ``frame`` or ``expressed_in``; a link of that name wins."""

PER_EFFORT = "stiffness_per_effort"

FRAMES_OF_ARMS = {"between": "frames", "obstacles": "guards"}
"""Keys of a task whose entries list frames with their arms."""


@dataclass(frozen=True)
class FilledIn:
    """A task whose words have been replaced.

    Attributes:
        document: Its data are joint angles, links and numbers; its text and places are those of the file.
        images: Arm that mirrors one with a named posture -> the same posture of its own limb [rad].
        problems: Words that the robot file does not explain.
    """

    document: Document
    images: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    problems: tuple[Problem, ...] = ()


def fill_in(document: Document, robot: RobotSpec, links: tuple[str, ...]) -> FilledIn:
    """Replaces the words of a task.

    Args:
        document: The task; it may have faults, which are left as they are.
        robot: That it runs on.
        links: Of that robot.
    """
    filling = _Filling(document, robot, links)
    arms = filling.data.get("arms")
    for name, arm in arms.items() if isinstance(arms, dict) else ():
        if isinstance(arm, dict) and name in robot.limbs:
            filling.arm(name, arm)
    filling.frames_of_arms()
    phases = filling.data.get("phases")
    for index, phase in enumerate(phases if isinstance(phases, list) else ()):
        postures = phase.get("posture") if isinstance(phase, dict) else None
        if not isinstance(postures, dict):
            continue
        for name in tuple(postures):
            filling.posture(("phases", index, "posture"), name, postures, name)
    changed = replace(document, data=filling.data)
    return FilledIn(changed, filling.images, tuple(filling.problems))


class _Filling:
    """A task's data on their way."""

    def __init__(self, document: Document, robot: RobotSpec, links: tuple[str, ...]) -> None:
        self.data: dict[str, Any] = deepcopy(document.data)
        self.images: dict[str, Mapping[str, float]] = {}
        self.problems: list[Problem] = []
        self._document, self._robot, self._links = document, robot, links

    def arm(self, name: str, arm: dict[str, Any]) -> None:
        """Replaces the words of one arm."""
        limb, at = self._robot.limbs[name], ("arms", name)
        original = self._document.data["arms"].get(str(arm.get("mirror")))
        if isinstance(original, dict):
            self._image(name, original)
            return
        self.posture(at, "posture", arm, name)
        for spring in arm["springs"] if isinstance(arm.get("springs"), list) else ():
            if isinstance(spring, dict) and HAND not in self._links:
                spring.update(
                    {key: limb.hand for key in ("frame", "expressed_in") if spring.get(key) == HAND}
                )
        bias = arm.get("joint_bias")
        if isinstance(bias, dict) and _is_number(bias.get(PER_EFFORT)) and "stiffness" not in bias:
            bias["stiffness"] = self._stiffness(limb, bias.pop(PER_EFFORT))

    def frames_of_arms(self) -> None:
        """Replaces LIMB.hand where frames are named with their arm."""
        hands = {f"{name}.{HAND}": f"{name}.{limb.hand}" for name, limb in self._robot.limbs.items()}
        for holder, place, _ in _named_frames(self.data) if HAND not in self._links else ():
            holder[place] = hands.get(holder[place], holder[place])

    def posture(self, at: KeyPath, key: str, holder: dict[str, Any], limb: str) -> None:
        """Replaces a posture's name by its angles."""
        name = holder.get(key)
        if not isinstance(name, str):
            return
        angles = self._robot.postures.get(name, {}).get(limb)
        if angles is None:
            known = tuple(given for given, limbs in self._robot.postures.items() if limb in limbs)
            message = (
                f"the robot '{self._robot.name}' names no posture '{name}' of '{limb}'{nearest(name, known)}"
            )
            valid = known or (f"postures: {{{name}: {{{limb}: {{...}}}}}} in its file", "joint angles in rad")
            self.problems.append(self._document.problem((*at, key), message, valid))
            del holder[key]
        else:
            holder[key] = dict(angles)

    def _image(self, name: str, original: Mapping[str, Any]) -> None:
        """An arm that mirrors one with a named posture starts from its own posture of that name."""
        named = original.get("posture")
        angles = self._robot.postures.get(named, {}).get(name) if isinstance(named, str) else None
        if angles is not None:
            self.images[name] = angles

    def _stiffness(self, limb: LimbSpec, per_effort: float) -> dict[str, float]:
        return {
            short: per_effort * self._robot.joints[joint].effort_max for short, joint in limb.joints.items()
        }


def _named_frames(data: Mapping[str, Any]) -> Iterator[tuple[Any, Any, KeyPath]]:
    """Lists frames that are named with their arm: holder, place in it, and path in the file."""
    for key, lists in FRAMES_OF_ARMS.items():
        given = data.get(key)
        for index, entry in enumerate(given if isinstance(given, list) else ()):
            if not isinstance(entry, dict):
                continue
            words = entry.get(lists)
            for place, word in enumerate(words if isinstance(words, list) else ()):
                if isinstance(word, str):
                    yield words, place, (key, index, lists, place)
            if isinstance(entry.get("expressed_in"), str):
                yield entry, "expressed_in", (key, index, "expressed_in")


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def tie_problems(document: Document, robot: RobotSpec, other: str) -> Iterator[Problem]:
    """Finds what ties a task to the robot that it names, where it shall run on another.

    Args:
        document: The task.
        robot: That it shall run on.
        other: The robot that it names.
    """
    arms = document.data.get("arms")
    for name, arm in arms.items() if isinstance(arms, dict) else ():
        if not isinstance(arm, dict):
            continue
        at = ("arms", name)
        if isinstance(arm.get("posture"), dict) and _joints(arm["posture"]):
            yield _tied(document, (*at, "posture"), "joint angles", robot, other, "posture: NAME")
        bias = arm.get("joint_bias")
        for key in ("stiffness", "damping"):
            if isinstance(bias, dict) and isinstance(bias.get(key), dict):
                words = "numbers of joints"
                yield _tied(
                    document,
                    (*at, "joint_bias", key),
                    words,
                    robot,
                    other,
                    f"{PER_EFFORT}: NUMBER, damping_ratio",
                )
        springs = arm.get("springs")
        for index, spring in enumerate(springs if isinstance(springs, list) else ()):
            yield from _tied_frames(document, (*at, "springs", index), spring, robot, other)
    for holder, place, path in _named_frames(document.data):
        frame = holder[place].partition(".")[2]
        if frame not in ("", HAND):
            words = f"the link '{frame}'"
            yield _tied(document, path, words, robot, other, f"ARM.{HAND}", value=True)
    phases = document.data.get("phases")
    for index, phase in enumerate(phases if isinstance(phases, list) else ()):
        postures = phase.get("posture") if isinstance(phase, dict) else None
        for name, posture in postures.items() if isinstance(postures, dict) else ():
            if isinstance(posture, dict) and _joints(posture):
                place = ("phases", index, "posture", name)
                yield _tied(document, place, "joint angles", robot, other, "a posture's name")


def _joints(posture: Mapping[str, Any]) -> bool:
    """Whether a posture is given by joints: plain numbers by name; a pose of the hand is given by a mapping."""
    return all(_is_number(value) for value in posture.values())


def _tied_frames(
    document: Document, at: KeyPath, spring: Any, robot: RobotSpec, other: str
) -> Iterator[Problem]:
    for key, neutral in (("frame", (HAND,)), ("expressed_in", (HAND, "world"))):
        frame = spring.get(key) if isinstance(spring, dict) else None
        if isinstance(frame, str) and frame not in neutral:
            words = f"the link '{frame}'"
            yield _tied(document, (*at, key), words, robot, other, " or ".join(neutral), value=True)


def _tied(
    document: Document,
    at: KeyPath,
    words: str,
    robot: RobotSpec,
    other: str,
    valid: str,
    *,
    value: bool = False,
) -> Problem:
    message = f"names {words} of the robot '{other}', so the task cannot run on '{robot.name}'"
    return document.problem(at, message, (valid, f"--robot {other}"), at="value" if value else "key")
