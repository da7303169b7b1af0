# SPDX-License-Identifier: BSD-3-Clause
"""The hand on the robot: everything that is sent goes through ``Stops`` here, whichever thread asks."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from impedance_modules.backends.baxter import topics
from impedance_modules.backends.baxter.joint_states import StateSample
from impedance_modules.backends.baxter.robot_link import RobotCallbacks, RobotLink
from impedance_modules.backends.baxter.ros.messages import AssemblyState, Float64, JointCommand, UInt16
from impedance_modules.backends.baxter.ros.transport import Publisher, Transport
from impedance_modules.backends.baxter.ros.wire import encode
from impedance_modules.backends.baxter.stops import DriveMode, Outgoing, Stops
from impedance_modules.errors import RobotRefused, RobotStopped
from impedance_modules.robot.model import Limb
from impedance_modules.safety.stop_events import Event

Array = NDArray[np.float64]

ATTACH_TIME = 0.3
"""Before the first command: a robot needs about 0.24 s to connect to a new publisher [s]."""

PARTING_HOLD = 0.1
"""For how long the last hold is repeated at least [s]."""

HOLD_PERIOD = 0.009
"""A hold is repeated this often [s], about 100 Hz: one message may be lost."""

REQUEST_PERIOD = 1.0
"""The rate of the states is asked for again this often [s]; the robot may have restarted its loop."""


class BaxterDriver:
    """Commands some limbs of a robot, as far as ``Stops`` lets it, with a watchdog beside it.

    Attributes:
        stops: What may be sent, and why not.
    """

    def __init__(self, link: RobotLink, limbs: Mapping[str, Limb], stops: Stops, rate: float) -> None:
        """Takes the robot, the limbs and the control rate [Hz]; sends nothing."""
        self.stops = stops
        self._link, self._limbs, self._rate = link, limbs, rate
        self._lock = threading.RLock()
        self._commander: Commander | None = None
        self._watchdog: Watchdog | None = None
        self._next_request = self._next_hold = 0.0

    def listen(self) -> None:
        """Lets ``Stops`` hear everything from now on."""
        self._link.set_callbacks(
            RobotCallbacks(self._on_state, self._on_robot, self._on_collision, self._on_cuff)
        )

    def attach(self) -> None:
        """Advertises the commands, starts the watchdog and makes sure that the robot listens.

        Raises:
            RobotRefused: It does not.
        """
        self._commander = Commander(self._link.transport, self._limbs)
        self._watchdog = Watchdog(self._check)
        self._watchdog.start()
        time.sleep(ATTACH_TIME)
        without_subscriber = self._commander.without_subscriber()
        if without_subscriber:
            raise RobotRefused(
                f"nobody listens to the commands of {', '.join(without_subscriber)}: the robot's software has another"
                " JointCommand message, or cannot reach this machine (valid: ROS_IP=the address of this"
                " machine in the robot's network)"
            )

    def set_timeout(self, seconds: float) -> None:
        """Sets the robot's command time-out [s]."""
        if self._commander is not None:
            self._commander.set_timeout(seconds)

    def move(self, position: Array) -> None:
        """Sets the target (n,) [rad] of position mode.

        Raises:
            RobotStopped: The robot may not move any more.
        """
        with self._lock:
            why = self.stops.move(position)
        if why is not None:
            raise RobotStopped(Event.BACKEND_LOST, f"the arms stop on their way to the start: {why}")

    def begin(self) -> None:
        """Starts torque mode.

        Raises:
            RobotStopped: That is impossible.
        """
        with self._lock:
            why = self.stops.begin(time.monotonic())
        if why is not None:
            raise RobotStopped(Event.BACKEND_LOST, f"torque mode cannot begin: {why}")

    def torque(self, effort: Array) -> None:
        """Sends a torque (n,) [N.m], or what must be sent in its place."""
        with self._lock:
            self._send(self.stops.torque(time.monotonic(), effort))

    def warm_up(self, effort: Array) -> None:
        """Goes through the motions of sending a torque; sends nothing."""
        if self._commander is not None:
            self._commander.warm_up(effort)

    def end(self) -> None:
        """Ends torque mode as planned: the hold leaves at once, from now on the watchdog repeats it."""
        with self._lock:
            self.stops.end()
            now = time.monotonic()
            self._send(self.stops.watch(now))
            self._next_hold = now + HOLD_PERIOD

    def raise_if_stopped(self) -> None:
        """Raises RobotStopped once something has ended torque control."""
        fault = self.stops.reason
        if fault is not None:
            raise RobotStopped(fault.event, fault.detail)

    def restore_settings(self) -> None:
        """Lets the hold be repeated for a while, then gives the robot its own time-out and rate back."""
        end = max(time.monotonic() + PARTING_HOLD, self.stops.pause_end)
        while self.stops.mode is DriveMode.HOLD and time.monotonic() < end:
            time.sleep(0.01)
        if self._commander is not None:
            self._commander.set_timeout(topics.DEFAULT_TIMEOUT)
            self._commander.ask_rate(topics.DEFAULT_STATE_RATE)

    def leave(self) -> None:
        """Sends nothing any more and withdraws from the network; may be called twice."""
        with self._lock:
            self.stops.leave()
        if self._watchdog is not None:
            self._watchdog.stop()
        self._link.set_callbacks(None)
        if self._commander is not None:
            self._commander.close()
        self._link.close()
        self._link.transport.close()

    def _check(self) -> None:
        """The watchdog's: sends what must be sent though nobody asked."""
        now = time.monotonic()
        with self._lock:
            order = self.stops.watch(now)
            if order.position is None or now >= self._next_hold:
                self._send(order)
                self._next_hold = now + HOLD_PERIOD
            if (
                self._commander is not None
                and now >= self._next_request
                and self.stops.mode is not DriveMode.OFF
            ):
                self._commander.ask_rate(round(self._rate))
                self._next_request = now + REQUEST_PERIOD
        if self.stops.reason is not None:
            self._link.wake()

    def _on_state(self, sample: StateSample) -> None:
        with self._lock:
            self.stops.on_state(sample.taken, sample.state.position, sample.state.velocity)

    def _on_robot(self, robot: AssemblyState, received: float) -> None:
        with self._lock:
            self.stops.on_robot(received, robot)
        self._check_if_stopped()

    def _on_collision(self, limb: str, felt: bool, received: float) -> None:
        with self._lock:
            self.stops.on_collision(received, limb, felt)
        self._check_if_stopped()

    def _on_cuff(self, limb: str, squeezed: bool) -> None:
        with self._lock:
            self.stops.on_cuff(limb, squeezed)
        self._check_if_stopped()

    def _check_if_stopped(self) -> None:
        if self.stops.reason is not None and self._watchdog is not None:
            self._watchdog.check_now()

    def _send(self, order: Outgoing) -> None:
        if self._commander is not None:
            self._commander.send(order)


