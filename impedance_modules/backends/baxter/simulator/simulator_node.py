# SPDX-License-Identifier: BSD-3-Clause
"""The simulator on the network: its topics, parameters, and the faults that are put on them."""

from __future__ import annotations

import time
import xmlrpc.client
from collections.abc import Callable
from functools import partial
from typing import Protocol

import numpy as np

from impedance_modules.backends.baxter.ros import messages
from impedance_modules.backends.baxter.ros.messages import Message
from impedance_modules.backends.baxter.ros.socket_transport import SocketTransport
from impedance_modules.backends.baxter.ros.transport import Publisher, Transport
from impedance_modules.backends.baxter.simulator.assembly_state import ON
from impedance_modules.backends.baxter.simulator.collision_safety import SUPPRESSIBLE, HandPush
from impedance_modules.backends.baxter.simulator.fault_injection import (
    InjectedFault,
    MessageFaults,
    parse_fault,
)
from impedance_modules.backends.baxter.simulator.parameters import STATE_RATE
from impedance_modules.backends.baxter.simulator.publishers import (
    JOINT_STATES,
    REALTIME_NODE,
    STATE,
    MessageBuilder,
    TopicPublisher,
    assembly_message,
    bounded_rate,
    topic_publishers,
)
from impedance_modules.backends.baxter.simulator.simulated_baxter import SimulatedBaxter
from impedance_modules.errors import BadInput

SECOND_NODE = "/another_robot"

DESCRIPTION, VERSION = "/robot_description", "/rethink/software_version"
"""Parameters."""

LOOK_TICKS = 10
"""Topics that tell a change at once are looked at every so many ticks."""

PUSH_TIME = 1.0
"""How long a push lasts unless it says so [s]."""

GONE_NODE, GONE_ADDRESS = "/realtime_loop_of_yesterday", "http://127.0.0.1:9/"
"""A node that was killed without a word; nobody listens at its address."""

FAULT_TOPIC = "/fake_baxter/fault"
"""Takes a String in the words of ``faults``."""


