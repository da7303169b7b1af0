# SPDX-License-Identifier: BSD-3-Clause
r"""An obstacle at rest pushes points of the arms away: a repulsive potential of their distance, and a damper in it.

d is the distance of a guarded frame's origin from the surface (negative inside), n the unit vector out of it, D the
distance at which the push begins, s = D - d how far the frame has come in, k the stiffness:

    U = k s^2 / 2   for 0 < s <= D,     U = k D (s - D / 2)   for s > D,     0 elsewhere
    f = k min(s, D) n - b min(s / D, 1) n n^T v,     \tau = J^T f = -dU/dq - J^T (...) J q'

U has a continuous gradient where d has; the push grows from nothing to k D at the surface and no further: inside it is
constant. The damper takes energy or none. Distances are those of a box with half edges h, rounded by a radius: a
sphere has no box, a capsule only a line; or of a half-space. Edges where n jumps lie inside the body alone.

This is a force, summed with the others, that the springs may outweigh: it shapes the way. What must not be passed are
the filter's distance rows (``safety.rows``), which hold whatever the modules ask for.

Sources: Khatib, Real-time obstacle avoidance for manipulators and mobile robots, Int. J. Robotics Research 5 (1986),
whose potential grows without bound; Hogan, Impedance control, part III (1985), for such fields as impedances.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.compiled import compiled
from impedance_modules.records import Array3, Indices, Matrix, Record, Vector
from impedance_modules.robot.kinematics import ArmGeometry, Kinematics
from impedance_modules.robot.rotation import dot, exp3, turn, turn_back
from impedance_modules.spec.obstacle_spec import ObstacleSpec

PLANE = "plane"


class Obstacles(Record):
    """All obstacles of a task and what they ask for; a pair is an obstacle and a frame that it guards.

    Attributes:
        flat: (obstacles,) 1 for a half-space.
        half: (obstacles, 3) half edges of the box that is rounded [m].
        radius: (obstacles,) of the rounding [m].
        rotation: (obstacles, 3, 3) of its axes in world.
        position: (obstacles, 3) of its centre in world [m].
        distance: (obstacles,) D [m].
        stiffness: (obstacles,) k [N/m].
        damping: (obstacles,) b [N.s/m].
        obstacle: (pairs,) number of the obstacle.
        frame: (pairs,) place of the frame among the cycle's frames.
        clearance: (pairs,) d [m].
        normal: (pairs, 3) n in world.
        effort: (obstacles, n) what each asks of the joints [N.m].
    """

    flat: Indices
    half: Matrix
    radius: Vector
    rotation: Array3
    position: Matrix
    distance: Vector
    stiffness: Vector
    damping: Vector
    obstacle: Indices
    frame: Indices
    clearance: Vector
    normal: Matrix
    effort: Matrix


@compiled
def clear(obstacles: Obstacles, o: int, point: Array, normal: Array) -> float:
    """Returns the distance d [m] of a point (3,) from obstacle ``o``, and writes n (3,), both in world."""
    away, local, out = np.empty(3), np.empty(3), np.zeros(3)
    for k in range(3):
        away[k] = point[k] - obstacles.position[o, k]
    turn_back(obstacles.rotation[o], away, local)
    if obstacles.flat[o] > 0:
        out[2] = 1.0
        turn(obstacles.rotation[o], out, normal)
        return float(local[2])
    nearest, length = 0, 0.0
    for k in range(3):
        beyond = abs(local[k]) - obstacles.half[o, k]
        if beyond > abs(local[nearest]) - obstacles.half[o, nearest]:
            nearest = k
        if beyond > 0.0:
            out[k] = beyond if local[k] > 0.0 else -beyond
            length += beyond * beyond
    length = math.sqrt(length)
    if length > 0.0:
        for k in range(3):
            out[k] /= length
    else:
        length = abs(local[nearest]) - obstacles.half[o, nearest]
        out[nearest] = 1.0 if local[nearest] >= 0.0 else -1.0
    turn(obstacles.rotation[o], out, normal)
    return float(length - obstacles.radius[o])


@compiled
def push_energy(stiffness: float, distance: float, depth: float) -> float:
    """Returns U [J] at a depth s [m] of a push that begins at ``distance`` D [m]."""
    if depth <= 0.0:
        return 0.0
    if depth <= distance:
        return 0.5 * stiffness * depth * depth
    return stiffness * distance * (depth - 0.5 * distance)


@compiled
def obstacle_energies(obstacles: Obstacles, arms: ArmGeometry) -> float:
    """Sums U of all obstacles, undiminished by the tank [J]; writes ``clearance`` and ``normal``."""
    total = 0.0
    for p in range(obstacles.frame.size):
        o, f = obstacles.obstacle[p], obstacles.frame[p]
        obstacles.clearance[p] = clear(obstacles, o, arms.translation[f], obstacles.normal[p])
        depth = obstacles.distance[o] - obstacles.clearance[p]
        total += push_energy(obstacles.stiffness[o], obstacles.distance[o], depth)
    return total


@compiled
def obstacle_efforts(obstacles: Obstacles, arms: ArmGeometry, velocity: Array, scale: float) -> float:
    """Writes the torque of every obstacle; returns their energy r U [J].

    Args:
        obstacles: Of the task; ``clearance``, ``normal`` and ``effort`` are overwritten.
        arms: At the state.
        velocity: (n,) that dampers act on [rad/s].
        scale: r in [0, 1]: relaxes the potential, not the dampers.
    """
    total = scale * obstacle_energies(obstacles, arms)
    obstacles.effort[:, :] = 0.0
    for p in range(obstacles.frame.size):
        o, f = obstacles.obstacle[p], obstacles.frame[p]
        depth = obstacles.distance[o] - obstacles.clearance[p]
        if depth <= 0.0:
            continue
        part = min(depth / obstacles.distance[o], 1.0)
        force = scale * obstacles.stiffness[o] * obstacles.distance[o] * part
        for j in range(arms.moved_by[0, f], arms.moved_by[1, f]):
            force -= (
                obstacles.damping[o] * part * dot(obstacles.normal[p], arms.jacobian[f, :3, j]) * velocity[j]
            )
        for j in range(arms.moved_by[0, f], arms.moved_by[1, f]):
            obstacles.effort[o, j] += force * dot(obstacles.normal[p], arms.jacobian[f, :3, j])
    return total


@dataclass(frozen=True)
class Obstacle:
    """One obstacle as a task declares it."""

    spec: ObstacleSpec

    @property
    def name(self) -> str:
        """As in the task."""
        return self.spec.name

    @property
    def module(self) -> str:
        """Name of its torque in recordings."""
        return f"obstacle.{self.spec.name}"

    @property
    def frames(self) -> tuple[str, ...]:
        """Frames that it guards."""
        return tuple(guard.frame for guard in self.spec.guards)

    @property
    def limbs(self) -> tuple[str, ...]:
        """Arms that move them."""
        return tuple(dict.fromkeys(guard.limb for guard in self.spec.guards))


def lay_out_obstacles(obstacles: Sequence[Obstacle], frames: tuple[str, ...], effort: Array) -> Obstacles:
    """Takes the memory of a task's obstacles; ``effort`` (obstacles, n) is overwritten in every cycle."""
    specs, count = [one.spec for one in obstacles], len(obstacles)
    pairs = [(o, frames.index(frame)) for o, one in enumerate(obstacles) for frame in one.frames]
    half, radius = np.zeros((count, 3)), np.zeros(count)
    for o, spec in enumerate(specs):
        if spec.shape == "box":
            half[o] = 0.5 * np.array(spec.size)
        elif spec.shape != PLANE:
            radius[o] = 0.5 * spec.size[0]
            half[o, 2] = 0.5 * spec.size[1] if spec.shape == "capsule" else 0.0
    return Obstacles(
        flat=np.array([spec.shape == PLANE for spec in specs], dtype=np.int64),
        half=half,
        radius=radius,
        rotation=np.array([exp3(np.array(spec.rotation)) for spec in specs]).reshape(count, 3, 3),
        position=np.array([spec.position for spec in specs], dtype=float).reshape(count, 3),
        distance=np.array([spec.distance for spec in specs]),
        stiffness=np.array([spec.stiffness for spec in specs]),
        damping=np.array([spec.damping for spec in specs]),
        obstacle=np.array([o for o, _ in pairs], dtype=np.int64),
        frame=np.array([frame for _, frame in pairs], dtype=np.int64),
        clearance=np.zeros(len(pairs)),
        normal=np.zeros((len(pairs), 3)),
        effort=effort,
    )


def obstacles_at(obstacles: Sequence[Obstacle], kinematics: Kinematics) -> Obstacles:
    """Gives all obstacles at the state of ``kinematics``: clearances, normals, and torques without dampers."""
    n = kinematics.model.n
    found = lay_out_obstacles(obstacles, kinematics.frames, np.zeros((len(obstacles), n)))
    obstacle_efforts(found, kinematics.arms, np.zeros(n), 1.0)
    return found


def push_force(obstacles: Obstacles, o: int, point: Array) -> Array:
    """Gives the force (3,) of the potential of obstacle ``o`` on a point (3,) [N]."""
    normal = np.zeros(3)
    depth = obstacles.distance[o] - clear(obstacles, o, point, normal)
    return np.asarray(obstacles.stiffness[o] * min(max(depth, 0.0), obstacles.distance[o]) * normal)
