# SPDX-License-Identifier: BSD-3-Clause
"""Where every spring and joint bias is at rest, and how a phase moves those places.

A phase is a pure function of its own clock [s]. The clock may run slower than time: that is how an
empty energy tank slows a task down. The next phase starts from wherever the clock has come to.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from impedance_modules.arrays import Array
from impedance_modules.compiled import compiled
from impedance_modules.errors import BadInput, nearest
from impedance_modules.modules.arms import TaskModules
from impedance_modules.modules.between_spring import BetweenSpring
from impedance_modules.modules.held_object import OBJECT, HeldObject
from impedance_modules.modules.minimum_jerk import minimum_jerk, minimum_jerk_slope
from impedance_modules.modules.pose_motion import (
    PoseMotion,
    PoseMotions,
    lay_out_motions,
    motion_along,
    pose_motion,
    resting,
    write_pose,
)
from impedance_modules.modules.recorded_path import path_motion
from impedance_modules.modules.spring import Spring
from impedance_modules.records import Array3, Indices, Matrix, Record, Vector
from impedance_modules.robot.pose import Pose
from impedance_modules.robot.rotation import compose, skew
from impedance_modules.spec.hinge_spec import ANGLE, HINGE
from impedance_modules.spec.task import AXES, Coordinate, PhaseSpec

OBJECT_TARGETS = (OBJECT, HINGE)
"""Targets that move the object, and all its grasps rigidly with it."""

IntegerArray = NDArray[np.int64]


@dataclass(frozen=True)
class Equilibrium:
    """All equilibria at one instant.

    Attributes:
        springs: Spring name -> X_WT; then the springs between two arms, with the relative pose of their rest.
        object: X_WO that the object's target asks for; None without an object.
        rests: Limb name -> (k,) rest angles of its joint bias [rad].
    """

    springs: Mapping[str, Pose]
    object: Pose | None
    rests: Mapping[str, Array]


def start_equilibrium(modules: TaskModules) -> Equilibrium:
    """Puts every equilibrium where its frame is at the start posture: all springs relaxed."""
    return Equilibrium(
        springs={spring.name: spring.start for spring in _all_springs(modules)},
        object=modules.held.start if modules.held is not None else None,
        rests={arm.limb.name: arm.bias.rest for arm in modules.arms if arm.bias is not None},
    )


def _all_springs(modules: TaskModules) -> tuple[Spring | BetweenSpring, ...]:
    """Springs of the arms, then those between arms: the order of all equilibria."""
    return (*(spring for arm in modules.arms for spring in arm.springs), *modules.between)


class EquilibriumMotion(Record):
    """How all equilibria of a task move during one phase, as arrays.

    Attributes:
        motions: The poses that move.
        rides: (springs,) which of them carries each spring's equilibrium.
        offset_rotation, offset_translation: (springs, 3, 3), (springs, 3) its fixed pose on that one [m].
        rest_start, rest_goal: (joints,) rest angles of the joint bias at the phase's ends [rad].
        joint: (joints,) where each of these stands among all joints.
        duration: Of the phase [s].
        rotation, translation: (motions, 3, 3), (motions, 3) where the poses are now [m].
    """

    motions: PoseMotions
    rides: Indices
    offset_rotation: Array3
    offset_translation: Matrix
    rest_start: Vector
    rest_goal: Vector
    joint: Indices
    duration: float
    rotation: Array3
    translation: Matrix


@compiled
def place_equilibria(
    motion: EquilibriumMotion, clock: float, rotation: Array, translation: Array, rest: Array
) -> None:
    """Writes every spring's equilibrium and the rest angles at a phase clock; continuous in the clock.

    Args:
        motion: Of the phase.
        clock: [s] into the phase.
        rotation: (springs, 3, 3) R_WT, overwritten.
        translation: (springs, 3) p_WT [m], overwritten.
        rest: (n,) q_0 [rad], overwritten where the phase knows a rest angle.
    """
    s = minimum_jerk(clock / motion.duration)
    for m in range(motion.rotation.shape[0]):
        write_pose(motion.motions, m, s, clock, motion.rotation[m], motion.translation[m])
    for i in range(motion.rides.size):
        m = motion.rides[i]
        compose(motion.rotation[m], motion.offset_rotation[i], rotation[i])
        for k in range(3):
            translation[i, k] = motion.translation[m, k]
            for j in range(3):
                translation[i, k] += motion.rotation[m, k, j] * motion.offset_translation[i, j]
    for j in range(motion.joint.size):
        start = motion.rest_start[j]
        rest[motion.joint[j]] = start + s * (motion.rest_goal[j] - start)


@dataclass(frozen=True)
class PhaseMotion:
    """How all equilibria move during one phase; those not listed stay.

    Attributes:
        start: Equilibria when the phase begins.
        moved: Target name (a spring's, ``object``, or ``hinge``: the frame of the object's hinge) -> its motion.
        carried: Names of the springs that move rigidly with the object's target.
        goals: Limb name -> (k,) rest angles that the phase reaches [rad].
        duration: Of the phase [s].
    """

    start: Equilibrium
    moved: Mapping[str, PoseMotion]
    carried: tuple[str, ...]
    goals: Mapping[str, Array]
    duration: float

    def at(self, clock: float) -> Equilibrium:
        """Gives all equilibria at ``clock`` seconds into the phase; the law is ``place_equilibria``."""
        arrays, names = self._arrays, tuple(self.start.springs)
        rotation, translation = np.empty((len(names), 3, 3)), np.empty((len(names), 3))
        rest = np.empty(arrays.joint.size)
        place_equilibria(arrays, clock, rotation, translation, rest)
        springs = {name: Pose(rotation[i], translation[i]) for i, name in enumerate(names)}
        ends = np.cumsum([len(angles) for angles in self.start.rests.values()], dtype=int)[:-1]
        rests = dict(zip(self.start.rests, np.split(rest, ends), strict=True)) if self.start.rests else {}
        return Equilibrium(springs, self._object_at(clock), rests)

    @property
    def mover(self) -> str | None:
        """The target that takes the object's grasps along, ``object`` or ``hinge``; None where neither moves."""
        return next((name for name in OBJECT_TARGETS if name in self.moved), None)

    def _object_at(self, clock: float) -> Pose | None:
        mover = self.mover
        if mover is None or self.start.object is None:
            return self.start.object
        now = self.moved[mover].pose(clock)
        return now if mover == OBJECT else now @ self._mover_start(mover).inverse() @ self.start.object

    @cached_property
    def _arrays(self) -> EquilibriumMotion:
        count = sum(len(angles) for angles in self.start.rests.values())
        return self.lay_out(np.arange(count, dtype=np.int64))

    def lay_out(self, joint: IntegerArray) -> EquilibriumMotion:
        """Lays the phase out as arrays; springs and rest angles in the order of ``start``.

        Args:
            joint: Place among all joints of each rest angle.
        """
        mover = self.mover
        motions: list[PoseMotion] = [] if mover is None else [self.moved[mover]]
        rides, offsets = [], []
        for name, start in self.start.springs.items():
            if name in self.carried and mover is not None:
                rides.append(0)
                offsets.append(self._mover_start(mover).inverse() @ start)
            else:
                rides.append(len(motions))
                motions.append(self.moved.get(name) or resting(start))
                offsets.append(Pose.identity())
        springs = len(offsets)
        rest = [self.start.rests[limb] for limb in self.start.rests]
        goal = [self.goals.get(limb, self.start.rests[limb]) for limb in self.start.rests]
        return EquilibriumMotion(
            motions=lay_out_motions(motions),
            rides=np.array(rides, dtype=np.int64),
            offset_rotation=np.array([offset.rotation for offset in offsets]).reshape(springs, 3, 3),
            offset_translation=np.array([offset.translation for offset in offsets]).reshape(springs, 3),
            rest_start=np.concatenate([np.zeros(0), *rest]),
            rest_goal=np.concatenate([np.zeros(0), *goal]),
            joint=joint,
            duration=self.duration,
            rotation=np.zeros((len(motions), 3, 3)),
            translation=np.zeros((len(motions), 3)),
        )

    def velocities(self, clock: float) -> Mapping[str, Array]:
        """Gives the twist of every spring's equilibrium per second of the clock, (6,) in world axes."""
        found = {name: np.zeros(6) for name in self.start.springs}
        found.update(
            {name: m.velocity(clock) for name, m in self.moved.items() if name not in OBJECT_TARGETS}
        )
        if (mover := self.mover) is not None:
            turn, twist = self.moved[mover].pose(clock).rotation, self.moved[mover].velocity(clock)
            for name, offset in zip(self.start.springs, self._arrays.offset_translation, strict=True):
                if name in self.carried:
                    lever = turn @ offset
                    found[name] = np.concatenate([twist[:3] + skew(twist[3:]) @ lever, twist[3:]])
        return found

    def rest_rates(self, clock: float) -> Mapping[str, Array]:
        """Gives how fast every arm's rest angles move per second of the clock, (k,) [rad/s]."""
        slope = minimum_jerk_slope(clock / self.duration) / self.duration
        return {limb: slope * (self.goals.get(limb, rest) - rest) for limb, rest in self.start.rests.items()}

    def _mover_start(self, mover: str) -> Pose:
        motion = self.moved[mover]
        return motion.reference @ motion.start


