# SPDX-License-Identifier: BSD-3-Clause
"""The simulated Baxter on the network: nodes, topics it publishes and subscribes to, parameters, injected faults.

Every request that comes by a topic is handed to the robot's next tick.
"""

from __future__ import annotations

import time
import xmlrpc.client
from collections.abc import Callable
from functools import partial
from typing import Protocol

import numpy as np

from impedance_modules.backends.baxter import topics
from impedance_modules.backends.baxter.ros import messages
from impedance_modules.backends.baxter.ros.messages import Message
from impedance_modules.backends.baxter.ros.socket_transport import SocketTransport
from impedance_modules.backends.baxter.ros.transport import Publisher, Transport
from impedance_modules.backends.baxter.simulator.assembly_state import ON
from impedance_modules.backends.baxter.simulator.collision_safety import SUPPRESSIBLE, HandPush
from impedance_modules.backends.baxter.simulator.fault_injection import (
    ON_LIMB,
    InjectedFault,
    MessageFaults,
    parse_fault,
)
from impedance_modules.backends.baxter.simulator.parameters import STATE_RATE
from impedance_modules.backends.baxter.simulator.publishers import (
    MessageBuilder,
    Publication,
    bounded_rate,
    publications,
)
from impedance_modules.backends.baxter.simulator.simulated_baxter import SimulatedBaxter
from impedance_modules.errors import BadInput

SECOND_NODE = "/another_robot"

CHANGE_TICKS = 10
"""Topics whose changes are published at once are checked every so many ticks."""

PUSH_TIME = 1.0
"""Duration of a push that states none [s]."""

GONE_NODE, GONE_ADDRESS = "/realtime_loop_of_yesterday", "http://127.0.0.1:9/"
"""A node that was killed and is still registered; nothing listens at its address."""

FAULT_TOPIC = "/fake_baxter/fault"
"""Takes a String in the syntax of ``fault_injection``."""


class Network(Protocol):
    """Connects nodes and registers them."""

    def connect(self, node_name: str) -> Transport:
        """Brings a node up."""

    def register_dead(self, topic: str, ros_type: str, on: bool) -> None:
        """Registers a publisher that no longer exists, or removes it again."""


class RosNetwork:
    """Nodes on a ROS master, by plain sockets: one process can be several nodes, and needs no ROS."""

    def __init__(self, master_address: str) -> None:
        """Takes the master's address."""
        self._address = master_address

    def connect(self, node_name: str) -> Transport:
        """Brings a node up."""
        return SocketTransport(node_name, self._address)

    def register_dead(self, topic: str, ros_type: str, on: bool) -> None:
        """Registers a publisher that no longer exists, or removes it again."""
        master = xmlrpc.client.ServerProxy(self._address)
        if on:
            master.registerPublisher(GONE_NODE, topic, ros_type, GONE_ADDRESS)
        else:
            master.unregisterPublisher(GONE_NODE, topic, GONE_ADDRESS)


