# SPDX-License-Identifier: BSD-3-Clause
"""A real Baxter behind the four methods of ``Backend``: each state that arrives starts one control cycle.

A watchdog thread of the driver supervises it. Between two states the next cycle is computed once in advance (warm-up)
and the CPU is kept out of deep idle states, because caches and CPU otherwise need longer than the computation.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.backends.baxter import topics
from impedance_modules.backends.baxter.driver import BaxterDriver
from impedance_modules.backends.baxter.gripper_link import GripperLink
from impedance_modules.backends.baxter.joint_states import StateSample
from impedance_modules.backends.baxter.position_mode import Approach
from impedance_modules.backends.baxter.robot_link import RobotLink, SeaColumns
from impedance_modules.backends.baxter.stops import DriveMode, Stops
from impedance_modules.backends.computer import SWITCH_INTERVAL, CpuIdleInhibitor
from impedance_modules.backends.grippers import GripperReport
from impedance_modules.backends.protocol import Finish, FirstState
from impedance_modules.errors import NotConnected, RobotRefused
from impedance_modules.robot.model import Limb
from impedance_modules.robot.state import RobotState
from impedance_modules.spec.gripper_spec import GripperMotion

PATIENCE = 1.5
"""Longest wait for a state, in periods; after a miss the next wait is one period longer each time."""

GRACE = 0.001
"""Shortest wait for a state [s]: after a pause of this process itself, one is already in the socket."""

DWELL = 0.3
"""How long zero torque is tried before a run [s]."""

DRIFT = 0.05
"""Where a joint moves further than this at zero torque, the robot does not compensate gravity [rad]."""

RAMP = 0.2
"""Time in which the torque goes to zero at the end of a run [s]."""

RATE_TIME = 3.0
"""Longest wait for the states to come at the rate asked for [s]."""

RATE_TOLERANCE = 0.1
"""Relative difference between measured and requested rate that is accepted."""

COLD_AFTER = 0.005
"""Above this period other processes displace this one from the CPU caches between two states [s]."""

WARM_UP_PART = 0.15
"""Last part of a period in which a warm-up cycle is computed: the first one is slow, as the real one would have been;
the last one ends just before the state is due."""

MOST_WARM_UPS = 5
"""Most warm-up cycles per period."""

WARM_UP_MARGIN = 0.0001
"""No warm-up cycle runs in this time before the state is due [s], since it may come early."""


@dataclass(frozen=True)
class DriveOptions:
    """How a run drives the robot.

    Attributes:
        rate: Control rate [Hz]; the states must come at it.
        read_only: Sends nothing at all.
        approach: Lets the robot's position mode bring the arms to ``start`` first; without it, a robot that
            stands elsewhere is refused.
        start: (n,) where the task begins [rad].
        grippers: Limbs whose grippers the task orders.
    """

    rate: float
    read_only: bool
    approach: bool
    start: Array
    grippers: tuple[str, ...] = ()


class BaxterBackend:
    """Drives some limbs of a robot that has passed its preflight checks.

    Attributes:
        driver: Sends everything.
    """

    def __init__(
        self,
        link: RobotLink,
        limbs: Mapping[str, Limb],
        stops: Stops,
        options: DriveOptions,
        check: Callable[[], None],
        grippers: Mapping[str, GripperLink] | None = None,
    ) -> None:
        """Takes the robot; nothing is advertised or sent before ``start``.

        Args:
            link: Listening.
            limbs: Those that are commanded.
            stops: Idle.
            options: Of the run.
            check: Raises RobotRefused when the robot must not be moved; called when the run begins.
            grippers: Those that take orders, listening.
        """
        self.driver = BaxterDriver(link, limbs, stops, options.rate)
        self._stops, self._check = stops, check
        self._link, self._limbs, self._options = link, limbs, options
        self._grippers = {} if grippers is None else grippers
        self._period = 1.0 / options.rate
        self._extra = SeaColumns(link.sea)
        self._last: StateSample | None = None
        self._zero_time = 0.0
        self._misses = 0
        self._warm_up: Callable[[], None] | None = None
        self._effort: Array = np.zeros(len(options.start))
        self._usual_interval = sys.getswitchinterval()
        self._idle_inhibitor = CpuIdleInhibitor()

    def start(self) -> FirstState:
        """Prepares the robot: rate, start pose, a test of zero torque, time-out; leaves it held where it stands.

        Raises:
            RobotRefused: A preflight check failed, or it does not keep the rate, does not subscribe, stands
                elsewhere or drifts at zero torque.
            RobotStopped: It was switched off, led by hand or hit meanwhile.
        """
        with ExitStack() as undo:
            undo.callback(self._leave)
            self._check()
            self._link.unsubscribe_endpoints()
            sys.setswitchinterval(SWITCH_INTERVAL)
            self._idle_inhibitor.begin()
            self.driver.listen()
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
        self._warm_up_before(last)
        deadline = last.received + (PATIENCE + self._misses) * self._period
        while True:
            self.driver.raise_if_stopped()
            sample = self._link.wait(last.number, max(deadline - time.monotonic(), GRACE))
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
        if self._stops.mode in (DriveMode.IDLE, DriveMode.HOLD) and self._stops.reason is None:
            # Now, not with the next state: this torque belongs to the state just read.
            self.driver.begin()
        np.copyto(self._effort, effort)
        self.driver.torque(effort)

    def gripper_limbs(self) -> tuple[str, ...]:
        """Names the limbs whose electric grippers take orders."""
        return tuple(self._grippers)

    def order_gripper(self, limb: str, motion: GripperMotion) -> None:
        """Hands an order on; sent at once, never waited for."""
        self._grippers[limb].order(motion)

    def gripper_report(self, limb: str) -> GripperReport:
        """What is known of a gripper now."""
        return self._grippers[limb].report()

    def warm_up_with(self, cycle: Callable[[], None]) -> None:
        """Calls ``cycle`` shortly before each state is due, unless states come so fast that the caches stay warm."""
        if self._period >= COLD_AFTER:
            self._warm_up = cycle

    def extra_columns(self) -> tuple[str, ...]:
        """Names the torques that the robot reports to add by itself."""
        return self._extra.names

    def extra_values(self) -> Array:
        """Newest value of each [N.m]."""
        return self._extra.values()

    def finish(self, how: Finish) -> None:
        """Ends torque control: torque to zero, then position mode where the robot is; or nothing, for ``release``."""
        if not self._options.read_only and self._stops.mode is not DriveMode.OFF and how == "hold":
            self._ramp_down()
            self.driver.end()
            self.driver.restore_settings()
        self._leave()

    def _warm_up_before(self, last: StateSample) -> None:
        """Computes a cycle in advance, repeatedly, until the next state is due or has come; sends nothing."""
        if self._warm_up is None or self._misses > 0:
            return
        due = last.received + self._period
        moment, lasted = due - WARM_UP_PART * self._period, 0.0
        for _ in range(MOST_WARM_UPS):
            if self._link.wait(last.number, max(moment - time.monotonic(), 0.0)) is not None:
                return
            moment = time.monotonic()
            if moment + lasted > due - WARM_UP_MARGIN:
                return
            self._warm_up()
            self._link.warm_up()
            self.driver.warm_up(self._effort)
            lasted = time.monotonic() - moment

    def _attach(self) -> None:
        """Advertises the commands of arms and grippers, and makes sure that the robot subscribes."""
        for gripper in self._grippers.values():
            gripper.attach()
        self.driver.attach()
        for gripper in self._grippers.values():
            gripper.refuse_without_subscriber()

    def _prepare(self) -> None:
        """Brings the arms to the start, sets the time-out, tries zero torque."""
        approach = Approach(self._limbs, self._options.start, self._options.approach)
        approach.go(self._link, self.driver.move)
        self.driver.set_timeout(topics.timeout_for(self._options.rate))
        self._try_zero_torque()

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
        """Commands zero torque for a moment, then a hold; refuses a robot whose arms drift."""
        start = self._fresh_sample()
        self.driver.begin()
        zero = np.zeros(len(self._options.start))
        joints = np.concatenate([limb.joints for limb in self._limbs.values()])
        end, sample = time.monotonic() + DWELL, start
        while time.monotonic() < end:
            self.driver.torque(zero)
            sample = self._link.wait(sample.number, self._period) or sample
            self.driver.raise_if_stopped()
            moved = float(np.abs(sample.state.position - start.state.position)[joints].max())
            if moved > DRIFT:
                raise RobotRefused(
                    f"an arm moved by {moved:.3f} rad in {DWELL:g} s at zero torque: the robot does not carry it"
                    " (valid: no tool that it does not know, nobody suppressing its gravity compensation)"
                )
        self.driver.end()

    def _ramp_down(self) -> None:
        """Takes the last torque to zero, unless something else has ended torque control already."""
        began = time.monotonic()
        while self._stops.mode is DriveMode.TORQUE and time.monotonic() - began < RAMP:
            left = 1.0 - (time.monotonic() - began) / RAMP
            self.driver.torque(left * self._effort)
            time.sleep(self._period)

    def _leave(self) -> None:
        sys.setswitchinterval(self._usual_interval)
        self._idle_inhibitor.end()
        for gripper in self._grippers.values():
            gripper.close()
        self.driver.leave()

    def _fresh_sample(self) -> StateSample:
        """Waits for a state newer than the last one."""
        before = 0 if self._link.sample is None else self._link.sample.number
        sample = self._link.wait(before, 1.0)
        if sample is None:
            raise RobotRefused("no state of the arms for 1 s: is the robot on, and does 'baxter check' pass?")
        return sample

    def _shifted(self, state: RobotState) -> RobotState:
        """Counts time from the run's first state."""
        return RobotState(state.time - self._zero_time, state.position, state.velocity, state.effort)
