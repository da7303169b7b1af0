# SPDX-License-Identifier: BSD-3-Clause
"""Set-points over ZeroMQ: every message is answered with whether it counts, and with the newest state of the run."""

from __future__ import annotations

import json
import threading
from typing import Any

from impedance_modules.errors import BadInput
from impedance_modules.streaming.inbox import Inbox
from impedance_modules.streaming.set_point_message import LONGEST, read_message

HERE = "127.0.0.1"
"""Where one listens unless told otherwise: programs on the same machine can reach it, nobody else."""

PORT = 5586
WAIT = 100
"""Longest wait for a message [ms]; then it is looked whether the run is over."""

WAITING = 100
"""Messages that wait to be read; more are dropped by the wire."""


def listening_address(given: str) -> str:
    """Completes nothing, HOST, :PORT or HOST:PORT.

    Raises:
        BadInput: The port is none.
    """
    host, _, port = given.rpartition(":") if ":" in given else (given, "", str(PORT))
    if not port.isdigit() or not 0 < int(port) < 65536:
        raise BadInput(f"--listen {given}: '{port}' is no port (valid: HOST:PORT, e.g. {HERE}:{PORT})")
    return f"tcp://{host or HERE}:{port}"


class SetPointReceiver:
    """Hands messages from a socket to an inbox, in a thread of its own, until it is closed."""

    def __init__(self, address: str, inbox: Inbox) -> None:
        """Begins to listen.

        Args:
            address: ``tcp://HOST:PORT``.
            inbox: Takes or refuses what comes.

        Raises:
            BadInput: pyzmq is not installed, or nothing can listen at that address.
        """
        self._zmq = zeromq()
        self._inbox = inbox
        self._context = self._zmq.Context()
        self._socket = self._context.socket(self._zmq.ROUTER)
        for option, value in (
            ("LINGER", 0),
            ("RCVHWM", WAITING),
            ("SNDHWM", WAITING),
            ("MAXMSGSIZE", LONGEST),
        ):
            self._socket.setsockopt(getattr(self._zmq, option), value)
        try:
            self._socket.bind(address)
        except self._zmq.ZMQError as error:
            self._context.destroy(linger=0)
            raise BadInput(
                f"--listen {address.removeprefix('tcp://')}: {error} (valid: a free port)"
            ) from None
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._receive, name="set-points", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stops listening; again does nothing."""
        if not self._over.is_set():
            self._over.set()
            self._thread.join()
            self._context.destroy(linger=0)

    def _receive(self) -> None:
        while not self._over.is_set():
            if self._socket.poll(WAIT):
                sender, *parts = self._socket.recv_multipart()
                answer = self._answer(sender.hex(), parts[-1] if parts else b"")
                self._socket.send_multipart([sender, json.dumps(answer).encode()], flags=self._zmq.DONTWAIT)

    def _answer(self, sender: str, text: bytes) -> dict[str, Any]:
        sequence, reason = None, None
        try:
            message = read_message(text)
            sequence = message.sequence
            self._inbox.put(message, sender)
        except BadInput as refusal:
            reason = str(refusal)
        report = self._inbox.report
        state = None if report is None else report.plain()
        return {"sequence": sequence, "accepted": reason is None, "reason": reason, "state": state}


def zeromq() -> Any:
    """Imports pyzmq, where set-points are sent or received.

    Raises:
        BadInput: It is not installed.
    """
    try:
        import zmq  # noqa: PLC0415 - an extra
    except ImportError:
        raise BadInput(
            "set-points come over ZeroMQ, and the package pyzmq is not installed"
            " (valid: pip install 'impedance-modules[listen]')"
        ) from None
    return zmq