def phase_motion(modules: TaskModules, phase: PhaseSpec, start: Equilibrium) -> PhaseMotion:
    """Plans a phase from the equilibria at its beginning.

    Args:
        modules: Springs (for their ``expressed_in``), biases and the object.
        phase: What the task file asks for.
        start: Equilibria now; ``start_equilibrium`` or the last phase's ``at(clock)``.

    Raises:
        BadInput: A target does not exist.
    """
    springs = {spring.name: spring for spring in _all_springs(modules)}
    moved: dict[str, PoseMotion] = {}
    for target, coordinates in phase.equilibrium.items():
        if target == HINGE:
            moved[HINGE] = _hinge_motion(modules.held, start, coordinates[ANGLE], phase.duration)
            continue
        reference, current = _coordinates_of(target, springs, start)
        if target in phase.paths:
            moved[target] = motion_along(path_motion(phase.paths[target]), reference, current)
            continue
        added = phase.submovements.get(target, ())
        moved[target] = pose_motion(reference, current, coordinates, phase.duration, added)
    # What set-points move rests in the phase's own motion.
    for target in phase.listen:
        moved[target] = resting(_coordinates_of(target, springs, start)[1])
    goals = {limb: _goal(modules, limb, angles, start) for limb, angles in phase.posture.items()}
    carried = _carried(modules.held, moved)
    return PhaseMotion(start, moved, carried, goals, phase.duration)


