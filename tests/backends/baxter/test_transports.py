# SPDX-License-Identifier: BSD-3-Clause
"""One contract for three transports (in process, sockets, rospy), and nodes that end, return or answer wrongly."""

import re
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from http.server import BaseHTTPRequestHandler, HTTPServer
from itertools import count
from pathlib import Path

import pytest

from impedance_modules.backends.baxter.ros.master_client import MasterClient, master_uri_of
from impedance_modules.backends.baxter.ros.messages import Bool, Empty, Float64, Message, String, UInt16
from impedance_modules.backends.baxter.ros.rospy_transport import RospyTransport
from impedance_modules.backends.baxter.ros.socket_transport import SocketTransport
from impedance_modules.backends.baxter.ros.tcp_connection import topic_address
from impedance_modules.backends.baxter.ros.transport import (
    NoMasterError,
    Publisher,
    Transport,
    TransportClosedError,
)
from impedance_modules.backends.baxter.ros.wire import checksum_of
from tests.support.baxter_process import start
from tests.support.in_process_transport import InProcessMaster, InProcessTransport
from tests.support.ros_master import ROSPY_NODE, TRANSPORTS, Heard, forget, free_port, until

NUMBERS = count()


class World:
    """A transport under test, and as many others on the same master as wanted; a topic of their own."""

    def __init__(self, make: Callable[[str], Transport], rospy_node: Transport | None = None) -> None:
        self._make, self._made = make, []
        self.topic = f"/topic_{next(NUMBERS)}"
        self.own, self.own_name = (rospy_node, ROSPY_NODE) if rospy_node else self.named("/own")

    def named(self, name: str) -> tuple[Transport, str]:
        """Another transport, and its name with a number."""
        name = f"{name}_{next(NUMBERS)}"
        self._made.append(self._make(name))
        return self._made[-1], name

    def other(self) -> Transport:
        return self.named("/other")[0]

    def hear(self, kind: type[Message], by: Transport | None = None) -> Heard:
        """Keeps what comes on the topic."""
        heard = Heard()
        (by or self.own).subscribe(self.topic, kind, heard)
        return heard

    def close(self) -> None:
        for transport in self._made:
            transport.close()


def make_world(kind: str, request) -> Iterator[World]:
    hub = InProcessMaster()
    if kind == "in process":
        world = World(lambda name: InProcessTransport(hub, name))
    else:
        uri = request.getfixturevalue("master")
        rospy_node = request.getfixturevalue("rospy_node") if kind == "rospy" else None
        world = World(lambda name: SocketTransport(name, uri), rospy_node)
    yield world
    world.close()


@pytest.fixture(
    params=["in process", *(pytest.param(kind, marks=pytest.mark.ros) for kind in ("sockets", "rospy"))]
)
def world(request) -> Iterator[World]:
    """Of every transport."""
    yield from make_world(request.param, request)


@pytest.fixture(params=TRANSPORTS)
def ros_world(request) -> Iterator[World]:
    """Of those that need a master."""
    yield from make_world(request.param, request)


@pytest.fixture
def socket_world(request) -> Iterator[World]:
    yield from make_world("sockets", request)


def connected(*publishers: Publisher, count: int = 1) -> bool:
    return until(lambda: all(publisher.connections() == count for publisher in publishers))


def test_a_subscriber_hears_every_publisher_early_or_late(world: World) -> None:
    early = world.other().advertise(world.topic, Float64)
    heard = world.hear(Float64)
    late = world.other().advertise(world.topic, Float64)
    assert connected(early, late)
    before = time.monotonic()
    early.send(Float64(1.5))
    late.send(Float64(-2.5))
    assert until(lambda: len(heard.messages) == 2)
    assert set(heard.messages) == {Float64(1.5), Float64(-2.5)}
    assert all(before <= received <= time.monotonic() for received in heard.times)


def test_what_is_sent_arrives_everywhere_whole_and_in_order(world: World) -> None:
    publisher = world.own.advertise(world.topic, String)
    listeners = [world.hear(String, by=world.other()) for _ in range(2)]
    assert connected(publisher, count=2)
    texts = [String("é" * n) for n in (0, 1, 5000, 200_000)]
    for n, text in enumerate(texts):
        publisher.send(text)
        assert until(lambda n=n: all(len(heard.messages) == n + 1 for heard in listeners))
    assert all(heard.messages == texts for heard in listeners)


