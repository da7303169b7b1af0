# SPDX-License-Identifier: BSD-3-Clause
"""Messages between a run and the process that commands one arm: whole datagrams over a pair of local sockets.

The run sends orders (``ArmOrder``: a kind and seven numbers); the process sends one report per state of its robot
(``ArmReport``) and, now and then, a text (``ArmText``).
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum

from impedance_modules.safety.stop_levels import Event

ARM_JOINTS = 7
"""Joints of one arm."""

LARGEST = 4096
"""Longest message [bytes]."""

_ORDER = struct.Struct(f"<B7x{1 + ARM_JOINTS}d")
_REPORT = struct.Struct(f"<B7x6d{5 * ARM_JOINTS}d")


class OrderKind(IntEnum):
    """What a run asks of an arm's process; the seven numbers are zero unless said otherwise."""

    BEGIN = 1
    """Begin torque mode at zero torque; the numbers are the largest torques that may be sent [N.m]."""

    TORQUE = 2
    """The numbers are the torque from now on [N.m]."""

    END = 3
    """Take the torque to zero, or bring a motion to rest, and end."""

    MOVE = 4
    """Move to the numbers [rad] by the robot's own position mode."""

    RECOVER = 5
    """Ask the robot for its automatic error recovery."""

    QUIT = 6
    """End, disconnect, exit."""


class TextKind(IntEnum):
    """What a text is about."""

    CONNECTED = 2
    """Connected; the text says with what."""

    REFUSED = 3
    """An order was refused by the robot, or it cannot be reached; in the words of its software."""

    ENDED = 4
    """Torque mode or a motion ended as ordered."""

    STOPPED = 5
    """Torque mode or a motion ended by itself; ``event`` says how."""

    ERRORS = 6
    """Errors that the robot shows now; an empty text when there are none any more."""


@dataclass(frozen=True)
class ArmOrder:
    """One order.

    Attributes:
        kind: What is asked for.
        values: Seven numbers.
        state: Time of the state that a torque was computed from, by the robot's clock [s].
    """

    kind: OrderKind
    values: tuple[float, ...] = (0.0,) * ARM_JOINTS
    state: float = 0.0


@dataclass(frozen=True)
class ArmReport:
    """One state of one robot.

    Attributes:
        time: On the robot's clock, whole milliseconds [s].
        mode: Number of ``ROBOT_MODES``.
        success: Share of the last 100 commands that the robot received in time; its own count.
        answered: From the arrival of the state before until the command for it left [s]; 0 outside torque mode.
        fresh: 1 where the last torque of the run left in answer to the very state that it was computed from, 0 where
            it came too late for that.
        torque_mode: 1 in torque mode, else 0.
        position, velocity: [rad], [rad/s].
        effort: Torque behind the gearbox, the arm's weight included [N.m].
        external: The robot's own estimate of the torque from outside [N.m].
        sent: Torque in the command before, without the weight [N.m].
    """

    time: float
    mode: int
    success: float
    answered: float
    fresh: float
    torque_mode: float
    position: tuple[float, ...]
    velocity: tuple[float, ...]
    effort: tuple[float, ...]
    external: tuple[float, ...]
    sent: tuple[float, ...]


@dataclass(frozen=True)
class ArmText:
    """A text of an arm's process.

    Attributes:
        kind: What it is about.
        text: In the words of the maker's software where it has some.
        event: Of ``safety.stop_levels`` where something has stopped, else empty.
    """

    kind: TextKind
    text: str
    event: str = ""


ROBOT_MODES = {
    0: "another mode",
    1: "idle",
    2: "moving",
    3: "guided by hand",
    4: "stopped by a reflex",
    5: "stopped by its user",
    6: "recovering from an error",
}
"""Modes of the robot by the numbers of the maker's software."""

IDLE, REFLEX = 1, 4
"""The mode in which a run may begin, and the one that automatic error recovery ends."""


def pack_order(order: ArmOrder) -> bytes:
    """Encodes an order."""
    return _ORDER.pack(order.kind, order.state, *order.values)


def unpack_order(message: bytes) -> ArmOrder:
    """Decodes an order."""
    kind, state, *values = _ORDER.unpack(message)
    return ArmOrder(OrderKind(kind), tuple(values), state)


def pack_report(scalars: Sequence[float], joints: Sequence[Sequence[float]]) -> bytes:
    """Encodes a report: its six scalars, then five times seven numbers, in the order of ``ArmReport``."""
    return _REPORT.pack(1, *scalars, *(value for row in joints for value in row))


def unpack_report(message: bytes) -> ArmReport:
    """Decodes a report."""
    _, *values = _REPORT.unpack(message)
    scalars, rest = values[:6], values[6:]
    rows = [tuple(rest[k : k + ARM_JOINTS]) for k in range(0, 5 * ARM_JOINTS, ARM_JOINTS)]
    return ArmReport(scalars[0], int(scalars[1]), *scalars[2:], *rows)


def pack_text(text: ArmText) -> bytes:
    """Encodes a text."""
    return bytes([text.kind]) + f"{text.event}\0{text.text}".encode()[: LARGEST - 1]


def unpack(message: bytes) -> ArmReport | ArmText:
    """Decodes what an arm's process has sent."""
    if message[0] == 1:
        return unpack_report(message)
    event, _, text = message[1:].decode(errors="replace").partition("\0")
    return ArmText(TextKind(message[0]), text, event)


def event_of(error: str, words: str) -> Event:
    """Says which event of ``safety.stop_levels`` an error of the maker's software is.

    Args:
        error: Class of the exception.
        words: Its text, which names the robot's errors.
    """
    if error == "NetworkException":
        return Event.BACKEND_LOST
    if "communication_constraints_violation" in words:
        return Event.CONTROLLER_SILENT
    if "joint_reflex" in words or "cartesian_reflex" in words:
        return Event.COLLISION
    if "user stop" in words.lower() or "UserStop" in words or "guiding" in words.lower():
        return Event.ROBOT_DISABLED
    return Event.ROBOT_REFLEX
