# SPDX-License-Identifier: BSD-3-Clause
r"""How one equilibrium pose moves during a phase, as a pure function of the phase's clock.

Notation: E the frame ``expressed_in``, frozen at the start posture; T the moving equilibrium. The six
coordinates of T in E are its position and its rotation vector, (p_ET, log R_ET) [m, rad]. With the
minimum jerk s(\sigma), from 0 to 1 over the phase,

    p(\sigma) = p_0 + s (p_1 - p_0) + a sin(2 \pi f \sigma)
    R(\sigma) = R_0 exp(s log(R_0^T R_1))                             the shortest relative rotation, or
    R(\sigma) = exp(c_0 + s (c_1 - c_0) + a sin(2 \pi f \sigma))     where a rotation coordinate oscillates.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from impedance_modules.robot.pose import Pose
from impedance_modules.robot.rotation import exp3, log3, log_jacobian
from impedance_modules.spec.task import AXES, Coordinate, Sine

Array = NDArray[np.float64]


def minimum_jerk(fraction: float) -> float:
    """Goes smoothly from 0 at 0 to 1 at 1, s = 10 x^3 - 15 x^4 + 6 x^5; stays there outside."""
    x = min(max(fraction, 0.0), 1.0)
    return x**3 * (10.0 - 15.0 * x + 6.0 * x**2)


def minimum_jerk_slope(fraction: float) -> float:
    """Gives ds/dx = 30 x^2 (1 - x)^2 of ``minimum_jerk``; 0 outside [0, 1]."""
    x = min(max(fraction, 0.0), 1.0)
    return 30.0 * x**2 * (1.0 - x) ** 2


@dataclass(frozen=True)
class PoseMotion:
    """One equilibrium's way through a phase.

    Attributes:
        reference: X_WE, frozen.
        start: X_ET when the phase begins.
        goal: (6,) coordinates in E that the minimum jerk reaches; a sine's centre.
        amplitude, frequency: (6,) of each coordinate's sine [m or rad], [Hz]; 0 for none.
        duration: Of the minimum jerk [s].
    """

    reference: Pose
    start: Pose
    goal: Array
    amplitude: Array
    frequency: Array
    duration: float

    def pose(self, clock: float) -> Pose:
        """Gives X_WT at ``clock`` seconds into the phase."""
        s = minimum_jerk(clock / self.duration)
        wave = self.amplitude * np.sin(2.0 * math.pi * self.frequency * clock)
        position = self.start.translation
        position = position + s * (self.goal[:3] - position) + wave[:3]
        return self.reference @ Pose(self._rotation(s, wave[3:]), position)

    def velocity(self, clock: float) -> Array:
        """Gives the twist of T per second of the phase's clock, (6,) in world axes at T's origin."""
        s, slope = minimum_jerk(clock / self.duration), minimum_jerk_slope(clock / self.duration)
        rate = 2.0 * math.pi * self.frequency
        wave, swing = self.amplitude * np.sin(rate * clock), self.amplitude * rate * np.cos(rate * clock)
        linear = slope / self.duration * (self.goal[:3] - self.start.translation) + swing[:3]
        if self.turns_along_triple:
            first, last = self.triples()
            change = slope / self.duration * (last - first) + swing[3:]
            angular = np.linalg.solve(log_jacobian(first + s * (last - first) + wave[3:]), change)
        else:
            angular = self.start.rotation @ (slope / self.duration * self.relative_turn)
        turn = self.reference.rotation
        return np.concatenate([turn @ linear, turn @ angular])

    def _rotation(self, s: float, wave: Array) -> Array:
        if self.turns_along_triple:
            first, last = self.triples()
            return exp3(first + s * (last - first) + wave)
        return self.start.rotation @ exp3(s * self.relative_turn)

    @cached_property
    def turns_along_triple(self) -> bool:
        """An oscillating coordinate means what the file says only along the rotation vector itself."""
        return bool(np.any(self.amplitude[3:]))

    @cached_property
    def relative_turn(self) -> Array:
        """Gives the rotation vector from the start to the goal, in the start's axes (3,) [rad]."""
        return log3(self.start.rotation.T @ exp3(self.goal[3:]))

    def triples(self) -> tuple[Array, Array]:
        """Gives first and last rotation vector, the last in its representation nearest to the first."""
        first, last = log3(self.start.rotation), self.goal[3:]
        angle = float(np.linalg.norm(last))
        if angle == 0.0:
            return first, last
        turned = last * (1.0 - 2.0 * math.pi / angle)
        near = np.linalg.norm(turned - first) < np.linalg.norm(last - first)
        return first, turned if near else last


def pose_motion(
    reference: Pose, current: Pose, coordinates: Mapping[str, Coordinate], duration: float
) -> PoseMotion:
    """Plans a motion from where an equilibrium is to the coordinates that a phase asks for.

    Args:
        reference: X_WE.
        current: X_WT now.
        coordinates: Axis name -> absolute value in E, or ``Sine``; omitted axes keep their value.
        duration: Of the phase [s].
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
    return PoseMotion(reference, start, goal, amplitude, frequency, duration)
