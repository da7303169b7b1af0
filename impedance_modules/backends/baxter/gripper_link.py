# SPDX-License-Identifier: BSD-3-Clause
"""An electric gripper of a Baxter: commands it by its own topics, reads its state, and says whether it may be ordered.

A motion is two commands, first ``configure`` (speed and forces), then ``go`` (opening). Each is repeated until the
state names its sender, so that no ``go`` acts with the forces of an earlier order. The transport's thread only keeps
the newest messages; everything else happens in ``order`` and ``report``, which run after the torque of a cycle.

Openings, forces and speeds are percentages of the largest, as Rethink's SDK (baxter_interface) has them; the robot
file says what 100 % is [m, N, m/s].
"""

from __future__ import annotations

import json
import math
import os
import time

from impedance_modules.backends.baxter import topics
from impedance_modules.backends.baxter.ros.messages import (
    EndEffectorCommand,
    EndEffectorProperties,
    EndEffectorState,
)
from impedance_modules.backends.baxter.ros.transport import Publisher, Transport
from impedance_modules.backends.grippers import THIN, GripperReport, GripperSample, OrderedGripper
from impedance_modules.backends.preflight import PreflightResult
from impedance_modules.errors import RobotRefused
from impedance_modules.spec.gripper_spec import GripperMotion, GripperSpec

KIND = "baxter-electric-gripper"
"""Kind of gripper in a robot file that is this one."""

CONFIGURE, GO = "configure", "go"
"""The commands that are sent; nothing else is."""

FULL = 100.0
"""Percent of what the gripper can."""

MOVING_FORCE = 40.0
"""Of a motion that shall hold nothing [%]: the SDK's own default."""

DEAD_ZONE = 0.8 * THIN
"""This near to the ordered opening the gripper ends a motion by itself [m]; here it counts as reached within THIN."""

REPEAT = 0.1
"""A command that the state does not answer yet is sent again after this time [s]."""

KNOWN_TIME = 5.0
"""Longest wait for a first state and for the properties [s], as the SDK waits."""

KINDS = {
    EndEffectorProperties.NO_GRIPPER: "no gripper",
    EndEffectorProperties.SUCTION_CUP_GRIPPER: "a suction cup",
    EndEffectorProperties.PASSIVE_GRIPPER: "a passive gripper",
}


