# SPDX-License-Identifier: BSD-3-Clause
"""What the robot reports of itself: positions and efforts on a grid, and a filtered velocity.

The robot's own loop (``Division.loop``) measures positions and estimates velocity from them:

    v <- v + (1 - exp(-T / time_constant)) ((q_k - q_{k-1}) / T - v)
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from impedance_modules.robot.state import RobotState
from impedance_modules.spec.robot import SensorSpec

Array = NDArray[np.float64]


class Sensors:
    """Joint sensors and velocity estimate of the robot.

    Attributes:
        position: (n,) last measured position [rad].
        velocity: (n,) velocity estimate [rad/s].
    """

    def __init__(self, spec: SensorSpec, period: float, noise: np.random.Generator | None) -> None:
        """Takes the sensors, the robot's own loop period [s] and a source of noise; None is silent."""
        self._spec = spec
        self._period = period
        self._noise = None if noise is None else _Noise(noise)
        slow = spec.velocity_filter > 0.0
        self._share = 1.0 - math.exp(-period / spec.velocity_filter) if slow else 1.0
        self.position: Array = np.zeros(0)
        self.velocity: Array = np.zeros(0)

    def reset(self, position: Array) -> None:
        """Starts at rest at the true position (n,) [rad]."""
        self.position = self._measure(position, self._spec.position_noise, self._spec.position_resolution)
        self.velocity = np.zeros(position.size)

    def update(self, position: Array) -> None:
        """Measures the true position (n,) [rad] once more, a period after the last."""
        measured = self._measure(position, self._spec.position_noise, self._spec.position_resolution)
        difference = (measured - self.position) / self._period
        self.velocity = self.velocity + self._share * (difference - self.velocity)
        self.position = measured

    def sample(self, time: float, load: Array) -> RobotState:
        """Reports the state at ``time`` [s]; ``load`` (n,) what a perfect effort sensor would say."""
        effort = self._measure(load, self._spec.effort_noise, self._spec.effort_resolution)
        parts = self.position.copy(), self.velocity.copy(), effort
        for part in parts:
            part.flags.writeable = False
        return RobotState(time, *parts)

    def _measure(self, truth: Array, spread: float, grid: float) -> Array:
        """Adds noise and rounds to the grid; always a new array."""
        value = truth.copy()
        if self._noise is not None and spread > 0.0:
            value += spread * self._noise.draw(truth.size)
        if grid > 0.0:
            value /= grid
            np.rint(value, out=value)
            value *= grid
        return value


class _Noise:
    """Standard normal numbers, drawn many at a time."""

    BLOCK = 4096

    def __init__(self, source: np.random.Generator) -> None:
        self._source = source
        self._numbers = np.zeros(0)
        self._next = 0

    def draw(self, count: int) -> Array:
        """Gives ``count`` fresh numbers; a view."""
        if self._next + count > self._numbers.size:
            self._numbers = self._source.standard_normal(max(self.BLOCK, count))
            self._next = 0
        self._next += count
        return self._numbers[self._next - count : self._next]
