# SPDX-License-Identifier: BSD-3-Clause
"""The run's end of the line to its ROS 2 node: starts the process, sends torques, takes states."""

from __future__ import annotations

import json
import select
import socket
import subprocess
import sys
import time
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.backends.ros2 import ros2_node
from impedance_modules.errors import RobotRefused, RobotStopped
from impedance_modules.safety.stop_levels import Event

EXIT_TIME = 3.0
"""Longest wait for the process to end [s]."""

JOIN_TIME = 20.0
"""Longest wait for the node to join the network [s]."""


class Ros2Link:
    """One node and what it has told.

    Attributes:
        moment: Stamp of the newest state [s].
        received: When it arrived, our monotonic clock [s]; 0 before the first.
        numbers: (3, n) its positions, velocities and efforts.
        dropped: Numbers of dropped states, by the order of ``ros2_node.DROPPED``.
        graph: Who publishes and subscribes, which joints and quantities are missing; None before it was told.
        states: Number of states so far.
        ended: Publishing that had begun is over.
    """

    def __init__(self, settings: ros2_node.NodeSettings, python: str) -> None:
        """Starts the process in the Python of that path; empty is our own."""
        self.moment = self.received = 0.0
        self.numbers: Array = np.zeros((3, len(settings.names)))
        self.dropped: tuple[float, ...] = (0.0,) * len(ros2_node.DROPPED)
        self.graph: dict[str, Any] | None = None
        self.states = 0
        self.ended = False
        self.stop: RobotStopped | None = None
        self._refused = ""
        self._count = len(settings.names)
        self._channel, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        # Said of both ends: another library in this process (rospy does) may have set a time-out for all new sockets,
        # and then even MSG_DONTWAIT waits.
        self._channel.setblocking(False)
        theirs.setblocking(True)
        try:
            self._process = subprocess.Popen(
                [
                    python or sys.executable,
                    str(Path(ros2_node.__file__).resolve()),
                    str(theirs.fileno()),
                    json.dumps(asdict(settings)),
                ],
                pass_fds=(theirs.fileno(),),
                stdin=subprocess.DEVNULL,
                start_new_session=True,
            )
        except OSError as error:
            self._channel.close()
            raise RobotRefused(
                f"ros2: python: {python}: {error.strerror} (valid: the path of a Python that can import rclpy)"
            ) from None
        finally:
            theirs.close()

    def fileno(self) -> int:
        """Of the socket, for ``select``."""
        return self._channel.fileno()

    def drain(self) -> None:
        """Takes everything that has arrived; never waits."""
        while True:
            try:
                message = self._channel.recv(ros2_node.LARGEST, socket.MSG_DONTWAIT)
            except BlockingIOError:
                return
            except OSError:
                message = b""
            if not message:
                self._note_stop(Event.BACKEND_LOST, "the process of the ROS 2 node has ended")
                return
            self._take(message)

    def wait(self, seconds: float) -> None:
        """Waits until something arrives, and takes it."""
        select.select([self._channel], [], [], max(seconds, 0.0))
        self.drain()

    def wait_for_state(self, seconds: float) -> None:
        """Waits for a state newer than all before.

        Raises:
            RobotRefused: None comes, or the node cannot run.
        """
        before, end = self.states, time.monotonic() + seconds
        while self.states == before:
            self.raise_if_refused()
            if time.monotonic() >= end:
                raise RobotRefused(
                    f"no complete state of the joints for {seconds:g} s (valid: a joint_state_broadcaster that runs)"
                )
            self.wait(0.05)

    def wait_for_graph(self) -> dict[str, Any]:
        """Waits until the node has joined and looked around.

        Raises:
            RobotRefused: It cannot, with the reason.
        """
        end = time.monotonic() + JOIN_TIME
        while self.graph is None:
            self.raise_if_refused()
            if time.monotonic() >= end:
                raise RobotRefused(f"the ROS 2 node does not join the network within {JOIN_TIME:g} s")
            self.wait(0.1)
        return self.graph

    def raise_if_refused(self) -> None:
        """Raises RobotRefused where the node cannot run or has ended before torque began."""
        if self._refused:
            remedy = (
                "pip install 'impedance-modules[ros2]', or 'python:' in the connection file, the path of a Python that"
                " has rclpy, with its ROS 2 sourced"
                if "No module named" in self._refused
                else "ROS 2 as its maker installs it, sourced"
            )
            raise RobotRefused(f"the ROS 2 node cannot run: {self._refused} (valid: {remedy})")
        if self.stop is not None:
            raise RobotRefused(self.stop.detail)

    def begin(self, weight: Array) -> None:
        """Begins to publish: zero torque, and the weight (n,) that this program carries [N.m]."""
        self.ended = False
        self._order(ros2_node.BEGIN, np.concatenate([np.zeros(self._count), weight]))

    def torque(self, effort: Array, weight: Array) -> None:
        """Publishes a torque (n,) and the weight (n,) that this program carries [N.m]."""
        self._order(ros2_node.TORQUE, np.concatenate([effort, weight]))

    def end(self) -> None:
        """Takes the task's torque to zero, then publishes nothing any more."""
        self._order(ros2_node.END, np.zeros(0))

    def wait_until_ended(self, seconds: float) -> None:
        """Waits until nothing is published any more."""
        end = time.monotonic() + seconds
        while not self.ended and self.stop is None and time.monotonic() < end:
            self.wait(0.05)

    def close(self) -> None:
        """Ends the process; may be called twice."""
        if self._process.poll() is None:
            self._order(ros2_node.QUIT, np.zeros(0))
        self._channel.close()
        try:
            self._process.wait(EXIT_TIME)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    def _order(self, kind: int, numbers: Array) -> None:
        try:
            self._channel.send(ros2_node.pack_numbers(kind, numbers.tolist()), socket.MSG_DONTWAIT)
        except BlockingIOError:
            return
        except OSError:
            self._note_stop(Event.BACKEND_LOST, "the process of the ROS 2 node has ended")

    def _take(self, message: bytes) -> None:
        kind = message[0]
        if kind == ros2_node.STATE:
            numbers = ros2_node.unpack_numbers(message)
            first = 1 + len(ros2_node.DROPPED)
            self.moment, self.dropped = numbers[0], numbers[1:first]
            self.numbers = np.array(numbers[first:]).reshape(3, self._count)
            self.received = time.monotonic()
            self.states += 1
        elif kind == ros2_node.GRAPH:
            self.graph = json.loads(ros2_node.unpack_text(message))
        elif kind == ros2_node.REFUSED:
            self._refused = ros2_node.unpack_text(message)
        else:
            self.ended = True
            if kind == ros2_node.STOPPED:
                text = ros2_node.unpack_text(message)
                event = Event.STATE_LOST if text.startswith("no state") else Event.CONTROLLER_SILENT
                self._note_stop(Event.TORQUE_REFUSED if "not finite" in text else event, text)

    def _note_stop(self, event: Event, detail: str) -> None:
        if self.stop is None:
            self.stop = RobotStopped(event, detail)
