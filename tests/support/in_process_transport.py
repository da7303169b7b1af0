# SPDX-License-Identifier: BSD-3-Clause
"""Topics without a network: several nodes in one process, every message delivered where it is sent."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any, Generic, TypeVar

from impedance_modules.backends.baxter.ros.messages import Message
from impedance_modules.backends.baxter.ros.transport import (
    Callback,
    ParameterValue,
    PublisherInfo,
    Transport,
    TransportClosedError,
)
from impedance_modules.backends.baxter.ros.wire import checksum_of, decode, encode
from impedance_modules.backends.baxter.simulator.simulator_node import GONE_NODE

M = TypeVar("M", bound=Message)


class InProcessMaster:
    """Knows who publishes and who listens; the meeting point of ``InProcessTransport``s.

    Attributes:
        parameters: Name -> value.
        clock: Gives receive times [s]; tests may replace it.
        dead: (node, topic) registrations of nodes that no longer exist.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self.parameters: dict[str, ParameterValue] = {}
        self.clock = clock
        self.dead: list[tuple[str, str]] = []
        self.lock = threading.RLock()
        self.publishers: list[_Publisher[Any]] = []
        self.subscriptions: list[_Subscription[Any]] = []


class InProcessTransport:
    """One node on an ``InProcessMaster``, with the methods of ``Transport``; sending runs the callbacks at once."""

    def __init__(self, master: InProcessMaster, node_name: str) -> None:
        self._master = master
        self._node_name = node_name
        self._closed = False

    def advertise(self, topic: str, message_type: type[M], *, latch: bool = False) -> _Publisher[M]:
        self._check()
        publisher = _Publisher(self._master, self._node_name, topic, message_type, latch)
        with self._master.lock:
            self._master.publishers.append(publisher)
        return publisher

    def subscribe(self, topic: str, message_type: type[M], callback: Callback[M]) -> _Subscription[M]:
        """Listens to every publisher of a topic; what they have latched arrives at once."""
        self._check()
        subscription = _Subscription(self._master, self._node_name, topic, message_type, callback)
        with self._master.lock:
            self._master.subscriptions.append(subscription)
            latched = [(p, p.last) for p in self._master.publishers if p.latch and subscription.hears(p)]
        for publisher, data in latched:
            if data is not None and subscription.hears(publisher):
                subscription.deliver(data)
        return subscription

    def get_parameter(self, name: str) -> ParameterValue | None:
        self._check()
        return self._master.parameters.get(name)

    def set_parameter(self, name: str, value: ParameterValue) -> None:
        self._check()
        self._master.parameters[name] = value

    def publishers_of(self, topic: str) -> tuple[str, ...]:
        return tuple(sorted({publisher.node for publisher in self._offers(topic)}))

    def publisher_info(self, topic: str) -> tuple[PublisherInfo, ...]:
        return tuple(publisher for publisher in self._offers(topic) if publisher.node != self._node_name)

    def close(self) -> None:
        self._closed = True
        with self._master.lock:
            ends = [*self._master.publishers, *self._master.subscriptions]
        for end in ends:
            if end.node == self._node_name:
                end.close()

    def _offers(self, topic: str) -> list[PublisherInfo]:
        self._check()
        with self._master.lock:
            alive = [p for p in self._master.publishers if p.topic == topic]
            dead = [node for node, where in self._master.dead if where == topic]
        publishers = [PublisherInfo(p.node, p.kind.ros_type, checksum_of(p.kind), None) for p in alive]
        return sorted(
            publishers + [PublisherInfo(node, None, None, "connection refused", gone=True) for node in dead],
            key=lambda publisher: publisher.node,
        )

    def _check(self) -> None:
        if self._closed:
            raise TransportClosedError(f"{self._node_name}: the transport is closed")


class InProcessNetwork:
    """Nodes within this process, for tests."""

    def __init__(self, master: InProcessMaster) -> None:
        self._master = master

    def connect(self, node_name: str) -> Transport:
        return InProcessTransport(self._master, node_name)

    def register_dead(self, topic: str, ros_type: str, on: bool) -> None:
        """Registers a publisher that no longer exists, or has it forgotten."""
        entry = (GONE_NODE, topic)
        if on and entry not in self._master.dead:
            self._master.dead.append(entry)
        elif not on and entry in self._master.dead:
            self._master.dead.remove(entry)


class _Publisher(Generic[M]):
    def __init__(self, master: InProcessMaster, node: str, topic: str, kind: type[M], latch: bool) -> None:
        self.node, self.topic, self.kind, self.latch = node, topic, kind, latch
        self.last: bytes | None = None
        self._master = master

    def send(self, message: M) -> None:
        """Delivers to every listener, in this thread."""
        data = encode(message)
        with self._master.lock:
            if self not in self._master.publishers:
                raise TransportClosedError(f"{self.topic}: the publisher is closed")
            self.last = data
            listeners = self._listeners()
        for subscription in listeners:
            subscription.deliver(data)

    def connections(self) -> int:
        with self._master.lock:
            return len(self._listeners()) if self in self._master.publishers else 0

    def close(self) -> None:
        with self._master.lock:
            if self in self._master.publishers:
                self._master.publishers.remove(self)

    def _listeners(self) -> list[_Subscription[Any]]:
        return [s for s in self._master.subscriptions if s.hears(self)]


class _Subscription(Generic[M]):
    def __init__(
        self, master: InProcessMaster, node: str, topic: str, kind: type[M], callback: Callback[M]
    ) -> None:
        self.node, self.topic, self.kind = node, topic, kind
        self._master, self._callback = master, callback

    def hears(self, publisher: _Publisher[Any]) -> bool:
        """Says whether both mean the same messages on the same topic."""
        return publisher.topic == self.topic and checksum_of(publisher.kind) == checksum_of(self.kind)

    def deliver(self, data: bytes) -> None:
        if self in self._master.subscriptions:
            self._callback(decode(self.kind, data), self._master.clock())

    def close(self) -> None:
        with self._master.lock:
            if self in self._master.subscriptions:
                self._master.subscriptions.remove(self)
