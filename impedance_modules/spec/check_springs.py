# SPDX-License-Identifier: BSD-3-Clause
"""What springs must fulfil: symmetric positive semidefinite matrices, and no undamped axis.

A stiffness or damping matrix with a negative eigenvalue supplies energy without bound, so it is refused.

An axis with a force, or a hand's axis without stiffness, keeps moving unless it is damped. It must be
damped by explicit damping, by a speed_limit, or, where it has stiffness, by a damping_ratio; a damping ratio
on an axis without stiffness gives no damping. A hand's axis that carries no force may also be damped by the
joint bias, if that damps every joint.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np

from impedance_modules.errors import Problem
from impedance_modules.spec.robot_spec import LimbSpec
from impedance_modules.spec.task import AXES, EQUILIBRIUM, HybridAxis, Matrix, SpringSpec
from impedance_modules.spec.task_draft import DraftArm, TaskDraft
from impedance_modules.spec.yaml_tree import KeyPath

RELATIVE_TOLERANCE = 1e-9
"""Of the largest entry: what rounding may do to symmetry and eigenvalues."""


def spring_problems(draft: TaskDraft, arms: Mapping[str, DraftArm]) -> Iterator[Problem]:
    """Checks the springs as they are at the start."""
    for name in draft.keys("arms"):
        yield from _name_problems(draft, name)
    for arm in arms.values():
        if arm.mirror_of is not None:
            continue
        for i, spring in arm.springs.items():
            yield from matrix_problems(draft, arm.path("springs", i, "stiffness"), spring.stiffness)
            if spring.damping is not None:
                yield from matrix_problems(draft, arm.path("springs", i, "damping"), spring.damping)
            yield from _damper_problems(draft, arm.path("springs", i), spring)
        limb = draft.limb(arm.name)
        if limb is not None and springs_complete(draft, arm, limb):
            for free in joined_axes(undamped_axes(arm, limb, arm.springs)):
                inside = ("axes", free.axis) if free.forced else ("stiffness",)
                yield draft.problem(arm.path("springs", free.spring, *inside), free.message)


def _damper_problems(draft: TaskDraft, path: KeyPath, spring: SpringSpec) -> Iterator[Problem]:
    """A damper that is to count from the equilibrium must be there."""
    limited = any(axis.speed_limit is not None for axis in spring.axes.values())
    damped = limited or spring.damping is not None or spring.damping_ratio is not None
    if spring.damping_against == EQUILIBRIUM and not damped:
        message = "this spring has no damper; give damping_ratio or damping, or leave damping_against out"
        yield draft.problem((*path, "damping_against"), message, at="key")


def springs_complete(draft: TaskDraft, arm: DraftArm, limb: LimbSpec) -> bool:
    """Whether all springs and the joint bias of an arm could be read, so that nothing is missed in a sum."""
    given = draft.count("arms", arm.mirror_of or arm.name, "springs")
    bias = ("arms", arm.mirror_of or arm.name, "joint_bias")
    joints = {joint for key in ("stiffness", "damping") for joint in draft.keys(*bias, key)}
    bias_is_sound = (draft.clean(*bias) and joints <= set(limb.joints)) or not draft.has(*bias)
    return len(arm.springs) == len(given) and bias_is_sound


def _name_problems(draft: TaskDraft, arm: str) -> Iterator[Problem]:
    at = ("arms", arm, "springs")
    seen: Counter[str] = Counter()
    for i in draft.count(*at):
        name = draft.value(*at, i, "name")
        if isinstance(name, str):
            seen[name] += 1
            if seen[name] > 1:
                yield draft.problem((*at, i, "name"), f"this arm already has a spring '{name}'")


def matrix_problems(draft: TaskDraft, path: KeyPath, matrix: Matrix) -> Iterator[Problem]:
    """Checks that a matrix (6, 6) is symmetric and has no negative eigenvalue."""
    scale = float(np.abs(matrix).max())
    uneven = np.argwhere(np.abs(matrix - matrix.T) > RELATIVE_TOLERANCE * scale)
    if len(uneven):
        i, j = (int(k) for k in uneven[0])
        message = (
            f"the matrix is not symmetric: row {i + 1} column {j + 1} is {matrix[i, j]:g}, "
            f"row {j + 1} column {i + 1} is {matrix[j, i]:g}"
        )
        yield draft.problem(path, message)
        return
    smallest = float(np.linalg.eigvalsh(matrix)[0])
    if smallest < -RELATIVE_TOLERANCE * scale:
        message = (
            f"the matrix is not positive semidefinite: its smallest eigenvalue is {smallest:.4g}; "
            "none may be negative"
        )
        yield draft.problem(path, message)


@dataclass(frozen=True)
class UndampedAxis:
    """An axis that nothing damps.

    Attributes:
        spring: Position of the spring in the file.
        axis: Its axis.
        forced: Whether a force acts on it.
    """

    spring: int
    axis: str
    forced: bool

    @property
    def message(self) -> str:
        """What is wrong and what would help."""
        if self.forced:
            return (
                f"a force acts on {self.axis} and nothing damps it; give a speed_limit, damping "
                f"on {self.axis}, or a stiffness with a damping_ratio (which needs a stiffness)"
            )
        return (
            f"the hand has no stiffness on {self.axis} and nothing damps it; give damping there, "
            "or a joint_bias that damps every joint (a damping_ratio needs a stiffness)"
        )


def undamped_axes(arm: DraftArm, limb: LimbSpec, springs: Mapping[int, SpringSpec]) -> Iterator[UndampedAxis]:
    """Finds the axes of an arm's springs that nothing damps.

    Springs on one frame in the same axes act as one: their stiffness and damping are summed first.
    """
    damped_by_bias = damps_every_joint(arm, limb)
    for i, spring in springs.items():
        same_axes = [
            s for s in springs.values() if (s.frame, s.expressed_in) == (spring.frame, spring.expressed_in)
        ]
        yield from _forced_axes(i, spring, same_axes)
        first_of_hand = spring.frame == limb.hand and spring is same_axes[0]
        others = (
            s for s in springs.values() if s.frame == spring.frame and s.expressed_in != spring.expressed_in
        )
        if first_of_hand and not damped_by_bias and not any(_is_regular(other) for other in others):
            yield from _idle_axes(i, same_axes)


def joined_axes(found: Iterable[UndampedAxis]) -> Iterator[UndampedAxis]:
    """Joins the idle axes of one spring, which have one cause, into one."""
    in_order = sorted(found, key=lambda free: (free.spring, free.forced))
    for (spring, forced), group in groupby(in_order, key=lambda free: (free.spring, free.forced)):
        if forced:
            yield from group
        else:
            yield UndampedAxis(spring, ", ".join(free.axis for free in group), False)


def _forced_axes(i: int, spring: SpringSpec, same_axes: Sequence[SpringSpec]) -> Iterator[UndampedAxis]:
    for axis, given in spring.axes.items():
        if given.force != 0.0 and not _is_damped(same_axes, AXES.index(axis)):
            yield UndampedAxis(i, axis, True)


def _idle_axes(i: int, same_axes: Sequence[SpringSpec]) -> Iterator[UndampedAxis]:
    """Axes without force, stiffness and damping; else a slanted direction without stiffness and damping."""
    for index, axis in enumerate(AXES):
        forced = any(axis in spring.axes and spring.axes[axis].force != 0.0 for spring in same_axes)
        if not forced and not _is_stiff(same_axes, index) and not _is_damped(same_axes, index):
            yield UndampedAxis(i, axis, False)
    total = sum((_resistance(spring) for spring in same_axes), np.zeros((6, 6)))
    used = np.flatnonzero(np.diag(total) > 0.0)
    scale = np.sqrt(np.diag(total)[used])
    values, vectors = np.linalg.eigh(total[np.ix_(used, used)] / np.outer(scale, scale))
    if len(used) and values[0] < RELATIVE_TOLERANCE:
        direction = vectors[:, 0] / scale / np.abs(vectors[:, 0] / scale).max()
        terms = [
            f"{AXES[k]} {value:.2g}" for k, value in zip(used, direction, strict=True) if abs(value) > 1e-6
        ]
        yield UndampedAxis(i, f"the direction ({', '.join(terms)})", False)


def _resistance(spring: SpringSpec) -> Matrix:
    """Stiffness plus explicit damping, units apart: its null space is what nothing holds or damps."""
    limited = [axis in spring.axes and _is_limited(spring.axes[axis]) for axis in AXES]
    total: Matrix = spring.stiffness + np.diag(np.array(limited, dtype=np.float64))
    return total if spring.damping is None else total + spring.damping


def _is_stiff(springs: Sequence[SpringSpec], index: int) -> bool:
    return any(spring.stiffness[index, index] > 0.0 for spring in springs)


def _is_damped(springs: Sequence[SpringSpec], index: int) -> bool:
    """Whether explicit damping, a speed limit or a damping ratio with stiffness acts on an axis."""
    return any(
        (spring.damping is not None and spring.damping[index, index] > 0.0)
        or (AXES[index] in spring.axes and _is_limited(spring.axes[AXES[index]]))
        or (spring.damping_ratio is not None and spring.stiffness[index, index] > 0.0)
        for spring in springs
    )


def _is_limited(axis: HybridAxis) -> bool:
    """Whether |force| / speed_limit is a damping at all."""
    return axis.speed_limit is not None and axis.force != 0.0


def _is_regular(spring: SpringSpec) -> bool:
    """Whether a spring in other axes is stiff, so that motion in every direction is damped or oscillates at least."""
    eigenvalues = np.linalg.eigvalsh(spring.stiffness)
    return bool(eigenvalues[0] > RELATIVE_TOLERANCE * eigenvalues[-1])


def damps_every_joint(arm: DraftArm, limb: LimbSpec) -> bool:
    """Whether the joint bias alone damps all joints of the limb, and so every axis of its hand."""
    bias = arm.joint_bias
    if bias is None:
        return False
    by_ratio = bias.damping_ratio is not None
    explicit = bias.damping or {}
    return all(
        (by_ratio and bias.stiffness.get(j, 0.0) > 0.0) or explicit.get(j, 0.0) > 0.0 for j in limb.joints
    )
