# SPDX-License-Identifier: BSD-3-Clause
r"""An equilibrium that retraces the path of a recording, as a pure function of the phase's clock.

The path is a uniform cubic B-spline in recorded time u, with control points c_i = (position, quaternion) a time
\Delta apart. With i = floor(u / \Delta) and f = u / \Delta - i,

    c(u) = ((1-f)^3 c_i + (3f^3 - 6f^2 + 4) c_{i+1} + (-3f^3 + 3f^2 + 3f + 1) c_{i+2} + f^3 c_{i+3}) / 6

Position and quaternion are both c(u), the quaternion divided by its length; velocity and acceleration are continuous.
With t the time since the path's beginning, L its recorded length, k the speed factor, and r a time of minimum jerk s,

    du/dt = k s(t / r)          up to t = r,       then k,       and k s((L/k + r - t) / r) in the last r

so the equilibrium begins and ends at rest, wherever in a motion the recording was cut, and takes L/k + r. Before t = 0
it goes by minimum jerk from where it is to the path's beginning.

Source: C. de Boor, "A Practical Guide to Splines", Springer 1978, for the spline.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.compiled import compiled
from impedance_modules.modules.minimum_jerk import minimum_jerk
from impedance_modules.records import Indices, Matrix, Record, Vector
from impedance_modules.robot.pose import Pose
from impedance_modules.robot.rotation import write_rotation
from impedance_modules.spec.path_spec import PathCourse, PathSpec

RAMP = 0.5
"""r: time in which the path is taken up to its speed, and back to rest [s]; the whole of a shorter path."""

STEP_ONTO = 0.5
"""Time of the way onto a path that begins where the target is [s]."""


class PathTable(Record):
    """The paths of several motions, as arrays.

    Attributes:
        first: (motions + 1,) where the control points of each motion begin; a motion without a path has none.
        control: (k, 7) positions [m] and quaternions (x, y, z, w), in world.
        spacing, length: (motions,) of recorded time [s].
        speed: (motions,) factor.
        ramp, approach: (motions,) [s].
    """

    first: Indices
    control: Matrix
    spacing: Vector
    length: Vector
    speed: Vector
    ramp: Vector
    approach: Vector


@compiled
def ramp_way(fraction: float) -> float:
    """Gives the integral of the minimum jerk from 0 to x, 5/2 x^4 - 3 x^5 + x^6; 1/2 at 1."""
    x = min(max(fraction, 0.0), 1.0)
    return x**4 * (2.5 - 3.0 * x + x**2)


@compiled
def recorded_time(since: float, length: float, speed: float, ramp: float) -> float:
    """Gives u [s] at a time since the path's beginning [s]."""
    over = length / speed + ramp
    if since < ramp:
        return speed * ramp * ramp_way(since / ramp)
    if since > over - ramp:
        return length - speed * ramp * ramp_way((over - since) / ramp)
    return speed * (since - 0.5 * ramp)


@compiled
def write_spline(table: PathTable, m: int, u: float, out: Array) -> None:
    """Writes c(u) (7,) of motion ``m`` at recorded time u [s]."""
    segments = table.first[m + 1] - table.first[m] - 3
    x = u / table.spacing[m]
    i = min(max(int(x), 0), segments - 1)
    f = x - i
    g = 1.0 - f
    a, d = g * g * g / 6.0, f * f * f / 6.0
    b = (3.0 * f * f * f - 6.0 * f * f + 4.0) / 6.0
    c = (-3.0 * f * f * f + 3.0 * f * f + 3.0 * f + 1.0) / 6.0
    at = table.first[m] + i
    for k in range(7):
        out[k] = (
            a * table.control[at, k]
            + b * table.control[at + 1, k]
            + c * table.control[at + 2, k]
            + d * table.control[at + 3, k]
        )


@compiled
def write_path(table: PathTable, m: int, clock: float, rotation: Array, translation: Array) -> None:
    """Writes X_WT of motion ``m``, which has a path, at a phase clock [s] after its approach."""
    found, length = np.empty(7), 0.0
    u = recorded_time(clock - table.approach[m], table.length[m], table.speed[m], table.ramp[m])
    write_spline(table, m, u, found)
    for k in range(3, 7):
        length += found[k] * found[k]
    length = math.sqrt(length)
    for k in range(3, 7):
        found[k] /= length
    write_rotation(found[3:], rotation)
    for k in range(3):
        translation[k] = found[k]


