# SPDX-License-Identifier: BSD-3-Clause
"""Torques on the plant's joints that follow a law of their motion, with no memory of their own."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from impedance_modules.effects.motion import JointMotion
from impedance_modules.effects.joint_motion import Sample, Shape, smoothing

Array = NDArray[np.float64]
Side = Literal["motor", "link"]

FAST = 5.0
"""Multiple of the turnover speed at which dry friction is measured."""


class LawTorque:
    """Minus the torque that a law says its joints consume."""

    def __init__(
        self,
        basis: Callable[[Sample, Shape], Array],
        port: Side,
        joints: NDArray[np.intp],
        *,
        coefficients: Array,
        shape: Shape,
        mobility: Callable[[Array], Array],
        sliding: NDArray[np.bool_],
    ) -> None:
        """Takes the law, its joints' indices (k,), coefficients (k, p), and shape values (k,) each.

        ``mobility`` gives the acceleration per torque (n,) of the port's side at a posture (n,); ``sliding``
        (k,) says which of the law's joints are prismatic.
        """
        self._basis = basis
        self._side: Side = port
        self._joints = joints
        self._coefficients = coefficients
        self._shape = shape
        self._mobility = mobility
        self._sharp = smoothing(sliding)
        self._turnover = self._sharp

    @property
    def port(self) -> Side:
        """Motor or link."""
        return self._side

    def start(self, motion: JointMotion, step: float) -> None:
        """Widens dry friction's turnover where it would stop a light part within less than a step.

        Over a step h a torque F changes a speed by F h / I: below that speed no friction of size F can be told
        from sticking, and an explicit integrator would shake.
        """
        sharp = replace(self._sample(motion), turnover=self._sharp)
        speed = FAST * self._sharp
        there = self._consumed(replace(sharp, velocity=speed))
        back = self._consumed(replace(sharp, velocity=-speed))
        dry = 0.5 * np.abs(there - back)
        self._turnover = np.maximum(self._sharp, dry * self._mobility(motion.position)[self._joints] * step)

    def torque(self, motion: JointMotion) -> Array:
        """Evaluates the law (n,) [N.m]."""
        out = np.zeros(motion.position.size)
        out[self._joints] = -self._consumed(self._sample(motion))
        return out

    def settle(self, motion: JointMotion) -> None:
        """Remembers nothing."""

    def _consumed(self, sample: Sample) -> Array:
        return np.asarray(np.sum(self._basis(sample, self._shape) * self._coefficients, axis=-1))

    def _sample(self, motion: JointMotion) -> Sample:
        """Picks the joints' motion on their side of the gear."""
        motor = self._side == "motor"
        position = motion.motor_position if motor else motion.position
        velocity = motion.motor_velocity if motor else motion.velocity
        return Sample(
            time=np.full(self._joints.size, motion.time),
            position=position[self._joints],
            velocity=velocity[self._joints],
            acceleration=np.zeros(self._joints.size),
            load=motion.load[self._joints],
            turnover=self._turnover,
        )
