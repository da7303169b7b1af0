# SPDX-License-Identifier: BSD-3-Clause
"""A ROS node by the standard library alone; no ROS needs to be installed."""

from __future__ import annotations

import os
import threading
from typing import Any, TypeVar

from impedance_modules.backends.baxter.ros.master_client import check_own_host, own_host
from impedance_modules.backends.baxter.ros.messages import Message
from impedance_modules.backends.baxter.ros.socket_topics import Outlet, SocketPublisher
from impedance_modules.backends.baxter.ros.sockets.incoming import SocketSubscription
from impedance_modules.backends.baxter.ros.sockets.node import NodeEvents, NodeServer
from impedance_modules.backends.baxter.ros.transport import (
    Callback,
    NoMasterError,
)
from impedance_modules.backends.baxter.ros.with_master import MasterTransport

M = TypeVar("M", bound=Message)


class SocketTransport(MasterTransport):
    """One ROS node."""

    def __init__(self, node_name: str, master_uri: str) -> None:
        """Introduces itself to nobody yet; the master must answer.

        Args:
            node_name: Full name, e.g. ``/impedance_modules_1234``; a second node of that name would replace this.
            master_uri: From ``master_uri_of(os.environ)``.

        Raises:
            NoMasterError: No master answers there, or this machine's own name (ROS_IP) is wrong.
        """
        super().__init__(node_name, master_uri)
        self._master.check()
        self._lock = threading.RLock()
        self._outlets: dict[str, Outlet] = {}
        self._subscriptions: list[SocketSubscription[Any]] = []
        host = own_host(os.environ, master_uri)
        events = NodeEvents(self._follow, self._outlets.get, self._listened, self._published, self.close)
        check_own_host(host)
        self._server = NodeServer(host, master_uri, events)

    def advertise(self, topic: str, message_type: type[M], *, latch: bool = False) -> SocketPublisher[M]:
        """Becomes a publisher of a topic."""
        self._check()
        with self._lock:
            outlet = self._outlets.get(topic)
            if outlet is None:
                outlet = Outlet(self._node_name, topic, message_type)
                self._outlets[topic] = outlet
                self._master.ask("registerPublisher", topic, message_type.ros_type, self._server.uri)
            outlet.users += 1
            if latch:
                outlet.keep_last()
        return SocketPublisher(outlet, lambda: self._withdraw(topic))

    def subscribe(self, topic: str, message_type: type[M], callback: Callback[M]) -> SocketSubscription[M]:
        """Listens to every publisher of a topic."""
        self._check()
        subscription = SocketSubscription(
            self._node_name, topic, message_type, callback, lambda: self._unsubscribed(subscription)
        )
        with self._lock:
            self._subscriptions.append(subscription)
        publishers = self._master.ask("registerSubscriber", topic, message_type.ros_type, self._server.uri)
        subscription.update(publishers)
        return subscription

    def close(self) -> None:
        """Withdraws everything this node has registered; a master that has gone does not matter."""
        with self._lock:
            if self._closed:
                return
            self._closed = True
            subscriptions, topics = list(self._subscriptions), list(self._outlets)
        for subscription in subscriptions:
            subscription.close()
        for topic in topics:
            self._drop(topic)
        self._sweep(self._server.uri)
        self._server.close()

    def _follow(self, topic: str, publishers: list[str]) -> None:
        with self._lock:
            concerned = [s for s in self._subscriptions if s.topic == topic]
        for subscription in concerned:
            subscription.update(publishers)

    def _listened(self) -> list[tuple[str, str]]:
        with self._lock:
            return [(s.topic, s.kind.ros_type) for s in self._subscriptions]

    def _published(self) -> list[tuple[str, str]]:
        with self._lock:
            return [(o.topic, o.kind.ros_type) for o in self._outlets.values()]

    def _unsubscribed(self, subscription: SocketSubscription[Any]) -> None:
        with self._lock:
            self._subscriptions.remove(subscription)
            others = any(s.topic == subscription.topic for s in self._subscriptions)
        if not others:
            self._tell("unregisterSubscriber", subscription.topic)

    def _withdraw(self, topic: str) -> None:
        with self._lock:
            outlet = self._outlets.get(topic)
            if outlet is None:
                return
            outlet.users -= 1
            last = outlet.users == 0
        if last:
            self._drop(topic)

    def _drop(self, topic: str) -> None:
        with self._lock:
            outlet = self._outlets.pop(topic, None)
        if outlet is not None:
            self._tell("unregisterPublisher", topic)
            outlet.close()

    def _tell(self, method: str, topic: str) -> None:
        try:
            self._master.ask(method, topic, self._server.uri)
        except NoMasterError:
            # A master that is gone remembers nothing that could be withdrawn.
            return