class SimulatorNode:
    """One simulator with its nodes on a network.

    Attributes:
        robot: The simulator.
        message_faults: Faults of its messages.
        opened: Whether its nodes are up.
        slipped: By how much the robot's life is behind the wall's clock, which its stamps follow [s].
    """

    def __init__(self, robot: SimulatedBaxter, network: Network, description: str) -> None:
        """Prepares everything; ``open`` brings the nodes up. ``description`` is the URDF that is served."""
        self.robot = robot
        self._network, self._description = network, description
        self._limbs = tuple(robot.model.limbs.values())
        self._readout = MessageBuilder(robot)
        last = self._limbs[-1].joint_names[-1]
        self.message_faults = MessageFaults(joint=last, seed=robot.options.seed)
        self._start = time.time_ns()
        self._topic_publishers = topic_publishers(self._readout, self._limbs)
        self._second = TopicPublisher(
            SECOND_NODE, STATE, messages.AssemblyState, STATE_RATE, lambda _: assembly_message(ON)
        )
        self._nodes: dict[str, Transport] = {}
        self._publishers: dict[tuple[str, str], Publisher[Message]] = {}
        self._last: dict[tuple[str, str], Message] = {}
        self._return_at: float | None = None
        self._script: list[InjectedFault] = []
        self._ticks = 0
        self.slipped = 0.0
        self.opened = False

    def open(self) -> None:
        """Brings the nodes up and sets the parameters."""
        for topic_publisher in self._topic_publishers:
            self._advertise(topic_publisher)
        realtime = self._nodes[REALTIME_NODE]
        realtime.set_parameter(DESCRIPTION, self._description)
        realtime.set_parameter(VERSION, self.robot.options.software_version)
        listen(realtime, self.robot, self._set_rate, self._inject_text)
        self.opened = True

    def close(self) -> None:
        """Takes the nodes down; every registration is withdrawn."""
        self.opened = False
        for node in self._nodes.values():
            node.close()
        self._nodes.clear()
        self._publishers.clear()

    def plan(self, faults: list[InjectedFault]) -> None:
        """Takes faults that happen at their time; those without one happen now."""
        for fault in faults:
            if fault.at is None:
                self.inject(fault)
        self._script = sorted((f for f in faults if f.at is not None), key=lambda f: f.at or 0.0)

    def tick(self) -> None:
        """Lives through one millisecond and sends what is due."""
        robot = self.robot
        while self._script and (self._script[0].at or 0.0) <= robot.now:
            self.inject(self._script.pop(0))
        robot.tick()
        self._ticks += 1
        if self._return_at is not None and robot.now >= self._return_at:
            self._return_at = None
            self.open()
        if not self.opened:
            return
        self.message_faults.release(robot.now)
        # A machine that is too slow makes the robot's life slower, not its clock.
        stamp = self._start + round((robot.now + self.slipped + self.message_faults.clock_step) * 1e9)
        for topic_publisher in self._topic_publishers:
            self._serve(topic_publisher, stamp)

    def _serve(self, topic_publisher: TopicPublisher, stamp: int) -> None:
        due = topic_publisher.due()
        if not (due or (topic_publisher.on_change and self._ticks % LOOK_TICKS == 0)):
            return
        place = (topic_publisher.node, topic_publisher.topic)
        publisher = self._publishers[place]
        if publisher.connections() == 0:
            return
        message = topic_publisher.make(stamp)
        if not due and _content(message) == _content(self._last.get(place)):
            return
        self._last[place] = message
        if topic_publisher.faulty:
            self.message_faults.send_through(place, message, self.robot.now, partial(self._send, place))
        else:
            publisher.send(message)

    def _send(self, place: tuple[str, str], message: Message) -> None:
        """Sends by whatever publisher stands there now."""
        publisher = self._publishers.get(place)
        if publisher is not None:
            publisher.send(message)

    def _advertise(self, topic_publisher: TopicPublisher) -> None:
        if topic_publisher.node not in self._nodes:
            self._nodes[topic_publisher.node] = self._network.connect(topic_publisher.node)
        publisher = self._nodes[topic_publisher.node].advertise(topic_publisher.topic, topic_publisher.kind)
        self._publishers[topic_publisher.node, topic_publisher.topic] = publisher

    def _set_rate(self, rate: int) -> None:
        for topic_publisher in self._topic_publishers:
            if (topic_publisher.node, topic_publisher.topic) == (REALTIME_NODE, JOINT_STATES):
                topic_publisher.rate = bounded_rate(rate)

    def _inject_text(self, text: str) -> None:
        """Carries out a fault that came by topic; nonsense is told, not obeyed."""
        try:
            self.inject(parse_fault(text, tuple(self.robot.limbs)))
        except BadInput as error:
            self.robot.log_event(str(error))

    def inject(self, fault: InjectedFault) -> None:
        """Lets a fault happen."""
        robot = self.robot
        value = fault.numbers[0] if fault.numbers and fault.on else 0.0
        words = [fault.name, *([fault.limb] if fault.limb else []), *(f"{x:g}" for x in fault.numbers)]
        robot.log_event(f"fault: {' '.join(words)}{'' if fault.on else ' off'}")
        if fault.name in ("silence", "freeze", "partial", "nan"):
            setattr(self.message_faults, fault.name, fault.on)
        elif fault.name in ("drop", "delay"):
            setattr(self.message_faults, fault.name, value)
        elif fault.name == "clock-step":
            self.message_faults.clock_step += value
        elif fault.name in ("duplicate", "dead", "wrong-md5", "restart"):
            self._inject_node_fault(fault, value)
        elif fault.name in ("cuff", "push"):
            self._inject_on_limb(fault)
        else:
            acts = {
                "estop": robot.machine.press,
                "estop-release": robot.machine.release,
                "joint-fault": robot.machine.fault,
            }
            acts[fault.name]()

    def _inject_on_limb(self, fault: InjectedFault) -> None:
        robot = self.robot
        if not fault.on:
            robot.cuffs.update(dict.fromkeys(robot.cuffs, False))
        elif fault.limb is not None and fault.name == "cuff":
            robot.cuffs[fault.limb] = True
        elif fault.limb is not None:
            lasts = fault.numbers[3] if len(fault.numbers) > 3 else PUSH_TIME
            robot.pushes[fault.limb] = HandPush(np.array(fault.numbers[:3]), robot.now + lasts)

    def _inject_node_fault(self, fault: InjectedFault, value: float) -> None:
        """Faults of nodes and registrations."""
        if fault.name == "dead":
            self._network.register_dead(STATE, messages.AssemblyState.ros_type, fault.on)
        elif fault.name == "restart":
            self.close()
            self.robot.machine.disable()
            self._return_at = self.robot.now + value
        elif fault.name == "duplicate" and fault.on and self._second not in self._topic_publishers:
            self._topic_publishers.append(self._second)
            self._advertise(self._second)
        elif fault.name == "duplicate" and not fault.on and self._second in self._topic_publishers:
            self._topic_publishers.remove(self._second)
            del self._publishers[SECOND_NODE, STATE]
            self._nodes.pop(SECOND_NODE).close()
        elif fault.name == "wrong-md5":
            self._send_as(messages.Bool if fault.on else messages.AssemblyState)

    def _right_state(self, stamp: int) -> messages.AssemblyState:  # noqa: ARG002 - as every maker of messages
        return self._readout.assembly()

    def _send_as(self, kind: type[Message]) -> None:
        """Sends the robot's state as another type."""
        for topic_publisher in self._topic_publishers:
            if (topic_publisher.node, topic_publisher.topic) == (REALTIME_NODE, STATE):
                topic_publisher.kind = kind
                topic_publisher.make = self._right_state if kind is messages.AssemblyState else _wrong_state
                self._publishers[REALTIME_NODE, STATE].close()
                self._advertise(topic_publisher)


