# SPDX-License-Identifier: BSD-3-Clause
r"""What the robot reports of itself: positions and efforts with noise, on a grid, and a filtered velocity.

The robot's own loop (``Division.loop``, T) measures positions q_k and estimates velocity from them:

    v <- v + (1 - exp(-T / time_constant)) ((q_k - q_{k-1}) / T - v)

What a patch makes wrong comes before noise and grid (``SensorErrors``).
"""

from __future__ import annotations

import math

import numpy as np

from impedance_modules.compiled import compiled
from impedance_modules.effects.plant_builder import SensorErrors
from impedance_modules.records import Matrix, Record, Scalar, Vector
from impedance_modules.robot.state import RobotState
from impedance_modules.spec.robot_spec import SensorSpec


class Readings(Record):
    """What the joint sensors know.

    Attributes:
        offset: (n,) of the encoders [rad].
        lag_share: (n,) of a change of the estimate that reaches the reported velocity in one loop.
        position: (n,) last measured [rad].
        estimate: (n,) velocity from measured positions, low-passed [rad/s].
        velocity: (n,) as reported: the estimate, with the lag of a patch [rad/s].
        grid: Of positions [rad]; 0 for none.
        effort_grid: [N.m]; 0 for none.
        period: Of the robot's own loop [s].
        share: Of a new difference that enters the estimate.
    """

    offset: Vector
    lag_share: Vector
    position: Vector
    estimate: Vector
    velocity: Vector
    grid: Scalar
    effort_grid: Scalar
    period: Scalar
    share: Scalar


@compiled
def read_encoders(readings: Readings, truth: Vector, noise: Vector) -> None:
    """Measures the true positions (n,) once more, a period after the last, and follows with the velocity.

    ``noise`` (n,) [rad] is added before rounding to the grid.
    """
    position, estimate, velocity = readings.position, readings.estimate, readings.velocity
    for i in range(truth.size):
        measured = round_to_grid(truth[i] + readings.offset[i] + noise[i], readings.grid)
        difference = (measured - position[i]) / readings.period
        estimate[i] += readings.share * (difference - estimate[i])
        velocity[i] += readings.lag_share[i] * (estimate[i] - velocity[i])
        position[i] = measured


@compiled
def report(readings: Readings, load: Vector, noise: Vector, out: Matrix) -> None:
    """Writes position, velocity and effort (3, n); the effort is ``load`` (n,) with noise, on its grid [N.m]."""
    for i in range(load.size):
        out[0, i], out[1, i] = readings.position[i], readings.velocity[i]
        out[2, i] = round_to_grid(load[i] + noise[i], readings.effort_grid)


@compiled
def round_to_grid(value: float, grid: float) -> float:
    """Rounds to the nearest multiple of ``grid``; 0 leaves the value as it is."""
    return float(np.rint(value / grid) * grid) if grid > 0.0 else value


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
        self._noise = None if noise is None else _Noise(noise)
        self._bends_effort = bool(np.any(errors.gain != 1.0) or errors.bias.any() or errors.crosstalk.any())
        n, late = errors.offset.size, errors.lag > 0.0
        self._no_noise = np.zeros(n)
        self._readings = Readings(
            offset=errors.offset.copy(),
            lag_share=np.where(late, -np.expm1(-period / np.where(late, errors.lag, 1.0)), 1.0),
            position=np.zeros(n),
            estimate=np.zeros(n),
            velocity=np.zeros(n),
            grid=spec.position_resolution,
            effort_grid=spec.effort_resolution,
            period=period,
            share=1.0 - math.exp(-period / spec.velocity_filter) if spec.velocity_filter > 0.0 else 1.0,
        )
        self.position: Vector = self._readings.position

    def reset(self, position: Vector) -> None:
        """Starts at rest at the true position (n,) [rad]."""
        self.update(position)
        self._readings.estimate[:], self._readings.velocity[:] = 0.0, 0.0

    def update(self, position: Vector) -> None:
        """Measures the true position (n,) [rad] once more, a period after the last."""
        read_encoders(self._readings, position, self._draw(self._spec.position_noise))

    def sample(self, time: float, load: Vector) -> RobotState:
        """Reports the state at ``time`` [s]; ``load`` (n,) what a perfect effort sensor would say [N.m]."""
        errors = self._errors
        if self._bends_effort:
            load = errors.gain * (load + errors.crosstalk @ load) + errors.bias
        parts = np.empty((3, load.size))
        report(self._readings, load, self._draw(self._spec.effort_noise), parts)
        parts.flags.writeable = False
        return RobotState(time * errors.clock, parts[0], parts[1], parts[2])

    def _draw(self, spread: float) -> Vector:
        """Gives fresh noise (n,) of a standard deviation; read-only."""
        if self._noise is None or spread == 0.0:
            return self._no_noise
        return spread * self._noise.draw(self._no_noise.size)


class _Noise:
    """Standard normal numbers, drawn many at a time."""

    BLOCK = 4096

    def __init__(self, source: np.random.Generator) -> None:
        self._source = source
        self._numbers = np.zeros(0)
        self._next = 0

    def draw(self, count: int) -> Vector:
        """Gives ``count`` fresh numbers; a view."""
        if self._next + count > self._numbers.size:
            self._numbers = self._source.standard_normal(max(self.BLOCK, count))
            self._next = 0
        self._next += count
        return self._numbers[self._next - count : self._next]
