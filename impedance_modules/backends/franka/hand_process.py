# SPDX-License-Identifier: BSD-3-Clause
"""The process that orders one Franka Hand: its calls return when the fingers rest, and no torque waits for them.

It takes orders and sends samples as lines of JSON, one per datagram (``hand_link`` is the other end). While the hand
moves there are no samples. It orders nothing by itself, at its end neither: a hand that holds something goes on.

Run as ``python -m impedance_modules.backends.franka.hand_process ADDRESS SOCKET``.
"""

from __future__ import annotations

import json
import select
import signal
import socket
import sys
from collections.abc import Mapping
from typing import Any

LARGEST = 4096
"""Longest message [bytes]."""

SAMPLE_PERIOD = 0.05
"""Time between two samples of a hand at rest [s]."""


def main(arguments: list[str]) -> int:
    """Connects to a hand and orders it until the run ends."""
    address, descriptor = arguments
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    channel = socket.socket(fileno=int(descriptor))
    try:
        HandProcess(channel).run(address)
    except (BrokenPipeError, ConnectionResetError):
        return 0
    return 0


class HandProcess:
    """One hand and the run that it serves."""

    def __init__(self, channel: socket.socket) -> None:
        """Takes the socket to the run."""
        self._channel = channel
        self._hand: Any = None
        self._ended, self._grasped = 0, False

    def run(self, address: str) -> None:
        """Samples the hand and carries orders out, the newest first, until the run is gone or the hand fails."""
        try:
            import pylibfranka  # noqa: PLC0415 - an extra, needed by this process alone

            self._hand = pylibfranka.Gripper(address)
            while self._serve():
                pass
        except (BrokenPipeError, ConnectionResetError):
            raise
        except Exception as error:  # noqa: BLE001 - whatever it is, the run is told
            self._send({"error": f"{type(error).__name__}: {error}"})

    def _serve(self) -> bool:
        """Sends a sample, waits for an order, carries it out; returns whether the run is still there."""
        state = self._hand.read_once()
        self._send(
            {
                "width": state.width,
                "widest": state.max_width,
                "held": bool(self._grasped and state.is_grasped),
                "ended": self._ended,
            }
        )
        if not select.select([self._channel], [], [], SAMPLE_PERIOD)[0]:
            return True
        order: Mapping[str, Any] | None = None
        while select.select([self._channel], [], [], 0.0)[0]:
            message = self._channel.recv(LARGEST)
            if not message:
                return False
            order = json.loads(message)
        if order is not None:
            self._carry_out(order, state.max_width)
        return True

    def _carry_out(self, order: Mapping[str, Any], widest: float) -> None:
        """Waits until the fingers are at rest. A move that something stops is no error: its width tells."""
        width, speed, force = min(order["width"], widest), order["speed"], order["force"]
        self._grasped = False
        if force is None:
            self._hand.move(width, speed)
        else:
            # Any width at which the fingers come to rest counts as grasped; the run judges by the width.
            self._grasped = bool(self._hand.grasp(width, speed, force, widest, widest))
        self._ended = order["number"]

    def _send(self, message: Mapping[str, Any]) -> None:
        self._channel.send(json.dumps(message).encode()[:LARGEST])


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
