# SPDX-License-Identifier: BSD-3-Clause
"""Can the hands come where a task takes them? Asked first: no torque and no energy means much without it.

Of every target that a phase moves, the nearest posture within the joints' ranges is sought
(``robot.inverse_kinematics``). What is left of the distance, along the directions in which the spring is stiff, is how
far the target is out of reach. It is refused where that is more than the phase's own ``until: {reached: ...}`` allows,
or ``OUT_OF_REACH``. Not asked for: the target of a hand that a surface holds up where the phase comes to rest, or whose
phase ends by contact: it lies behind the surface so that the spring presses; and of a phase that says ``beyond_reach``.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.control.assembly import Assembly
from impedance_modules.errors import Problem
from impedance_modules.modules.arms import with_phase_gains
from impedance_modules.modules.equilibrium import PhaseMotion, phase_motion, start_equilibrium
from impedance_modules.modules.held_object import OBJECT
from impedance_modules.modules.spring import Spring
from impedance_modules.prediction.quasi_static import MotionPrediction
from impedance_modules.prediction.statics import Rest
from impedance_modules.robot.inverse_kinematics import FoundPosture, FrameGoal, LimbKinematics
from impedance_modules.robot.pose import Pose
from impedance_modules.spec.task import ContactCondition, PhaseSpec, ReachedCondition, Sine

OUT_OF_REACH = 0.01
"""A target that lies farther than this out of reach is refused [m], unless its phase says how near is enough."""

WORTH_A_NOTE, TURNED = 1e-3, 0.1
"""Distances [m] and angles [rad] that are left from which on they are noted."""

OSCILLATION_SAMPLES = 8
"""Instants at which an oscillating target is looked at."""

PATH_SAMPLES = 24
"""Instants at which a target is looked at that takes the path of a recording."""

STIFF = 1e-6
"""Part of a spring's largest translational stiffness below which a direction counts as free."""


@dataclass(frozen=True)
class CourseAndRests:
    """How a task goes: its motion, and where each phase comes to rest (None where it does not)."""

    motion: MotionPrediction
    rests: tuple[Rest | None, ...]


@dataclass(frozen=True)
class MissedTarget:
    """A target that no posture reaches.

    Attributes:
        phase: Index of the phase.
        target: As the phase names it.
        spring: Name of the spring whose frame does not come there.
        frame: That frame.
        distance: From the nearest posture [m].
        angle: Between the orientations there [rad]; 0 where only the place is missed.
        nearest: (3,) the point that the frame comes to, world axes [m].
        allowed: Distance up to which it is accepted [m].
    """

    phase: int
    target: str
    spring: str
    frame: str
    distance: float
    angle: float
    nearest: Array
    allowed: float


def missed_targets(assembly: Assembly, course: CourseAndRests | None) -> tuple[MissedTarget, ...]:
    """Finds the targets of all phases that no posture reaches.

    Args:
        assembly: The task.
        course: Its prediction: where each phase's equilibria really start, the posture it ends in, and what holds the
            hands up there. None where it could not be predicted; then every phase lasts its whole duration.
    """
    return tuple(_Reach(assembly).missed(course))


def reach_problems(assembly: Assembly, missed: tuple[MissedTarget, ...]) -> Iterator[Problem]:
    """Refuses targets that are missed by more than is allowed, at the line of each."""
    for found in missed:
        if found.distance <= found.allowed:
            continue
        phase = assembly.task.phases[found.phase]
        x, y, z = found.nearest
        yield assembly.task.document.problem(
            ("phases", found.phase, "equilibrium", found.target),
            f"phase '{phase.name}': '{found.frame}' comes no nearer to the target of '{found.spring}' than"
            f" {1e3 * found.distance:.0f} mm, at ({x:.3f}, {y:.3f}, {z:.3f}) m in world (valid: at most"
            f" {1e3 * found.allowed:g} mm out of reach, or 'beyond_reach: true' in a phase whose spring shall only"
            " pull that way)",
        )


def reach_notes(assembly: Assembly, missed: tuple[MissedTarget, ...]) -> Iterator[str]:
    """Says what is missed, but accepted."""
    for found in missed:
        name = assembly.task.phases[found.phase].name
        if found.distance > WORTH_A_NOTE:
            yield (
                f"phase '{name}': '{found.frame}' comes no nearer to the target of '{found.spring}' than"
                f" {1e3 * found.distance:.0f} mm: it is out of reach"
            )
        elif found.angle > TURNED:
            yield (
                f"phase '{name}': where '{found.frame}' is at the target of '{found.spring}' it stays turned by"
                f" {math.degrees(found.angle):.0f} degrees or more: that orientation is out of reach"
            )


