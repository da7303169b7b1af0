# SPDX-License-Identifier: BSD-3-Clause
"""A real Baxter behind the four methods of ``Backend``: ticks on its states, watched by a thread of its own."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impedance_modules.backends.backend import Finish, FirstState
from impedance_modules.backends.baxter import topics
from impedance_modules.backends.baxter.approach import Approach
from impedance_modules.backends.baxter.commander import Commander
from impedance_modules.backends.baxter.joint_states import Sample
from impedance_modules.backends.baxter.link import Listener, RobotLink
from impedance_modules.backends.baxter.messages import AssemblyState
from impedance_modules.backends.baxter.sea_columns import SeaColumns
from impedance_modules.backends.baxter.stops import Mode, Order, Stops
from impedance_modules.backends.baxter.watchdog import Watchdog
from impedance_modules.errors import NotConnected, RobotRefused, RobotStopped
from impedance_modules.robot.model import Limb
from impedance_modules.robot.state import RobotState
from impedance_modules.safety.stop_events import Event

Array = NDArray[np.float64]

PATIENCE = 1.5
"""A state is awaited for so many periods; later ones for one period each."""

ATTACH_TIME = 0.3
"""Before the first command: a robot needs about 0.24 s to connect to a new publisher [s]."""

DWELL = 0.3
"""How long zero torque is tried before a run [s]."""

DRIFT = 0.05
"""A joint that moves further than this at zero torque is not carried by the robot [rad]."""

RAMP = 0.2
"""In which the torque goes to zero at the end of a run [s]."""

PARTING_HOLD = 0.1
"""For how long the last hold is repeated at least [s]."""

HOLD_PERIOD = 0.009
"""A hold is repeated this often [s], about 100 Hz: one message may be lost."""

RATE_TIME = 3.0
"""Longest wait for the states to come at the rate asked for [s]."""

RATE_TOLERANCE = 0.1


@dataclass(frozen=True)
class DriveOptions:
    """How a run drives the robot.

    Attributes:
        rate: Control rate [Hz]; the states must come at it.
        read_only: Sends nothing at all.
        approach: Lets the robot's position mode bring the arms to ``start`` first; without it, a robot that
            stands elsewhere is refused.
        start: (n,) where the task begins [rad].
    """

    rate: float
    read_only: bool
    approach: bool
    start: Array


class BaxterBackend:
    """Drives some limbs of a robot that has passed its gates.

    Attributes:
        stops: What may be sent, and why not.
    """

    def __init__(
        self,
        link: RobotLink,
        limbs: Mapping[str, Limb],
        stops: Stops,
        options: DriveOptions,
        check: Callable[[], None],
    ) -> None:
        """Takes the robot; nothing is advertised or sent before ``start``.

        Args:
            link: Listening.
            limbs: Those that are commanded.
            stops: Idle.
            options: Of the run.
            check: Raises RobotRefused when the robot must not be moved; asked when the run begins.
        """
        self.stops, self._check = stops, check
        self._link, self._limbs, self._options = link, limbs, options
        self._period = 1.0 / options.rate
        self._lock = threading.RLock()
        self._commander: Commander | None = None
        self._watchdog: Watchdog | None = None
        self._extra = SeaColumns(link.sea)
        self._last: Sample | None = None
        self._zero_time = 0.0
        self._misses = 0
        self._effort = np.zeros(len(options.start))
        self._next_request = self._next_hold = 0.0

    def start(self) -> FirstState:
        """Prepares the robot: rate, start pose, a try at zero torque, time-out; leaves it held where it stands.

        Raises:
            RobotRefused: It does not keep the rate, does not listen, stands elsewhere or drifts at zero torque.
        """
        with ExitStack() as undo:
            undo.callback(self._leave)
            self._check()
            self._listen()
            if not self._options.read_only:
                self._attach()
            self._check_rate()
            if not self._options.read_only:
                self._prepare()
            first = self.newest()
            undo.pop_all()
        return first

    def newest(self) -> FirstState:
        """Waits for a state newer than all before, and counts time from it."""
        sample = self._fresh_sample()
        self._last, self._zero_time, self._misses = sample, sample.state.time, 0
        return FirstState(self._shifted(sample.state), np.zeros(len(self._options.start)))

    def read(self) -> RobotState | None:
        """Waits for the next state; None when it is late.

        Raises:
            RobotStopped: The robot, or the watchdog, has ended torque control.
        """
        last = self._last
        if last is None:
            raise NotConnected("the robot is not connected: call start() first")
        patience = PATIENCE if self._misses == 0 else self._misses + 1.0
        deadline = last.received + patience * self._period
        while True:
            self._raise_fault()
            left = deadline - time.monotonic()
            sample = self._link.wait(last.number, max(left, 0.0))
            if sample is not None:
                self._last, self._misses = sample, 0
                return self._shifted(sample.state)
            if time.monotonic() >= deadline:
                self._misses += 1
                return None

    def write(self, effort: Array) -> None:
        """Sends one torque command (n,) [N.m], or what must be sent in its place.

        Raises:
            RobotStopped: Torque mode cannot begin.
        """
        if self.stops.mode in (Mode.IDLE, Mode.HOLD) and self.stops.fault is None:
            self._begin()
        with self._lock:
            self._effort = effort.copy()
            self._send(self.stops.torque(time.monotonic(), effort))

    def extra_columns(self) -> tuple[str, ...]:
        """Names what the robot says it adds by itself."""
        return self._extra.names

    def extra_values(self) -> Array:
        """What it last said of that [N.m]."""
        return self._extra.values()

    def finish(self, how: Finish) -> None:
        """Ends torque control: torque to zero, then position mode where the robot is; or nothing, for ``release``."""
        if self._commander is not None and self.stops.mode is not Mode.OFF and how == "hold":
            self._ramp_down()
            with self._lock:
                self.stops.end()
            self._part()
        self._leave()

    # --- the beginning

    def _listen(self) -> None:
        self._link.tell(Listener(self._on_state, self._on_robot, self._on_collision, self._on_cuff))

    def _attach(self) -> None:
        """Advertises the commands and makes sure that the robot listens."""
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

    def _prepare(self) -> None:
        """Brings the arms to the start, sets the time-out, tries zero torque."""
        approach = Approach(self._limbs, self._options.start, self._options.approach)
        approach.go(self._link, self._move)
        if self._commander is not None:
            self._commander.set_timeout(topics.timeout_for(self._options.rate))
        self._try_zero_torque()

    def _move(self, position: Array) -> None:
        with self._lock:
            why = self.stops.move(position)
        if why is not None:
            raise RobotStopped(Event.BACKEND_LOST, f"the arms stop on their way to the start: {why}")

    def _check_rate(self) -> None:
        """Waits until the states come at the control rate."""
        asked, end = self._options.rate, time.monotonic() + RATE_TIME
        while abs(self._link.rate(time.monotonic()) - asked) > RATE_TOLERANCE * asked:
            if time.monotonic() > end:
                measured = self._link.rate(time.monotonic())
                raise RobotRefused(
                    f"the robot's states come at {measured:.0f} Hz, not at the control rate of {asked:.0f} Hz"
                    f" (valid: --rate {max(round(measured, -1), 100):.0f}, or a wired, quiet network)"
                )
            time.sleep(0.05)

    def _try_zero_torque(self) -> None:
        """Lets the robot carry its arms alone for a moment, then has it hold them; a drifting one is refused."""
        self._begin()
        start = self._fresh_sample()
        nothing = np.zeros(len(self._options.start))
        end, sample = time.monotonic() + DWELL, start
        while time.monotonic() < end:
            with self._lock:
                self._send(self.stops.torque(time.monotonic(), nothing))
            sample = self._link.wait(sample.number, self._period) or sample
            self._raise_fault()
            moved = np.abs(sample.state.position - start.state.position)
            joints = np.concatenate([limb.joints for limb in self._limbs.values()])
            if moved[joints].max() > DRIFT:
                raise RobotRefused(
                    f"an arm moved by {moved[joints].max():.3f} rad in {DWELL:g} s at zero torque: the robot does not"
                    " carry it (a tool that it does not know? somebody suppressing its gravity compensation?)"
                )
        with self._lock:
            self.stops.end()

    def _begin(self) -> None:
        """Starts torque mode on a fresh state."""
        self._fresh_sample()
        with self._lock:
            why = self.stops.begin(time.monotonic())
        if why is not None:
            raise RobotStopped(Event.BACKEND_LOST, f"torque mode cannot begin: {why}")

    # --- the end

    def _ramp_down(self) -> None:
        """Takes the last torque to zero, unless something else has ended torque control already."""
        began = time.monotonic()
        while self.stops.mode is Mode.TORQUE and time.monotonic() - began < RAMP:
            left = 1.0 - (time.monotonic() - began) / RAMP
            with self._lock:
                self._send(self.stops.torque(time.monotonic(), left * self._effort))
            time.sleep(self._period)

    def _part(self) -> None:
        """Repeats the hold for a while, then gives the robot its own time-out and rate back."""
        end = max(time.monotonic() + PARTING_HOLD, self.stops.pause_end)
        while self.stops.mode is Mode.HOLD and time.monotonic() < end:
            time.sleep(0.01)
        if self._commander is not None:
            self._commander.set_timeout(topics.DEFAULT_TIMEOUT)
            self._commander.ask_rate(topics.DEFAULT_STATE_RATE)

    def _leave(self) -> None:
        """Sends nothing any more and withdraws from the network."""
        with self._lock:
            self.stops.leave()
        if self._watchdog is not None:
            self._watchdog.stop()
        self._link.tell(None)
        if self._commander is not None:
            self._commander.close()
        self._link.close()
        self._link.transport.close()

    # --- what others' threads do

    def _look(self) -> None:
        """The watchdog's: sends what must be sent though nobody asked."""
        now = time.monotonic()
        with self._lock:
            order = self.stops.watch(now)
            if order.position is None or now >= self._next_hold:
                self._send(order)
                self._next_hold = now + HOLD_PERIOD
            if self._commander is not None and now >= self._next_request and self.stops.mode is not Mode.OFF:
                self._commander.ask_rate(round(self._options.rate))
                self._next_request = now + 1.0
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

    # --- small things

    def _send(self, order: Order) -> None:
        if self._commander is not None:
            self._commander.send(order)

    def _raise_fault(self) -> None:
        fault = self.stops.fault
        if fault is not None:
            raise RobotStopped(fault.event, fault.detail)

    def _fresh_sample(self) -> Sample:
        """Waits for a state newer than the last one."""
        before = 0 if self._link.sample is None else self._link.sample.number
        sample = self._link.wait(before, 1.0)
        if sample is None:
            raise RobotRefused("no state of the arms for 1 s: is the robot on, and does 'baxter check' pass?")
        return sample

    def _shifted(self, state: RobotState) -> RobotState:
        """Counts time from the run's first state."""
        return RobotState(state.time - self._zero_time, state.position, state.velocity, state.effort)