class Commander:
    """Publishers of some limbs' commands; every command names all joints of its limb."""

    def __init__(self, transport: Transport, limbs: Mapping[str, Limb]) -> None:
        """Advertises; sends nothing yet."""
        self._limbs = limbs
        self._commands = {
            name: transport.advertise(topics.joint_command(name), JointCommand) for name in limbs
        }
        self._timeouts = {
            name: transport.advertise(topics.command_timeout(name), Float64, latch=True) for name in limbs
        }
        self._rate = transport.advertise(topics.STATE_RATE_REQUEST, UInt16, latch=True)

    def without_subscriber(self) -> tuple[str, ...]:
        """Names the limbs to whose commands nobody listens."""
        return tuple(name for name, publisher in self._commands.items() if publisher.connections() == 0)

    def send(self, order: Outgoing) -> None:
        """Sends what an order says to each of its limbs."""
        if order.effort is not None:
            mode, values = JointCommand.TORQUE_MODE, order.effort
        elif order.position is not None:
            mode, values = JointCommand.POSITION_MODE, order.position
        else:
            return
        for name in order.limbs:
            limb = self._limbs[name]
            command = tuple(values[limb.joints].tolist())
            self._commands[name].send(JointCommand(mode, command, limb.joint_names))

    def warm_up(self, effort: Array) -> None:
        """Lays out the torques (n,) [N.m] of all limbs as ``send`` does, and sends nothing."""
        for limb in self._limbs.values():
            encode(
                JointCommand(JointCommand.TORQUE_MODE, tuple(effort[limb.joints].tolist()), limb.joint_names)
            )

    def set_timeout(self, seconds: float) -> None:
        """Sets after how long without a command the robot leaves torque mode [s]."""
        for publisher in self._timeouts.values():
            publisher.send(Float64(seconds))

    def ask_rate(self, rate: int) -> None:
        """Asks for the joint states at a rate [Hz]."""
        self._rate.send(UInt16(rate))

    def close(self) -> None:
        """Stops publishing."""
        publishers: list[Publisher[JointCommand] | Publisher[Float64] | Publisher[UInt16]] = [
            *self._commands.values(),
            *self._timeouts.values(),
            self._rate,
        ]
        for publisher in publishers:
            publisher.close()


CHECK_PERIOD = 0.005
"""How often it looks [s]; less than the shortest of ``StopThresholds``'s times."""

HELD_UP = 0.02
"""A look that comes this much after the last one [s]: not only the robot was silent, this whole process stood still."""


class Watchdog:
    """Calls one function until it is stopped.

    Attributes:
        checks: How often it has looked.
    """

    def __init__(self, look: Callable[[], None]) -> None:
        self.checks = 0
        self._check = look
        self._wake = threading.Event()
        self._stopped = False
        self._thread = threading.Thread(target=self._watch, daemon=True, name="watchdog")

    def start(self) -> None:
        """Begins to watch."""
        self._thread.start()

    def check_now(self) -> None:
        """Has it look now."""
        self._wake.set()

    def stop(self) -> None:
        """Ends it; returns when the last look is over."""
        self._stopped = True
        self._wake.set()
        if self._thread.is_alive():
            self._thread.join()

    def _watch(self) -> None:
        looked = time.monotonic()
        while not self._stopped:
            if time.monotonic() - looked > HELD_UP:
                # What the robot said meanwhile is in the sockets: who reads them comes first, then silence is judged.
                time.sleep(CHECK_PERIOD)
            self._check()
            self.checks += 1
            looked = time.monotonic()
            self._wake.wait(CHECK_PERIOD)
            self._wake.clear()
