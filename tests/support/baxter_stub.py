# SPDX-License-Identifier: BSD-3-Clause
"""A stub Baxter for unit tests: publishes what a test sets, records its commands; and the backend that drives it.

No physics: position mode reaches its target at once; torque moves nothing unless ``drift`` is set. The
simulator with physics is ``impedance baxter fake``.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
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


class StubBaxter:
    """All topics of a robot on one in-process master.

    Attributes:
        commands: (time, limb, mode, values) of every JointCommand.
        timeouts, rates: (time, value) of every request.
    """

    def __init__(self, spec: RobotSpec) -> None:
        self.spec, self.model = spec, RobotModel(spec)
        self.hub = InProcessMaster()
        self.commands: list[tuple[float, str, int, np.ndarray]] = []
        self.timeouts: list[tuple[float, float]] = []
        self.rates: list[tuple[float, int]] = []
        self.obeys_rate, self.rate = True, 100.0
        self.frozen, self.drift = False, 0.0
        self._q = np.full(self.model.n, 0.3)
        self._effort = np.zeros(self.model.n)
        self._state, self._collision, self._cuff = (
            ON,
            dict.fromkeys(spec.limbs, False),
            dict.fromkeys(spec.limbs, False),
        )
        self._left_out: set[str] = set()
        self._silent: set[str] = set()
        self._tip, self._weight = dict.fromkeys(spec.limbs, 0.0), dict.fromkeys(spec.limbs, 0.0)
        self._count = 0
        self._lock = threading.RLock()
        self.hub.parameters.update({"/rethink/software_version": "1.2.0.57"})
        self.serve(spec.urdf.read_text())
        self._wrong: set[str] = set()
        self._node = "/realtime_loop"
        self._built: dict[tuple[str, str], object] = {}
        subscriber = InProcessTransport(self.hub, "/subscriber")
        for limb in spec.limbs:
            subscriber.subscribe(
                topics.joint_command(limb), messages.JointCommand, lambda m, t, limb=limb: self._hear(limb, m)
            )
            subscriber.subscribe(
                topics.command_timeout(limb),
                messages.Float64,
                lambda m, t: self.timeouts.append((time.monotonic(), m.data)),
            )
        subscriber.subscribe(topics.STATE_RATE_REQUEST, messages.UInt16, self._hear_rate)

    # --- what tests change

    def place(self, angles: Mapping[str, float] | np.ndarray) -> None:
        if isinstance(angles, np.ndarray):
            self._q = angles.copy()
            return
        for name, angle in angles.items():
            self._q[self.model.joint_names.index(name)] = angle

    def power(self, **fields) -> None:
        self._state = replace(ON, **fields)
        self._say(topics.ROBOT_STATE, self._state)

    def collide(self, limb: str, felt: bool = True) -> None:
        self._collision[limb] = felt
        self._say(topics.collision_state(limb), messages.CollisionDetectionState(self._header(), felt))

    def squeeze(self, limb: str, squeezed: bool = True) -> None:
        self._cuff[limb] = squeezed
        self._say(topics.cuff(limb), messages.DigitalIOState(int(squeezed), True))

    def set_effort(self, joint: str, value: float) -> None:
        self._effort[self.model.joint_names.index(joint)] = value

    def leave_out(self, joint: str) -> None:
        self._left_out.add(joint)

    def silence(self, topic: str) -> None:
        self._silent.add(topic)

    def rename_loop(self, node: str) -> None:
        self._node = node

    def wrong_message(self, limb: str) -> None:
        self._wrong.add(topics.endpoint_state(limb))

    def move_tip(self, limb: str, metres: float) -> None:
        self._tip[limb] = metres

    def add_weight(self, limb: str, torque: float) -> None:
        self._weight[limb] = torque

    def serve(self, text: str | None) -> None:
        self.hub.parameters.pop("/robot_description", None)
        if text is not None:
            self.hub.parameters["/robot_description"] = text

    def another_robot(self) -> None:
        InProcessTransport(self.hub, "/simulator").advertise(topics.ROBOT_STATE, messages.AssemblyState)

    def another_controller(self, limb: str) -> None:
        InProcessTransport(self.hub, "/somebody").advertise(topics.joint_command(limb), messages.JointCommand)

    # --- what it does

    def tick(self) -> None:
        """Publishes everything once."""
        with self._lock:
            self._count += 1
            if self.frozen:
                return
            self._q = self._q + self.drift
            names = [n for n in (*sorted(self.model.joint_names), "head_pan") if n not in self._left_out]
            at = {name: k for k, name in enumerate(self.model.joint_names)}
            angles = tuple(float(self._q[at[n]]) if n in at else 0.0 for n in names)
            carried = self.model.gravity(self._q) + self._effort
            efforts = tuple(float(carried[at[n]]) if n in at else 0.0 for n in names)
        zeros = (0.0,) * len(names)
        header = self._header()
        self._say(topics.JOINT_STATES, messages.JointState(header, tuple(names), angles, zeros, efforts))
        self._say(
            topics.JOINT_STATES,
            messages.JointState(header, GRIPPERS, (0.0,) * 2, (0.0,) * 2, (0.0,) * 2),
            "/end_effector_publisher",
        )
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
        for moment, _, mode, _ in list(self.commands):
            if moment >= since and found[-1:] != [mode]:
                found.append(mode)
        return found

    def _limb(self, limb: str, header: messages.Header) -> None:
        model = self.model
        part = model.limbs[limb]
        hand = model.pose(self._q, part.hand)
        tip = hand.translation + hand.rotation @ np.array([0.0, 0.0, TIP + self._tip[limb]])
        zero = messages.Vector3(0.0, 0.0, 0.0)
        pose = messages.PoseMessage(messages.Point(*map(float, tip)), messages.Quaternion(0.0, 0.0, 0.0, 1.0))
        kind = topics.endpoint_state(limb)
        if kind in self._wrong:
            self._say(kind, messages.Float64(1.0))
        else:
            self._say(
                kind,
                messages.EndpointState(header, pose, messages.Twist(zero, zero), messages.Wrench(zero, zero)),
            )
        alone = model.gravity(self._q) - model.parallel_spring_effort(self._q)
        gravity = tuple((alone[part.joints] + self._weight[limb]).tolist())
        self._say(
            topics.sea_state(limb),
            messages.SEAJointState(header, part.joint_names, *((),) * 7, gravity, gravity, (), (), 0.0),
        )
        self._say(
            topics.collision_state(limb), messages.CollisionDetectionState(header, self._collision[limb])
        )
        self._say(topics.cuff(limb), messages.DigitalIOState(int(self._cuff[limb]), True))

    def _header(self) -> messages.Header:
        return messages.Header(self._count, time.monotonic_ns() + 10**18, "")

    def _say(self, topic: str, message: messages.Message, node: str | None = None) -> None:
        if topic in self._silent:
            return
        name = self._node if node is None else node
        key = (topic, name)
        if key not in self._built:
            self._built[key] = InProcessTransport(self.hub, name).advertise(topic, type(message))
        self._built[key].send(message)

    def _hear(self, limb: str, message: messages.JointCommand) -> None:
        values = np.array(message.command)
        self.commands.append((time.monotonic(), limb, message.mode, values))
        if message.mode == message.POSITION_MODE:
            with self._lock:
                for name, value in zip(message.names, values, strict=True):
                    self._q[self.model.joint_names.index(name)] = value

    def _hear_rate(self, message: messages.UInt16, received: float) -> None:
        self.rates.append((received, message.data))
        if self.obeys_rate:
            self.rate = float(message.data)


@contextmanager
def open_session(robot: StubBaxter) -> Iterator[Session]:
    """A session that has received a few messages and does not wait for more."""
    with (
        mock.patch.object(session, "LISTENING", 0.0),
        mock.patch.object(preflight_checks, "LOWEST_RATE", 1.0),
    ):
        found = Session(InProcessTransport(robot.hub, "/us"), robot.spec)
        for _ in range(5):
            robot.tick()
        try:
            yield found
        finally:
            found.close()


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
    started: float = field(default_factory=time.monotonic)

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

    def since(self, moment: float) -> list:
        return [command for command in list(self.robot.commands) if command[0] > moment]


@contextmanager
def driving(robot: StubBaxter, *, start=None, check=lambda: None, rate=100.0, **options) -> Iterator[Drive]:
    generous = mock.patch.object(backend, "RATE_TOLERANCE", TOLERANCE)
    with open_session(robot) as session, robot.live(), generous:
        model = session.model
        rules = StopThresholds(
            STALE, 0.1, STALE + 0.2, 1.0, model.column("effort_max"), np.eye(model.n) * 5.0
        )
        limbs = {"left": model.limbs["left"]}
        stops = Stops(rules, {"left": model.limbs["left"].joints})
        start = np.full(model.n, 0.3) if start is None else start
        given = DriveOptions(rate=rate, start=start, **{"read_only": False, "approach": False, **options})
        driven = BaxterBackend(session.link, limbs, stops, given, check)
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
