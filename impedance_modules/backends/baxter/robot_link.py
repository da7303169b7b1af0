# SPDX-License-Identifier: BSD-3-Clause
"""The newest of every message of a Baxter: one set of subscriptions, readable from any thread.

``SeaColumns`` are the torques that the robot reports to add by itself, as columns of an episode [N.m]:
``gravity.<joint>`` is the gravity torque with inertial feed-forward, ``gravity_only.<joint>`` what holds the arm at
rest, ``hysteresis.<joint>`` the model of the parallel spring, ``crosstalk.<joint>`` of the neighbours' influence. They
come more slowly than the states; a row repeats the last value.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TypeVar

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.backends.baxter import topics
from impedance_modules.backends.baxter.joint_states import JointStateMerger, StateSample
from impedance_modules.backends.baxter.ros.messages import (
    AssemblyState,
    CollisionDetectionState,
    DigitalIOState,
    EndpointState,
    JointState,
    Message,
    SEAJointState,
)
from impedance_modules.backends.baxter.ros.transport import Subscription, Transport
from impedance_modules.backends.baxter.ros.wire import decode, encode

M = TypeVar("M", bound=Message)

RATE_WINDOW = 1.0
"""Time over which the rate of the states is measured [s]."""

FIELDS: Mapping[str, str] = {
    "gravity": "gravity_model_effort",
    "gravity_only": "gravity_only",
    "hysteresis": "hysteresis_model_effort",
    "crosstalk": "crosstalk_model_effort",
}
"""Column -> field of the message."""


@dataclass(frozen=True)
class RobotCallbacks:
    """Functions that a link calls at once, in the thread in which the message came.

    Attributes:
        on_state: A complete sample.
        on_robot: /robot/state and when it arrived [s].
        on_collision: A limb, whether it reports a collision, and when.
        on_cuff: A limb and whether its cuff is squeezed.
    """

    on_state: Callable[[StateSample], None]
    on_robot: Callable[[AssemblyState, float], None]
    on_collision: Callable[[str, bool, float], None]
    on_cuff: Callable[[str, bool], None]


class RobotLink:
    """Listens to one robot; sends nothing.

    Attributes:
        transport: On which it listens.
        merge: Of the joint states.
        sample: The newest complete state, or None.
        robot: The newest /robot/state, or None.
        sea, endpoint: Limb -> newest message, for limbs that have sent one.
        collision, squeezed: Limb -> what it last said.
    """

    def __init__(self, transport: Transport, joint_names: tuple[str, ...], limbs: Sequence[str]) -> None:
        """Begins to listen, to these joints and all these limbs of the robot."""
        self.transport = transport
        self.merge = JointStateMerger(joint_names)
        self.sample: StateSample | None = None
        self.robot: AssemblyState | None = None
        self.sea: dict[str, SEAJointState] = {}
        self.endpoint: dict[str, EndpointState] = {}
        self.collision: dict[str, bool] = {}
        self.squeezed: dict[str, bool] = {}
        self._callbacks: RobotCallbacks | None = None
        self._warm_up_merge = JointStateMerger(joint_names)
        self._last_message: JointState | None = None
        self._arrived = threading.Condition()
        self._arrivals: deque[float] = deque(maxlen=4096)
        self._hands: list[Subscription] = []
        self._subscriptions: list[Subscription] = [
            transport.subscribe(topics.JOINT_STATES, JointState, self._joint_states),
            transport.subscribe(topics.ROBOT_STATE, AssemblyState, self._robot_state),
        ]
        for limb in limbs:
            self._listen_to_limb(limb)

    def set_callbacks(self, callbacks: RobotCallbacks | None) -> None:
        """From now on calls these with every message too; None ends that."""
        self._callbacks = callbacks

    def wait(self, after: int, seconds: float) -> StateSample | None:
        """Waits for a sample with a number above ``after``; None when none comes in time, or on ``wake``."""
        with self._arrived:
            if self.sample is None or self.sample.number <= after:
                self._arrived.wait(seconds)
            sample = self.sample
            return sample if sample is not None and sample.number > after else None

    def warm_up(self) -> None:
        """Decodes and merges the last message once more, into a copy that is not used."""
        if self._last_message is not None:
            self._warm_up_merge.take(decode(JointState, encode(self._last_message)), 0.0)

    def unsubscribe_endpoints(self) -> None:
        """Unsubscribes from the endpoint states; the control loop needs the time."""
        for subscription in self._hands:
            subscription.close()

    def wake(self) -> None:
        """Ends a ``wait`` in another thread."""
        with self._arrived:
            self._arrived.notify_all()

    def rate(self, now: float) -> float:
        """Rate of the complete states over the last second before ``now`` [Hz]."""
        arrivals = [moment for moment in list(self._arrivals) if moment > now - RATE_WINDOW]
        return len(arrivals) / RATE_WINDOW

    def close(self) -> None:
        """Stops listening."""
        for subscription in (*self._subscriptions, *self._hands):
            subscription.close()

    def _listen_to_limb(self, limb: str) -> None:
        subscribe = self.transport.subscribe
        self._hands.append(
            subscribe(topics.endpoint_state(limb), EndpointState, partial(_keep, self.endpoint, limb))
        )
        self._subscriptions += [
            subscribe(topics.sea_state(limb), SEAJointState, partial(_keep, self.sea, limb)),
            subscribe(
                topics.collision_state(limb), CollisionDetectionState, partial(self._collision_state, limb)
            ),
            subscribe(topics.cuff(limb), DigitalIOState, partial(self._cuff_state, limb)),
        ]

    def _joint_states(self, message: JointState, received: float) -> None:
        # Two publishers may call at once, each in its own thread.
        with self._arrived:
            self._last_message = message
            sample = self.merge.take(message, received)
            if sample is None:
                return
        # Outside the lock: the callback has its own, and may be waiting for this one. And before notify_all: the thread
        # that wakes up below needs the interpreter, which this one gives up when it reads on.
        if self._callbacks is not None:
            self._callbacks.on_state(sample)
        with self._arrived:
            if self.sample is None or sample.number > self.sample.number:
                self.sample = sample
            self._arrivals.append(received)
            self._arrived.notify_all()

    def _robot_state(self, message: AssemblyState, received: float) -> None:
        self.robot = message
        if self._callbacks is not None:
            self._callbacks.on_robot(message, received)

    def _collision_state(self, limb: str, message: CollisionDetectionState, received: float) -> None:
        self.collision[limb] = message.collision_state
        if self._callbacks is not None:
            self._callbacks.on_collision(limb, message.collision_state, received)

    def _cuff_state(self, limb: str, message: DigitalIOState, received: float) -> None:  # noqa: ARG002
        self.squeezed[limb] = message.state == message.PRESSED
        if self._callbacks is not None:
            self._callbacks.on_cuff(limb, self.squeezed[limb])


def _keep(newest: dict[str, M], limb: str, message: M, received: float) -> None:  # noqa: ARG001
    newest[limb] = message


class SeaColumns:
    """Columns for what a robot has reported so far; fields that it leaves empty get none.

    Attributes:
        names: Of the columns.
    """

    def __init__(self, newest: Mapping[str, SEAJointState]) -> None:
        """Takes limb -> newest message, which goes on being updated; the columns are fixed now."""
        self._newest = newest
        self._parts = [
            (limb, field, message.name, column)
            for limb, message in newest.items()
            for column, field in FIELDS.items()
            if len(getattr(message, field)) == len(message.name) > 0
        ]
        self.names = tuple(f"{column}.{joint}" for _, _, joints, column in self._parts for joint in joints)
        self._values = np.full(len(self.names), np.nan)
        self._read: dict[str, SEAJointState] = {}

    def values(self) -> Array:
        """Newest value of every column; not a number where a message has shrunk since the beginning."""
        if any(self._read.get(limb) is not message for limb, message in self._newest.items()):
            self._read = dict(self._newest)
            self._update()
        return self._values

    def _update(self) -> None:
        at = 0
        for limb, field, joints, _ in self._parts:
            message = self._read[limb]
            numbers = getattr(message, field)
            complete = message.name == joints and len(numbers) == len(joints)
            self._values[at : at + len(joints)] = numbers if complete else np.nan
            at += len(joints)
