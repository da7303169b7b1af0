# SPDX-License-Identifier: BSD-3-Clause
"""The process that commands one arm: it answers every state of its robot in the same cycle, whatever the run does.

The maker's library holds Python's interpreter lock while it waits for a state, and each robot has a clock of its own:
two arms in one process would wait for each other, and so would the threads that write files. A process per arm answers
its robot alone. It ends torque mode calmly where the run says so, where no torque comes any more, and where the run's
process has died; ``docs/franka.md`` has the measurements.

Run as ``python -m impedance_modules.backends.franka.arm_process ADDRESS SOCKET REALTIME ANSWER SILENT``.
"""

from __future__ import annotations

import os
import select
import signal
import socket
import struct
import sys
import time
from typing import Any

from impedance_modules.backends.franka.arm_messages import (
    LARGEST,
    REFLEX,
    ArmOrder,
    ArmText,
    OrderKind,
    TextKind,
    event_of,
    pack_report,
    pack_text,
    unpack_order,
)
from impedance_modules.backends.franka.commands import EndOfTorque, PathCommand, TorqueCommand

FIRST_TORQUE = 2.0
"""Longest time at zero torque until the first torque comes [s]."""

PRIORITY = 80
"""Of this process among those in real time, where the operating system permits it."""

IDLE_NUMBERS = [0.0] * 7


def main(arguments: list[str]) -> int:
    """Connects to a robot and commands it until the run ends."""
    address, descriptor, realtime, answer, silent = arguments
    # Ctrl-C is the run's affair: it brakes first, then tells this process to end.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    channel = socket.socket(fileno=int(descriptor))
    process = ArmProcess(channel, float(answer), float(silent))
    try:
        process.connect(address, enforce=realtime == "required")
        process.run()
    except (BrokenPipeError, ConnectionResetError):
        return 0
    return 0


