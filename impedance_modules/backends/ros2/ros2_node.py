# SPDX-License-Identifier: BSD-3-Clause
"""The ROS 2 node of a run, in a process of its own: passes joint states on, and publishes the run's torques.

It may run in another Python than the run (that of a ROS installation, say), so it imports nothing of this package: the
run starts this file as a program and imports its message formats. It drops states that are malformed, not finite, out
of order, doubled or too old, and counts them. Where states or torques stop coming, the task's torque goes to zero
within ``RAMP`` and the run is told; the weight that the run adds (``gravity: controller``) goes on, else the arm would
fall.

Run as ``python ros2_node.py SOCKET SETTINGS``, settings in JSON (``NodeSettings``).
"""

from __future__ import annotations

import json
import math
import signal
import socket
import struct
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

LARGEST = 16384
"""Longest message [bytes]."""

BEGIN, TORQUE, END, QUIT = 1, 2, 3, 4
"""Orders of the run. BEGIN and TORQUE carry torque and weight, of every joint [N.m]."""

STATE, GRAPH, STOPPED, ENDED, REFUSED = 1, 2, 3, 4, 5
"""What the node tells: a state; who publishes and subscribes; why it stopped; that it ended; why it cannot be."""

DROPPED = ("malformed", "not finite", "out of order", "doubled", "too old")
"""Why states are not passed on, in the order of their counts."""

RAMP = 0.2
"""Time in which the task's torque goes to zero [s]."""

TICK = 0.005
"""Period of the watch [s]."""

FIRST_TORQUE = 2.0
"""Longest time at zero torque until the first torque comes [s]."""

FASTEST_OF = 200
"""States over which the fastest delivery is looked for."""


@dataclass(frozen=True)
class NodeSettings:
    """What the node is told.

    Attributes:
        joint_states: Topic of the states.
        reliable: Whether only reliable publishers are heard.
        names: Of the joints on that topic, in the run's order.
        controllers: Topic of each controller, and places of its joints in the run's order.
        stale: Age of the last state or torque at which the task's torque goes to zero [s].
        oldest: Largest delay of a state beyond that of the fastest one [s].
    """

    joint_states: str
    reliable: bool
    names: tuple[str, ...]
    controllers: tuple[tuple[str, tuple[int, ...]], ...]
    stale: float
    oldest: float


def pack_numbers(kind: int, numbers: Sequence[float]) -> bytes:
    """Encodes an order or a state: its kind, then numbers."""
    return struct.pack(f"<B7x{len(numbers)}d", kind, *numbers)


def unpack_numbers(message: bytes) -> tuple[float, ...]:
    """Decodes the numbers of an order or a state."""
    return struct.unpack(f"<{(len(message) - 8) // 8}d", message[8:])


def pack_text(kind: int, text: str) -> bytes:
    """Encodes a text."""
    return bytes([kind]) + text.encode()[: LARGEST - 1]


def unpack_text(message: bytes) -> str:
    """Decodes a text."""
    return message[1:].decode(errors="replace")


class StateCollector:
    """Makes complete states of messages that name some joints each, and drops what must not be used.

    Attributes:
        dropped: Number of states dropped, by the order of ``DROPPED``.
        missing: Joints that were never reported.
        empty: Quantities that messages leave empty, ``velocity`` or ``effort``.
    """

    def __init__(self, names: Sequence[str], oldest: float) -> None:
        """Takes the joints, and the largest delay of a state beyond that of the fastest one [s]."""
        self.dropped = [0] * len(DROPPED)
        self.missing = set(names)
        self.empty: set[str] = set()
        self._places = {name: k for k, name in enumerate(names)}
        self._numbers = [[math.nan] * len(names) for _ in range(3)]
        self._waiting = set(range(len(names)))
        self._count, self._oldest = len(names), oldest
        self._last = -math.inf
        self._delays: list[float] = []

    def take(
        self, stamp: float, names: Sequence[str], rows: Sequence[Sequence[float]], now: float
    ) -> tuple[float, list[float]] | None:
        """Takes a message; returns the stamp [s] and the 3 n numbers of the state that it completes, or None.

        Args:
            stamp: Of the message, 0 where it has none [s].
            names: Its joints.
            rows: Their positions, velocities and efforts, in the units of a state.
            now: When it came, by the clock of the stamps [s].
        """
        ours = [(self._places[name], k) for k, name in enumerate(names) if name in self._places]
        if not ours:
            return None
        self.empty |= {
            what for what, row in zip(("velocity", "effort"), rows[1:], strict=True) if not len(row)
        }
        stamp = stamp if stamp > 0.0 else now
        why = self._why_not(stamp, len(names), ours, rows, now - stamp)
        if why:
            self.dropped[DROPPED.index(why)] += 1
            return None
        return self._add(stamp, ours, rows)

    def _why_not(
        self,
        stamp: float,
        length: int,
        ours: list[tuple[int, int]],
        rows: Sequence[Sequence[float]],
        delay: float,
    ) -> str:
        """Says why a message must not be used, in a word of ``DROPPED``; empty where it may."""
        if any(len(row) != length for row in rows):
            return "malformed"
        if not all(math.isfinite(row[k]) for row in rows for _, k in ours):
            return "not finite"
        if stamp < self._last:
            return "out of order"
        again = len(self._waiting) == self._count or not self._waiting & {place for place, _ in ours}
        if stamp == self._last and again:
            return "doubled"
        return "too old" if self._too_old(delay) else ""

    def _add(
        self, stamp: float, ours: list[tuple[int, int]], rows: Sequence[Sequence[float]]
    ) -> tuple[float, list[float]] | None:
        for place, k in ours:
            for numbers, row in zip(self._numbers, rows, strict=True):
                numbers[place] = row[k]
        self._waiting -= {place for place, _ in ours}
        self.missing -= {name for name, place in self._places.items() if place not in self._waiting}
        if self._waiting:
            return None
        self._last = stamp
        self._waiting = set(range(self._count))
        return stamp, [value for row in self._numbers for value in row]

    def _too_old(self, delay: float) -> bool:
        """The clocks of the two computers need not agree: only how much later than the fastest one it came counts."""
        self._delays.append(delay)
        del self._delays[:-FASTEST_OF]
        return delay - min(self._delays) > self._oldest


