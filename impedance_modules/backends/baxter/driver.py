# SPDX-License-Identifier: BSD-3-Clause
"""The hand on the robot: everything that is sent goes through ``Stops`` here, whichever thread asks."""

from __future__ import annotations

import threading
import time
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from impedance_modules.backends.baxter import topics
from impedance_modules.backends.baxter.commander import Commander
from impedance_modules.backends.baxter.joint_states import Sample
from impedance_modules.backends.baxter.link import Listener, RobotLink
from impedance_modules.backends.baxter.messages import AssemblyState
from impedance_modules.backends.baxter.stop_rules import Mode, Order
from impedance_modules.backends.baxter.stops import Stops
from impedance_modules.backends.baxter.watchdog import Watchdog
from impedance_modules.errors import RobotRefused, RobotStopped
from impedance_modules.robot.model import Limb
from impedance_modules.safety.stop_levels import Event

Array = NDArray[np.float64]

ATTACH_TIME = 0.3
"""Before the first command: a robot needs about 0.24 s to connect to a new publisher [s]."""

PARTING_HOLD = 0.1
"""For how long the last hold is repeated at least [s]."""

HOLD_PERIOD = 0.009
"""A hold is repeated this often [s], about 100 Hz: one message may be lost."""

REQUEST_PERIOD = 1.0
"""The rate of the states is asked for again this often [s]; the robot may have restarted its loop."""


class Driver:
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
        self._link.tell(Listener(self._on_state, self._on_robot, self._on_collision, self._on_cuff))

    def attach(self) -> None:
        """Advertises the commands, starts the watchdog and makes sure that the robot listens.

        Raises:
            RobotRefused: It does not.
        """
        self._commander = Commander(self._link.transport, self._limbs)
        self._watchdog = Watchdog(self._look)
        self._watchdog.start()
        time.sleep(ATTACH_TIME)
        deaf = self._commander.deaf()
        if deaf:
            raise RobotRefused(
                f"nobody listens to the commands of {', '.join(deaf)}: the robot's software has another"
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

    def rehearse(self, effort: Array) -> None:
        """Goes through the motions of sending a torque; sends nothing."""
        if self._commander is not None:
            self._commander.rehearse(effort)

    def end(self) -> None:
        """Ends torque mode as planned: the hold leaves at once, from now on the watchdog repeats it."""
        with self._lock:
            self.stops.end()
            now = time.monotonic()
            self._send(self.stops.watch(now))
            self._next_hold = now + HOLD_PERIOD

    def raise_fault(self) -> None:
        """Raises RobotStopped once something has ended torque control."""
        fault = self.stops.fault
        if fault is not None:
            raise RobotStopped(fault.event, fault.detail)

    def part(self) -> None:
        """Lets the hold be repeated for a while, then gives the robot its own time-out and rate back."""
        end = max(time.monotonic() + PARTING_HOLD, self.stops.pause_end)
        while self.stops.mode is Mode.HOLD and time.monotonic() < end:
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
        self._link.tell(None)
        if self._commander is not None:
            self._commander.close()
        self._link.close()
        self._link.transport.close()

    def _look(self) -> None:
        """The watchdog's: sends what must be sent though nobody asked."""
        now = time.monotonic()
        with self._lock:
            order = self.stops.watch(now)
            if order.position is None or now >= self._next_hold:
                self._send(order)
                self._next_hold = now + HOLD_PERIOD
            if self._commander is not None and now >= self._next_request and self.stops.mode is not Mode.OFF:
                self._commander.ask_rate(round(self._rate))
                self._next_request = now + REQUEST_PERIOD
        if self.stops.fault is not None:
            self._link.wake()

    def _on_state(self, sample: Sample) -> None:
        with self._lock:
            self.stops.on_state(sample.taken, sample.state.position, sample.state.velocity)

    def _on_robot(self, robot: AssemblyState, received: float) -> None:
        with self._lock:
            self.stops.on_robot(received, robot)
        self._hurry()

    def _on_collision(self, limb: str, felt: bool, received: float) -> None:
        with self._lock:
            self.stops.on_collision(received, limb, felt)
        self._hurry()

    def _on_cuff(self, limb: str, squeezed: bool) -> None:
        with self._lock:
            self.stops.on_cuff(limb, squeezed)
        self._hurry()

    def _hurry(self) -> None:
        if self.stops.fault is not None and self._watchdog is not None:
            self._watchdog.hurry()

    def _send(self, order: Order) -> None:
        if self._commander is not None:
            self._commander.send(order)