def test_latched_messages_reach_those_who_come_later(world: World) -> None:
    heard, unheard = Heard(), Heard()
    latched = world.own.advertise(world.topic, Float64, latch=True)
    plain = world.own.advertise(world.topic + "_plain", Float64)
    for value in (0.1, 0.2):
        latched.send(Float64(value))
        plain.send(Float64(value))
    world.other().subscribe(world.topic, Float64, heard)
    world.other().subscribe(world.topic + "_plain", Float64, unheard)
    assert until(lambda: heard.messages == [Float64(0.2)] and plain.connections() == 1)
    assert unheard.messages == []


def test_only_the_newest_message_waits_for_a_slow_listener(world: World) -> None:
    values: list[float] = []

    def slow(message: Float64, received: float) -> None:
        values.append(message.data)
        time.sleep(0.02)

    publisher = world.other().advertise(world.topic, Float64)
    world.own.subscribe(world.topic, Float64, slow)
    assert connected(publisher)
    began = time.monotonic()
    sent = 0
    while time.monotonic() - began < 0.3:
        publisher.send(Float64(float(sent)))
        sent += 1
        time.sleep(0.0005)
    assert until(lambda: values[-1] == sent - 1)
    assert values == sorted(values)
    assert time.monotonic() - began < 2.0
    assert len(values) <= 60


def test_sending_does_not_wait_for_a_listener_that_is_stuck(world: World) -> None:
    if isinstance(world.own, InProcessTransport):
        return  # a callback is the sender here; there is nobody to wait for
    publisher = world.own.advertise(world.topic, String)
    world.other().subscribe(world.topic, String, lambda message, received: time.sleep(1.5))
    assert connected(publisher)
    big = String("x" * 1_000_000)
    began = time.monotonic()
    for _ in range(20):
        publisher.send(big)
    assert time.monotonic() - began < 1.0


def test_after_closing_nothing_is_heard_and_nobody_is_registered(world: World) -> None:
    heard = Heard()
    other, name = world.named("/other")
    publisher = other.advertise(world.topic, Empty)
    subscription = world.own.subscribe(world.topic, Empty, heard)
    assert connected(publisher)
    subscription.close()
    subscription.close()
    publisher.send(Empty())
    time.sleep(0.1)
    assert heard.messages == []
    assert world.own.publishers_of(world.topic) == (name,)
    publisher.close()
    publisher.close()
    assert until(lambda: world.own.publishers_of(world.topic) == ())
    with pytest.raises(TransportClosedError):
        publisher.send(Empty())
    other.close()
    with pytest.raises(TransportClosedError):
        other.advertise(world.topic, Empty)


def test_two_handles_on_one_topic_are_two_until_both_are_closed(world: World) -> None:
    first, second = (world.own.advertise(world.topic, UInt16) for _ in range(2))
    heard = world.hear(UInt16, by=world.other())
    assert connected(second)
    first.close()
    second.send(UInt16(500))
    assert until(lambda: heard.messages == [UInt16(500)])
    assert world.own.publishers_of(world.topic) == (world.own_name,)


def test_offers_name_others_types_and_checksums(world: World) -> None:
    world.own.advertise(world.topic, Bool)
    other, name = world.named("/other")
    other.advertise(world.topic, Float64)
    assert world.own.publishers_of(world.topic) == tuple(sorted((name, world.own_name)))
    (publisher,) = world.own.publisher_info(world.topic)
    said = (publisher.node, publisher.ros_type, publisher.checksum, publisher.problem)
    assert said == (name, "std_msgs/Float64", checksum_of(Float64), None)


def test_another_message_under_the_same_name_is_not_heard(world: World) -> None:
    wrong = world.other().advertise(world.topic, Float64)
    heard = world.hear(Bool)
    right = world.other().advertise(world.topic, Bool)
    assert connected(right)
    wrong.send(Float64(1.0))
    right.send(Bool(True))
    assert until(lambda: heard.messages == [Bool(True)])


def test_parameters_come_back_and_unknown_ones_are_none(world: World) -> None:
    name = f"/parameter_{next(NUMBERS)}"
    assert world.own.get_parameter(name) is None
    for value in (True, 7, 0.25, "<robot name='é'/>" * 2000, [1, [2.5, "x"]], {"a": {"b": 1}}):
        world.own.set_parameter(name, value)
        assert world.other().get_parameter(name) == value


