# SPDX-License-Identifier: BSD-3-Clause
"""A connection that is over at a moment, however slowly the other side talks.

A time-out of a socket is for one read. A peer that sends a byte now and then would never let it pass.
"""

from __future__ import annotations

import socket
import time
from typing import Any


class TimedSocket(socket.socket):
    """A connected socket all of whose reads and writes together may take so long.

    Attributes:
        end: When it is over, by ``time.monotonic()`` [s].
    """

    end: float

    @classmethod
    def of(cls, plain: socket.socket, seconds: float) -> TimedSocket:
        """Takes a connection over; ``plain`` is closed afterwards."""
        timed = cls(plain.family, plain.type, plain.proto, plain.detach())
        timed.end = time.monotonic() + seconds
        return timed

    def untimed(self) -> socket.socket:
        """Gives the connection back without any limit; this object is closed afterwards."""
        plain = socket.socket(self.family, self.type, self.proto, self.detach())
        plain.settimeout(None)
        return plain

    def recv(self, *arguments: Any) -> bytes:
        """Receives as a socket does; raises TimeoutError once the time is over."""
        self._limit()
        return super().recv(*arguments)

    def recv_into(self, *arguments: Any) -> int:
        """Receives as a socket does; raises TimeoutError once the time is over."""
        self._limit()
        return super().recv_into(*arguments)

    def sendall(self, *arguments: Any) -> None:
        """Sends as a socket does; raises TimeoutError once the time is over."""
        self._limit()
        super().sendall(*arguments)

    def _limit(self) -> None:
        left = self.end - time.monotonic()
        if left <= 0.0:
            raise TimeoutError("the other side talks too slowly")
        self.settimeout(left)
