# SPDX-License-Identifier: BSD-3-Clause
"""Listening: one thread per publisher of a topic, the newest message only, connecting again when it breaks."""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Callable, Iterable
from typing import Generic, TypeVar

from impedance_modules.backends.baxter.ros.message_definitions import full_text
from impedance_modules.backends.baxter.ros.messages import Message
from impedance_modules.backends.baxter.ros.sockets.connect import connect_to_topic
from impedance_modules.backends.baxter.ros.tcp_connection import GreetingError, cut_frames
from impedance_modules.backends.baxter.ros.transport import Callback
from impedance_modules.backends.baxter.ros.wire import MessageError, checksum_of, decode

M = TypeVar("M", bound=Message)

PAUSES = (0.05, 0.1, 0.2, 0.5, 1.0)
"""Waits before trying a publisher again [s]; the last repeats as long as the master lists it."""

CHUNK = 1 << 16


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
            except (OSError, GreetingError, MessageError):
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
