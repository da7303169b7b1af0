# SPDX-License-Identifier: BSD-3-Clause
"""One contract, three transports: in one process, plain sockets, rospy."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from itertools import count

import pytest

from impedance_modules.backends.baxter.ros.messages import Bool, Empty, Float64, String, UInt16
from impedance_modules.backends.baxter.ros.socket_transport import SocketTransport
from impedance_modules.backends.baxter.ros.transport import Transport, TransportClosedError
from impedance_modules.backends.baxter.ros.wire import checksum_of
from tests.support.in_process_transport import InProcessMaster, InProcessTransport
from tests.support.ros_master import Heard, until

NUMBERS = count()


class World:
    """A transport under test, and as many others on the same master as wanted."""

    def __init__(self, own: Transport, make: Callable[[str], Transport]) -> None:
        self.own, self._make = own, make
        self._others: list[Transport] = []
        self.topic = f"/topic_{next(NUMBERS)}"

    def other(self) -> Transport:
        transport = self._make(f"/other_{next(NUMBERS)}")
        self._others.append(transport)
        return transport

    def close(self) -> None:
        for transport in self._others:
            transport.close()


@pytest.fixture(
    params=[
        "in process",
        pytest.param("sockets", marks=pytest.mark.ros),
        pytest.param("rospy", marks=pytest.mark.ros),
    ]
)
def world(request) -> Iterator[World]:
    if request.param == "in process":
        hub = InProcessMaster()
        found = World(InProcessTransport(hub, "/own"), lambda name: InProcessTransport(hub, name))
    else:
        uri = request.getfixturevalue("master")
        own = (
            request.getfixturevalue("rospy_node")
            if request.param == "rospy"
            else SocketTransport(f"/own_{next(NUMBERS)}", uri)
        )
        found = World(own, lambda name: SocketTransport(name, uri))
    yield found
    found.close()
    if request.param != "rospy":
        found.own.close()


def test_a_subscriber_hears_every_publisher_early_or_late(world: World) -> None:
    heard = Heard()
    early = world.other().advertise(world.topic, Float64)
    world.own.subscribe(world.topic, Float64, heard)
    late = world.other().advertise(world.topic, Float64)
    assert until(lambda: early.connections() == 1 and late.connections() == 1)
    before = time.monotonic()
    early.send(Float64(1.5))
    late.send(Float64(-2.5))
    assert until(lambda: len(heard.messages) == 2)
    assert set(heard.messages) == {Float64(1.5), Float64(-2.5)}
    assert all(before <= received <= time.monotonic() for received in heard.times)


def test_what_is_sent_arrives_everywhere_whole_and_in_order(world: World) -> None:
    listeners = [Heard(), Heard()]
    publisher = world.own.advertise(world.topic, String)
    for heard in listeners:
        world.other().subscribe(world.topic, String, heard)
    assert until(lambda: publisher.connections() == 2)
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
    assert until(lambda: publisher.connections() == 1)
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
    assert until(lambda: publisher.connections() == 1)
    big = String("x" * 1_000_000)
    began = time.monotonic()
    for _ in range(20):
        publisher.send(big)
    assert time.monotonic() - began < 1.0


def test_after_closing_nothing_is_heard_and_nobody_is_registered(world: World) -> None:
    heard = Heard()
    other = world.other()
    publisher = other.advertise(world.topic, Empty)
    subscription = world.own.subscribe(world.topic, Empty, heard)
    assert until(lambda: publisher.connections() == 1)
    subscription.close()
    subscription.close()
    publisher.send(Empty())
    time.sleep(0.1)
    assert heard.messages == []
    assert world.own.publishers_of(world.topic) == (other.node_name,)
    publisher.close()
    publisher.close()
    assert until(lambda: world.own.publishers_of(world.topic) == ())
    with pytest.raises(TransportClosedError):
        publisher.send(Empty())
    other.close()
    with pytest.raises(TransportClosedError):
        other.advertise(world.topic, Empty)


def test_two_handles_on_one_topic_are_two_until_both_are_closed(world: World) -> None:
    heard = Heard()
    first, second = (world.own.advertise(world.topic, UInt16) for _ in range(2))
    world.other().subscribe(world.topic, UInt16, heard)
    assert until(lambda: second.connections() == 1)
    first.close()
    second.send(UInt16(500))
    assert until(lambda: heard.messages == [UInt16(500)])
    assert world.own.publishers_of(world.topic) == (world.own.node_name,)


def test_offers_name_others_types_and_checksums(world: World) -> None:
    world.own.advertise(world.topic, Bool)
    other = world.other()
    other.advertise(world.topic, Float64)
    assert world.own.publishers_of(world.topic) == tuple(sorted((other.node_name, world.own.node_name)))
    (offer,) = world.own.offers_of(world.topic)
    assert (offer.node, offer.ros_type, offer.checksum, offer.problem) == (
        other.node_name,
        "std_msgs/Float64",
        checksum_of(Float64),
        None,
    )


def test_another_message_under_the_same_name_is_not_heard(world: World) -> None:
    heard = Heard()
    wrong = world.other().advertise(world.topic, Float64)
    world.own.subscribe(world.topic, Bool, heard)
    right = world.other().advertise(world.topic, Bool)
    assert until(lambda: right.connections() == 1)
    wrong.send(Float64(1.0))
    right.send(Bool(True))
    assert until(lambda: heard.messages == [Bool(True)])


def test_parameters_come_back_and_unknown_ones_are_none(world: World) -> None:
    name = f"/parameter_{next(NUMBERS)}"
    assert world.own.get_parameter(name) is None
    for value in (True, 7, 0.25, "<robot name='é'/>" * 2000, [1, [2.5, "x"]], {"a": {"b": 1}}):
        world.own.set_parameter(name, value)
        assert world.other().get_parameter(name) == value