@pytest.mark.ros
def test_a_publisher_that_has_ended_is_named_and_does_no_harm(ros_world: World, master: str) -> None:
    registrar = MasterClient(master, "/dead")
    registrar.ask("registerPublisher", ros_world.topic, "std_msgs/Bool", f"http://127.0.0.1:{free_port()}/")
    heard = ros_world.hear(Bool)
    alive, name = ros_world.named("/alive")
    publisher = alive.advertise(ros_world.topic, Bool)
    assert connected(publisher)
    publisher.send(Bool(False))
    assert until(lambda: heard.messages == [Bool(False)])
    publishers = {publisher.node: publisher for publisher in ros_world.own.publisher_info(ros_world.topic)}
    assert publishers[name].problem is None and not publishers[name].gone
    assert publishers["/dead"].gone and "refused" in str(publishers["/dead"].problem)


@pytest.mark.ros
def test_an_ended_nodes_port_taken_by_another_program_is_not_taken_for_the_node(ros_world, master) -> None:
    """Ports come back: a later node, its topics, another program, or the master itself may answer there."""
    topic = ros_world.topic
    (heir, heir_name), (other, other_name) = ros_world.named("/heir"), ros_world.named("/other")
    heir.advertise(topic, Bool)
    other.advertise(f"{topic}_else", Bool)
    address = MasterClient(master, "/test").address_of
    host, port = topic_address(str(address(heir_name)), "/test", topic)
    with HTTPServer(("127.0.0.1", 0), BaseHTTPRequestHandler) as web:
        threading.Thread(target=web.serve_forever, daemon=True).start()
        answering = {
            "/dead_heir": address(heir_name),
            "/dead_other": address(other_name),
            "/dead_topic": f"http://{host}:{port}/",
            "/dead_web": f"http://127.0.0.1:{web.server_address[1]}/",
            "/dead_master": master,
        }
        if ros_world.own_name == ROSPY_NODE:
            answering["/dead_rospy"] = address(ROSPY_NODE)
        for node, uri in answering.items():
            MasterClient(master, node).ask("registerPublisher", topic, "std_msgs/Bool", uri)
        publishers = {publisher.node: publisher for publisher in ros_world.own.publisher_info(topic)}
        web.shutdown()
    assert {node for node, publisher in publishers.items() if not publisher.gone} == {heir_name}, publishers
    for node in answering:
        forget(master, node)


@pytest.mark.ros
def test_a_silent_node_counts_as_running(socket_world: World, master: str) -> None:
    with socket.create_server(("127.0.0.1", 0)) as mute:
        port = mute.getsockname()[1]
        silent = {"/silent": f"http://127.0.0.1:{port}/", "/nowhere": "http://no-such-robot.invalid:4000/"}
        for node, uri in silent.items():
            MasterClient(master, node).ask("registerPublisher", socket_world.topic, "std_msgs/Bool", uri)
        publishers = socket_world.own.publisher_info(socket_world.topic)
    said = [(publisher.node, publisher.gone) for publisher in publishers]
    assert said == [("/nowhere", False), ("/silent", False)]
    assert all("cannot be reached" in str(publisher.problem) for publisher in publishers)
    for node in silent:
        forget(master, node)


@pytest.fixture
def not_under_nohup() -> Iterator[None]:
    """Lets SIGHUP end programs started meanwhile, also where the tests themselves run under ``nohup``."""
    before = signal.signal(signal.SIGHUP, signal.SIG_DFL)
    yield
    signal.signal(signal.SIGHUP, before)


@pytest.mark.ros
@pytest.mark.usefixtures("not_under_nohup")
@pytest.mark.parametrize("kind", TRANSPORTS)
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_verb_ended_by_a_person_leaves_nothing_with_the_master(kind: str, number: int, master: str) -> None:
    """Also while it is still waiting for a robot, and though its terminal is gone."""
    process = start("baxter", "check", "--transport", kind)
    node = f"/impedance_check_{process.pid}"
    known = MasterClient(master, "/test").registrations_of
    assert until(lambda: any(known(node).values()), 30.0)
    process.send_signal(number)
    said, _ = process.communicate(timeout=30.0)
    assert process.returncode == 130, said
    assert not any(known(node).values()), known(node)


@pytest.mark.ros
def test_a_publisher_that_comes_back_is_heard_again(socket_world: World, master: str) -> None:
    heard = socket_world.hear(UInt16)
    for number in (1, 2):
        other = SocketTransport("/comes_back", master)
        publisher = other.advertise(socket_world.topic, UInt16)
        assert connected(publisher)
        publisher.send(UInt16(number))
        assert until(lambda number=number: heard.messages[-1:] == [UInt16(number)])
        other.close()


