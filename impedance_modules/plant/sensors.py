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

from impedance_modules.compiled import compiled
from impedance_modules.effects.worn import SensorErrors
from impedance_modules.robot.state import RobotState
from impedance_modules.spec.robot import SensorSpec

Array = NDArray[np.float64]


class Sensors:
    """Joint sensors and velocity estimate of the robot.

    Attributes:
        position: (n,) last measured position [rad]; a live view.
    """

    def __init__(
        self, spec: SensorSpec, errors: SensorErrors, period: float, noise: np.random.Generator | None
    ) -> None:
        """Takes the sensors, their errors, the robot's own loop period [s] and a source of noise or None."""
        self._spec = spec
        self._errors = errors
        self._period = period
        self._noise = None if noise is None else _Noise(noise)
        self._bends_effort = bool(np.any(errors.gain != 1.0) or errors.bias.any() or errors.crosstalk.any())
        slow = spec.velocity_filter > 0.0
        self._share = 1.0 - math.exp(-period / spec.velocity_filter) if slow else 1.0
        late = errors.lag > 0.0
        self._silence = np.zeros(errors.offset.size)
        self._readings = np.zeros((5, errors.offset.size))
        self._readings[OFFSET] = errors.offset
        self._readings[LAG_SHARE] = np.where(late, -np.expm1(-period / np.where(late, errors.lag, 1.0)), 1.0)
        self.position: Array = self._readings[POSITION]

    def reset(self, position: Array) -> None:
        """Starts at rest at the true position (n,) [rad]."""
        self.update(position)
        self._readings[ESTIMATE], self._readings[VELOCITY] = 0.0, 0.0

    def update(self, position: Array) -> None:
        """Measures the true position (n,) [rad] once more, a period after the last."""
        spec = self._spec
        noise = self._draw(spec.position_noise)
        read_encoders(self._readings, position, noise, spec.position_resolution, self._period, self._share)

    def sample(self, time: float, load: Array) -> RobotState:
        """Reports the state at ``time`` [s]; ``load`` (n,) what a perfect effort sensor would say."""
        errors, spec = self._errors, self._spec
        if self._bends_effort:
            load = errors.gain * (load + errors.crosstalk @ load) + errors.bias
        parts = np.empty((3, load.size))
        report(self._readings, load, self._draw(spec.effort_noise), spec.effort_resolution, parts)
        parts.flags.writeable = False
        return RobotState(time * errors.clock, parts[0], parts[1], parts[2])

    def _draw(self, spread: float) -> Array:
        """Gives fresh noise (n,) of a standard deviation; read-only."""
        if self._noise is None or spread == 0.0:
            return self._silence
        return spread * self._noise.draw(self._silence.size)


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


OFFSET, LAG_SHARE, POSITION, ESTIMATE, VELOCITY = range(5)
"""Rows of the readings: encoder offset [rad], share of the estimate passed on, and what was last reported."""


@compiled
def read_encoders(
    readings: Array, truth: Array, noise: Array, grid: float, period: float, share: float
) -> None:
    """Measures the true positions (n,) once more, ``period`` [s] after the last, and follows with the velocity.

    ``noise`` (n,) is added before rounding to ``grid`` [rad]; ``share`` of a new difference enters the estimate.
    """
    for i in range(truth.size):
        measured = on_grid(truth[i] + readings[OFFSET, i] + noise[i], grid)
        difference = (measured - readings[POSITION, i]) / period
        readings[ESTIMATE, i] += share * (difference - readings[ESTIMATE, i])
        readings[VELOCITY, i] += readings[LAG_SHARE, i] * (readings[ESTIMATE, i] - readings[VELOCITY, i])
        readings[POSITION, i] = measured


@compiled
def report(readings: Array, load: Array, noise: Array, grid: float, out: Array) -> None:
    """Writes position, velocity and effort (3, n); the effort is ``load`` (n,) with noise, on its grid [N.m]."""
    for i in range(load.size):
        out[0, i], out[1, i] = readings[POSITION, i], readings[VELOCITY, i]
        out[2, i] = on_grid(load[i] + noise[i], grid)


@compiled
def on_grid(value: float, grid: float) -> float:
    """Rounds to the nearest multiple of ``grid``; 0 leaves the value as it is."""
    return float(np.rint(value / grid) * grid) if grid > 0.0 else value
