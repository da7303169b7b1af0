# SPDX-License-Identifier: BSD-3-Clause
r"""Where a limb's position servo is led: a robot's own position, velocity and hold modes.

    POSITION      eased' = clip(target - eased, +-ratio v_max T),  reference' = (eased - reference) T / lag
    RAW_POSITION  reference' = clip(target - reference, +-v_max T)
    VELOCITY      reference' = clip(v, +-v_max) T
    hold          reference stays

    theta_s = reference + integral of error + weight / K_sea + v_ref D_s / K_s - ease (v - v_ref)

The weight winds the joint's own spring, so the motor must stand ahead of the link; the integral takes the rest.
``ease`` = 0.4 sqrt(M_ii / K_sea) feeds the link's speed back, or the arm would swing on its springs for seconds.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Tuning:
    """How a robot's own modes are tuned.

    Attributes:
        tick: Period of the robot's own loop [s].
        lag: By which position mode trails a moving command [s].
        integral_rate, integral_limit: Integral action of the position servo [1/s] and its limit [rad].
    """

    tick: float
    lag: float
    integral_rate: float
    integral_limit: float


@dataclass(frozen=True)
class Reach:
    """How far and how fast a limb's joints go, each (k,): [rad], [rad], [rad/s]."""

    low: Array
    high: Array
    speed: Array


@dataclass(frozen=True)
class Sensed:
    """A limb's measured positions (k,) [rad] and velocities (k,) [rad/s]."""

    position: Array
    velocity: Array


@dataclass(frozen=True)
class Servo:
    """How a limb's servo is set, each (k,).

    Attributes:
        ahead: By how much the weight winds the joints' springs [rad].
        lead: D_s / K_s [s].
        ease: Of the links' swing [s].
    """

    ahead: Array
    lead: Array
    ease: Array


class Reference:
    """The moving set-point of one limb's servo.

    Attributes:
        position: (k,) where the links shall be [rad].
        velocity: (k,) how fast it moves [rad/s].
        integral: (k,) of the position error times the integral rate [rad].
    """

    def __init__(self, reach: Reach, tuning: Tuning) -> None:
        self._reach, self._tuning = reach, tuning
        self._catching_up = 1.0 - math.exp(-tuning.tick / tuning.lag)
        k = reach.speed.size
        self.position, self.velocity, self.integral = np.zeros(k), np.zeros(k), np.zeros(k)
        self._eased = np.zeros(k)

    def settle(self, position: Array) -> None:
        """Starts to hold at measured positions (k,) [rad]."""
        self.position = position.copy()
        self._eased = position.copy()
        self.velocity[:] = 0.0
        self.integral[:] = 0.0

    def stay(self) -> None:
        """Holds."""
        self.velocity[:] = 0.0
        self._eased = self.position.copy()

    def approach(self, target: Array, ratio: float) -> None:
        """Moves on in position mode at a share of the top speed."""
        target = np.clip(target, self._reach.low, self._reach.high)
        step = ratio * self._reach.speed * self._tuning.tick
        self._eased = self._eased + np.clip(target - self._eased, -step, step)
        self._move(self._catching_up * (self._eased - self.position))

    def follow(self, target: Array) -> None:
        """Moves on in raw position mode: only the joints' top speed is kept."""
        step = self._reach.speed * self._tuning.tick
        self._move(np.clip(target - self.position, -step, step))
        self._eased = self.position.copy()

    def run(self, velocity: Array) -> None:
        """Moves on in velocity mode, up to the limits."""
        bounded = np.clip(velocity, -self._reach.speed, self._reach.speed)
        goal = np.clip(self.position + bounded * self._tuning.tick, self._reach.low, self._reach.high)
        self._move(goal - self.position)
        self._eased = self.position.copy()

    def motor_target(self, sensed: Sensed, servo: Servo) -> Array:
        """Computes theta_s (k,) [rad].

        Args:
            sensed: What the joints report.
            servo: How the joints' servo is set.
        """
        tuning = self._tuning
        self.integral += tuning.integral_rate * tuning.tick * (self.position - sensed.position)
        np.clip(self.integral, -tuning.integral_limit, tuning.integral_limit, out=self.integral)
        swing = sensed.velocity - self.velocity
        ahead = servo.ahead + servo.lead * self.velocity - servo.ease * swing
        return np.asarray(self.position + self.integral + ahead)

    def _move(self, step: Array) -> None:
        self.position = self.position + step
        self.velocity = step / self._tuning.tick