def _hinge_motion(
    held: HeldObject | None, start: Equilibrium, angle: Coordinate, duration: float
) -> PoseMotion:
    """Turns the hinge's frame, which takes the object's target along its arc, to an angle [rad]."""
    if held is None or held.hinge is None or start.object is None:
        raise BadInput(f"no target '{HINGE}': the task holds no object on a hinge")
    on_axis = dict.fromkeys(AXES, 0.0)
    coordinates = {**on_axis, AXES[-1]: angle}
    return pose_motion(held.hinge.frame, start.object @ held.hinge.on_object, coordinates, duration)


def _coordinates_of(
    target: str, springs: Mapping[str, Spring | BetweenSpring], start: Equilibrium
) -> tuple[Pose, Pose]:
    """Finds the frame a target's coordinates count in, and where the target is now."""
    if target != OBJECT and target in springs:
        return springs[target].reference, start.springs[target]
    if target == OBJECT and start.object is not None:
        return Pose.identity(), start.object
    valid = [*springs, *([OBJECT] if start.object is not None else [])]
    raise BadInput(f"no target '{target}'{nearest(target, valid)} (valid: {', '.join(valid)})")


def _carried(held: HeldObject | None, moved: Mapping[str, PoseMotion]) -> tuple[str, ...]:
    return () if held is None or not set(OBJECT_TARGETS) & set(moved) else held.springs


def _goal(modules: TaskModules, limb: str, angles: Mapping[str, float], start: Equilibrium) -> Array:
    names = modules.arm(limb).limb.short_names
    rest = start.rests[limb]
    return np.array([angles.get(name, rest[index]) for index, name in enumerate(names)])
