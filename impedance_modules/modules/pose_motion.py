# SPDX-License-Identifier: BSD-3-Clause
r"""How one equilibrium pose moves during a phase, as a pure function of the phase's clock.

Notation: E the frame ``expressed_in``, frozen at the start posture; T the moving equilibrium. The six
coordinates of T in E are its position and its rotation vector, (p_ET, log R_ET) [m, rad]. With the
minimum jerk s(\sigma), from 0 to 1 over the phase,

    p(\sigma) = p_0 + s (p_1 - p_0) + a sin(2 \pi f \sigma)
    R(\sigma) = R_0 exp(s log(R_0^T R_1))                             the shortest relative rotation, or
    R(\sigma) = exp(c_0 + s (c_1 - c_0) + a sin(2 \pi f \sigma))     where a rotation coordinate oscillates.

Submovements add to both (``modules.submovements``). A motion along the path of a recording is that of
``modules.recorded_path`` instead; this is then the way onto the path's beginning.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.compiled import compiled
from impedance_modules.modules.minimum_jerk import minimum_jerk, minimum_jerk_slope
from impedance_modules.modules.recorded_path import PathMotion, PathTable, lay_out_paths, write_path
from impedance_modules.modules.submovements import (
    SubmovementTable,
    added_twist,
    lay_out_submovements,
    write_displacement,
)
from impedance_modules.records import Array3, Indices, Matrix, Record
from impedance_modules.robot.pose import Pose
from impedance_modules.robot.rotation import compose, exp3, exponential, log3, log_jacobian
from impedance_modules.spec.submovement_spec import Submovement
from impedance_modules.spec.task import AXES, Coordinate, Sine


class PoseMotions(Record):
    """Several equilibria's ways through one phase, as arrays over the motions; see ``PoseMotion``.

    Attributes:
        reference_rotation, reference_translation: (motions, 3, 3), (motions, 3) X_WE [m].
        start_rotation, start_translation: (motions, 3, 3), (motions, 3) X_ET when the phase begins [m].
        goal: (motions, 3) position that the minimum jerk reaches, a sine's centre [m].
        amplitude, frequency: (motions, 6) of each coordinate's sine [m or rad], [Hz].
        relative_turn: (motions, 3) rotation vector from start to goal in the start's axes [rad].
        first_vector, last_vector: (motions, 3) rotation vectors at the ends [rad].
        along_vector: (motions,) 1 where a rotation coordinate oscillates, 0 elsewhere.
        submovements: Those of each motion.
        paths: Likewise.
    """

    reference_rotation: Array3
    reference_translation: Matrix
    start_rotation: Array3
    start_translation: Matrix
    goal: Matrix
    amplitude: Matrix
    frequency: Matrix
    relative_turn: Matrix
    first_vector: Matrix
    last_vector: Matrix
    along_vector: Indices
    submovements: SubmovementTable
    paths: PathTable


@compiled
def write_pose(
    motions: PoseMotions, m: int, s: float, clock: float, rotation: Array, translation: Array
) -> None:
    """Writes X_WT of motion ``m`` at minimum jerk ``s`` and ``clock`` [s] (the module's equations)."""
    if motions.paths.first[m + 1] > motions.paths.first[m]:
        if clock > motions.paths.approach[m]:
            write_path(motions.paths, m, clock, rotation, translation)
            return
        s = minimum_jerk(clock / motions.paths.approach[m])
    wave, added = np.empty(6), np.empty(6)
    write_displacement(motions.submovements, m, clock, added)
    for k in range(6):
        wave[k] = motions.amplitude[m, k] * math.sin(2.0 * math.pi * motions.frequency[m, k] * clock)
    local, vector = np.empty(3), np.empty(3)
    for k in range(3):
        start = motions.start_translation[m, k]
        local[k] = start + s * (motions.goal[m, k] - start) + wave[k] + added[k]
    turn, reference = np.empty((3, 3)), motions.reference_rotation[m]
    if motions.along_vector[m] > 0:
        for k in range(3):
            first = motions.first_vector[m, k]
            vector[k] = first + s * (motions.last_vector[m, k] - first) + wave[3 + k]
        exponential(vector, turn)
        compose(reference, turn, rotation)
    else:
        for k in range(3):
            vector[k] = s * motions.relative_turn[m, k]
        exponential(vector, turn)
        product = np.empty((3, 3))
        compose(motions.start_rotation[m], turn, product)
        if motions.submovements.turns[m] > 0:
            exponential(added[3:], turn)
            compose(turn, product, rotation)
            product[:, :] = rotation
        compose(reference, product, rotation)
    for k in range(3):
        translation[k] = motions.reference_translation[m, k]
        for j in range(3):
            translation[k] += reference[k, j] * local[j]


@dataclass(frozen=True)
class PoseMotion:
    """One equilibrium's way through a phase.

    Attributes:
        reference: X_WE, frozen.
        start: X_ET when the phase begins.
        goal: (6,) coordinates in E that the minimum jerk reaches; a sine's centre.
        amplitude, frequency: (6,) of each coordinate's sine [m or rad], [Hz]; 0 for none.
        duration: Of the minimum jerk [s].
        submovements: That are added; none of them turns where a rotation coordinate oscillates.
        path: That is taken after the minimum jerk, which leads to its beginning; None for none.
    """

    reference: Pose
    start: Pose
    goal: Array
    amplitude: Array
    frequency: Array
    duration: float
    submovements: tuple[Submovement, ...] = ()
    path: PathMotion | None = None

    def pose(self, clock: float) -> Pose:
        """Gives X_WT at ``clock`` seconds into the phase; the law is ``write_pose``."""
        rotation, translation = np.empty((3, 3)), np.empty(3)
        s = minimum_jerk(clock / self.duration)
        write_pose(self._alone, 0, s, clock, rotation, translation)
        return Pose(rotation, translation)

    def velocity(self, clock: float) -> Array:
        """Gives the twist of T per second of the phase's clock, (6,) in world axes at T's origin."""
        if self.path is not None and clock > self.path.approach:
            return self.path.velocity(clock)
        s, slope = minimum_jerk(clock / self.duration), minimum_jerk_slope(clock / self.duration)
        rate = 2.0 * math.pi * self.frequency
        wave, swing = self.amplitude * np.sin(rate * clock), self.amplitude * rate * np.cos(rate * clock)
        linear = slope / self.duration * (self.goal[:3] - self.start.translation) + swing[:3]
        if self.turns_along_vector:
            first, last = self.end_vectors()
            change = slope / self.duration * (last - first) + swing[3:]
            angular = np.linalg.solve(log_jacobian(first + s * (last - first) + wave[3:]), change)
        else:
            angular = self.start.rotation @ (slope / self.duration * self.relative_turn)
        added, angular = added_twist(self.submovements, clock, np.asarray(angular))
        turn = self.reference.rotation
        return np.concatenate([turn @ (linear + added), turn @ angular])

    @cached_property
    def _alone(self) -> PoseMotions:
        return lay_out_motions((self,))

    @cached_property
    def turns_along_vector(self) -> bool:
        """An oscillating coordinate means what the file says only along the rotation vector itself."""
        return bool(np.any(self.amplitude[3:]))

    @cached_property
    def relative_turn(self) -> Array:
        """Gives the rotation vector from the start to the goal, in the start's axes (3,) [rad]."""
        return log3(self.start.rotation.T @ exp3(self.goal[3:]))

    def end_vectors(self) -> tuple[Array, Array]:
        """Gives first and last rotation vector, the last in its representation nearest to the first."""
        first, last = log3(self.start.rotation), self.goal[3:]
        angle = float(np.linalg.norm(last))
        if angle == 0.0:
            return first, last
        turned = last * (1.0 - 2.0 * math.pi / angle)
        near = np.linalg.norm(turned - first) < np.linalg.norm(last - first)
        return first, turned if near else last


def pose_motion(
    reference: Pose,
    current: Pose,
    coordinates: Mapping[str, Coordinate],
    duration: float,
    submovements: tuple[Submovement, ...] = (),
) -> PoseMotion:
    """Plans a motion from where an equilibrium is to the coordinates that a phase asks for.

    Args:
        reference: X_WE.
        current: X_WT now.
        coordinates: Axis name -> absolute value in E, or ``Sine``; omitted axes keep their value.
        duration: Of the phase [s].
        submovements: That are added.
    """
    start = reference.inverse() @ current
    goal = np.concatenate([start.translation, log3(start.rotation)])
    amplitude, frequency = np.zeros(6), np.zeros(6)
    for axis, coordinate in coordinates.items():
        index = AXES.index(axis)
        if isinstance(coordinate, Sine):
            amplitude[index], frequency[index] = coordinate.amplitude, coordinate.frequency
            if coordinate.center is not None:
                goal[index] = coordinate.center
        else:
            goal[index] = coordinate
    return PoseMotion(reference, start, goal, amplitude, frequency, duration, submovements)


def motion_along(path: PathMotion, reference: Pose, current: Pose) -> PoseMotion:
    """Plans a motion from where an equilibrium is onto a path, and along it.

    Args:
        path: To take.
        reference: X_WE.
        current: X_WT now.
    """
    start, begin = reference.inverse() @ current, reference.inverse() @ path.pose(0.0)
    goal = np.concatenate([begin.translation, log3(begin.rotation)])
    return PoseMotion(reference, start, goal, np.zeros(6), np.zeros(6), path.approach, path=path)


def resting(pose: Pose) -> PoseMotion:
    """Keeps an equilibrium where it is."""
    return PoseMotion(pose, Pose.identity(), np.zeros(6), np.zeros(6), np.zeros(6), 1.0)


def lay_out_motions(motions: Sequence[PoseMotion]) -> PoseMotions:
    """Lays several motions out as arrays, in their order."""
    count = len(motions)
    ends = [motion.end_vectors() for motion in motions]

    def rows(values: list[Array], *shape: int) -> Array:
        return np.array(values, dtype=float).reshape(count, *shape)

    return PoseMotions(
        reference_rotation=rows([motion.reference.rotation for motion in motions], 3, 3),
        reference_translation=rows([motion.reference.translation for motion in motions], 3),
        start_rotation=rows([motion.start.rotation for motion in motions], 3, 3),
        start_translation=rows([motion.start.translation for motion in motions], 3),
        goal=rows([motion.goal[:3] for motion in motions], 3),
        amplitude=rows([motion.amplitude for motion in motions], 6),
        frequency=rows([motion.frequency for motion in motions], 6),
        relative_turn=rows([motion.relative_turn for motion in motions], 3),
        first_vector=rows([first for first, _ in ends], 3),
        last_vector=rows([last for _, last in ends], 3),
        along_vector=np.array([motion.turns_along_vector for motion in motions], dtype=np.int64),
        submovements=lay_out_submovements([motion.submovements for motion in motions]),
        paths=lay_out_paths([motion.path for motion in motions]),
    )