@dataclass(frozen=True)
class PathMotion:
    """One equilibrium's way along a path.

    Attributes:
        course: The path.
        speed: Factor on the recorded speed.
        approach: Time of the way onto it [s].
    """

    course: PathCourse
    speed: float
    approach: float

    @property
    def ramp(self) -> float:
        """R [s]."""
        return min(RAMP, self.course.length / self.speed)

    @property
    def end(self) -> float:
        """Phase clock at which the path is over [s]."""
        return self.approach + self.course.length / self.speed + self.ramp

    @property
    def moves(self) -> bool:
        """Whether the path leads anywhere."""
        return bool(np.ptp(self.course.control, axis=0).max() > 0.0)

    def pose(self, clock: float) -> Pose:
        """Gives X_WT at a phase clock [s]; the path's beginning before the approach is over."""
        rotation, translation = np.empty((3, 3)), np.empty(3)
        write_path(self._table, 0, max(clock, self.approach), rotation, translation)
        return Pose(rotation, translation)

    def velocity(self, clock: float) -> Array:
        r"""Gives the twist (6,) at a phase clock [s] after the approach, in world axes [m/s, rad/s].

        With q the quaternion before it is divided by its length, w = 2 (q' q^*) / |q|^2, vector part.
        """
        since = clock - self.approach
        u = recorded_time(since, self.course.length, self.speed, self.ramp)
        slope = self._slope(u) * self.rate(clock)
        value = np.empty(7)
        write_spline(self._table, 0, u, value)
        (x, y, z, w), (dx, dy, dz, dw) = value[3:], slope[3:]
        q, dq = np.array([x, y, z]), np.array([dx, dy, dz])
        angular = 2.0 * (w * dq - dw * q - np.cross(dq, q)) / float(value[3:] @ value[3:])
        return np.concatenate([slope[:3], angular])

    def rate(self, clock: float) -> float:
        """Gives du/dt at a phase clock [s]."""
        since = clock - self.approach
        over = self.course.length / self.speed + self.ramp
        if not 0.0 <= since <= over:
            return 0.0
        return self.speed * minimum_jerk(min(since, over - since) / self.ramp)

    def _slope(self, u: float) -> Array:
        """Gives dc/du (7,) at recorded time u [s]."""
        control, x = self.course.control, u / self.course.spacing
        i = min(max(int(x), 0), len(control) - 4)
        f = x - i
        weights = np.array(
            [
                -0.5 * (1.0 - f) ** 2,
                1.5 * f**2 - 2.0 * f,
                -1.5 * f**2 + f + 0.5,
                0.5 * f**2,
            ]
        )
        return np.asarray(weights @ control[i : i + 4] / self.course.spacing)

    @cached_property
    def _table(self) -> PathTable:
        return lay_out_paths((self,))


def path_motion(path: PathSpec) -> PathMotion:
    """Plans the way along a path that has been read.

    Raises:
        ValueError: It has not.
    """
    if path.course is None:
        raise ValueError(f"the path of '{path.episode}' has not been read yet")
    return PathMotion(path.course, path.speed, STEP_ONTO if path.approach is None else path.approach)


def lay_out_paths(motions: Sequence[PathMotion | None]) -> PathTable:
    """Lays out the paths of several motions, in their order; None for one without."""
    points = [np.zeros((0, 7)) if motion is None else motion.course.control for motion in motions]

    def column(attribute: str) -> Array:
        found = [0.0 if m is None else getattr(m, attribute) for m in motions]
        return np.array(found, dtype=float)

    def of_course(attribute: str) -> Array:
        return np.array([0.0 if m is None else getattr(m.course, attribute) for m in motions], dtype=float)

    return PathTable(
        first=np.cumsum([0, *map(len, points)], dtype=np.int64),
        control=np.concatenate([np.zeros((0, 7)), *points]),
        spacing=of_course("spacing"),
        length=of_course("length"),
        speed=column("speed"),
        ramp=column("ramp"),
        approach=column("approach"),
    )
