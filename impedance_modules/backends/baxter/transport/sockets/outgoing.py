# SPDX-License-Identifier: BSD-3-Clause
"""Publishing: a message goes to every listener at once, and never waits for one that is slow."""

from __future__ import annotations

import select
import socket
import threading
from collections.abc import Callable
from typing import Generic, TypeVar

from impedance_modules.backends.baxter.message_definition import full_text
from impedance_modules.backends.baxter.messages import Message
from impedance_modules.backends.baxter.transport.protocol import TransportClosedError
from impedance_modules.backends.baxter.transport.sockets.connect import ANYTHING
from impedance_modules.backends.baxter.transport.sockets.framing import LENGTH, pack_greeting
from impedance_modules.backends.baxter.wire import checksum_of, encode

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
        self._listeners: list[_Listener] = []

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
        listener = _Listener(connection, self._forget)
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

    def _forget(self, listener: _Listener) -> None:
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


class _Listener:
    """One connection outwards.

    A message leaves in the sender's thread; only if the listener's buffer is full does a thread take over, and
    then only the newest of what came meanwhile follows.
    """

    def __init__(self, connection: socket.socket, on_end: Callable[[_Listener], None]) -> None:
        connection.setblocking(False)
        self._connection, self._on_end = connection, on_end
        self._lock = threading.Lock()
        self._rest = b""
        self._next: bytes | None = None
        self._stopped = False
        self._bell, self._ear = socket.socketpair()
        self._bell.setblocking(False)
        threading.Thread(target=self._watch, daemon=True, name="listener").start()

    def send(self, data: bytes) -> None:
        """Sends now, or as soon as the listener has read what it was sent before."""
        with self._lock:
            if self._rest:
                self._next = data
                return
            self._rest = self._push(data)
            if self._rest:
                self._bell.send(b"!")

    def stop(self) -> None:
        """Hangs up."""
        with self._lock:
            if self._stopped:
                return
            self._stopped = True
            self._bell.send(b"!")

    def _push(self, data: bytes) -> bytes:
        """Writes what fits and returns the rest; a broken connection swallows it."""
        try:
            return data[self._connection.send(data) :]
        except BlockingIOError:
            return data
        except OSError:
            # The listener is gone; the watching thread notices and removes it.
            return b""

    def _watch(self) -> None:
        """Body of the thread: waits for the end of the connection, and writes what is left over."""
        while not self._stopped:
            wants = [self._connection] if self._rest else []
            readable, writable, _ = select.select([self._connection, self._ear], wants, [])
            if self._ear in readable:
                self._ear.recv(64)
            if self._connection in readable and self._hung_up():
                break
            if writable:
                with self._lock:
                    self._rest = self._push(self._rest)
                    if not self._rest and self._next is not None:
                        self._rest, self._next = self._push(self._next), None
        self._on_end(self)
        with self._lock:
            self._stopped = True
            for part in (self._connection, self._bell, self._ear):
                part.close()

    def _hung_up(self) -> bool:
        try:
            return self._connection.recv(4096) == b""
        except BlockingIOError:
            return False
        except OSError:
            return True
