# SPDX-License-Identifier: BSD-3-Clause
"""A stub Baxter for unit tests: publishes what a test sets, records its commands; and the backend that drives it.

No physics: position mode reaches its target at once; torque moves nothing unless ``drift`` is set.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import NamedTuple
from unittest import mock

import numpy as np
import pytest

from impedance_modules.backends.baxter import baxter_backend as backend
from impedance_modules.backends.baxter import preflight_checks, session, topics
from impedance_modules.backends.baxter.baxter_backend import BaxterBackend, DriveOptions
from impedance_modules.backends.baxter.ros import messages
from impedance_modules.backends.baxter.ros.messages import JointCommand
from impedance_modules.backends.baxter.session import Session
from impedance_modules.backends.baxter.stops import Stops, StopThresholds
from impedance_modules.errors import RobotStopped
from impedance_modules.robot.model import RobotModel
from impedance_modules.spec.robot_spec import RobotSpec
from impedance_modules.spec.task_reader import read_task
from tests.support.in_process_transport import InProcessMaster, InProcessTransport

ON = messages.AssemblyState(True, True, False, False, 0, 0)
GRIPPERS = ("l_gripper_l_finger_joint", "l_gripper_r_finger_joint")
TIP = 0.025


class Command(NamedTuple):
    """A JointCommand as it was received."""

    time: float
    limb: str
    mode: int
    values: np.ndarray


class StubBaxter:
    """All topics of a robot on one in-process master.

    Attributes:
        commands: Every JointCommand.
        timeouts, rates: (time, value) of every request.
        parameters: Of the master: the software's version and the served description.
        loop: Node that publishes the states.
        left_out, silent, wrong: Joints never reported, topics without messages, topics with another message.
        effort: Added to gravity in the joint states, (n,) [N.m].
        tip, weight: By limb: offset of the served hand [m], torque added to the served gravity [N.m].
    """

    def __init__(self, spec: RobotSpec) -> None:
        self.spec, self.model = spec, RobotModel(spec)
        self.hub = InProcessMaster()
        self.parameters = self.hub.parameters
        self.commands: list[Command] = []
        self.timeouts: list[tuple[float, float]] = []
        self.rates: list[tuple[float, int]] = []
        self.obeys_rate, self.rate = True, 100.0
        self.frozen, self.drift = False, 0.0
        self.loop = "/realtime_loop"
        self.left_out, self.silent, self.wrong = set[str](), set[str](), set[str]()
        self.effort = np.zeros(self.model.n)
        self.tip, self.weight = dict.fromkeys(spec.limbs, 0.0), dict.fromkeys(spec.limbs, 0.0)
        self._q = np.full(self.model.n, 0.3)
        self._state = ON
        self._collision, self._cuff = dict.fromkeys(spec.limbs, False), dict.fromkeys(spec.limbs, False)
        self._count = 0
        self._lock = threading.RLock()
        self.parameters["/rethink/software_version"] = "1.2.0.57"
        self.parameters["/robot_description"] = spec.urdf.read_text()
        self._built: dict[tuple[str, str], object] = {}
        hear = InProcessTransport(self.hub, "/subscriber").subscribe
        for limb in spec.limbs:
            hear(topics.joint_command(limb), JointCommand, lambda m, t, limb=limb: self._hear(limb, m))
            hear(topics.command_timeout(limb), messages.Float64, self._hear_timeout)
        hear(topics.STATE_RATE_REQUEST, messages.UInt16, self._hear_rate)

    # --- what tests change

    def place(self, joint: str, angle: float) -> None:
        self._q[self.model.joint_names.index(joint)] = angle

    def power(self, **fields) -> None:
        self._state = replace(ON, **fields)
        self._say(topics.ROBOT_STATE, self._state)

    def collide(self, limb: str, detected: bool = True) -> None:
        self._collision[limb] = detected
        self._say(topics.collision_state(limb), messages.CollisionDetectionState(self._header(), detected))

    def squeeze(self, limb: str, squeezed: bool = True) -> None:
        self._cuff[limb] = squeezed
        self._say(topics.cuff(limb), messages.DigitalIOState(int(squeezed), True))

    def set_effort(self, joint: str, value: float) -> None:
        self.effort[self.model.joint_names.index(joint)] = value

    def another_robot(self) -> None:
        InProcessTransport(self.hub, "/simulator").advertise(topics.ROBOT_STATE, messages.AssemblyState)

    def another_controller(self, limb: str) -> None:
        InProcessTransport(self.hub, "/somebody").advertise(topics.joint_command(limb), JointCommand)

    # --- what it does

    def tick(self) -> None:
        """Publishes everything once."""
        with self._lock:
            self._count += 1
            if self.frozen:
                return
            self._q = self._q + self.drift
            names = [n for n in (*sorted(self.model.joint_names), "head_pan") if n not in self.left_out]
            angles = dict(zip(self.model.joint_names, self._q.tolist(), strict=True))
            carried = self.model.gravity(self._q) + self.effort
            efforts = dict(zip(self.model.joint_names, carried.tolist(), strict=True))
        header, zeros = self._header(), (0.0,) * len(names)
        position, effort = (tuple(row.get(name, 0.0) for name in names) for row in (angles, efforts))
        self._say(topics.JOINT_STATES, messages.JointState(header, tuple(names), position, zeros, effort))
        still = messages.JointState(header, GRIPPERS, *((0.0,) * 2,) * 3)
        self._say(topics.JOINT_STATES, still, "/end_effector_publisher")
        self._say(topics.ROBOT_STATE, self._state)
        for limb in self.spec.limbs:
            self._limb(limb, header)

    @contextmanager
    def live(self) -> Iterator[StubBaxter]:
        """Ticks at ``rate`` in a thread, as long as it is entered."""
        stop = threading.Event()

        def body() -> None:
            due = time.monotonic()
            while not stop.is_set():
                self.tick()
                due = max(due + 1.0 / self.rate, time.monotonic())
                time.sleep(max(0.0, due - time.monotonic()))

        thread = threading.Thread(target=body, daemon=True)
        thread.start()
        try:
            yield self
        finally:
            stop.set()
            thread.join()

    def modes(self, since: float = 0.0) -> list[int]:
        """Modes of the commands since a time, in order, each change once."""
        found: list[int] = []
        for command in list(self.commands):
            if command.time >= since and found[-1:] != [command.mode]:
                found.append(command.mode)
        return found

    def _limb(self, limb: str, header: messages.Header) -> None:
        model = self.model
        part = model.limbs[limb]
        hand = model.pose(self._q, part.hand)
        tip = hand.translation + hand.rotation @ np.array([0.0, 0.0, TIP + self.tip[limb]])
        zero = messages.Vector3(0.0, 0.0, 0.0)
        pose = messages.PoseMessage(messages.Point(*map(float, tip)), messages.Quaternion(0.0, 0.0, 0.0, 1.0))
        twist, wrench = messages.Twist(zero, zero), messages.Wrench(zero, zero)
        alone = model.gravity(self._q) - model.parallel_spring_effort(self._q)
        gravity = tuple((alone[part.joints] + self.weight[limb]).tolist())
        sea = messages.SEAJointState(header, part.joint_names, *((),) * 7, gravity, gravity, (), (), 0.0)
        self._say(topics.endpoint_state(limb), messages.EndpointState(header, pose, twist, wrench))
        self._say(topics.sea_state(limb), sea)
        felt = messages.CollisionDetectionState(header, self._collision[limb])
        self._say(topics.collision_state(limb), felt)
        self._say(topics.cuff(limb), messages.DigitalIOState(int(self._cuff[limb]), True))

    def _header(self) -> messages.Header:
        return messages.Header(self._count, time.monotonic_ns() + 10**18, "")

    def _say(self, topic: str, message: messages.Message, node: str | None = None) -> None:
        if topic in self.silent:
            return
        if topic in self.wrong:
            message = messages.Float64(1.0)
        key = (topic, self.loop if node is None else node)
        if key not in self._built:
            self._built[key] = InProcessTransport(self.hub, key[1]).advertise(topic, type(message))
        self._built[key].send(message)

    def _hear(self, limb: str, message: messages.JointCommand) -> None:
        values = np.array(message.command)
        self.commands.append(Command(time.monotonic(), limb, message.mode, values))
        if message.mode == message.POSITION_MODE:
            with self._lock:
                for name, value in zip(message.names, values, strict=True):
                    self.place(name, value)

    def _hear_timeout(self, message: messages.Float64, received: float) -> None:
        self.timeouts.append((time.monotonic(), message.data))

    def _hear_rate(self, message: messages.UInt16, received: float) -> None:
        self.rates.append((received, message.data))
        if self.obeys_rate:
            self.rate = float(message.data)


@contextmanager
def open_session(robot: StubBaxter) -> Iterator[Session]:
    """A session that has received a few messages and does not wait for more."""
    low_rate = mock.patch.object(preflight_checks, "LOWEST_RATE", 1.0)
    with mock.patch.object(session, "LISTENING", 0.0), low_rate:
        found = Session(InProcessTransport(robot.hub, "/us"), robot.spec)
        for _ in range(5):
            robot.tick()
        try:
            yield found
        finally:
            found.link.close()
            found.transport.close()


SPEC = read_task("joint-springs")[1]
TORQUE, POSITION = JointCommand.TORQUE_MODE, JointCommand.POSITION_MODE
STALE = 0.25
"""Large, so that a scheduling delay of a busy machine is not taken for the robot's silence [s]."""
TOLERANCE = 0.7
"""Likewise of the rate: on a busy machine the stub publishes more slowly than requested."""