class _Reach:
    """Looks at one task."""

    def __init__(self, assembly: Assembly) -> None:
        self._assembly = assembly
        model, posture = assembly.model, assembly.modules.posture
        self._limbs = {
            arm.limb.name: LimbKinematics(model, arm.limb, posture) for arm in assembly.modules.arms
        }

    def missed(self, course: CourseAndRests | None) -> Iterator[MissedTarget]:
        """Goes through the phases."""
        modules, targets = self._assembly.modules, start_equilibrium(self._assembly.modules)
        q = modules.posture
        for index, phase in enumerate(self._assembly.task.phases):
            modules = with_phase_gains(modules, phase)
            rest = None
            if course is None:
                moves = phase_motion(modules, phase, targets)
                targets = moves.at(moves.duration)
            else:
                predicted, rest = course.motion.phases[index], course.rests[index]
                moves, q = predicted.motion, predicted.q
            if phase.beyond_reach or isinstance(phase.until, ContactCondition):
                continue
            for arm in modules.arms:
                if rest is not None and _held_up(rest, arm.limb.hand):
                    continue
                for spring in arm.springs:
                    target = _mover(moves, spring.name)
                    if target is not None and (found := self._look(phase, spring, moves, q)):
                        yield MissedTarget(index, target, spring.name, spring.frame, *found)

    def _look(
        self, phase: PhaseSpec, spring: Spring, moves: PhaseMotion, q: Array
    ) -> tuple[float, float, Array, float] | None:
        """Gives distance, angle, nearest point and what is allowed of the farthest target; None if all are reached."""
        free, turns = _free_directions(spring)
        if free is None:
            return None
        worst: tuple[float, float, Array, float] | None = None
        allowed = phase.until.distance if isinstance(phase.until, ReachedCondition) else OUT_OF_REACH
        for clock in _instants(phase):
            goal = moves.at(clock).springs[spring.name]
            here = self._assembly.model.pose(q, spring.frame)
            place = goal.translation + free @ (here.translation - goal.translation)
            distance, angle, nearest = self._nearest(spring, Pose(goal.rotation, place), turns, q)
            if worst is None or (distance, angle) > worst[:2]:
                worst = distance, angle, nearest, allowed
            if phase.paths and distance > allowed:
                break  # one place of a path out of reach is enough, and each takes seconds to be sure of
        if worst is None or (worst[0] <= WORTH_A_NOTE and worst[1] <= TURNED):
            return None
        return worst

    def _nearest(self, spring: Spring, goal: Pose, turns: bool, q: Array) -> tuple[float, float, Array]:
        """Gives what is left of distance and angle, and where the frame comes to (3,)."""
        limb = self._assembly.model.limbs[spring.limb]
        kinematics, start = self._limbs[limb.name], q[limb.joints]
        placed = FrameGoal(spring.frame, goal, oriented=False)
        if turns and kinematics.reaches(FrameGoal(spring.frame, goal), start):
            return 0.0, 0.0, goal.translation
        if not kinematics.reaches(placed, start):
            found = kinematics.nearest(placed, [start])
            if found.distance > WORTH_A_NOTE:
                return found.distance, 0.0, self._point(found, spring, q)
        if not turns:
            return 0.0, 0.0, goal.translation
        turned = kinematics.nearest(FrameGoal(spring.frame, goal), [start])
        return 0.0, turned.angle + turned.distance, goal.translation

    def _point(self, found: FoundPosture, spring: Spring, q: Array) -> Array:
        limb, there = self._assembly.model.limbs[spring.limb], q.copy()
        there[limb.joints] = found.q
        return self._assembly.model.pose(there, spring.frame).translation


def _held_up(rest: Rest, hand: str) -> bool:
    """Tells whether a surface pushes on a hand, or on the held object, at rest."""
    return any(bool(rest.pressure[body].any()) for body in (hand, OBJECT) if body in rest.pressure)


def _mover(moves: PhaseMotion, spring: str) -> str | None:
    """Names the target of a phase that moves a spring's equilibrium; None where it stays."""
    if spring in moves.moved:
        return spring
    return moves.mover if spring in moves.carried else None


def _free_directions(spring: Spring) -> tuple[Array | None, bool]:
    """Gives the projector (3, 3) on directions without stiffness, None if none has any; whether turns have it."""
    stiffness = spring.world_stiffness
    sizes, directions = np.linalg.eigh(stiffness[:3, :3])
    if sizes[-1] <= 0.0:
        return None, False
    free = directions[:, sizes < STIFF * sizes[-1]]
    turning = np.linalg.eigvalsh(stiffness[3:, 3:])
    return free @ free.T, bool(turning[0] > STIFF * max(turning[-1], 1e-12))


def _instants(phase: PhaseSpec) -> Array:
    """Lists the clocks at which a phase's targets are looked at [s].

    Its end; several where one oscillates or takes the path of a recording, and where each submovement ends.
    """
    waves = any(isinstance(c, Sine) for target in phase.equilibrium.values() for c in target.values())
    if waves or phase.paths:
        samples = PATH_SAMPLES if phase.paths else OSCILLATION_SAMPLES
        return np.linspace(0.0, phase.duration, samples + 1)[1:]
    ends = {movement.end for movements in phase.submovements.values() for movement in movements}
    return np.array(sorted({*(end for end in ends if end < phase.duration), phase.duration}))