class SimulatorNode:
    """One simulated Baxter with its nodes on a network.

    Attributes:
        robot: The simulated Baxter.
        message_faults: Faults of its messages.
        opened: Whether its nodes are up.
        lag: By how much simulated time is behind real time, which the stamps follow [s].
    """

    def __init__(self, robot: SimulatedBaxter, network: Network, description: str) -> None:
        """Prepares everything; ``open`` brings the nodes up. ``description`` is the URDF that is served."""
        self.robot = robot
        self._network, self._description = network, description
        self._limbs = tuple(robot.model.limbs.values())
        self._messages = MessageBuilder(robot)
        last = self._limbs[-1].joint_names[-1]
        self.message_faults = MessageFaults(joint=last, seed=robot.options.seed)
        self._start = time.time_ns()
        self._publications = publications(self._messages, self._limbs)
        self._second = Publication(
            topics.ROBOT_STATE, messages.AssemblyState, lambda _: ON, STATE_RATE, SECOND_NODE
        )
        self._nodes: dict[str, Transport] = {}
        self._publishers: dict[tuple[str, str], Publisher[Message]] = {}
        self._last: dict[tuple[str, str], Message] = {}
        self._return_at: float | None = None
        self._script: list[InjectedFault] = []
        self._ticks = 0
        self.lag = 0.0
        self.opened = False

    def open(self) -> None:
        """Brings the nodes up and sets the parameters."""
        for publication in self._publications:
            self._advertise(publication)
        realtime = self._nodes[topics.REALTIME_NODE]
        realtime.set_parameter(topics.DESCRIPTIONS[0], self._description)
        realtime.set_parameter(topics.SOFTWARE_VERSION, self.robot.options.software_version)
        subscribe_all(realtime, self.robot, self._set_rate, self._inject_text)
        self.opened = True

    def close(self) -> None:
        """Takes the nodes down; every registration is withdrawn."""
        self.opened = False
        for node in self._nodes.values():
            node.close()
        self._nodes.clear()
        self._publishers.clear()

    def plan(self, faults: list[InjectedFault]) -> None:
        """Schedules faults; those without a time are injected now."""
        for fault in faults:
            if fault.at is None:
                self.inject(fault)
        self._script = sorted((f for f in faults if f.at is not None), key=lambda f: f.at or 0.0)

    def tick(self) -> None:
        """Simulates one millisecond and sends what is due."""
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
        # On a machine that is too slow the simulation slows down, the robot's clock does not.
        stamp = self._start + round((robot.now + self.lag + self.message_faults.clock_step) * 1e9)
        for publication in self._publications:
            self._serve(publication, stamp)

    def _serve(self, publication: Publication, stamp: int) -> None:
        due = publication.due()
        if not (due or (publication.on_change and self._ticks % CHANGE_TICKS == 0)):
            return
        place = publication.key
        publisher = self._publishers[place]
        if publisher.connections() == 0 or self._silent(publication):
            return
        message = publication.make(stamp)
        if not due and _content(message) == _content(self._last.get(place)):
            return
        self._last[place] = message
        if publication.faulty:
            self.message_faults.send_through(place, message, self.robot.now, partial(self._send, place))
        else:
            publisher.send(message)

    def _send(self, place: tuple[str, str], message: Message) -> None:
        """Sends by the publisher that is open now, if there is one."""
        publisher = self._publishers.get(place)
        if publisher is not None:
            publisher.send(message)

    def _advertise(self, publication: Publication) -> None:
        if publication.node not in self._nodes:
            self._nodes[publication.node] = self._network.connect(publication.node)
        publisher = self._nodes[publication.node].advertise(publication.topic, publication.kind)
        self._publishers[publication.key] = publisher

    def _set_rate(self, rate: int) -> None:
        for publication in self._publications:
            if publication.key == (topics.REALTIME_NODE, topics.JOINT_STATES):
                publication.rate = bounded_rate(rate)

    def _inject_text(self, text: str) -> None:
        """Injects a fault that came by topic; one that cannot be parsed is logged."""
        try:
            self.inject(parse_fault(text, tuple(self.robot.limbs)))
        except BadInput as error:
            self.robot.log_event(str(error))

    def inject(self, fault: InjectedFault) -> None:
        """Injects a fault, or ends it."""
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
        elif fault.name in ON_LIMB:
            self._inject_on_gripper(fault)
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

    def _inject_on_gripper(self, fault: InjectedFault) -> None:
        """Faults of one gripper; off, of all."""
        for limb, gripper in self.robot.grippers.items():
            if fault.on and limb != fault.limb:
                continue
            if fault.name == "thing":
                gripper.body.thing = fault.numbers[0] if fault.on else None
            elif fault.name == "gripper-uncalibrated":
                gripper.calibrated = not fault.on
            elif fault.name == "gripper-error":
                gripper.error = fault.on
            else:
                gripper.silent = fault.on

    def _silent(self, publication: Publication) -> bool:
        """Whether a topic is that of a gripper which publishes no state."""
        silent = (topics.gripper_state(limb) for limb, it in self.robot.grippers.items() if it.silent)
        return publication.topic in silent

    def _inject_node_fault(self, fault: InjectedFault, value: float) -> None:
        """Faults of nodes and registrations."""
        if fault.name == "dead":
            self._network.register_dead(topics.ROBOT_STATE, messages.AssemblyState.ros_type, fault.on)
        elif fault.name == "restart":
            self.close()
            self.robot.machine.disable()
            self._return_at = self.robot.now + value
        elif fault.name == "duplicate" and fault.on and self._second not in self._publications:
            self._publications.append(self._second)
            self._advertise(self._second)
        elif fault.name == "duplicate" and not fault.on and self._second in self._publications:
            self._publications.remove(self._second)
            del self._publishers[SECOND_NODE, topics.ROBOT_STATE]
            self._nodes.pop(SECOND_NODE).close()
        elif fault.name == "wrong-md5":
            self._send_as(messages.Bool if fault.on else messages.AssemblyState)

    def _send_as(self, kind: type[Message]) -> None:
        """Sends the robot's state as another type."""
        for publication in self._publications:
            if publication.key == (topics.REALTIME_NODE, topics.ROBOT_STATE):
                publication.kind = kind
                right = kind is messages.AssemblyState
                publication.make = self._messages.assembly if right else _wrong_state
                self._publishers[topics.REALTIME_NODE, topics.ROBOT_STATE].close()
                self._advertise(publication)


