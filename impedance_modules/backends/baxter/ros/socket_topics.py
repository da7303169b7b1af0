# SPDX-License-Identifier: BSD-3-Clause
"""Publishing: a message goes to every listener at once, and never waits for one that is slow."""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Callable, Iterable
from typing import Generic, TypeVar

from impedance_modules.backends.baxter.ros.message_definitions import full_text
from impedance_modules.backends.baxter.ros.messages import Message
from impedance_modules.backends.baxter.ros.tcp_connection import (
    ANYTHING,
    LENGTH,
    HeaderError,
    SubscriberConnection,
    connect_to_topic,
    cut_frames,
    pack_header,
)
from impedance_modules.backends.baxter.ros.transport import Callback, TransportClosedError
from impedance_modules.backends.baxter.ros.wire import MessageError, checksum_of, decode, encode

M = TypeVar("M", bound=Message)

PAUSES = (0.05, 0.1, 0.2, 0.5, 1.0)
"""Waits before trying a publisher again [s]; the last repeats as long as the master lists it."""

CHUNK = 1 << 16


class PublishedTopic:
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
        self._listeners: list[SubscriberConnection] = []

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
        connection.sendall(pack_header(fields))
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        listener = SubscriberConnection(connection, self._forget)
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

    def _forget(self, listener: SubscriberConnection) -> None:
        with self._lock:
            if listener in self._listeners:
                self._listeners.remove(listener)


class SocketPublisher(Generic[M]):
    """A handle to write to a topic."""

    def __init__(self, outlet: PublishedTopic, on_close: Callable[[], None]) -> None:
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


class SocketSubscription(Generic[M]):
    """A topic that is listened to, from however many publishers it has.

    Attributes:
        topic, kind: What is heard.
    """

    def __init__(
        self, caller: str, topic: str, kind: type[M], callback: Callback[M], on_close: Callable[[], None]
    ) -> None:
        self.topic, self.kind = topic, kind
        self._caller, self._callback, self._on_close = caller, callback, on_close
        self._lock = threading.Lock()
        self._calling = threading.RLock()
        self._closed = False
        self._links: dict[str, _Link] = {}

    def update(self, publishers: Iterable[str]) -> None:
        """Follows the list of publishers' addresses: connects to new ones, leaves those that are gone."""
        with self._lock:
            if self._closed:
                return
            wanted = set(publishers)
            for uri in [uri for uri in self._links if uri not in wanted]:
                self._links.pop(uri).stop()
            for uri in wanted - set(self._links):
                self._links[uri] = _Link(uri, self._listen)

    def close(self) -> None:
        """Stops listening; no callback begins afterwards."""
        with self._lock:
            if self._closed:
                return
            self._closed = True
            links = list(self._links.values())
            self._links.clear()
        for link in links:
            link.stop()
        with self._calling:
            pass
        self._on_close()

    def _listen(self, link: _Link) -> None:
        """Body of a link's thread: connect, read, and again, until it is stopped."""
        failures = 0
        while not link.stopped.is_set():
            try:
                connection, _ = connect_to_topic(link.uri, self._caller, self.topic, self._fields())
                failures = 0
                with connection:
                    if link.holds(connection):
                        self._read(connection, link)
            except (OSError, HeaderError, MessageError):
                # Gone, not there yet, or meaning another message: only asking again can tell.
                failures += 1
            link.stopped.wait(PAUSES[min(failures, len(PAUSES) - 1)])

    def _read(self, connection: socket.socket, link: _Link) -> None:
        buffer = bytearray()
        while not link.stopped.is_set():
            more = connection.recv(CHUNK)
            received = time.monotonic()
            if not more:
                return
            buffer += more
            newest = cut_frames(buffer)
            if newest is None:
                continue
            message = decode(self.kind, newest)
            with self._calling:
                if not self._closed:
                    self._callback(message, received)

    def _fields(self) -> dict[str, str]:
        return {
            "type": self.kind.ros_type,
            "md5sum": checksum_of(self.kind),
            "message_definition": full_text(self.kind.ros_type),
        }


class _Link:
    """One publisher's connection and the thread that reads it."""

    def __init__(self, uri: str, body: Callable[[_Link], None]) -> None:
        self.uri = uri
        self.stopped = threading.Event()
        self._lock = threading.Lock()
        self._connection: socket.socket | None = None
        threading.Thread(target=body, args=(self,), daemon=True, name=f"from {uri}").start()

    def holds(self, connection: socket.socket) -> bool:
        """Remembers the open connection so that ``stop`` can end it; False when it is too late."""
        with self._lock:
            self._connection = connection
            return not self.stopped.is_set()

    def stop(self) -> None:
        """Ends the thread soon, also out of a blocked read."""
        with self._lock:
            self.stopped.set()
            connection = self._connection
        if connection is not None:
            try:
                connection.shutdown(socket.SHUT_RDWR)
            except OSError:
                # The other side has hung up already; the thread ends by itself.
                return
