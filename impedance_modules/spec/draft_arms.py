# SPDX-License-Identifier: BSD-3-Clause
"""The arms of a draft: what is clean of each, mirror images already resolved."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from impedance_modules.spec.build_task import build_joint_bias, build_numbers, build_spring
from impedance_modules.spec.mirror import mirrored_frames, mirrored_posture, mirrored_spring
from impedance_modules.spec.task import ArmSpec, JointBiasSpec, SpringSpec
from impedance_modules.spec.task_draft import Draft
from impedance_modules.spec.yaml_tree import Path


@dataclass(frozen=True)
class DraftArm:
    """What is known of an arm so far.

    Attributes:
        name: As in the file.
        mirror_of: Name of the arm whose image it is; None where it is written out.
        posture: [rad] by short joint name; only the clean ones.
        joint_bias: None where it is absent or at fault.
        springs: By position in the file; only the clean ones.
    """

    name: str
    mirror_of: str | None
    posture: Mapping[str, float]
    joint_bias: JointBiasSpec | None
    springs: Mapping[int, SpringSpec]

    def path(self, *inside: str | int) -> Path:
        """Where a part of the arm stands in the file; a mirror image stands where it is asked for."""
        return ("arms", self.name, *inside) if self.mirror_of is None else ("arms", self.name, "mirror")

    def finished(self) -> ArmSpec:
        """The arm of a draft in which nothing is wrong."""
        return ArmSpec(self.name, self.posture, self.joint_bias, tuple(self.springs.values()))


def draft_arms(draft: Draft) -> Mapping[str, DraftArm]:
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


def _written_arm(draft: Draft, name: str) -> DraftArm:
    at = ("arms", name)
    angles = {
        j: draft.value(*at, "posture", j)
        for j in draft.keys(*at, "posture")
        if draft.clean(*at, "posture", j)
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
    )


def _mirrored_arm(draft: Draft, name: str, original: DraftArm) -> DraftArm | None:
    source, image = draft.limb(original.name), draft.limb(name)
    if draft.robot is None or draft.urdf is None or draft.robot.mirror is None or not source or not image:
        return None
    frames = mirrored_frames(source, image, draft.urdf)
    plane = draft.robot.mirror.plane
    return DraftArm(
        name=name,
        mirror_of=original.name,
        posture=mirrored_posture(original.posture, draft.robot.mirror),
        joint_bias=original.joint_bias,
        springs={
            i: mirrored_spring(spring, frames, plane)
            for i, spring in original.springs.items()
            if spring.frame in frames and spring.expressed_in in frames
        },
    )


def spring_names(draft: Draft, arm: str) -> tuple[str, ...]:
    """Names of an arm's springs as the file gives them, sound or not; an image has its original's."""
    original = draft.value("arms", arm, "mirror")
    at = ("arms", arm if original is None else str(original), "springs")
    names = (draft.value(*at, i, "name") for i in draft.count(*at))
    return tuple(name for name in names if isinstance(name, str))
