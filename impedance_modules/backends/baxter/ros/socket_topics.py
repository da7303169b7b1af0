# SPDX-License-Identifier: BSD-3-Clause
"""Topics over plain sockets: publishing and subscribing.

A publisher sends to every subscriber at once and never waits for a slow one. A subscription has one thread per
publisher, keeps the newest message only, and connects again when a connection breaks.
"""

from __future__ import annotations

import re
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
from impedance_modules.backends.baxter.ros.timed_socket import TimedSocket
from impedance_modules.backends.baxter.ros.transport import Callback, TransportClosedError
from impedance_modules.backends.baxter.ros.wire import MessageError, checksum_of, decode, encode

M = TypeVar("M", bound=Message)

PAUSES = (0.05, 0.1, 0.2, 0.5, 1.0)
"""Waits before trying a publisher again [s]; the last one repeats as long as the master lists it."""

CHUNK = 1 << 16

MOST_SUBSCRIBERS = 32
"""Of one topic of this node; each takes a thread and three descriptors."""

MOST_PUBLISHERS = 16
"""Of one topic that are listened to; each takes a thread, and memory for a message."""

NODE_ADDRESS = re.compile(r"http://[A-Za-z0-9._:%\[\]-]{1,253}:[0-9]{1,5}/?")


class PublishedTopic:
    """One topic of this node, with its subscribers; shared by all its publishers.

    Attributes:
        topic, kind: What is sent.
        users: Publishers that are open.
    """

    def __init__(self, caller: str, topic: str, kind: type[Message]) -> None:
        self.topic, self.kind, self.users = topic, kind, 0
        self._caller = caller
        self._latched: bytes | None = None
        self._latches = False
        self._lock = threading.Lock()
        self._subscribers: list[SubscriberConnection] = []

    def keep_last(self) -> None:
        """From now on, subscribers that connect later get the last message."""
        self._latches = True

    def send(self, data: bytes) -> None:
        """Sends a framed message to all subscribers."""
        with self._lock:
            if self._latches:
                self._latched = data
            subscribers = list(self._subscribers)
        for subscriber in subscribers:
            subscriber.send(data)

    def refuse_more(self) -> str | None:
        """Says that there are too many subscribers, or None."""
        return (
            f"{self.topic} has {MOST_SUBSCRIBERS} subscribers" if self.count() >= MOST_SUBSCRIBERS else None
        )

    def count(self) -> int:
        """Counts the subscribers."""
        with self._lock:
            return len(self._subscribers)

    def refusal(self, header: dict[str, str]) -> str | None:
        """Says why a subscriber cannot have this topic, or None."""
        wanted, own = header.get("md5sum", ""), checksum_of(self.kind)
        if wanted in (ANYTHING, own):
            return None
        other = header.get("type", "?")
        return f"{self.topic} is {self.kind.ros_type} ({own}), not {other} ({wanted})"

    def accept(self, connection: TimedSocket) -> None:
        """Adds a subscriber."""
        fields = {
            "callerid": self._caller,
            "topic": self.topic,
            "type": self.kind.ros_type,
            "md5sum": checksum_of(self.kind),
            "message_definition": full_text(self.kind.ros_type),
            "latching": "1" if self._latches else "0",
        }
        connection.sendall(pack_header(fields))
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        subscriber = SubscriberConnection(connection.untimed(), self._forget)
        with self._lock:
            self._subscribers.append(subscriber)
            latched = self._latched
            if latched is not None:
                subscriber.send(latched)

    def close(self) -> None:
        """Closes all connections."""
        with self._lock:
            subscribers = list(self._subscribers)
        for subscriber in subscribers:
            subscriber.stop()

    def _forget(self, subscriber: SubscriberConnection) -> None:
        with self._lock:
            if subscriber in self._subscribers:
                self._subscribers.remove(subscriber)


class SocketPublisher(Generic[M]):
    """A publisher of a topic."""

    def __init__(self, topic: PublishedTopic, on_close: Callable[[], None]) -> None:
        self._topic, self._on_close = topic, on_close
        self._closed = False

    def send(self, message: M) -> None:
        """Sends to all present subscribers; never waits.

        Raises:
            TransportClosedError: The publisher is closed.
        """
        if self._closed:
            raise TransportClosedError(f"{self._topic.topic}: the publisher is closed")
        data = encode(message)
        self._topic.send(LENGTH.pack(len(data)) + data)

    def connections(self) -> int:
        """Counts the subscribers."""
        return 0 if self._closed else self._topic.count()

    def close(self) -> None:
        """Stops publishing."""
        if not self._closed:
            self._closed = True
            self._on_close()


def node_addresses(said: object) -> list[str]:
    """Returns what is an address of a node in what a master, or anybody, says of publishers; the first of many."""
    if not isinstance(said, list | tuple | set | frozenset):
        return []
    found = [uri for uri in said if isinstance(uri, str) and NODE_ADDRESS.fullmatch(uri)]
    return sorted(set(found))[:MOST_PUBLISHERS]


class SocketSubscription(Generic[M]):
    """A subscription to all publishers of a topic.

    Attributes:
        topic, kind: What is received.
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
        """Takes the list of publishers' addresses: connects to new ones, disconnects from those that are gone."""
        with self._lock:
            if self._closed:
                return
            wanted = set(node_addresses(publishers))
            for uri in [uri for uri in self._links if uri not in wanted]:
                self._links.pop(uri).stop()
            for uri in wanted - set(self._links):
                self._links[uri] = _Link(uri, self._receive)

    def close(self) -> None:
        """Unsubscribes; no callback begins afterwards."""
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

    def _receive(self, link: _Link) -> None:
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
                # No address, gone, not there yet, or another message type: only trying again can tell.
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
                # The other side has closed it already; the thread ends by itself.
                return
