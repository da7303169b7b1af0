# SPDX-License-Identifier: BSD-3-Clause
r"""The plant, started from a measured state and driven by recorded torques instead of a controller.

    q, v  measured        theta = q + (tau_s / K + play)        \dot\theta = v + \dot\tau_s / K

Nothing is sensed and nothing is late here: whoever drives it gives the torque that acts, step by step.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from impedance_modules.effects.joint_motion import JointHistory
from impedance_modules.plant.joints import ELASTIC
from impedance_modules.plant.plant import Plant
from impedance_modules.records import Vector

RUNAWAY = 1e5
"""Speed beyond which a joint has run away: no robot's moves so fast [rad/s], [m/s]."""


@dataclass(frozen=True, eq=False)
class RolloutStart:
    """Where the plant begins.

    Attributes:
        time: Since the recording began [s].
        position, velocity: (n,) of the links [rad], [rad/s].
        load, load_rate: (n,) torque between gear and link [N.m] and its rate [N.m/s].
        command: (n,) torque that acts now [N.m], without what the robot adds by itself.
        past: Motions one integration step apart that led here, for effects that remember.
    """

    time: float
    position: Vector
    velocity: Vector
    load: Vector
    load_rate: Vector
    command: Vector
    past: JointHistory


class RolloutPlant(Plant):
    """A plant for experiments on recordings. Call ``reset`` once, then ``seed`` and ``roll`` as often as wanted."""

    def seed(self, start: RolloutStart) -> None:
        """Puts the plant into a measured state; effects know the past."""
        begin, joints = self.state.start, self.state.joints
        self._integrator.follow_past(start.past)
        self._start.clear(start.position)
        soft = joints["kind"] == ELASTIC
        compliance = np.where(soft, 1.0 / np.where(soft, joints["stiffness"], 1.0), 0.0)
        lead = compliance * start.load + soft * joints["half_gap"] * np.sign(start.load)
        begin.velocity[:] = start.velocity
        begin.motor_position[:] = start.position + lead
        begin.motor_velocity[:] = start.velocity + compliance * start.load_rate
        joints["load"] = joints["motor"] = start.load
        joints["command"] = start.command
        self._integrator.time = start.time

    def roll(self, commands: Vector, aims: Vector | None) -> tuple[Vector, Vector]:
        """Takes N integration steps, each with its own torque.

        Args:
            commands: (N, n) torque that acts [N.m], without what the robot adds by itself.
            aims: (N, 2, n) joint motion that the controller aims at; None where nobody recorded it.

        Returns:
            True positions and velocities where the encoders sit (N, n), each at the end of its step; NaN from where
            a joint is faster than any robot's, since what follows is beyond what can be computed.
        """
        weight, offset = self._weight, self._effects.sensors.offset
        joints, n = self.state.joints, self.state.n
        position, velocity = self._at_encoders(), self.state.start.velocity
        out = np.empty((2, len(commands), n))
        for k, command in enumerate(commands):
            joints["command"] = command
            if weight.acts:
                joints["assist"] = weight.torque(position + offset)
            if aims is not None:
                self.aim(aims[k, 0], aims[k, 1])
            self._integrator.advance(1)
            position = self._at_encoders()
            out[0, k], out[1, k] = position, velocity
            if not np.abs(velocity).max() <= RUNAWAY:
                out[:, k:] = np.nan
                break
        if self._encoders_at_motors and len(commands) > 1:
            at_motor = self.model.encoder_at_motor
            out[1][:, at_motor] = np.gradient(out[0][:, at_motor], self.division.step, axis=0)
        return out[0], out[1]

    def assistance(self, position: Vector) -> Vector:
        """Computes what the robot adds by itself at a reported position (n,) [N.m]."""
        return self._weight.torque(position)