@dataclass
class Drive:
    robot: StubBaxter
    backend: BaxterBackend

    def cycle(self, count: int = 1, effort: float = 1.0) -> None:
        for _ in range(count):
            self.backend.write(np.full(self.robot.model.n, effort))
            self.backend.read()

    def until_stopped(self, seconds: float = 3.0) -> RobotStopped:
        end = time.monotonic() + seconds
        with pytest.raises(RobotStopped) as stop:
            while time.monotonic() < end:
                self.cycle()
        return stop.value

    def since(self, moment: float) -> list[Command]:
        return [command for command in list(self.robot.commands) if command.time > moment]


@contextmanager
def driving(robot: StubBaxter, *, start=None, rate=100.0, **options) -> Iterator[Drive]:
    generous = mock.patch.object(backend, "RATE_TOLERANCE", TOLERANCE)
    with open_session(robot) as session, robot.live(), generous:
        model = session.model
        high, left = model.column("effort_max"), model.limbs["left"]
        stops = Stops(StopThresholds(STALE, 0.1, STALE + 0.2, 1.0, high), {"left": left.joints})
        start = np.full(model.n, 0.3) if start is None else start
        given = DriveOptions(rate=rate, start=start, **{"read_only": False, "approach": False, **options})
        driven = BaxterBackend(session.link, {"left": left}, stops, given, lambda: None)
        try:
            yield Drive(robot, driven)
        finally:
            driven.finish("hold")
            driven.finish("hold")


def started(drive: Drive) -> Drive:
    first = drive.backend.start()
    assert first.state.time == 0.0
    assert not first.acting.any()
    return drive