class GripperLink:
    """One electric gripper.

    Attributes:
        state: What it last said, and when that arrived [s, monotonic]; None before the first message.
        properties: What it says it is; None before the first message.
    """

    def __init__(self, transport: Transport, limb: str, spec: GripperSpec) -> None:
        """Begins to listen; sends nothing."""
        self._transport, self._limb, self._spec = transport, limb, spec
        self.state: tuple[EndEffectorState, float] | None = None
        self.properties: EndEffectorProperties | None = None
        self._ordered = OrderedGripper(spec, self._begin)
        self._publisher: Publisher[EndEffectorCommand] | None = None
        self._heard: tuple[EndEffectorState, float] | None = None
        self._unanswered: list[EndEffectorCommand] = []
        self._sent = -math.inf
        self._number = self._ended = self._sequence = 0
        self._motion: GripperMotion | None = None
        self._subscriptions = [
            transport.subscribe(topics.gripper_state(limb), EndEffectorState, self._take_state),
            transport.subscribe(
                topics.gripper_properties(limb), EndEffectorProperties, self._take_properties
            ),
        ]

    def wait_until_known(self, seconds: float) -> None:
        """Waits until it has said its state and what it is, or for this time [s]."""
        end = time.monotonic() + seconds
        while (self.state is None or self.properties is None) and time.monotonic() < end:
            time.sleep(0.02)

    def check(self, *, ordered: bool) -> PreflightResult:
        """Says whether it may be ordered; where the task does not order it, nothing fails."""
        name, why = f"gripper {self._limb}", self._unfit()
        if not why:
            return PreflightResult(name, True, "electric, calibrated, without error", "")
        remedy = (
            "Rethink's electric gripper, calibrated by hand before the run: 'gripper_keyboard.py' of its SDK, key"
            " 'c', fingers free; this program never calibrates, because that moves the fingers"
        )
        return PreflightResult(name, False if ordered else None, why, remedy)

    def attach(self) -> None:
        """Advertises the commands; sends nothing."""
        self._publisher = self._transport.advertise(topics.gripper_command(self._limb), EndEffectorCommand)

    def refuse_without_subscriber(self) -> None:
        """Raises RobotRefused where nobody listens to the commands."""
        if self._publisher is not None and self._publisher.connections() == 0:
            raise RobotRefused(
                f"nobody listens to {topics.gripper_command(self._limb)} (valid: a robot whose gripper software runs,"
                " and ROS_IP=the address of this machine in the robot's network)"
            )

    def order(self, motion: GripperMotion) -> None:
        """Hands an order on."""
        self._ordered.order(motion, time.monotonic())

    def report(self) -> GripperReport:
        """What is known of the gripper now; goes on with the commands of the order that stands."""
        newest = self.state
        if newest is not None and newest is not self._heard:
            self._heard = newest
            self._follow(newest[0])
            self._ordered.hear(self._sample(*newest))
        now = time.monotonic()
        if self._unanswered and now - self._sent > REPEAT:
            self._send(now)
        return self._ordered.report(now)

    def close(self) -> None:
        """Stops listening and orders nothing; may be called twice."""
        for subscription in self._subscriptions:
            subscription.close()
        if self._publisher is not None:
            self._publisher.close()
        self._unanswered = []

    def _unfit(self) -> str:
        """Says why it must not be ordered; empty where it may."""
        if self.state is None:
            return f"nothing comes on {topics.gripper_state(self._limb)}"
        if self.properties is None:
            return f"nothing comes on {topics.gripper_properties(self._limb)}"
        kind = self.properties.ui_type
        if kind != EndEffectorProperties.ELECTRIC_GRIPPER:
            return f"the robot says that {KINDS.get(kind, f'a gripper of type {kind}')} is mounted"
        return wrong_with(self.state[0])

    def _begin(self, number: int, motion: GripperMotion) -> None:
        """Sends the first command of an order."""
        self._number, self._motion = number, motion
        force = MOVING_FORCE if motion.force is None else FULL * motion.force / self._spec.force
        settings = {
            "velocity": FULL * motion.speed / self._spec.speed,
            "moving_force": force,
            "holding_force": force,
            "dead_zone": FULL * DEAD_ZONE / (self._spec.widest - self._spec.narrowest),
        }
        self._unanswered = [
            self._command(CONFIGURE, settings),
            self._command(GO, {"position": opening_of(motion.width, self._spec)}),
        ]
        self._send(time.monotonic())

    def _command(self, name: str, values: dict[str, float]) -> EndEffectorCommand:
        """Builds a command; each has a sender of its own, since some states name the sender and not the number."""
        self._sequence += 1
        hardware = 0 if self.state is None else self.state[0].id
        sender = f"/impedance_{os.getpid()}_{name}_{self._sequence}"
        rounded = {key: round(min(max(value, 0.0), FULL), 3) for key, value in values.items()}
        return EndEffectorCommand(hardware, name, json.dumps(rounded), sender, self._sequence)

    def _send(self, now: float) -> None:
        if self._publisher is not None:
            self._publisher.send(self._unanswered[0])
        self._sent = now

    def _follow(self, state: EndEffectorState) -> None:
        """Sends the next command once a state answers the one before; decides whether the order is carried out."""
        if self._unanswered:
            first = self._unanswered[0]
            if state.command_sender != first.sender or state.command_sequence not in (first.sequence, 0):
                return
            self._unanswered.pop(0)
            if self._unanswered:
                self._send(time.monotonic())
                return
        motion = self._motion
        if motion is None or state.moving == EndEffectorState.STATE_TRUE:
            return
        gripped = motion.force is not None and state.gripping == EndEffectorState.STATE_TRUE
        if gripped or abs(width_of(state.position, self._spec) - motion.width) <= THIN:
            self._ended = self._number

    def _sample(self, state: EndEffectorState, received: float) -> GripperSample:
        return GripperSample(
            received,
            width_of(state.position, self._spec),
            self._spec.force * state.force / FULL,
            self._ended,
            held=state.gripping == EndEffectorState.STATE_TRUE,
            error=wrong_with(state),
        )

    def _take_state(self, state: EndEffectorState, received: float) -> None:
        self.state = (state, received)

    def _take_properties(self, properties: EndEffectorProperties, received: float) -> None:  # noqa: ARG002
        self.properties = properties


def wrong_with(state: EndEffectorState) -> str:
    """Says what is wrong with a gripper by its own state; empty for nothing. UNKNOWN is no calibration."""
    if state.error == EndEffectorState.STATE_TRUE:
        return f"it reports an error{f' ({state.state})' if state.state else ''}"
    if state.enabled == EndEffectorState.STATE_FALSE:
        return "it reports that it is switched off"
    if state.calibrated != EndEffectorState.STATE_TRUE:
        return "it reports that it is not calibrated"
    return ""


def width_of(opening: float, spec: GripperSpec) -> float:
    """Distance between the fingers [m] of an opening [%]."""
    return spec.narrowest + opening / FULL * (spec.widest - spec.narrowest)


def opening_of(width: float, spec: GripperSpec) -> float:
    """Opening [%] of a distance between the fingers [m]."""
    return FULL * (width - spec.narrowest) / (spec.widest - spec.narrowest)
