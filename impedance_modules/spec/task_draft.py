# SPDX-License-Identifier: BSD-3-Clause
"""A task file on its way to a TaskSpec: which parts are sound, its arms with their mirror images, and the robot.

A file may have one fault in one place; all others are still checked, so that every fault is reported at once. A part
is *clean* when neither the YAML nor the schema found anything wrong in it or around it.

A reflection P of space (P = diag(1, -1, 1) for the plane xz) takes a twist (v, w) to (P v, -P w): w is a
pseudo-vector. With D = diag(P, -P), a stiffness becomes D K D and a wrench D w. The same D holds in the axes
of a hand, because the image of a frame with axes R has the axes P R P.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impedance_modules.errors import Problem
from impedance_modules.spec.build_task import (
    build_hand_posture,
    build_joint_bias,
    build_numbers,
    build_spring,
)
from impedance_modules.spec.document import Document
from impedance_modules.spec.robot_spec import LimbSpec, MirrorSpec, RobotSpec
from impedance_modules.spec.task import (
    AXES,
    ArmSpec,
    HandPosture,
    HybridAxis,
    JointBiasSpec,
    Matrix,
    SpringSpec,
)
from impedance_modules.spec.urdf import UrdfFacts
from impedance_modules.spec.yaml_tree import KeyPath

WORLD = "world"


class _Absent:
    """Marks a value that is not given; None is a value that is given as null."""


_ABSENT = _Absent()


@dataclass(frozen=True)
class TaskDraft:
    """A task file, its faults so far, and its robot.

    Attributes:
        document: The file.
        broken: Paths at which the YAML or the schema found something wrong.
        robot: None where the robot itself could not be read; what needs it is then left unchecked.
        urdf: Of that robot.
        images: Arm that mirrors another -> its own posture [rad], where the robot file names it.
    """

    document: Document
    broken: tuple[KeyPath, ...]
    robot: RobotSpec | None
    urdf: UrdfFacts | None
    images: Mapping[str, Mapping[str, float]] = field(default_factory=dict)

    def has(self, *path: str | int) -> bool:
        """Whether the file gives a value at a path."""
        return self._find(path) is not _ABSENT

    def clean(self, *path: str | int) -> bool:
        """Whether a value is given and nothing is wrong with it."""
        touching = (broken[: len(path)] == path[: len(broken)] for broken in self.broken)
        return self.has(*path) and not any(touching)

    def value(self, *path: str | int) -> Any:
        """The value at a path; None where there is none."""
        found = self._find(path)
        return None if found is _ABSENT else found

    def keys(self, *path: str | int) -> tuple[str, ...]:
        """Keys of the mapping at a path; none where there is no mapping."""
        found = self._find(path)
        return tuple(found) if isinstance(found, dict) else ()

    def count(self, *path: str | int) -> range:
        """Positions of the list at a path; none where there is no list."""
        found = self._find(path)
        return range(len(found)) if isinstance(found, list) else range(0)

    def limb(self, arm: str) -> LimbSpec | None:
        """The limb of an arm; None where it is unknown."""
        return None if self.robot is None else self.robot.limbs.get(arm)

    def problem(
        self, path: Sequence[str | int], message: str, valid: Sequence[str] = (), at: str = "value"
    ) -> Problem:
        """Locates a problem in the file, as ``Document.problem`` does."""
        return self.document.problem(path, message, valid, at)

    def _find(self, path: KeyPath) -> Any:
        found: Any = self.document.data
        for step in path:
            in_list = isinstance(found, list) and isinstance(step, int) and step < len(found)
            if not in_list and not (isinstance(found, dict) and step in found):
                return _ABSENT
            found = found[step]
        return found


@dataclass(frozen=True)
class DraftArm:
    """What is known of an arm so far.

    Attributes:
        name: As in the file.
        mirror_of: Name of the arm whose image it is; None where it is written out.
        posture: [rad] by short joint name; only the clean ones.
        joint_bias: None where it is absent or at fault.
        springs: By position in the file; only the clean ones.
        by_hand: Posture by the hand's pose; None where angles are given, or where it is at fault.
    """

    name: str
    mirror_of: str | None
    posture: Mapping[str, float]
    joint_bias: JointBiasSpec | None
    springs: Mapping[int, SpringSpec]
    by_hand: HandPosture | None = None

    def path(self, *inside: str | int) -> KeyPath:
        """Where a part of the arm stands in the file; a mirror image stands where it is asked for."""
        return ("arms", self.name, *inside) if self.mirror_of is None else ("arms", self.name, "mirror")

    def finished(self) -> ArmSpec:
        """The arm of a draft in which nothing is wrong."""
        springs = tuple(self.springs.values())
        return ArmSpec(self.name, self.posture, self.joint_bias, springs, self.by_hand, self.mirror_of)


def draft_arms(draft: TaskDraft) -> Mapping[str, DraftArm]:
    """Returns the arms by name, in the order of the file; images whose original is unusable are left out."""
    names = draft.keys("arms")
    written = {name: _written_arm(draft, name) for name in names if not draft.has("arms", name, "mirror")}
    arms: dict[str, DraftArm] = {}
    for name in names:
        original = written.get(str(draft.value("arms", name, "mirror")))
        if name in written:
            arms[name] = written[name]
        elif original is not None and (image := _mirrored_arm(draft, name, original)):
            arms[name] = image
    return arms


def spring_names(draft: TaskDraft, arm: str) -> tuple[str, ...]:
    """Names of an arm's springs as the file gives them, sound or not; an image has its original's."""
    original = draft.value("arms", arm, "mirror")
    at = ("arms", arm if original is None else str(original), "springs")
    names = (draft.value(*at, i, "name") for i in draft.count(*at))
    return tuple(name for name in names if isinstance(name, str))


def twist_signs(plane: str) -> NDArray[np.float64]:
    """Diagonal (6,) of D for the planes ``xy``, ``xz`` and ``yz``, linear then angular."""
    reflected = np.array([1.0 if axis in plane else -1.0 for axis in "xyz"])
    return np.concatenate([reflected, -reflected])


def mirrored_posture(posture: Mapping[str, float], mirror: MirrorSpec) -> Mapping[str, float]:
    """Joint angles [rad] of the mirror image; joints without a sign are left out."""
    signs, offsets = mirror.joint_sign, mirror.joint_offset
    return {
        joint: signs[joint] * angle + offsets.get(joint, 0.0)
        for joint, angle in posture.items()
        if joint in signs
    }


def mirrored_frames(source: LimbSpec, image: LimbSpec, urdf: UrdfFacts) -> Mapping[str, str]:
    """Which frame of one limb is the image of which frame of the other.

    The hands, the links that joints of the same short name move, and the world.
    """
    frames = {WORLD: WORLD, source.hand: image.hand}
    for short, joint in source.joints.items():
        if short in image.joints and joint in urdf.joints and image.joints[short] in urdf.joints:
            frames[urdf.joints[joint].child] = urdf.joints[image.joints[short]].child
    return frames


def mirrored_spring(spring: SpringSpec, frames: Mapping[str, str], plane: str) -> SpringSpec:
    """The image of a spring; its ``frame`` and ``expressed_in`` must be keys of ``frames``."""
    signs = twist_signs(plane)
    return replace(
        spring,
        frame=frames[spring.frame],
        expressed_in=frames[spring.expressed_in],
        stiffness=_mirrored_matrix(spring.stiffness, signs),
        damping=None if spring.damping is None else _mirrored_matrix(spring.damping, signs),
        axes={axis: _mirrored_axis(axis, given, signs) for axis, given in spring.axes.items()},
    )


def _mirrored_axis(axis: str, given: HybridAxis, signs: NDArray[np.float64]) -> HybridAxis:
    return replace(given, force=float(signs[AXES.index(axis)]) * given.force + 0.0)


def _mirrored_matrix(matrix: Matrix, signs: NDArray[np.float64]) -> Matrix:
    image: Matrix = signs[:, None] * matrix * signs[None, :] + 0.0  # + 0.0 turns -0.0 into 0.0
    image.setflags(write=False)
    return image


def _written_arm(draft: TaskDraft, name: str) -> DraftArm:
    at = ("arms", name)
    by_hand = given_by_hand(draft, name)
    angles = {
        j: draft.value(*at, "posture", j)
        for j in draft.keys(*at, "posture")
        if draft.clean(*at, "posture", j) and not by_hand
    }
    springs = {
        i: draft.value(*at, "springs", i)
        for i in draft.count(*at, "springs")
        if draft.clean(*at, "springs", i)
    }
    bias = draft.value(*at, "joint_bias") if draft.clean(*at, "joint_bias") else None
    return DraftArm(
        name=name,
        mirror_of=None,
        posture=build_numbers(angles),
        joint_bias=None if bias is None else build_joint_bias(bias),
        springs={i: build_spring(raw) for i, raw in springs.items()},
        by_hand=build_hand_posture(draft.value(*at, "posture"))
        if by_hand and draft.clean(*at, "posture")
        else None,
    )


def given_by_hand(draft: TaskDraft, arm: str) -> bool:
    """Whether an arm's posture is given by its hand's pose: a limb may have a joint that is called ``hand``."""
    return isinstance(draft.value("arms", arm, "posture", "hand"), dict)


def _mirrored_arm(draft: TaskDraft, name: str, original: DraftArm) -> DraftArm | None:
    source, image = draft.limb(original.name), draft.limb(name)
    if draft.robot is None or draft.urdf is None or draft.robot.mirror is None or not source or not image:
        return None
    frames = mirrored_frames(source, image, draft.urdf)
    plane = draft.robot.mirror.plane
    return DraftArm(
        name=name,
        mirror_of=original.name,
        posture=draft.images.get(name) or mirrored_posture(original.posture, draft.robot.mirror),
        joint_bias=original.joint_bias,
        springs={
            i: mirrored_spring(spring, frames, plane)
            for i, spring in original.springs.items()
            if spring.frame in frames and spring.expressed_in in frames
        },
        by_hand=original.by_hand,
    )
