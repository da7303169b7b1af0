# SPDX-License-Identifier: BSD-3-Clause
"""Torques on the plant's joints that follow a law of their motion, with no memory of their own."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from impedance_modules.effects.motion import JointMotion
from impedance_modules.effects.sample import Sample, Shape

Array = NDArray[np.float64]
Side = Literal["motor", "link"]


def sample_of(motion: JointMotion, side: Side, joints: NDArray[np.intp]) -> Sample:
    """Picks some joints' motion on one side of their gears."""
    motor = side == "motor"
    position = motion.motor_position if motor else motion.position
    velocity = motion.motor_velocity if motor else motion.velocity
    return Sample(
        time=np.full(joints.size, motion.time),
        position=position[joints],
        velocity=velocity[joints],
        acceleration=np.zeros(joints.size),
        load=motion.load[joints],
    )


class LawTorque:
    """Minus the torque that a law says its joints consume."""

    def __init__(
        self,
        basis: Callable[[Sample, Shape], Array],
        port: Side,
        joints: NDArray[np.intp],
        coefficients: Array,
        shape: Shape,
    ) -> None:
        """Takes the law, its joints' indices (k,), coefficients (k, p), and shape values (k,) each."""
        self._basis = basis
        self._side: Side = port
        self._joints = joints
        self._coefficients = coefficients
        self._shape = shape

    @property
    def port(self) -> Side:
        """Motor or link."""
        return self._side

    def torque(self, motion: JointMotion) -> Array:
        """Evaluates the law (n,) [N.m]."""
        out = np.zeros(motion.position.size)
        basis = self._basis(sample_of(motion, self._side, self._joints), self._shape)
        out[self._joints] = -np.sum(basis * self._coefficients, axis=-1)
        return out

    def settle(self, motion: JointMotion) -> None:
        """Remembers nothing."""

    def start(self, motion: JointMotion, step: float) -> None:
        """Has nothing to forget."""
