# SPDX-License-Identifier: BSD-3-Clause
"""The run's end of the line to one arm's process: starts it, sends it orders, takes its reports."""

from __future__ import annotations

import select
import socket
import time
from collections.abc import Sequence

from impedance_modules.backends.franka.arm_messages import (
    LARGEST,
    ArmOrder,
    ArmReport,
    ArmText,
    OrderKind,
    TextKind,
    pack_order,
    unpack,
)
from impedance_modules.backends.franka.processes import arrived, end_process, start_process
from impedance_modules.errors import RobotRefused, RobotStopped
from impedance_modules.safety.stop_levels import Event
from impedance_modules.spec.connection_file import ArmWatch


class ArmLink:
    """One arm's process and what it has reported.

    Attributes:
        limb: Name of the arm.
        address: Of its robot.
        report: The newest state; None before the first.
        received: When it arrived, our monotonic clock [s].
        lost: States of the robot that were never seen, since the first one.
        refused: Why the robot refused an order, in the words of the maker's software; empty where it did not.
        errors: Errors that the robot shows now.
        connected: What it is connected with; empty before.
        torque_ended: Torque mode or a motion that had begun is over.
    """

    def __init__(self, limb: str, address: str, watch: ArmWatch, *, realtime: bool) -> None:
        """Starts the process, which connects at once."""
        self.limb, self.address = limb, address
        self.report: ArmReport | None = None
        self.received = 0.0
        self.lost = 0
        self.refused = self.errors = self.connected = ""
        self.torque_ended = False
        self._stop: RobotStopped | None = None
        self._channel, self._process = start_process(
            "impedance_modules.backends.franka.arm_process",
            address,
            ("required" if realtime else "optional", repr(watch.answer), repr(watch.silent)),
        )

    def fileno(self) -> int:
        """Of the socket, for ``select``."""
        return self._channel.fileno()

    @property
    def stop(self) -> RobotStopped | None:
        """Why torque mode or the connection ended by itself; None while it has not."""
        return self._stop

    def drain(self) -> None:
        """Takes everything that has arrived; never waits."""
        for message in arrived(self._channel, LARGEST):
            if message:
                self._take(unpack(message))
            else:
                self._note_stop(Event.BACKEND_LOST, "its process has ended")

    def order(self, kind: OrderKind, values: Sequence[float] | None = None) -> None:
        """Sends an order, which answers the newest state; dropped without room for it: the next one replaces it."""
        state = 0.0 if self.report is None else self.report.time
        order = ArmOrder(kind) if values is None else ArmOrder(kind, tuple(values), state)
        try:
            self._channel.send(pack_order(order), socket.MSG_DONTWAIT)
        except BlockingIOError:
            return
        except OSError:
            self._note_stop(Event.BACKEND_LOST, "its process has ended")

    def wait_for_report(self, seconds: float) -> ArmReport:
        """Waits for a state newer than all before.

        Raises:
            RobotRefused: None comes, or the robot refuses; with the maker's words.
        """
        end, before = time.monotonic() + seconds, self.received
        while self.received <= before:
            self.drain()
            self.raise_if_refused()
            if self.received > before:
                break
            left = end - time.monotonic()
            if left <= 0.0:
                raise RobotRefused(f"{self.limb} ({self.address}): no state of the robot for {seconds:g} s")
            select.select([self], [], [], left)
        if self.report is None:
            raise RobotRefused(f"{self.limb} ({self.address}): no state of the robot")
        return self.report

    def wait_until_ended(self, seconds: float) -> bool:
        """Waits until torque mode or a motion is over; returns whether it is."""
        end = time.monotonic() + seconds
        while not self.torque_ended and self._stop is None and time.monotonic() < end:
            select.select([self], [], [], 0.05)
            self.drain()
        return self.torque_ended

    def raise_if_refused(self) -> None:
        """Raises RobotRefused once the robot refused something, or has ended by itself before torque began."""
        if self.refused:
            raise RobotRefused(
                f"{self.limb} ({self.address}): {self.refused} (valid: {remedy(self.refused)})"
            )
        if self._stop is not None:
            raise RobotRefused(f"{self.limb} ({self.address}): {self._stop.detail}")

    def begin(self, kind: OrderKind, values: Sequence[float]) -> None:
        """Orders torque mode or a motion to begin."""
        self.torque_ended = False
        self.order(kind, values)

    def close(self) -> None:
        """Ends what goes on and the process; may be called twice."""
        if self._process.poll() is None:
            self.order(OrderKind.QUIT)
        self._channel.close()
        end_process(self._process)

    def _take(self, message: ArmReport | ArmText) -> None:
        if isinstance(message, ArmReport):
            if self.report is not None:
                self.lost += max(0, round(1e3 * (message.time - self.report.time)) - 1)
            self.report, self.received = message, time.monotonic()
        elif message.kind is TextKind.CONNECTED:
            self.connected = message.text
        elif message.kind is TextKind.ENDED:
            self.torque_ended = True
        elif message.kind is TextKind.ERRORS:
            self.errors = message.text
        elif message.kind is TextKind.REFUSED:
            self.refused = self.refused or message.text
            self.torque_ended = True
        else:
            self.torque_ended = True
            self._note_stop(Event(message.event), message.text)

    def _note_stop(self, event: Event, detail: str) -> None:
        if self._stop is None:
            self._stop = RobotStopped(event, f"{self.limb}: {detail}")


def remedy(words: str) -> str:
    """Says what helps where the maker's software refuses, by its own words."""
    remedies = {
        "Connection": "the robot's address, its brakes open and FCI activated in Desk, no other program connected",
        "FCI": "the robot's address, its brakes open and FCI activated in Desk, no other program connected",
        "ncompatible": "the pylibfranka whose version the maker lists for this robot's system image",
        "realtime": "a kernel with PREEMPT_RT and the right to use it; or realtime: optional in the connection"
        " file, where lost commands are acceptable",
        "No module named": "pip install 'impedance-modules[franka]'",
        "imeout": "the robot's address, a wired network, FCI activated in Desk",
    }
    for part, text in remedies.items():
        if part in words:
            return text
    return "what Desk asks for; then try again"
