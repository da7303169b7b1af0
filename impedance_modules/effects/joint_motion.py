# SPDX-License-Identifier: BSD-3-Clause
r"""Motion of joints: what an effect's law is a function of, and what the plant passes to an effect's torque.

A `JointSample` is read by the same law twice: the plant hands over the joints of one instant, the diagnosis one
joint over a whole recording. All its arrays have one shape, (k,) joints or (N,) samples.

Dry friction can change its sign over a speed, or over a displacement, as bristles that bend (Dahl 1968): over a
displacement dq in one direction their bend moves towards sgn(dq) by the share 1 - exp(-|dq| / stretch), which is
exact and independent of the speed.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from impedance_modules.arrays import Array

Shape = Mapping[str, Array | float]
"""Values of the parameters that enter a law nonlinearly, by symbol; numbers or one per joint."""

REGULARISATION_VELOCITY, SLIDING_REGULARISATION_VELOCITY = 0.01, 0.001
"""Regularisation velocity v_0 of dry friction, sgn(v) ~ tanh(v / v_0) [rad/s], and of a sliding joint [m/s].

The diagnosis always uses this one, the plant a larger one where a light link would demand a shorter step.
"""


@dataclass(frozen=True)
class JointSample:
    """Motion and torques that a joint's law may depend on.

    Attributes:
        time: Since the start [s].
        position, velocity, acceleration: Of the side at which the effect acts [rad], [rad/s], [rad/s^2];
            the plant, which is still to find the acceleration, gives zeros.
        load: Torque between gear and link [N.m].
        regularisation: Regularisation velocity v_0 of dry friction [rad/s].
        bristles: Bend in [-1, 1] of the bristles, where a displacement and not a speed decides; or None.
    """

    time: Array
    position: Array
    velocity: Array
    acceleration: Array
    load: Array
    regularisation: Array | float = REGULARISATION_VELOCITY
    bristles: Array | None = None

    @property
    def direction(self) -> Array:
        """The regularised sign of the velocity, or the bend of the bristles."""
        if self.bristles is not None:
            return self.bristles
        return sign(self.velocity, self.regularisation)


def regularisation_velocity(sliding: NDArray[np.bool_]) -> Array:
    """Gives each joint's regularisation velocity v_0 (n,) from whether it is prismatic."""
    return np.where(sliding, SLIDING_REGULARISATION_VELOCITY, REGULARISATION_VELOCITY)


def sign(velocity: Array, regularisation: Array | float = REGULARISATION_VELOCITY) -> Array:
    """Gives the regularised sign tanh(v / v_0)."""
    return np.asarray(np.tanh(velocity / regularisation))


@dataclass
class JointMotion:
    """Live views of the joints at one stage, all (n,); read them, do not write.

    Attributes:
        time: Of the step's start [s].
        position, velocity: Of the links [rad], [rad/s].
        motor_position, motor_velocity: Of the rotors, seen at the joint; a rigid joint's are its link's.
        command: Torque command that acts now [N.m].
        load: Torque between gear and link at the step's start [N.m].
        drive: Torque asked of the motors: the command plus what the robot adds by itself [N.m].
        position_command, velocity_command: The joint motion the controller aims at [rad], [rad/s].
    """

    time: float
    position: Array
    velocity: Array
    motor_position: Array
    motor_velocity: Array
    command: Array
    load: Array
    drive: Array
    position_command: Array
    velocity_command: Array


class JointTorque(Protocol):
    """An effect that acts as a torque on joints."""

    @property
    def port(self) -> Literal["motor", "link"]:
        """Which of the two equations of motion the torque enters (thesis eq. 3.1 or 3.2)."""
        ...

    def torque(self, motion: JointMotion) -> Array:
        """Gives the torque (n,) [N.m] at one stage; must not remember anything."""
        ...

    def settle(self, motion: JointMotion) -> None:
        """Is told the motion at the end of each step; the place for memory such as a stuck bristle."""
        ...


class EffectTorque(ABC):
    """A joint torque of the catalogue: it can start again. Without more said it has no memory."""

    port: Literal["motor", "link"]

    @abstractmethod
    def torque(self, motion: JointMotion) -> Array:
        """Gives the torque (n,) [N.m] at one stage; must not remember anything."""

    def start(self, motion: JointMotion, step: float) -> None:  # noqa: B027
        """Forgets the past: the joints are as given, and steps of a length [s] follow."""

    def settle(self, motion: JointMotion) -> None:  # noqa: B027
        """Is told the motion at the end of each step."""


def bent(bristle: Array, moved: Array, stretch: Array | float) -> Array:
    """Gives the bristles' bend zeta in [-1, 1] after a displacement in one direction."""
    direction = np.sign(moved)
    return np.asarray(direction + (bristle - direction) * np.exp(-np.abs(moved) / stretch))


def follow(position: Array, stretch: float) -> Array:
    """Computes the bend (N,) along a path (N,), unbent at its start."""
    out = np.zeros(position.size)
    steps = np.diff(position)
    keep, direction = np.exp(-np.abs(steps) / stretch), np.sign(steps)
    bristle = 0.0
    for i in range(steps.size):
        bristle = direction[i] + (bristle - direction[i]) * keep[i]
        out[i + 1] = bristle
    return out
