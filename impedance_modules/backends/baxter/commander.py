# SPDX-License-Identifier: BSD-3-Clause
"""Puts orders on the robot's topics: torques, angles, time-out, speed, rate."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from impedance_modules.backends.baxter import topics
from impedance_modules.backends.baxter.ros.messages import Float64, JointCommand, UInt16
from impedance_modules.backends.baxter.ros.transport import Publisher, Transport
from impedance_modules.backends.baxter.ros.wire import encode
from impedance_modules.backends.baxter.stop_rules import Order
from impedance_modules.robot.model import Limb

Array = NDArray[np.float64]


class Commander:
    """Publishers of some limbs' commands; every command names all joints of its limb."""

    def __init__(self, transport: Transport, limbs: Mapping[str, Limb]) -> None:
        """Advertises; sends nothing yet."""
        self._limbs = limbs
        self._commands = {
            name: transport.advertise(topics.joint_command(name), JointCommand) for name in limbs
        }
        self._timeouts = {
            name: transport.advertise(topics.command_timeout(name), Float64, latch=True) for name in limbs
        }
        self._rate = transport.advertise(topics.STATE_RATE_REQUEST, UInt16, latch=True)

    def deaf(self) -> tuple[str, ...]:
        """Names the limbs to whose commands nobody listens."""
        return tuple(name for name, publisher in self._commands.items() if publisher.connections() == 0)

    def send(self, order: Order) -> None:
        """Sends what an order says to each of its limbs."""
        if order.effort is not None:
            mode, values = JointCommand.TORQUE_MODE, order.effort
        elif order.position is not None:
            mode, values = JointCommand.POSITION_MODE, order.position
        else:
            return
        for name in order.limbs:
            limb = self._limbs[name]
            command = tuple(values[limb.joints].tolist())
            self._commands[name].send(JointCommand(mode, command, limb.joint_names))

    def rehearse(self, effort: Array) -> None:
        """Lays out the torques (n,) [N.m] of all limbs as ``send`` does, and sends nothing."""
        for limb in self._limbs.values():
            encode(
                JointCommand(JointCommand.TORQUE_MODE, tuple(effort[limb.joints].tolist()), limb.joint_names)
            )

    def set_timeout(self, seconds: float) -> None:
        """Sets after how long without a command the robot leaves torque mode [s]."""
        for publisher in self._timeouts.values():
            publisher.send(Float64(seconds))

    def ask_rate(self, rate: int) -> None:
        """Asks for the joint states at a rate [Hz]."""
        self._rate.send(UInt16(rate))

    def close(self) -> None:
        """Stops publishing."""
        publishers: list[Publisher[JointCommand] | Publisher[Float64] | Publisher[UInt16]] = [
            *self._commands.values(),
            *self._timeouts.values(),
            self._rate,
        ]
        for publisher in publishers:
            publisher.close()
