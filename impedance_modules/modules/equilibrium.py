# SPDX-License-Identifier: BSD-3-Clause
"""Where every spring and joint bias is at rest, and how a phase moves those places.

A phase is a pure function of its own clock [s]. The clock may run slower than time: that is how an
empty energy tank slows a task down. The next phase starts from wherever the clock has come to.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impedance_modules.errors import BadInput, nearest
from impedance_modules.modules.arms import TaskModules
from impedance_modules.modules.held_object import OBJECT, HeldObject
from impedance_modules.modules.pose_motion import PoseMotion, minimum_jerk, pose_motion
from impedance_modules.modules.spring import Spring
from impedance_modules.robot.pose import Pose
from impedance_modules.robot.rotation import skew
from impedance_modules.spec.task import PhaseSpec

Array = NDArray[np.float64]

@dataclass(frozen=True)
class Equilibrium:
    """All equilibria at one instant.

    Attributes:
        springs: Spring name -> X_WT.
        object: X_WO that the object's target asks for; None without an object.
        rests: Limb name -> (k,) rest angles of its joint bias [rad].
    """

    springs: Mapping[str, Pose]
    object: Pose | None
    rests: Mapping[str, Array]


def start_equilibrium(modules: TaskModules) -> Equilibrium:
    """Puts every equilibrium where its frame is at the start posture: all springs relaxed."""
    return Equilibrium(
        springs={spring.name: spring.start for arm in modules.arms for spring in arm.springs},
        object=modules.held.start if modules.held is not None else None,
        rests={arm.limb.name: arm.bias.rest for arm in modules.arms if arm.bias is not None},
    )


@dataclass(frozen=True)
class PhaseMotion:
    """How all equilibria move during one phase; those not listed stay.

    Attributes:
        start: Equilibria when the phase begins.
        moved: Target name (a spring's, or ``object``) -> its motion.
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
        """Gives all equilibria at ``clock`` seconds into the phase; continuous in the clock."""
        springs = dict(self.start.springs)
        springs.update({name: motion.pose(clock) for name, motion in self.moved.items() if name != OBJECT})
        held = self.start.object
        if held is not None and OBJECT in self.moved:
            held = self.moved[OBJECT].pose(clock)
            carry = held @ self._object_start().inverse()
            springs.update({name: carry @ self.start.springs[name] for name in self.carried})
        s = minimum_jerk(clock / self.duration)
        rests = dict(self.start.rests)
        rests.update({limb: rests[limb] + s * (goal - rests[limb]) for limb, goal in self.goals.items()})
        return Equilibrium(springs, held, rests)

    def velocities(self, clock: float) -> Mapping[str, Array]:
        """Gives the twist of every spring's equilibrium per second of the clock, (6,) in world axes."""
        found = {name: np.zeros(6) for name in self.start.springs}
        found.update({name: m.velocity(clock) for name, m in self.moved.items() if name != OBJECT})
        if OBJECT in self.moved:
            now, twist = self.at(clock), self.moved[OBJECT].velocity(clock)
            origin = self.moved[OBJECT].pose(clock).translation
            for name in self.carried:
                lever = now.springs[name].translation - origin
                found[name] = np.concatenate([twist[:3] + skew(twist[3:]) @ lever, twist[3:]])
        return found

    def _object_start(self) -> Pose:
        motion = self.moved[OBJECT]
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
    springs = {spring.name: spring for arm in modules.arms for spring in arm.springs}
    moved: dict[str, PoseMotion] = {}
    for target, coordinates in phase.equilibrium.items():
        reference, current = _coordinates_of(target, springs, start)
        moved[target] = pose_motion(reference, current, coordinates, phase.duration)
    goals = {limb: _goal(modules, limb, angles, start) for limb, angles in phase.posture.items()}
    carried = _carried(modules.held, moved)
    return PhaseMotion(start, moved, carried, goals, phase.duration)


def _coordinates_of(target: str, springs: Mapping[str, Spring], start: Equilibrium) -> tuple[Pose, Pose]:
    """Finds the frame a target's coordinates count in, and where the target is now."""
    if target != OBJECT and target in springs:
        return springs[target].reference, start.springs[target]
    if target == OBJECT and start.object is not None:
        return Pose.identity(), start.object
    valid = [*springs, *([OBJECT] if start.object is not None else [])]
    raise BadInput(f"no target '{target}'{nearest(target, valid)} (valid: {', '.join(valid)})")


def _carried(held: HeldObject | None, moved: Mapping[str, PoseMotion]) -> tuple[str, ...]:
    return () if held is None or OBJECT not in moved else held.springs


def _goal(modules: TaskModules, limb: str, angles: Mapping[str, float], start: Equilibrium) -> Array:
    names = modules.arm(limb).limb.short_names
    rest = start.rests[limb]
    return np.array([angles.get(name, rest[index]) for index, name in enumerate(names)])