class ArmProcess:
    """One robot and the run that it serves.

    Attributes:
        channel: To the run.
    """

    def __init__(self, channel: socket.socket, answer: float, silent: float) -> None:
        """Takes the socket, how long a state's own torque is waited for, and how long a torque counts [s]."""
        self.channel = channel
        self._answer, self._silent = answer, silent
        self._robot: Any = None
        self._library: Any = None
        self._control: Any = None
        self._torque: TorqueCommand | None = None
        self._path: PathCommand | None = None
        self._errors = ""
        self._quit = self._own_torque = False
        self._answered = self._fresh = self._now = 0.0

    def connect(self, address: str, *, enforce: bool) -> None:
        """Connects; tells the run how that went."""
        try:
            import pylibfranka  # noqa: PLC0415 - an extra, needed by this process alone

            kind = pylibfranka.RealtimeConfig
            self._library = pylibfranka
            self._robot = pylibfranka.Robot(address, kind.kEnforce if enforce else kind.kIgnore)
        except Exception as error:  # noqa: BLE001 - whatever it is, the run is told
            self._say(TextKind.REFUSED, _words(error))
            self._quit = True
            return
        version = getattr(self._library, "__version__", "of unknown version")
        self._say(
            TextKind.CONNECTED, f"pylibfranka {version}{'' if _in_real_time() else ', not in real time'}"
        )

    def run(self) -> None:
        """Reports every state, and answers it while a mode is on, until the run quits or its process is gone."""
        while not (self._quit and self._control is None):
            try:
                self._cycle()
            except Exception as error:  # noqa: BLE001 - whatever it is, the run is told
                self._stopped(error)

    def _cycle(self) -> None:
        if self._control is None:
            self._report(self._robot.read_once())
            self._listen(wait=False)
            return
        state, elapsed = self._control.readOnce()
        arrived = time.monotonic()
        self._now = state.time.to_sec()
        self._report(state)
        self._listen(wait=self._torque is not None)
        if self._torque is not None:
            self._send_torque(self._torque)
        elif self._path is not None:
            self._send_position(self._path, elapsed.to_sec())
        self._answered = time.monotonic() - arrived

    def _send_torque(self, torque: TorqueCommand) -> None:
        last = torque.step(time.monotonic())
        command = self._library.Torques(torque.sent)
        command.motion_finished = last
        self._control.writeOnce(command)
        if last:
            why = torque.ending
            self._leave_mode()
            if why is None or why.by_order:
                self._say(TextKind.ENDED, "torque mode ended")
            else:
                self._say(TextKind.STOPPED, why.detail, why.event)

    def _send_position(self, path: PathCommand, elapsed: float) -> None:
        position, last = path.step(elapsed)
        command = self._library.JointPositions(position)
        command.motion_finished = last
        self._control.writeOnce(command)
        if last:
            self._leave_mode()
            self._say(TextKind.ENDED, "halted on the way" if path.halted else "at the pose")

    def _listen(self, *, wait: bool) -> None:
        """Takes all orders that have come; where ``wait``, gives the torque of this very state a moment to come.

        By ``select``: a socket's own time-out is rounded up to the scheduler's ticks, which are as long as a cycle.
        """
        deadline = time.monotonic() + self._answer
        self._own_torque = False
        self._take_orders()
        while wait and not self._own_torque and not self._quit:
            left = deadline - time.monotonic()
            if left <= 0.0:
                return
            select.select([self.channel], [], [], left)
            self._take_orders()

    def _take_orders(self) -> None:
        while True:
            try:
                message = self.channel.recv(LARGEST, socket.MSG_DONTWAIT)
            except BlockingIOError:
                return
            if not message:
                self._gone()
                return
            self._obey(unpack_order(message))

    def _obey(self, order: ArmOrder) -> None:
        if order.kind is OrderKind.TORQUE:
            if self._torque is not None:
                self._torque.order(order.values, time.monotonic())
                self._own_torque = order.state == self._now
                self._fresh = float(self._own_torque)
        elif order.kind is OrderKind.BEGIN:
            self._begin(order)
        elif order.kind is OrderKind.MOVE:
            self._move(order)
        elif order.kind is OrderKind.RECOVER:
            self._robot.automatic_error_recovery()
            self._say(TextKind.ENDED, "automatic error recovery")
        else:
            self._end(EndOfTorque(True, "", "the run ended"))
            self._quit = self._quit or order.kind is OrderKind.QUIT

    def _begin(self, order: ArmOrder) -> None:
        if self._control is not None:
            return
        self._control = self._robot.start_torque_control()
        self._torque = TorqueCommand(order.values, self._silent, FIRST_TORQUE, time.monotonic())

    def _move(self, order: ArmOrder) -> None:
        if self._control is not None:
            return
        start = self._robot.read_once().q_d
        self._control = self._robot.start_joint_position_control(self._library.ControllerMode.JointImpedance)
        self._path = PathCommand(start, order.values)

    def _end(self, why: EndOfTorque) -> None:
        if self._torque is not None:
            self._torque.end(why)
        elif self._path is not None:
            self._path.halt()

    def _gone(self) -> None:
        """The run's process has died: what goes on is brought to its end."""
        self._end(EndOfTorque(False, "controller_silent", "the run's process has ended"))
        self._quit = True

    def _leave_mode(self) -> None:
        self._control = self._torque = self._path = None
        self._answered = self._fresh = 0.0

    def _stopped(self, error: Exception) -> None:
        """The maker's software has ended torque mode, refused an order or lost the robot."""
        controlled = self._control is not None
        self._leave_mode()
        words = _words(error)
        kind = type(error).__name__
        if controlled or kind == "NetworkException":
            self._say(TextKind.STOPPED, words, event_of(kind, words))
        else:
            self._say(TextKind.REFUSED, words)
        self._quit = self._quit or kind == "NetworkException"

    def _report(self, state: Any) -> None:
        """Sends a state; one that the run has no room for is lost, and the next one says so by its time."""
        torque = self._torque
        mode = int(state.robot_mode)
        scalars = (
            state.time.to_sec(),
            mode,
            state.control_command_success_rate,
            self._answered,
            self._fresh,
            0.0 if torque is None else 1.0,
        )
        sent = IDLE_NUMBERS if torque is None else torque.sent
        joints = (state.q, state.dq, state.tau_J, state.tau_ext_hat_filtered, sent)
        try:
            self.channel.send(pack_report(scalars, joints), socket.MSG_DONTWAIT)
        except BlockingIOError:
            return
        except (BrokenPipeError, ConnectionResetError):
            self._gone()
            return
        if torque is None:
            self._report_errors(state, mode)

    def _report_errors(self, state: Any, mode: int) -> None:
        found = str(state.current_errors) if state.current_errors else ""
        if not found and mode == REFLEX:
            found = str(state.last_motion_errors)
        if found != self._errors:
            self._errors = found
            self._say(TextKind.ERRORS, found)

    def _say(self, kind: TextKind, text: str, event: str = "") -> None:
        self.channel.setsockopt(socket.SOL_SOCKET, socket.SO_SNDTIMEO, _timeval(1.0))
        try:
            self.channel.send(pack_text(ArmText(kind, text, event)))
        except (BrokenPipeError, ConnectionResetError, BlockingIOError):
            self._quit = True


def _words(error: Exception) -> str:
    """The maker's words, with the class of the error where they do not say it."""
    return f"{type(error).__name__}: {error}"


def _timeval(seconds: float) -> bytes:
    whole = int(seconds)
    return struct.pack("ll", whole, round(1e6 * (seconds - whole)))


def _in_real_time() -> bool:
    """Asks the operating system to run this process before all others; returns whether it does."""
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
    except (OSError, AttributeError):
        return False
    return True


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