class TorqueOutput:
    """The torque that is published: the run's, or on its way to zero.

    Attributes:
        active: Whether anything is published.
        ending: Why it goes to zero, empty while it does not; ``ordered`` says whether the run wanted it.
    """

    def __init__(self, count: int, stale: float) -> None:
        """Takes the number of joints and how long a state or a torque counts [s]."""
        self.active, self.ordered, self.ending = False, False, ""
        self._effort, self._weight = [0.0] * count, [0.0] * count
        self._stale = stale
        self._deadline = self._ended_at = 0.0

    def begin(self, weight: Sequence[float], now: float) -> None:
        """Begins at zero torque, with the weight that the run adds [N.m]."""
        self.active, self.ordered, self.ending = True, False, ""
        self._effort, self._weight = [0.0] * len(weight), list(weight)
        self._deadline = now + FIRST_TORQUE

    def order(self, effort: Sequence[float], weight: Sequence[float], now: float) -> bool:
        """Sets torque and weight [N.m]; returns whether they may be published now."""
        if not self.active or self.ending:
            return False
        if not all(math.isfinite(value) for value in (*effort, *weight)):
            self.end("a torque is not finite", now, ordered=False)
            return True
        self._effort, self._weight = list(effort), list(weight)
        self._deadline = now + self._stale
        return True

    def end(self, why: str, now: float, *, ordered: bool) -> None:
        """Takes the torque to zero from now on; the first reason stays."""
        if self.active and not self.ending:
            self.ending, self.ordered, self._ended_at = why, ordered, now

    def watch(self, now: float, state_age: float) -> bool:
        """Looks at the clocks; returns whether it has become zero, after which nothing is published any more."""
        if not self.active:
            return False
        if not self.ending and now > self._deadline:
            self.end(
                f"no torque from the run for {now - self._deadline + self._stale:.3f} s", now, ordered=False
            )
        if not self.ending and state_age > self._stale:
            self.end(f"no state for {state_age:.3f} s", now, ordered=False)
        if self.ending and now - self._ended_at >= RAMP:
            self.active = False
            return True
        return False

    def torque(self, now: float) -> list[float]:
        """What is published now, every joint [N.m]."""
        left = 1.0 if not self.ending else max(0.0, 1.0 - (now - self._ended_at) / RAMP)
        return [left * a + b for a, b in zip(self._effort, self._weight, strict=True)]


