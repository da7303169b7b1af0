# SPDX-License-Identifier: BSD-3-Clause
"""One who listens to a topic of ours: bytes leave at once, in the sender's thread; nobody waits for a slow one."""

from __future__ import annotations

import select
import socket
import threading
from collections.abc import Callable


class Listener:
    """One open connection, over which a publisher sends.

    A message leaves in the sender's thread; only if the listener's buffer is full does a thread take over, and
    then only the newest of what came meanwhile follows.
    """

    def __init__(self, connection: socket.socket, on_end: Callable[[Listener], None]) -> None:
        """Takes a connection that has been greeted, and closes it in the end.

        Args:
            connection: To the listener.
            on_end: Called once when the connection is over, whoever hung up.
        """
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
