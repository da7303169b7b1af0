# SPDX-License-Identifier: BSD-3-Clause
"""Sends set-points to a task that runs with ``--listen``: for teleoperators and policies in other processes."""

from __future__ import annotations

import json
import time
from collections.abc import Mapping, Sequence
from types import TracebackType
from typing import Any

from impedance_modules.streaming.receiver import HERE, PORT, zeromq
from impedance_modules.strict_json import parse_json

SENT_AND_WAITING = 10
"""Messages that wait for a receiver; with none listening, more are dropped."""


class SetPointSender:
    """One sender of set-points.

    Example:
        >>> with SetPointSender() as sender:
        ...     sender.send({"left.hand": {"position": [0.7, 0.3, 0.2]}})
    """

    def __init__(self, address: str = f"tcp://{HERE}:{PORT}") -> None:
        """Connects to a receiver, which may come later.

        Raises:
            BadInput: pyzmq is not installed.
        """
        self._zmq = zeromq()
        self._context = self._zmq.Context()
        self._socket = self._context.socket(self._zmq.DEALER)
        for option, value in (("LINGER", 0), ("SNDHWM", SENT_AND_WAITING)):
            self._socket.setsockopt(getattr(self._zmq, option), value)
        self._socket.connect(address)
        self.sequence = 0

    def send(self, targets: Mapping[str, Mapping[str, Sequence[float]]], *, stamp: bool = True) -> bool:
        """Sends one message of ``schemas/set-point.schema.json``; never waits.

        Args:
            targets: Target -> position (3,) [m], rotation (4,), stiffness (6,), force (6,), each if it is to change.
            stamp: Says when it was sent, by this machine's clock.

        Returns:
            Whether it is on its way; False where nobody listens.
        """
        self.sequence += 1
        message: dict[str, Any] = {"sequence": self.sequence, "targets": _plain(targets)}
        if stamp:
            message["sent"] = time.time()
        try:
            self._socket.send(json.dumps(message).encode(), flags=self._zmq.DONTWAIT)
        except self._zmq.Again:
            return False
        return True

    def answers(self, wait: float = 0.0) -> list[dict[str, Any]]:
        """Returns the answers that have come: ``sequence``, ``accepted``, ``reason`` and ``state`` of the run.

        Args:
            wait: For the first one [s].
        """
        found = []
        if self._socket.poll(int(1000.0 * wait)):
            while self._socket.poll(0):
                found.append(parse_json(self._socket.recv()))
        return found

    def close(self) -> None:
        """Ends the connection."""
        self._context.destroy(linger=0)

    def __enter__(self) -> SetPointSender:
        """Returns itself."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Ends the connection."""
        self.close()


def _plain(targets: Mapping[str, Mapping[str, Sequence[float]]]) -> dict[str, dict[str, list[float]]]:
    return {
        name: {key: [float(value) for value in values] for key, values in asked.items()}
        for name, asked in targets.items()
    }