class RunNode:
    """The node: topics on one side, the run's socket on the other; one thread does everything."""

    def __init__(self, channel: socket.socket, settings: NodeSettings) -> None:
        """Joins the network."""
        import rclpy  # noqa: PLC0415 - the rest of this file is used without ROS
        from rclpy.qos import QoSProfile, ReliabilityPolicy  # noqa: PLC0415
        from sensor_msgs.msg import JointState  # noqa: PLC0415
        from std_msgs.msg import Float64MultiArray  # noqa: PLC0415

        rclpy.init(args=[])
        self._rclpy, self._message = rclpy, Float64MultiArray
        self._node = rclpy.create_node("impedance_run")
        self._channel, self._settings = channel, settings
        self._collector = StateCollector(settings.names, settings.oldest)
        self._output = TorqueOutput(len(settings.names), settings.stale)
        self._state_at = -math.inf
        self._quit = False
        policy = ReliabilityPolicy.RELIABLE if settings.reliable else ReliabilityPolicy.BEST_EFFORT
        self._node.create_subscription(
            JointState, settings.joint_states, self._on_state, QoSProfile(depth=1, reliability=policy)
        )
        command = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE)
        self._publishers = [
            (self._node.create_publisher(Float64MultiArray, topic, command), places)
            for topic, places in settings.controllers
        ]

    def run(self) -> None:
        """Serves both sides until the run quits or its process has died."""
        next_tick = next_graph = 0.0
        while not (self._quit and not self._output.active):
            self._rclpy.spin_once(self._node, timeout_sec=0.0005)
            self._obey()
            now = time.monotonic()
            if now >= next_tick:
                next_tick = now + TICK
                self._watch(now)
            if now >= next_graph:
                next_graph = now + 0.25
                self._tell_graph()

    def close(self) -> None:
        """Leaves the network."""
        self._node.destroy_node()
        self._rclpy.shutdown()

    def _on_state(self, message: Any) -> None:
        stamp = message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec
        rows = (message.position, message.velocity, message.effort)
        found = self._collector.take(stamp, message.name, rows, time.time())
        if found is None:
            return
        self._state_at = time.monotonic()
        moment, numbers = found
        self._send(pack_numbers(STATE, (moment, *self._collector.dropped, *numbers)))
        # The torque that belongs to this state is on its way: it leaves without waiting for the next turn.
        self._obey()

    def _obey(self) -> None:
        while True:
            try:
                message = self._channel.recv(LARGEST, socket.MSG_DONTWAIT)
            except BlockingIOError:
                return
            except OSError:
                message = b""
            now = time.monotonic()
            if not message:
                self._output.end("the run's process has ended", now, ordered=False)
                self._quit = True
                return
            self._do(message[0], unpack_numbers(message), now)

    def _do(self, kind: int, numbers: tuple[float, ...], now: float) -> None:
        count = len(self._settings.names)
        if kind == BEGIN:
            self._output.begin(numbers[count:], now)
            self._publish(now)
        elif kind == TORQUE:
            if self._output.order(numbers[:count], numbers[count:], now):
                self._publish(now)
        else:
            self._output.end("the run ended", now, ordered=True)
            self._quit = self._quit or kind == QUIT

    def _watch(self, now: float) -> None:
        if not self._output.active:
            return
        done = self._output.watch(now, now - self._state_at)
        if self._output.ending:
            self._publish(now)
        if done:
            kind = ENDED if self._output.ordered else STOPPED
            self._send(pack_text(kind, self._output.ending))

    def _publish(self, now: float) -> None:
        torque = self._output.torque(now)
        for publisher, places in self._publishers:
            message = self._message()
            message.data = [torque[place] for place in places]
            publisher.publish(message)

    def _tell_graph(self) -> None:
        settings, count = self._settings, self._node.count_publishers
        facts = {
            "state_publishers": count(settings.joint_states),
            "controllers": {
                topic: [self._node.count_subscribers(topic), count(topic) - 1]
                for topic, _ in settings.controllers
            },
            "missing": sorted(self._collector.missing),
            "empty": sorted(self._collector.empty),
        }
        self._send(pack_text(GRAPH, json.dumps(facts)))

    def _send(self, message: bytes) -> None:
        """Sends to the run; what it has no room for is lost."""
        try:
            self._channel.send(message, socket.MSG_DONTWAIT)
        except BlockingIOError:
            return
        except OSError:
            self._output.end("the run's process has ended", time.monotonic(), ordered=False)
            self._quit = True


def read_settings(text: str) -> NodeSettings:
    """Decodes settings from JSON."""
    data = json.loads(text)
    controllers = tuple((topic, tuple(places)) for topic, places in data["controllers"])
    return NodeSettings(**{**data, "names": tuple(data["names"]), "controllers": controllers})


def main(arguments: list[str]) -> int:
    """Serves a run until it ends."""
    # Ctrl-C is the run's affair: it brakes first, then tells this process to end.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    channel = socket.socket(fileno=int(arguments[0]))
    try:
        node = RunNode(channel, read_settings(arguments[1]))
    except Exception as error:  # noqa: BLE001 - whatever it is, the run is told
        channel.send(pack_text(REFUSED, f"{type(error).__name__}: {error}"))
        return 2
    try:
        node.run()
    finally:
        node.close()
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