def subscribe_all(
    node: Transport,
    robot: SimulatedBaxter,
    set_rate: Callable[[int], None],
    inject_text: Callable[[str], None],
) -> None:
    """Subscribes to everything that the real robot subscribes to.

    Args:
        node: On which to subscribe.
        robot: Receives the requests.
        set_rate: Takes a requested rate of the joint states [Hz].
        inject_text: Takes a fault as text.
    """
    post = robot.post
    node.subscribe(topics.ENABLE, messages.Bool, lambda m, _: post(partial(robot.enable, m.data)))
    node.subscribe(topics.RESET, messages.Empty, lambda _, __: post(robot.reset))
    node.subscribe(topics.STOP, messages.Empty, lambda _, __: post(robot.stop))
    node.subscribe(topics.STATE_RATE_REQUEST, messages.UInt16, lambda m, _: post(partial(set_rate, m.data)))
    node.subscribe(FAULT_TOPIC, messages.String, lambda m, _: post(partial(inject_text, m.data)))
    for limb in robot.limbs:
        _subscribe_limb(node, robot, limb)


def _wrong_state(stamp: int) -> messages.Bool:  # noqa: ARG001 - as every builder of messages
    return messages.Bool(data=True)


def _content(message: Message | None) -> object:
    """Returns the content of a message without its header."""
    if isinstance(message, messages.CollisionDetectionState):
        return message.collision_state
    if isinstance(message, messages.CollisionAvoidanceState):
        return message.other_arm, message.collision_object
    return message


def _subscribe_limb(node: Transport, robot: SimulatedBaxter, limb: str) -> None:
    drive, post = robot.limbs[limb], robot.post

    def request(name: str) -> Callable[[messages.Empty, float], None]:
        return lambda _, __: post(lambda: robot.suppressions[limb].request(name, robot.now))

    node.subscribe(
        topics.joint_command(limb),
        messages.JointCommand,
        lambda m, _: post(partial(robot.command, limb, m.mode, m.names, m.command)),
    )
    node.subscribe(
        topics.command_timeout(limb),
        messages.Float64,
        lambda m, _: post(partial(drive.set_time_out, m.data)),
    )
    node.subscribe(
        topics.speed_ratio(limb),
        messages.Float64,
        lambda m, _: post(partial(drive.set_speed_ratio, m.data)),
    )
    gripper = robot.grippers.get(limb)
    if gripper is not None:
        node.subscribe(
            topics.gripper_command(limb),
            messages.EndEffectorCommand,
            lambda m, _: post(partial(gripper.take, m)),
        )
    for name in SUPPRESSIBLE:
        node.subscribe(topics.suppression(limb, name), messages.Empty, request(name))
