# SPDX-License-Identifier: BSD-3-Clause
"""Franka arms behind the four methods of ``Backend``: the states of the first arm are the clock of the control loop.

Each arm has a process of its own (``arm_process``), which answers every state of its robot at 1 kHz. The control loop
may be slower by a whole factor: it then takes every second, third ... state. Two robots have two clocks: of the other
arms the newest state is taken, which is at most one of their cycles older.
"""

from __future__ import annotations

import select
import sys
import time
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.backends.computer import SWITCH_INTERVAL, CpuIdleInhibitor
from impedance_modules.backends.franka.arm_link import ArmLink, remedy
from impedance_modules.backends.franka.arm_messages import REFLEX, ArmReport, OrderKind
from impedance_modules.backends.franka.franka_checks import NEAR, CheckedArm, check_arms
from impedance_modules.backends.franka.hand_link import KIND, HandLink
from impedance_modules.backends.grippers import GripperReport
from impedance_modules.backends.preflight import PreflightResult, refuse_failed
from impedance_modules.backends.protocol import Finish, FirstState
from impedance_modules.errors import NotConnected, RobotRefused, RobotStopped
from impedance_modules.robot.model import Limb, RobotModel
from impedance_modules.robot.state import RobotState
from impedance_modules.safety.stop_levels import Event
from impedance_modules.spec.connection_file import FrankaConnection
from impedance_modules.spec.gripper_spec import GripperMotion

ROBOT_PERIOD = 0.001
"""Of the robots' own loops [s]."""

CONNECT_TIME = 10.0
"""Longest wait for a robot to answer [s]."""

LISTENING = 0.5
"""Time in which the rate of the states is measured [s]."""

DWELL = 0.3
"""How long zero torque is tried before a run, on the robot's clock [s]."""

DRIFT = 0.05
"""Where a joint moves further than this at zero torque, the robot does not carry its arm [rad]."""

MODE_TIME = 3.0
"""Longest wait for a mode to begin or end [s]."""

MOVE_TIME = 60.0
"""Longest way to a start pose [s]."""

COMPANION_WAIT = 0.0002
"""How long the other arms' states of the same moment are waited for [s]."""


ARM_COLUMNS = ("states_lost", "success", "answer_time", "fresh_torque", "robot_time", "arrival")
"""Recorded of each arm: states never seen, the robot's own share of received commands, time until the command for the
state before left [s], whether that was the torque of that very state, and the state's time by the robot's clock and its
arrival by ours [s]."""


@dataclass(frozen=True)
class FrankaOptions:
    """How a run drives the robots.

    Attributes:
        rate: Control rate [Hz]; a whole part of 1000.
        read_only: Sends nothing at all.
        approach: Lets the robots' own position mode bring the arms to ``start`` first.
        recover: Asks a robot that a reflex has stopped for its automatic error recovery first.
        start: (n,) where the task begins [rad].
        grippers: Limbs whose grippers the task orders.
    """

    rate: float
    read_only: bool
    approach: bool
    recover: bool
    start: Array
    grippers: tuple[str, ...] = ()


