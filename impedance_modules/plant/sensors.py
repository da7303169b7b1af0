# SPDX-License-Identifier: BSD-3-Clause
"""What the robot reports of itself: positions and efforts on a grid, and a filtered velocity.

The robot's own loop (``Division.loop``) measures positions and estimates velocity from them:

    v <- v + (1 - exp(-T / time_constant)) ((q_k - q_{k-1}) / T - v)

What a patch makes wrong comes before noise and grid (``effects.worn.SensorErrors``).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from impedance_modules.effects.worn import SensorErrors
from impedance_modules.robot.state import RobotState
from impedance_modules.spec.robot import SensorSpec

Array = NDArray[np.float64]


class Sensors:
    """Joint sensors and velocity estimate of the robot.

    Attributes:
        position: (n,) last measured position [rad].
        velocity: (n,) velocity estimate [rad/s].
    """

    def __init__(
        self, spec: SensorSpec, errors: SensorErrors, period: float, noise: np.random.Generator | None
    ) -> None:
        """Takes the sensors, their errors, the robot's own loop period [s] and a source of noise or None."""
        self._spec = spec
        self._errors = errors
        self._late = errors.lag > 0.0
        self._lag_share = np.where(
            self._late, -np.expm1(-period / np.where(self._late, errors.lag, 1.0)), 1.0
        )
        self._bends_effort = bool(np.any(errors.gain != 1.0) or errors.bias.any() or errors.crosstalk.any())
        self._period = period
        self._noise = None if noise is None else _Noise(noise)
        slow = spec.velocity_filter > 0.0
        self._share = 1.0 - math.exp(-period / spec.velocity_filter) if slow else 1.0
        self.position: Array = np.zeros(0)
        self.velocity: Array = np.zeros(0)
        self._estimate: Array = np.zeros(0)

    def reset(self, position: Array) -> None:
        """Starts at rest at the true position (n,) [rad]."""
        self.position = self._encoders(position)
        self.velocity, self._estimate = np.zeros(position.size), np.zeros(position.size)

    def update(self, position: Array) -> None:
        """Measures the true position (n,) [rad] once more, a period after the last."""
        measured = self._encoders(position)
        difference = (measured - self.position) / self._period
        self._estimate = self._estimate + self._share * (difference - self._estimate)
        self.velocity = self.velocity + self._lag_share * (self._estimate - self.velocity)
        self.position = measured

    def sample(self, time: float, load: Array) -> RobotState:
        """Reports the state at ``time`` [s]; ``load`` (n,) what a perfect effort sensor would say."""
        if self._bends_effort:
            errors = self._errors
            load = errors.gain * (load + errors.crosstalk @ load) + errors.bias
        effort = self._measure(load, self._spec.effort_noise, self._spec.effort_resolution)
        parts = self.position.copy(), self.velocity.copy(), effort
        for part in parts:
            part.flags.writeable = False
        return RobotState(time * self._errors.clock, *parts)

    def _encoders(self, position: Array) -> Array:
        """Reads the joint angles; always a new array."""
        spec = self._spec
        return self._measure(position + self._errors.offset, spec.position_noise, spec.position_resolution)

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