@pytest.mark.ros
def test_asking_a_publisher_does_not_disturb_it(socket_world: World, rospy_node) -> None:
    publisher = rospy_node.advertise(socket_world.topic, UInt16)
    heard = socket_world.hear(UInt16)
    for number in range(5):
        assert connected(publisher)
        assert socket_world.own.publisher_info(socket_world.topic)[0].problem is None
        assert connected(publisher)
        publisher.send(UInt16(number))
        assert until(lambda number=number: heard.messages[-1:] == [UInt16(number)])
    assert len(heard.messages) == 5


@pytest.mark.ros
def test_nothing_of_a_closed_node_is_left_with_the_master(master: str) -> None:
    own = SocketTransport("/leaves_nothing", master)
    own.advertise("/a", Bool, latch=True)
    own.subscribe("/b", Bool, Heard())
    own.close()
    own.close()
    registered = MasterClient(master, "/test").ask("getSystemState")
    assert not any("/leaves_nothing" in nodes for part in registered for _, nodes in part)


@pytest.mark.ros
def test_debians_own_tool_understands_our_node(socket_world, tmp_path) -> None:
    """`rostopic`-like second opinion: Debian's rospy with std_msgs' own classes, in its own interpreter."""
    script = tmp_path / "listen.py"
    script.write_text(
        "import rospy, std_msgs.msg as m\n"
        "rospy.init_node('debian', disable_signals=True)\n"
        "rospy.Publisher('/to_us', m.UInt16, queue_size=1, latch=True).publish(77)\n"
        "print(rospy.wait_for_message('/to_debian', m.Float64, timeout=10).data)\n"
        "rospy.sleep(1.0)\n"
        "rospy.signal_shutdown('')\n"
    )
    if not Path("/usr/lib/python3/dist-packages/rospy").is_dir():
        pytest.skip("no rospy of Debian's")
    heard = Heard()
    socket_world.own.advertise("/to_debian", Float64, latch=True).send(Float64(0.125))
    socket_world.own.subscribe("/to_us", UInt16, heard)
    command = ["/usr/bin/python3", script]
    done = subprocess.run(command, check=False, capture_output=True, text=True, timeout=30)
    assert "0.125" in done.stdout, done.stderr
    assert heard.messages == [UInt16(77)]


@pytest.mark.parametrize("uri", ["", "robot.local", "http://robot.local", "ftp://robot.local:11311"])
def test_a_missing_address_is_refused_with_an_example(uri: str) -> None:
    with pytest.raises(NoMasterError, match=re.escape("export ROS_MASTER_URI=http://ROBOT.local:11311")):
        master_uri_of({"ROS_MASTER_URI": uri})


def test_no_master_and_something_else_are_told_apart() -> None:
    with pytest.raises(NoMasterError, match=r"no ROS master answers at .*ping"):
        SocketTransport("/own", f"http://127.0.0.1:{free_port()}")
    with pytest.raises(NoMasterError, match=r"no ROS master answers"):
        SocketTransport("/own", "http://no-such-robot.invalid:11311")
    with HTTPServer(("127.0.0.1", 0), BaseHTTPRequestHandler) as somebody:
        threading.Thread(target=somebody.handle_request, daemon=True).start()
        with pytest.raises(NoMasterError, match=r"is no ROS master"):
            SocketTransport("/own", f"http://127.0.0.1:{somebody.server_address[1]}")


@pytest.mark.ros
@pytest.mark.parametrize("kind", TRANSPORTS)
@pytest.mark.parametrize("address", ["192.0.2.1", "no-such-machine.invalid"])
def test_an_address_that_is_not_ours_is_refused(kind: str, address: str, master: str, monkeypatch) -> None:
    transport = {"sockets": SocketTransport, "rospy": RospyTransport}[kind]
    monkeypatch.setenv("ROS_IP", address)
    with pytest.raises(NoMasterError, match=rf"'{address}' is not an address of this machine.*ROS_IP="):
        transport("/own", master)


def test_without_rospy_the_error_says_what_to_install(tmp_path: Path) -> None:
    """In a Python that cannot see rospy, whatever this one sees."""
    script = (
        "import sys; sys.modules['rospy'] = None\n"
        "from impedance_modules.backends.baxter.ros.rospy_transport import *\n"
        "try:\n    RospyTransport('/x', 'http://127.0.0.1:1')\n"
        "except NoRospyError as error:\n    print(error)\n"
    )
    done = subprocess.run([sys.executable, "-c", script], check=False, capture_output=True, text=True)
    assert "apt-get install --no-install-recommends python3-rospy" in done.stdout, done.stderr
    assert "--system-site-packages" in done.stdout
