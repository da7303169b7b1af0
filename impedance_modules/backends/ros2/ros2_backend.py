# SPDX-License-Identifier: BSD-3-Clause
"""A robot on ROS 2 behind the four methods of ``Backend``: each joint state that is due starts one control cycle.

With ``gravity: controller`` the backend plays the part of a robot that carries its own weight: it adds g(q) of the
robot's model to every torque, and what the run records as its command is without it.

With ``effort: without_weight`` it adds g(q) to every measured effort, so that a recording's effort is the torque
between gearbox and link whatever the robot reports; what was reported has columns of its own.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.backends.computer import SWITCH_INTERVAL, CpuIdleInhibitor
from impedance_modules.backends.preflight import PreflightResult, refuse_failed
from impedance_modules.backends.protocol import Finish, FirstState
from impedance_modules.backends.ros2.ros2_checks import FINDING, LISTENING, Heard, check_robot
from impedance_modules.backends.ros2.ros2_link import Ros2Link
from impedance_modules.backends.ros2.ros2_node import DROPPED, RAMP, NodeSettings
from impedance_modules.errors import NotConnected, RobotRefused
from impedance_modules.robot.model import Limb, RobotModel
from impedance_modules.robot.state import RobotState
from impedance_modules.spec.connection_file import Ros2Connection

DWELL = 0.3
"""How long zero torque is tried before a run [s]."""

DRIFT = 0.05
"""Where a joint moves further than this at zero torque, the weight is carried by nobody, or twice [rad]."""

DUE = 0.6
"""Part of a control period after which the next state is taken: stamps tremble, and faster states are left out."""


@dataclass(frozen=True)
class Ros2Options:
    """How a run drives the robot.

    Attributes:
        rate: Control rate [Hz].
        read_only: Sends nothing at all.
        start: (n,) where the task begins [rad].
    """

    rate: float
    read_only: bool
    start: Array


class Ros2Backend:
    """Drives the arms of a task through effort controllers; those that it leaves out are read."""

    def __init__(
        self,
        model: RobotModel,
        commanded: Mapping[str, Limb],
        connection: Ros2Connection,
        options: Ros2Options,
        of_task: Callable[[RobotState], tuple[PreflightResult, ...]],
    ) -> None:
        """Takes what the run says; nothing is started before ``start``.

        Args:
            model: Of the robot.
            commanded: Limbs of the task.
            connection: Topics, order of joints, who carries the weight, what efforts hold, the watch.
            options: Of the run.
            of_task: The task's own checks of a state at rest.
        """
        self._model, self._commanded, self._connection = model, commanded, connection
        self._options, self._of_task = options, of_task
        self._period = 1.0 / options.rate
        self._adds_weight = connection.effort == "without_weight"
        self._link: Ros2Link | None = None
        self._zero_time = self._last_time = self._read_at = 0.0
        self._misses = 0
        self._no_weight = np.zeros(model.n)
        self._weight = self._no_weight
        self._idle_inhibitor = CpuIdleInhibitor()
        self._usual_interval = sys.getswitchinterval()

    def start(self) -> FirstState:
        """Joins the network, makes every check, tries zero torque.

        Raises:
            RobotRefused: The robot is not there or must not be moved; every reason with its remedy.
            RobotStopped: States stopped coming meanwhile.
        """
        with ExitStack() as undo:
            undo.callback(self._leave)
            self._link = Ros2Link(settings_of(self._model, self._connection), self._connection.python)
            sys.setswitchinterval(SWITCH_INTERVAL)
            self._idle_inhibitor.begin()
            self._check()
            if not self._options.read_only:
                self._try_zero_torque()
            first = self._first_state()
            undo.pop_all()
        return first

    def newest(self) -> FirstState:
        """Begins to publish zero torque, waits for a state, and counts time from there."""
        if not self._options.read_only:
            self._begin()
        return self._first_state()

    def read(self) -> RobotState | None:
        """Waits for the next state that is due; None when it is late.

        Raises:
            RobotStopped: States stopped, or the node has ended.
        """
        link = self._opened()
        deadline = self._read_at + self._connection.watch.patience + self._misses * self._period
        due = self._last_time + DUE * self._period
        while True:
            link.drain()
            self._raise_if_stopped(link)
            if link.moment > due:
                self._last_time, self._read_at, self._misses = link.moment, time.monotonic(), 0
                return self._state(link)
            left = deadline - time.monotonic()
            if left <= 0.0:
                self._misses += 1
                return None
            link.wait(left)

    def write(self, effort: Array) -> None:
        """Publishes a torque (n,) [N.m], with the weight where this program carries it."""
        self._opened().torque(effort, self._weight)

    def finish(self, how: Finish) -> None:  # noqa: ARG002 - an effort controller can do nothing but go to zero
        """Takes the task's torque to zero and publishes nothing any more; a weight that is carried stays published."""
        if self._link is None:
            return
        if not self._options.read_only and self._link.stop is None:
            self._link.end()
            self._link.wait_until_ended(RAMP + 1.0)
        self._leave()

    def warm_up_with(self, cycle: Callable[[], None]) -> None:
        """Does nothing: the node's process is the one that must be quick."""

    def extra_columns(self) -> tuple[str, ...]:
        """Names counts of dropped states, stamps, arrivals, the weight that was sent, efforts as reported."""
        counts = tuple(f"dropped.{why.replace(' ', '_')}" for why in DROPPED)
        joints = self._model.joint_names
        reported = tuple(f"reported_effort.{joint}" for joint in joints) if self._adds_weight else ()
        return (*counts, "stamp", "arrival", *(f"weight.{joint}" for joint in joints), *reported)

    def extra_values(self) -> Array:
        """Newest value of each [s], [N.m]."""
        link = self._opened()
        reported = link.numbers[2] if self._adds_weight else ()
        return np.array([*link.dropped, link.moment, link.received, *self._weight, *reported])

    def _opened(self) -> Ros2Link:
        if self._link is None:
            raise NotConnected("the robot is not connected: call start() first")
        return self._link

    def _check(self) -> None:
        """Listens for a while, makes every check, and refuses where one fails."""
        link = self._opened()
        graph = link.wait_for_graph()
        end = time.monotonic() + FINDING
        while link.states == 0 and time.monotonic() < end:
            link.raise_if_refused()
            link.wait(0.1)
        before, began = link.states, time.monotonic()
        efforts = []
        while time.monotonic() - began < LISTENING:
            link.wait(0.05)
            link.raise_if_refused()
            efforts.append(link.numbers[2])
        graph = link.graph or graph
        rate = (link.states - before) / (time.monotonic() - began)
        state = self._state(link) if link.states else None
        heard = Heard(graph, link.dropped, rate, state, np.mean(efforts, axis=0))
        results = check_robot(heard, self._model, self._commanded, self._connection, self._options.rate)
        own: Sequence[PreflightResult] = ()
        if heard.state is not None:
            start = None if self._options.read_only else self._options.start
            own = (*self._check_start(heard.state, start), *self._of_task(heard.state))
        refuse_failed((*results, *own), commanding=not self._options.read_only)

    def _check_start(self, state: RobotState, start: Array | None) -> tuple[PreflightResult, ...]:
        if start is None:
            return ()
        joints = np.concatenate([limb.joints for limb in self._commanded.values()])
        off = np.abs(state.position - start)[joints]
        worst = int(np.argmax(off))
        found = f"{self._model.joint_names[joints[worst]]} is {off[worst]:.3f} rad away from where the task begins"
        remedy = "within 0.1 rad, brought there by a trajectory controller"
        return (PreflightResult("start", bool(off[worst] <= 0.1), found, remedy),)

    def _begin(self) -> None:
        link = self._opened()
        link.wait_for_state(1.0)
        self._weigh(link)
        link.begin(self._weight)

    def _try_zero_torque(self) -> None:
        """Publishes zero torque for a moment; refuses a robot that drifts."""
        self._begin()
        link = self._opened()
        start, end = link.numbers[0].copy(), time.monotonic() + DWELL
        joints = np.concatenate([limb.joints for limb in self._commanded.values()])
        while time.monotonic() < end:
            link.wait_for_state(1.0)
            self._raise_if_stopped(link)
            self._weigh(link)
            link.torque(self._no_weight, self._weight)
            moved = float(np.abs(link.numbers[0] - start)[joints].max())
            if moved > DRIFT:
                raise RobotRefused(
                    f"a joint moved by {moved:.3f} rad at zero torque: with gravity: {self._connection.gravity} the"
                    " arm's weight is carried by nobody, or twice (valid: the other word, after a look at docs/ros2.md;"
                    " a tool in the robot file)"
                )
        link.end()
        link.wait_until_ended(RAMP + 1.0)

    def _weigh(self, link: Ros2Link) -> None:
        """Computes the weight of the newest state, where this program carries it; of commanded limbs only."""
        if self._connection.gravity != "controller":
            return
        weight = self._model.gravity(link.numbers[0])
        self._weight = np.zeros(self._model.n)
        for limb in self._commanded.values():
            self._weight[limb.joints] = weight[limb.joints]

    def _raise_if_stopped(self, link: Ros2Link) -> None:
        if link.stop is not None:
            raise link.stop

    def _first_state(self) -> FirstState:
        link = self._opened()
        link.wait_for_state(1.0)
        self._zero_time = self._last_time = link.moment
        self._read_at, self._misses = time.monotonic(), 0
        return FirstState(self._state(link), np.zeros(self._model.n))

    def _state(self, link: Ros2Link) -> RobotState:
        self._weigh(link)
        numbers = link.numbers.copy()
        if self._adds_weight:
            numbers[2] += self._model.gravity(numbers[0])
        numbers.flags.writeable = False
        return RobotState(link.moment - self._zero_time, numbers[0], numbers[1], numbers[2])

    def _leave(self) -> None:
        if self._link is not None:
            self._link.close()
            self._link = None
        sys.setswitchinterval(self._usual_interval)
        self._idle_inhibitor.end()


def settings_of(model: RobotModel, connection: Ros2Connection) -> NodeSettings:
    """What the node is told of a robot and its connection."""
    places = {name: k for k, name in enumerate(model.joint_names)}
    return NodeSettings(
        joint_states=connection.joint_states,
        reliable=connection.reliable,
        names=tuple(connection.names.get(name, name) for name in model.joint_names),
        controllers=tuple(
            (each.topic, tuple(places[joint] for joint in each.joints)) for each in connection.controllers
        ),
        stale=connection.watch.stale,
        oldest=connection.watch.oldest,
    )
