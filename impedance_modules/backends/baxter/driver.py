# SPDX-License-Identifier: BSD-3-Clause
"""Everything that is sent to a Baxter: each command passes ``Stops``, whichever thread asks for it.

``BaxterDriver`` combines ``Stops`` with a ``Commander`` (the publishers) and a ``Watchdog`` (a thread that sends zero
torque, then holds the arms, when the control loop or the robot is silent).
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping

from impedance_modules.arrays import Array
from impedance_modules.backends.baxter import topics
from impedance_modules.backends.baxter.joint_states import StateSample
from impedance_modules.backends.baxter.robot_link import RobotCallbacks, RobotLink
from impedance_modules.backends.baxter.ros.messages import AssemblyState, Float64, JointCommand, UInt16
from impedance_modules.backends.baxter.ros.transport import Publisher, Transport
from impedance_modules.backends.baxter.ros.wire import encode
from impedance_modules.backends.baxter.stops import DriveMode, Outgoing, Stops
from impedance_modules.errors import RobotRefused, RobotStopped
from impedance_modules.robot.model import Limb
from impedance_modules.safety.stop_levels import Event

ATTACH_TIME, ATTACH_LIMIT = 0.3, 2.0
"""Wait before the first command [s]: a robot needs about 0.24 s to connect to a new publisher; then it is too late."""

LAST_HOLD = 0.1
"""The last hold is repeated for at least this time [s]."""

HOLD_PERIOD = 0.009
"""Time between repetitions of a hold [s], about 100 Hz: one message may be lost."""

REQUEST_PERIOD = 1.0
"""Time between requests for the rate of the states [s]; the robot may have restarted its loop."""

CHECK_PERIOD = 0.005
"""Period of the watchdog [s]; less than the shortest time of ``StopThresholds``."""

PROCESS_PAUSE = 0.02
"""Above this time between two checks of the watchdog, this whole process was paused, not only the robot silent [s]."""


class BaxterDriver:
    """Commands some limbs of a robot as far as ``Stops`` permits, supervised by a watchdog.

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
        """Passes every message on to ``Stops`` from now on."""
        self._link.set_callbacks(
            RobotCallbacks(self._on_state, self._on_robot, self._on_collision, self._on_cuff)
        )

    def attach(self) -> None:
        """Advertises the commands, starts the watchdog and makes sure that the robot subscribes.

        Raises:
            RobotRefused: It does not.
        """
        self._commander = Commander(self._link.transport, self._limbs)
        self._watchdog = Watchdog(self._check)
        self._watchdog.start()
        missing = self._commander.wait_for_subscribers()
        if missing:
            raise RobotRefused(
                f"nobody listens to {', '.join(missing)}: the robot's software has another"
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
        """Encodes a torque (n,) [N.m] as ``torque`` would; sends nothing."""
        if self._commander is not None:
            self._commander.warm_up(effort)

    def end(self) -> None:
        """Ends torque mode as planned: a hold is sent at once, and repeated by the watchdog."""
        with self._lock:
            self.stops.end()
            now = time.monotonic()
            self._send(self.stops.watch(now))
            self._next_hold = now + HOLD_PERIOD

    def raise_if_stopped(self) -> None:
        """Raises RobotStopped once something has ended torque control."""
        reason = self.stops.reason
        if reason is not None:
            raise RobotStopped(reason.event, reason.detail)

    def restore_settings(self) -> None:
        """Waits while the hold is repeated, then restores the robot's own time-out and rate."""
        end = max(time.monotonic() + LAST_HOLD, self.stops.pause_end)
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
        """Called by the watchdog: sends what must be sent though the control loop did not ask."""
        now = time.monotonic()
        with self._lock:
            command = self.stops.watch(now)
            if command.position is None or now >= self._next_hold:
                self._send(command)
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
            self.stops.on_state(sample.taken, sample.state.position)

    def _on_robot(self, robot: AssemblyState, received: float) -> None:
        with self._lock:
            self.stops.on_robot(received, robot)
        self._check_if_stopped()

    def _on_collision(self, limb: str, detected: bool, received: float) -> None:
        with self._lock:
            self.stops.on_collision(received, limb, detected)
        self._check_if_stopped()

    def _on_cuff(self, limb: str, squeezed: bool) -> None:
        with self._lock:
            self.stops.on_cuff(limb, squeezed)
        self._check_if_stopped()

    def _check_if_stopped(self) -> None:
        if self.stops.reason is not None and self._watchdog is not None:
            self._watchdog.check_now()

    def _send(self, command: Outgoing) -> None:
        if self._commander is not None:
            self._commander.send(command)


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

    def wait_for_subscribers(self) -> tuple[str, ...]:
        """Waits until each limb's commands and time-out have a subscriber; names the topics that have none in time.

        A time-out that the robot does not hear leaves it its own: 0.2 s with the last torque.
        """
        limit = time.monotonic() + ATTACH_LIMIT
        time.sleep(ATTACH_TIME)
        while (missing := self._without_subscriber()) and time.monotonic() < limit:
            time.sleep(CHECK_PERIOD)
        return missing

    def _without_subscriber(self) -> tuple[str, ...]:
        listening = {topics.joint_command(name): of.connections() for name, of in self._commands.items()}
        listening |= {topics.command_timeout(name): of.connections() for name, of in self._timeouts.items()}
        return tuple(topic for topic, count in listening.items() if count == 0)

    def send(self, outgoing: Outgoing) -> None:
        """Sends a command to each of its limbs."""
        if outgoing.effort is not None:
            mode, values = JointCommand.TORQUE_MODE, outgoing.effort
        elif outgoing.position is not None:
            mode, values = JointCommand.POSITION_MODE, outgoing.position
        else:
            return
        for name in outgoing.limbs:
            limb = self._limbs[name]
            command = tuple(values[limb.joints].tolist())
            self._commands[name].send(JointCommand(mode, command, limb.joint_names))

    def warm_up(self, effort: Array) -> None:
        """Encodes the torques (n,) [N.m] of all limbs as ``send`` does, and sends nothing."""
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


class Watchdog:
    """A thread that calls one function every ``CHECK_PERIOD`` until it is stopped."""

    def __init__(self, check: Callable[[], None]) -> None:
        self._check = check
        self._wake = threading.Event()
        self._stopped = False
        self._thread = threading.Thread(target=self._watch, daemon=True, name="watchdog")

    def start(self) -> None:
        """Starts the thread."""
        self._thread.start()

    def check_now(self) -> None:
        """Has it call the function now."""
        self._wake.set()

    def stop(self) -> None:
        """Ends the thread; returns when the last call is over."""
        self._stopped = True
        self._wake.set()
        if self._thread.is_alive():
            self._thread.join()

    def _watch(self) -> None:
        checked = time.monotonic()
        while not self._stopped:
            if time.monotonic() - checked > PROCESS_PAUSE:
                # The messages of this pause are still in the sockets: they are read before silence is concluded.
                time.sleep(CHECK_PERIOD)
            self._check()
            checked = time.monotonic()
            self._wake.wait(CHECK_PERIOD)
            self._wake.clear()
