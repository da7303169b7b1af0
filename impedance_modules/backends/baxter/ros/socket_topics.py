# SPDX-License-Identifier: BSD-3-Clause
"""Publishing: a message goes to every listener at once, and never waits for one that is slow."""

from __future__ import annotations

import socket
import threading
from collections.abc import Callable
from typing import Generic, TypeVar

from impedance_modules.backends.baxter.ros.message_definitions import full_text
from impedance_modules.backends.baxter.ros.messages import Message
from impedance_modules.backends.baxter.ros.sockets.connect import ANYTHING
from impedance_modules.backends.baxter.ros.sockets.listener import Listener
from impedance_modules.backends.baxter.ros.tcp_connection import LENGTH, pack_greeting
from impedance_modules.backends.baxter.ros.transport import TransportClosedError
from impedance_modules.backends.baxter.ros.wire import checksum_of, encode

M = TypeVar("M", bound=Message)


class Outlet:
    """One topic of this node, with its listeners; shared by all its publishers.

    Attributes:
        topic, kind: What is sent.
        users: Publishers that are open.
    """

    def __init__(self, caller: str, topic: str, kind: type[Message]) -> None:
        self.topic, self.kind, self.users = topic, kind, 0
        self._caller = caller
        self._latched: bytes | None = None
        self._keeps = False
        self._lock = threading.Lock()
        self._listeners: list[Listener] = []

    def keep_last(self) -> None:
        """From now on, who connects later gets the last message."""
        self._keeps = True

    def send(self, data: bytes) -> None:
        """Sends a framed message to everybody who listens."""
        with self._lock:
            if self._keeps:
                self._latched = data
            listeners = list(self._listeners)
        for listener in listeners:
            listener.send(data)

    def count(self) -> int:
        """Counts the listeners."""
        with self._lock:
            return len(self._listeners)

    def refusal(self, greeting: dict[str, str]) -> str | None:
        """Says why a listener cannot have this topic, or None."""
        wanted, own = greeting.get("md5sum", ""), checksum_of(self.kind)
        if wanted in (ANYTHING, own):
            return None
        other = greeting.get("type", "?")
        return f"{self.topic} is {self.kind.ros_type} ({own}), not {other} ({wanted})"

    def accept(self, connection: socket.socket) -> None:
        """Takes a listener on board."""
        fields = {
            "callerid": self._caller,
            "topic": self.topic,
            "type": self.kind.ros_type,
            "md5sum": checksum_of(self.kind),
            "message_definition": full_text(self.kind.ros_type),
            "latching": "1" if self._keeps else "0",
        }
        connection.sendall(pack_greeting(fields))
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        listener = Listener(connection, self._forget)
        with self._lock:
            self._listeners.append(listener)
            latched = self._latched
            if latched is not None:
                listener.send(latched)

    def close(self) -> None:
        """Hangs up on all listeners."""
        with self._lock:
            listeners = list(self._listeners)
        for listener in listeners:
            listener.stop()

    def _forget(self, listener: Listener) -> None:
        with self._lock:
            if listener in self._listeners:
                self._listeners.remove(listener)


class SocketPublisher(Generic[M]):
    """A handle to write to a topic."""

    def __init__(self, outlet: Outlet, on_close: Callable[[], None]) -> None:
        self._outlet, self._on_close = outlet, on_close
        self._closed = False

    def send(self, message: M) -> None:
        """Sends to everybody who listens now; never waits.

        Raises:
            TransportClosedError: The publisher is closed.
        """
        if self._closed:
            raise TransportClosedError(f"{self._outlet.topic}: the publisher is closed")
        data = encode(message)
        self._outlet.send(LENGTH.pack(len(data)) + data)

    def connections(self) -> int:
        """Counts the listeners."""
        return 0 if self._closed else self._outlet.count()

    def close(self) -> None:
        """Stops publishing."""
        if not self._closed:
            self._closed = True
            self._on_close()