class FrankaBackend:
    """Drives the arms of a task; those that it leaves out are read."""

    def __init__(
        self,
        model: RobotModel,
        commanded: Mapping[str, Limb],
        connection: FrankaConnection,
        options: FrankaOptions,
        of_task: Callable[[RobotState], tuple[PreflightResult, ...]],
    ) -> None:
        """Takes what the run says; nothing is connected before ``start``.

        Args:
            model: Of the robot.
            commanded: Limbs of the task.
            connection: Addresses of all limbs, and the watch.
            options: Of the run.
            of_task: The task's own checks of a state at rest.
        """
        self._model, self._commanded, self._options = model, commanded, options
        self._connection, self._watch = connection, connection.watch
        self._of_task = of_task
        # The first commanded arm leads: its states are the clock of the loop.
        self._names = [*commanded, *(name for name in model.limbs if name not in commanded)]
        self._links: dict[str, ArmLink] = {}
        self._hands: dict[str, HandLink] = {}
        self._divisor = round(1.0 / (ROBOT_PERIOD * options.rate))
        self._period = 1.0 / options.rate
        self._zero_time = self._last_time = 0.0
        self._read_at, self._misses = 0.0, 0
        self._idle_inhibitor = CpuIdleInhibitor()
        self._usual_interval = sys.getswitchinterval()

    def start(self) -> FirstState:
        """Connects, checks, recovers and approaches where asked to, tries zero torque; leaves the robots idle.

        Raises:
            RobotRefused: A robot cannot be reached or must not be moved; every reason with its remedy.
            RobotStopped: One stopped by itself meanwhile.
        """
        with ExitStack() as undo:
            undo.callback(self._leave)
            self._connect()
            sys.setswitchinterval(SWITCH_INTERVAL)
            self._idle_inhibitor.begin()
            if self._options.recover and not self._options.read_only:
                self._recover()
            self._check()
            if not self._options.read_only:
                self._approach()
                self._try_zero_torque()
            first = self._first_state()
            undo.pop_all()
        return first

    def newest(self) -> FirstState:
        """Begins torque mode at zero torque, waits for a state of it, and counts time from there."""
        if not self._options.read_only:
            self._begin_torque()
        return self._first_state()

    def read(self) -> RobotState | None:
        """Waits for the next state of all arms; None when it is late.

        Raises:
            RobotStopped: A robot, or what watches it, has ended torque control.
        """
        if not self._links:
            raise NotConnected("the robots are not connected: call start() first")
        leader = self._links[self._names[0]]
        deadline = self._read_at + self._watch.patience + self._misses * self._period
        due = self._last_time + (self._divisor - 0.5) * ROBOT_PERIOD
        while True:
            self._drain()
            if leader.report is not None and leader.report.time > due and self._companions_fresh(leader):
                return self._take(leader)
            left = deadline - time.monotonic()
            if left <= 0.0:
                self._misses += 1
                return None
            select.select(list(self._links.values()), [], [], left)

    def write(self, effort: Array) -> None:
        """Sends each commanded arm its part of a torque (n,) [N.m]."""
        for name, limb in self._commanded.items():
            self._links[name].order(OrderKind.TORQUE, effort[limb.joints].tolist())

    def gripper_limbs(self) -> tuple[str, ...]:
        """Names the limbs that have a Franka Hand."""
        limbs = self._model.spec.limbs.items()
        return tuple(name for name, limb in limbs if limb.gripper is not None and limb.gripper.kind == KIND)

    def order_gripper(self, limb: str, motion: GripperMotion) -> None:
        """Hands an order on to a hand's own process."""
        self._hands[limb].order(motion)

    def gripper_report(self, limb: str) -> GripperReport:
        """What is known of a hand now."""
        return self._hands[limb].report()

    def finish(self, how: Finish) -> None:  # noqa: ARG002 - a robot that left torque mode holds by itself
        """Takes every torque to zero and ends torque mode: the robots then hold by themselves."""
        if not self._links:
            return
        commanded = [self._links[name] for name in self._commanded]
        for link in commanded:
            link.order(OrderKind.END)
        for link in commanded:
            if link.report is not None and link.report.torque_mode > 0.0 and link.stop is None:
                link.wait_until_ended(MODE_TIME)
        self._leave()

    def warm_up_with(self, cycle: Callable[[], None]) -> None:
        """Does nothing: at these rates the caches stay warm."""

    def extra_columns(self) -> tuple[str, ...]:
        """Names what the arms' processes report beyond a state."""
        names = []
        for limb in self._names:
            names += [f"{kind}.{limb}" for kind in ARM_COLUMNS]
            names += [f"external.{joint}" for joint in self._model.limbs[limb].joint_names]
            names += [f"sent.{joint}" for joint in self._model.limbs[limb].joint_names]
        return tuple(names)

    def extra_values(self) -> Array:
        """Newest value of each; torques in N.m, times in s."""
        values: list[float] = []
        for limb in self._names:
            link = self._links[limb]
            report = link.report
            if report is None:
                values += [np.nan] * (len(ARM_COLUMNS) + 2 * len(self._model.limbs[limb].joint_names))
                continue
            values += [link.lost, report.success, report.answered, report.fresh, report.time, link.received]
            values += [*report.external, *report.sent]
        return np.array(values)

    def _connect(self) -> None:
        """Starts all processes and waits until each has a state, or refuses with all reasons."""
        for name in self._names:
            self._links[name] = ArmLink(
                name, self._connection.addresses[name], self._watch, realtime=self._connection.realtime
            )
        for name in self._options.grippers:
            gripper = self._model.spec.limbs[name].gripper
            if gripper is not None:
                self._hands[name] = HandLink(name, self._connection.addresses[name], gripper)
        problems = []
        for link in self._links.values():
            try:
                link.wait_for_report(CONNECT_TIME)
            except RobotRefused as refusal:
                known = "valid:" in str(refusal)
                problems.append(str(refusal) if known else f"{refusal} (valid: {remedy('Connection')})")
        for hand in self._hands.values():
            try:
                hand.wait_until_known(CONNECT_TIME)
            except RobotRefused as refusal:
                problems.append(str(refusal))
        if problems:
            raise RobotRefused("\n".join(problems))

    def _recover(self) -> None:
        """Asks the robots that a reflex has stopped, and only those, for their automatic error recovery."""
        for name in self._commanded:
            link = self._links[name]
            if link.report is not None and link.report.mode == REFLEX:
                link.begin(OrderKind.RECOVER, (0.0,) * 7)
                if not link.wait_until_ended(MOVE_TIME):
                    raise RobotRefused(
                        f"{name}: no answer to automatic error recovery (valid: what Desk says)"
                    )
                link.raise_if_refused()
                self._wait_for_mode(link, torque=False)

    def _check(self) -> None:
        """Measures the rate, makes every check, and refuses where one fails."""
        before = {name: link.wait_for_report(1.0).time for name, link in self._links.items()}
        began = time.monotonic()
        while time.monotonic() - began < LISTENING:
            select.select(list(self._links.values()), [], [], 0.05)
            for link in self._links.values():
                link.drain()
        arms = {
            name: self._checked_arm(link, before[name], time.monotonic() - began)
            for name, link in self._links.items()
        }
        brought = self._options.approach or self._options.read_only
        results = check_arms(arms, self._model, self._commanded, None if brought else self._options.start)
        own = self._of_task(self._state()) if not self._options.approach else ()
        refuse_failed((*results, *own), commanding=not self._options.read_only)

    def _checked_arm(self, link: ArmLink, before: float, seconds: float) -> CheckedArm:
        report = link.wait_for_report(1.0)
        rate = (report.time - before) / ROBOT_PERIOD / seconds
        return CheckedArm(link, report, rate, self._watch.least_rate)

    def _approach(self) -> None:
        """Brings the arms to the start by position mode where that was asked for and is needed."""
        if not self._options.approach:
            return
        goals = {name: self._options.start[limb.joints] for name, limb in self._commanded.items()}
        for name, goal in goals.items():
            self._links[name].begin(OrderKind.MOVE, goal.tolist())
        for name, goal in goals.items():
            link = self._links[name]
            ended = link.wait_until_ended(MOVE_TIME)
            link.raise_if_refused()
            off = float(np.abs(np.array(link.wait_for_report(1.0).position) - goal).max())
            if not ended or off > NEAR:
                raise RobotRefused(
                    f"{name}: the arm stopped {off:.3f} rad away from the start (valid: a free way)"
                )
        refuse_failed(self._of_task(self._state()), commanding=True)

    def _begin_torque(self) -> None:
        largest = self._model.column("effort_max")
        for name, limb in self._commanded.items():
            self._links[name].begin(OrderKind.BEGIN, largest[limb.joints].tolist())
        for name in self._commanded:
            self._wait_for_mode(self._links[name], torque=True)

    def _wait_for_mode(self, link: ArmLink, *, torque: bool) -> ArmReport:
        """Waits until an arm's reports say that torque mode is on, or that it is not."""
        end = time.monotonic() + MODE_TIME
        while True:
            report = link.wait_for_report(1.0)
            if (report.torque_mode > 0.0) == torque:
                return report
            if time.monotonic() > end:
                raise RobotRefused(f"{link.limb}: torque mode does not {'begin' if torque else 'end'}")

    def _try_zero_torque(self) -> None:
        """Commands zero torque for a moment, then ends it; refuses robots that drift or lose commands."""
        self._begin_torque()
        start = self._state()
        zero, end = np.zeros(self._model.n), self._time() + DWELL
        joints = np.concatenate([limb.joints for limb in self._commanded.values()])
        while self._time() < end:
            self.write(zero)
            self._links[self._names[0]].wait_for_report(1.0)
            self._drain()
            moved = float(np.abs(self._state().position - start.position)[joints].max())
            if moved > DRIFT:
                raise RobotRefused(
                    f"an arm moved by {moved:.3f} rad at zero torque: the robot does not carry it (valid: its tool and"
                    " its mounting as in Desk, nobody touching it)"
                )
        self._check_success()
        for name in self._commanded:
            self._links[name].order(OrderKind.END)
        for name in self._commanded:
            self._links[name].wait_until_ended(MODE_TIME)

    def _check_success(self) -> None:
        for name in self._commanded:
            share = self._links[name].wait_for_report(1.0).success
            if share < self._watch.least_success:
                raise RobotRefused(
                    f"{name}: the robot received {share:.0%} of the commands in time (valid:"
                    f" {self._watch.least_success:.0%} or more: a wired network, a real-time kernel, an idle computer)"
                )

    def _companions_fresh(self, leader: ArmLink) -> bool:
        """Whether the other arms' newest states are of this moment, or need not be waited for any longer."""
        now = time.monotonic()
        waited = now - leader.received > COMPANION_WAIT
        for link in self._links.values():
            age = leader.received - link.received
            if age > (self._watch.patience if waited else 0.5 * ROBOT_PERIOD):
                return False
        return True

    def _take(self, leader: ArmLink) -> RobotState:
        if leader.report is None:
            raise NotConnected("no state yet")
        self._last_time = leader.report.time
        self._read_at, self._misses = time.monotonic(), 0
        state = self._state()
        if not np.isfinite(state.position + state.velocity + state.effort).all():
            raise RobotStopped(Event.STATE_LOST, f"a state is not finite, {state.time:.3f} s after the start")
        return state

    def _drain(self) -> None:
        for link in self._links.values():
            link.drain()
            if link.stop is not None:
                raise link.stop
            if link.refused:
                raise RobotStopped(Event.ROBOT_REFLEX, f"{link.limb}: {link.refused}")

    def _first_state(self) -> FirstState:
        """Waits for new states of all arms and counts time from now."""
        for link in self._links.values():
            link.wait_for_report(1.0)
        self._drain()
        leader = self._links[self._names[0]].wait_for_report(1.0)
        self._zero_time = self._last_time = leader.time
        self._read_at, self._misses = time.monotonic(), 0
        return FirstState(self._state(), np.zeros(self._model.n))

    def _state(self) -> RobotState:
        """The newest state of every arm, in the model's order; time is the first arm's."""
        numbers = np.zeros((3, self._model.n))
        for name, link in self._links.items():
            report, joints = link.report, self._model.limbs[name].joints
            if report is None:
                raise NotConnected(f"{name}: no state yet")
            numbers[0, joints], numbers[1, joints] = report.position, report.velocity
            numbers[2, joints] = report.effort
        numbers.flags.writeable = False
        leader = self._links[self._names[0]].report
        seconds = 0.0 if leader is None else leader.time - self._zero_time
        return RobotState(seconds, numbers[0], numbers[1], numbers[2])

    def _time(self) -> float:
        """Of the first arm's newest state, on its robot's clock [s]."""
        report = self._links[self._names[0]].report
        if report is None:
            raise NotConnected("no state yet")
        return report.time

    def _leave(self) -> None:
        for link in self._links.values():
            link.close()
        for hand in self._hands.values():
            hand.close()
        self._links.clear()
        self._hands.clear()
        sys.setswitchinterval(self._usual_interval)
        self._idle_inhibitor.end()
