# SPDX-License-Identifier: BSD-3-Clause
"""How near guarded frames come to a task's obstacles: a task whose hand begins or comes inside one is refused.

An obstacle pushes with a bounded force, which springs and inertia may outweigh. The predicted motion tells whether they
do, the equilibria of springs on guarded frames whether something pulls through an obstacle all the same.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.control.assembly import Assembly
from impedance_modules.errors import Problem
from impedance_modules.modules.obstacle import Obstacles, clear, obstacles_at
from impedance_modules.prediction.mechanism import Mechanism
from impedance_modules.prediction.quasi_static import MotionPrediction
from impedance_modules.spec.obstacle_spec import OBSTACLES

LOOKS = 40
"""Instants of a phase at which its equilibria are looked at."""


@dataclass(frozen=True)
class NearestApproach:
    """How near a guarded frame comes to an obstacle.

    Attributes:
        obstacle: Its number in the task.
        frame: That it guards.
        clearance: From the surface; negative inside [m].
        phase: In which it is nearest.
        push: There [N].
    """

    obstacle: int
    frame: str
    clearance: float
    phase: str
    push: float


def inside_at_start(assembly: Assembly, mechanism: Mechanism) -> Iterator[Problem]:
    """Refuses a start posture that has a guarded frame inside an obstacle."""
    obstacles = assembly.modules.obstacles
    if not obstacles:
        return
    mechanism.update(assembly.modules.posture, np.zeros(assembly.model.n))
    found = obstacles_at(obstacles, mechanism.kinematics)
    for (o, frame), clearance in zip(_pairs(assembly), found.clearance, strict=True):
        if clearance < 0.0:
            yield assembly.task.document.problem(
                (OBSTACLES, o),
                f"'{frame}' begins {-1e3 * clearance:.0f} mm inside this obstacle (valid: another posture, or the"
                " obstacle elsewhere or smaller)",
            )


def nearest_approaches(
    assembly: Assembly, mechanism: Mechanism, motion: MotionPrediction
) -> tuple[NearestApproach, ...]:
    """Finds where on the predicted way each guarded frame is nearest to each obstacle."""
    obstacles, pairs = assembly.modules.obstacles, _pairs(assembly)
    nearest: dict[int, NearestApproach] = {}
    for phase in motion.phases if obstacles else ():
        for sample in motion.samples[phase.samples]:
            mechanism.update(sample.q, sample.velocity)
            found = obstacles_at(obstacles, mechanism.kinematics)
            for p, (o, frame) in enumerate(pairs):
                clearance, D = float(found.clearance[p]), float(found.distance[o])
                if p not in nearest or clearance < nearest[p].clearance:
                    push = float(found.stiffness[o]) * min(max(D - clearance, 0.0), D)
                    nearest[p] = NearestApproach(o, frame, clearance, phase.name, push)
    return tuple(nearest.values())


def inside_on_the_way(assembly: Assembly, approaches: tuple[NearestApproach, ...]) -> Iterator[Problem]:
    """Refuses a task whose predicted motion takes a guarded frame inside an obstacle."""
    for one in approaches:
        if one.clearance < 0.0:
            spec = assembly.task.obstacles[one.obstacle]
            yield assembly.task.document.problem(
                (OBSTACLES, one.obstacle),
                f"'{one.frame}' is predicted to come {-1e3 * one.clearance:.0f} mm inside this obstacle in phase"
                f" '{one.phase}': its push of at most {spec.largest_force:.0f} N is outweighed (valid: a larger"
                " stiffness or distance, softer springs, or a way that does not lead through it)",
            )


def obstacle_notes(
    assembly: Assembly, motion: MotionPrediction, approaches: tuple[NearestApproach, ...]
) -> Iterator[str]:
    """Says how near guarded frames come to obstacles that push them, and which equilibria lead through one."""
    for one in approaches:
        spec = assembly.task.obstacles[one.obstacle]
        if one.push > 0.0:
            yield (
                f"phase '{one.phase}': '{one.frame}' comes within {1e3 * one.clearance:.0f} mm of '{spec.name}', which"
                f" pushes it with {one.push:.1f} N of at most {spec.largest_force:.0f} N"
            )
    modules = assembly.modules
    laid_out = obstacles_at(modules.obstacles, Mechanism(assembly).kinematics) if modules.obstacles else None
    for phase in motion.phases if laid_out is not None else ():
        for arm in modules.arms:
            for spring in arm.springs:
                places = [phase.motion.at(t).springs[spring.name].translation for t in _clocks(phase.clock)]
                for o, obstacle in enumerate(modules.obstacles):
                    if (
                        spring.frame not in obstacle.frames
                        or laid_out is None
                        or spring.name not in phase.motion.moved
                    ):
                        continue
                    deepest = min(_clearance(laid_out, o, place) for place in places)
                    if deepest < 0.0:
                        yield (
                            f"phase '{phase.name}': the equilibrium of '{spring.name}' leads through '{obstacle.name}',"
                            f" {-1e3 * deepest:.0f} mm deep: it is the push that keeps the frame out"
                        )


def _clocks(end: float) -> Array:
    return np.linspace(0.0, end, LOOKS)


def _clearance(obstacles: Obstacles, o: int, place: Array) -> float:
    return float(clear(obstacles, o, place, np.zeros(3)))


def _pairs(assembly: Assembly) -> list[tuple[int, str]]:
    """Lists (number of the obstacle, frame), in the order of ``Obstacles.frame``."""
    return [(o, frame) for o, one in enumerate(assembly.modules.obstacles) for frame in one.frames]