def _wrong_state(stamp: int) -> messages.Bool:  # noqa: ARG001 - as every maker of messages
    return messages.Bool(data=True)


def _content(message: Message | None) -> object:
    """Gives what a message says, without when."""
    if isinstance(message, messages.CollisionDetectionState):
        return message.collision_state
    if isinstance(message, messages.CollisionAvoidanceState):
        return message.other_arm, message.collision_object
    return message


class Network(Protocol):
    """Where nodes meet."""

    def connect(self, node_name: str) -> Transport:
        """Brings a node up."""

    def register_dead(self, topic: str, ros_type: str, on: bool) -> None:
        """Registers a publisher that no longer exists, or has it forgotten."""


class RosNetwork:
    """Nodes on a ROS master, by plain sockets: one process can be several nodes, and needs no ROS."""

    def __init__(self, master_address: str) -> None:
        """Takes the master's address."""
        self._address = master_address

    def connect(self, node_name: str) -> Transport:
        """Brings a node up."""
        return SocketTransport(node_name, self._address)

    def register_dead(self, topic: str, ros_type: str, on: bool) -> None:
        """Registers a publisher that no longer exists, or has it forgotten."""
        master = xmlrpc.client.ServerProxy(self._address)
        if on:
            master.registerPublisher(GONE_NODE, topic, ros_type, GONE_ADDRESS)
        else:
            master.unregisterPublisher(GONE_NODE, topic, GONE_ADDRESS)


def listen(
    node: Transport,
    robot: SimulatedBaxter,
    set_rate: Callable[[int], None],
    inject_text: Callable[[str], None],
) -> None:
    """Subscribes to everything that the robot listens to.

    Args:
        node: Of the robot.
        robot: Whose limbs and power are commanded.
        set_rate: Takes a wished rate of the joint states [Hz].
        inject_text: Takes a fault in words.
    """
    post = robot.post
    node.subscribe("/robot/set_super_enable", messages.Bool, lambda m, _: post(partial(robot.enable, m.data)))
    node.subscribe("/robot/set_super_reset", messages.Empty, lambda _, __: post(robot.reset))
    node.subscribe("/robot/set_super_stop", messages.Empty, lambda _, __: post(robot.stop))
    node.subscribe(
        "/robot/joint_state_publish_rate", messages.UInt16, lambda m, _: post(partial(set_rate, m.data))
    )
    node.subscribe(FAULT_TOPIC, messages.String, lambda m, _: post(partial(inject_text, m.data)))
    for limb in robot.limbs:
        _listen_for(node, robot, limb)


def _listen_for(node: Transport, robot: SimulatedBaxter, limb: str) -> None:
    drive, post, place = robot.limbs[limb], robot.post, f"/robot/limb/{limb}"

    def ask(name: str) -> Callable[[messages.Empty, float], None]:
        return lambda _, __: post(lambda: robot.suppressions[limb].ask(name, robot.now))

    node.subscribe(
        f"{place}/joint_command",
        messages.JointCommand,
        lambda m, _: post(partial(robot.command, limb, m.mode, m.names, m.command)),
    )
    node.subscribe(
        f"{place}/joint_command_timeout",
        messages.Float64,
        lambda m, _: post(partial(drive.set_time_out, m.data)),
    )
    node.subscribe(
        f"{place}/set_speed_ratio",
        messages.Float64,
        lambda m, _: post(partial(drive.set_speed_ratio, m.data)),
    )
    for name in SUPPRESSIBLE:
        node.subscribe(f"{place}/{name}", messages.Empty, ask(name))
