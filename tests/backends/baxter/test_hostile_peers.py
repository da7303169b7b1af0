# SPDX-License-Identifier: BSD-3-Clause
"""Peers that talk nonsense, too much, too slowly, too often: refused or tried again; no thread dies, nothing grows."""

import http.client
import resource
import socket
import struct
import subprocess
import sys
import threading
import time
import xmlrpc.client
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from impedance_modules.backends.baxter.ros import socket_topics, socket_transport, tcp_connection
from impedance_modules.backends.baxter.ros.master_client import MasterClient
from impedance_modules.backends.baxter.ros.messages import Float64
from impedance_modules.backends.baxter.ros.socket_topics import (
    MOST_PUBLISHERS,
    PublishedTopic,
    SocketPublisher,
    SocketSubscription,
)
from impedance_modules.backends.baxter.ros.socket_transport import LONGEST_CALL, NodeEvents, NodeServer
from impedance_modules.backends.baxter.ros.tcp_connection import (
    NoNodeError,
    pack_header,
    read_header,
    topic_address,
)
from impedance_modules.backends.baxter.ros.timed_socket import TimedSocket
from impedance_modules.backends.baxter.ros.transport import NoMasterError
from tests.support.ros_master import Heard, until

GREETING = {"callerid": "/x", "topic": "/t", "type": "*", "md5sum": "*"}


@dataclass
class Node:
    """A node with one topic, and what it was told."""

    topic: PublishedTopic
    server: NodeServer
    updates: list[object] = field(default_factory=list)
    stops: list[int] = field(default_factory=list)

    @property
    def port(self) -> int:
        return int(self.server._tcp.getsockname()[1])

    @property
    def calls(self) -> int:
        return int(self.server._xmlrpc.server_address[1])

    def connect(self) -> socket.socket:
        return socket.create_connection(("127.0.0.1", self.port), 5.0)

    def greeted(self) -> socket.socket:
        """A subscriber whose greeting was answered."""
        connection = self.connect()
        connection.sendall(pack_header(GREETING))
        assert read_header(connection)["topic"] == "/t"
        return connection

    def answers(self) -> bool:
        try:
            self.greeted().close()
            return xmlrpc.client.ServerProxy(f"http://127.0.0.1:{self.calls}/").getPid("/x")[0] == 1
        except (OSError, tcp_connection.HeaderError, http.client.HTTPException):
            return False


@pytest.fixture
def dead_threads(monkeypatch) -> list[str]:
    found: list[str] = []
    monkeypatch.setattr(
        threading, "excepthook", lambda how: found.append(f"{how.exc_type.__name__}: {how.exc_value}")
    )
    return found


@pytest.fixture
def node(monkeypatch, dead_threads) -> Iterator[Node]:
    monkeypatch.setattr(socket_transport, "GREETING_TIME", 0.5)
    topic = PublishedTopic("/me", "/t", Float64)
    updates: list[object] = []
    stops: list[int] = []
    events = NodeEvents(
        lambda name, publishers: updates.append((name, publishers)),
        {"/t": topic}.get,
        list,
        lambda: [("/t", "std_msgs/Float64")],
        lambda: stops.append(1),
    )
    server = NodeServer("127.0.0.1", "http://127.0.0.1:1/", events)
    yield Node(topic, server, updates, stops)
    topic.close()
    server.close()
    assert not dead_threads


def threads(name: str) -> int:
    return sum(thread.name == name for thread in threading.enumerate())


# --- as a publisher ---------------------------------------------------------------------------------------


def test_garbage_and_endless_lengths_are_refused(node: Node) -> None:
    for data in (
        b"",
        b"\0" * 200,
        b"GET / HTTP/1.0\r\n\r\n",
        struct.pack("<I", 0xFFFFFFFF),
        struct.pack("<II", 8, 900),
    ):
        with node.connect() as peer:
            peer.sendall(data)
    assert until(node.answers)


def test_slow_greeters_are_hung_up_on_and_are_never_more_than_so_many(node: Node) -> None:
    """Each sends a byte now and then, so that no single read is late."""
    peers = [node.connect() for _ in range(2 * socket_transport.MOST_GREETERS)]
    began = time.monotonic()
    for _ in range(3):
        for peer in peers:
            try:
                peer.sendall(struct.pack("<I", 1 << 20)[:1])
            except OSError:
                continue
        assert threads("handshake") <= socket_transport.MOST_GREETERS + socket_transport.MOST_CALLS
        time.sleep(0.15)
    assert until(lambda: threads("handshake") == 0)
    assert time.monotonic() - began < 5.0
    assert until(node.answers)
    for peer in peers:
        peer.close()


def test_listeners_beyond_a_number_are_refused_and_deaf_ones_cost_two_messages(
    node: Node, monkeypatch
) -> None:
    monkeypatch.setattr(socket_topics, "MOST_SUBSCRIBERS", 3)
    peers = [node.greeted() for _ in range(3)]
    assert until(lambda: node.topic.count() == 3)
    with node.connect() as more:
        more.sendall(pack_header(GREETING))
        with pytest.raises(tcp_connection.HeaderError, match="/t has 3 subscribers"):
            read_header(more)
    data = struct.pack("<I", 1 << 20) + b"x" * (1 << 20)
    for _ in range(200):
        node.topic.send(data)
    held = [subscriber for subscriber in node.topic._subscribers]
    assert all(len(each._rest) + len(each._next or b"") <= 2 * len(data) for each in held)
    for peer in peers:
        peer.close()
    assert until(lambda: node.topic.count() == 0)


FLOOD = """
import socket, sys, time
held = []
for _ in range(300):
    try:
        held.append(socket.create_connection(("127.0.0.1", int(sys.argv[1])), 1))
    except OSError:
        break
print(len(held), flush=True)
time.sleep(1.5)
"""


@pytest.mark.parametrize("door", ["port", "calls"])
def test_a_node_that_ran_out_of_descriptors_answers_again(node: Node, door: str) -> None:
    """Without descriptors nothing can be accepted; the thread that accepts must live on."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    words = [sys.executable, "-S", "-c", FLOOD, str(getattr(node, door))]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as child:
        open_now = len(list(Path("/proc/self/fd").iterdir()))
        resource.setrlimit(resource.RLIMIT_NOFILE, (open_now + 5, hard))
        try:
            assert int(child.stdout.readline()) > 5
            child.wait(10)
        finally:
            resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))
    assert threads("accept") >= 1
    assert until(node.answers)


def test_calls_are_bounded(node: Node) -> None:
    def post(length: str, body: bytes = b"", **more: str) -> int:
        connection = http.client.HTTPConnection("127.0.0.1", node.calls, timeout=5.0)
        connection.putrequest("POST", "/")
        for key, value in {"Content-Type": "text/xml", "Content-Length": length, **more}.items():
            connection.putheader(key, value)
        connection.endheaders()
        connection.send(body)
        return connection.getresponse().status

    for length in (str(LONGEST_CALL + 1), "99999999999", "9" * 30, "-5", "x", ""):
        assert post(length) == 413
    assert post("10", **{"Content-Encoding": "gzip"}) == 415
    with socket.create_connection(("127.0.0.1", node.calls), 5.0) as slow:
        slow.sendall(b"POST / HTTP/1.1\r\nContent-Length: 500\r\n\r\n")
        assert until(lambda: slow.recv(100) == b"", 3.0), "hung up on, however slowly it talks"
    peers = [
        socket.create_connection(("127.0.0.1", node.calls), 5.0)
        for _ in range(3 * socket_transport.MOST_CALLS)
    ]
    assert threads("handshake") <= socket_transport.MOST_CALLS
    for peer in peers:
        peer.close()
    assert until(node.answers)


@pytest.mark.parametrize(
    "body",
    [
        b"<html>",
        xmlrpc.client.dumps((), "system.listMethods").encode(),
        xmlrpc.client.dumps((), "__class__").encode(),
        xmlrpc.client.dumps(("/x", "/t", 5), "publisherUpdate").encode(),
        xmlrpc.client.dumps(("/x", 7, ["http://a:1/"]), "publisherUpdate").encode(),
        b'<?xml version="1.0"?><!DOCTYPE l [<!ENTITY a "' + b"x" * 50 + b'">'
        + b"".join(b'<!ENTITY %c "%s">' % (98 + i, (b"&%c;" % (97 + i)) * 10) for i in range(9))
        + b"]><methodCall><methodName>&j;</methodName></methodCall>",
    ],
    ids=range(6),
)  # fmt: skip
def test_calls_that_are_none_change_nothing(node: Node, body: bytes) -> None:
    connection = http.client.HTTPConnection("127.0.0.1", node.calls, timeout=5.0)
    connection.request("POST", "/", body, {"Content-Type": "text/xml"})
    said = connection.getresponse().read()
    assert b"fault" in said or b"-1" in said
    assert not node.updates and not node.stops and node.answers()


def test_asked_to_stop_many_times_a_node_stops_once(node: Node) -> None:
    proxy = xmlrpc.client.ServerProxy(f"http://127.0.0.1:{node.calls}/")
    for _ in range(5):
        assert proxy.shutdown("/stranger", "bye")[0] == 1
    assert until(lambda: node.stops == [1])


# --- as a subscriber --------------------------------------------------------------------------------------


class BadPublisher:
    """Answers every call with the same bytes."""

    def __init__(self, answer: Callable[[socket.socket], None]) -> None:
        self.listener = socket.create_server(("127.0.0.1", 0))
        self.hits, self._answer = 0, answer
        threading.Thread(target=self._serve, daemon=True).start()

    @property
    def uri(self) -> str:
        return f"http://127.0.0.1:{self.listener.getsockname()[1]}/"

    def _serve(self) -> None:
        while True:
            try:
                connection, _ = self.listener.accept()
            except OSError:
                return
            self.hits += 1
            with connection:
                try:
                    connection.settimeout(1.0)
                    connection.recv(65536)
                    self._answer(connection)
                except OSError:
                    continue


def body(content: bytes) -> Callable[[socket.socket], None]:
    head = b"HTTP/1.1 200 OK\r\nContent-Type: text/xml\r\nContent-Length: %d\r\n\r\n" % len(content)
    return lambda connection: connection.sendall(head + content)


def says(value: object) -> bytes:
    return xmlrpc.client.dumps((value,), methodresponse=True, allow_none=True).encode()


def value(inner: bytes) -> bytes:
    return (
        b"<?xml version='1.0'?><methodResponse><params><param><value>%s</value></param></params></methodResponse>"
        % inner
    )


ANSWERS = {
    "port text": says([1, "", ["TCPROS", "127.0.0.1", "abc"]]),
    "port beyond": says([1, "", ["TCPROS", "127.0.0.1", 99999]]),
    "port negative": says([1, "", ["TCPROS", "127.0.0.1", -1]]),
    "port true": says([1, "", ["TCPROS", "127.0.0.1", True]]),
    "port none": says([1, "", ["TCPROS", "127.0.0.1", None]]),
    "host long": says([1, "", ["TCPROS", "a" * 70 + ".x", 80]]),
    "host dots": says([1, "", ["TCPROS", "..", 80]]),
    "host tab": says([1, "", ["TCPROS", "a\tb", 80]]),
    "host none": says([1, "", ["TCPROS", None, 80]]),
    "short": says([1, "", ["TCPROS"]]),
    "a number": says(5),
    "code text": says(["x", "", 0]),
    "nothing": b"",
    "html": b"<html>hi</html>",
    "no param": b"<?xml version='1.0'?><methodResponse></methodResponse>",
    "bad int": value(b"<int>abc</int>"),
    "long int": value(b"<int>" + b"9" * 5000 + b"</int>"),
    "bad base64": value(b"<base64>%%%</base64>"),
    "bad member": value(b"<struct><member><value>1</value></member></struct>"),
    "bad date": value(b"<dateTime.iso8601>x</dateTime.iso8601>"),
    "deep": value(b"<array><data><value>" * 5000),
}


@pytest.mark.parametrize("name", ANSWERS)
def test_a_publisher_that_answers_nonsense_is_tried_again(name: str, dead_threads) -> None:
    bad = BadPublisher(body(ANSWERS[name]))
    with pytest.raises((tcp_connection.HeaderError, OSError)):
        address = topic_address(bad.uri, "/me", "/t")
        tcp_connection.open_connection(address, "/me", "/t", {})
    subscription = SocketSubscription("/me", "/t", Float64, Heard(), lambda: None)
    subscription.update([bad.uri])
    assert until(lambda: bad.hits >= 3), "it is tried again"
    assert not dead_threads
    subscription.close()
    with pytest.raises(NoMasterError):
        MasterClient(bad.uri, "/me").publishers_of("/t")
    bad.listener.close()


def endless(connection: socket.socket) -> None:
    connection.sendall(
        b"HTTP/1.1 200 OK\r\nContent-Type: text/xml\r\n\r\n<?xml version='1.0'?><methodResponse>"
    )
    while True:
        connection.sendall(b"<!-- " + b"x" * 100_000 + b" -->")


def dripping(connection: socket.socket) -> None:
    connection.sendall(b"HTTP/1.1 200 OK\r\n")
    for sign in b"X-A: " + b"b" * 1000:
        connection.sendall(bytes([sign]))
        time.sleep(0.05)


@pytest.mark.parametrize("answer", [endless, dripping])
def test_an_answer_without_end_ends(answer, monkeypatch) -> None:
    monkeypatch.setattr(tcp_connection, "CONNECT_TIME", 0.2)
    monkeypatch.setattr(tcp_connection, "LONGEST_ANSWER", 1 << 20)
    bad = BadPublisher(answer)
    began = time.monotonic()
    with pytest.raises((NoNodeError, OSError)):
        topic_address(bad.uri, "/me", "/t")
    assert time.monotonic() - began < 10.0
    bad.listener.close()


ADDRESSES = (
    "ftp://x",
    "http://[bad",
    "",
    "http://127.0.0.1:999999/",
    "http://a b:1/",
    "http://a:1/\r\nX: y",
    5,
    None,
    ["x"],
)


def test_addresses_that_are_none_are_left_out(dead_threads) -> None:
    subscription = SocketSubscription("/me", "/t", Float64, Heard(), lambda: None)
    for said in (list(ADDRESSES), 5, None, "http://127.0.0.1:1/", {"http://127.0.0.1:1/": 1}):
        subscription.update(said)
        assert subscription._links == {}
    subscription.update(["http://" + "a" * 70 + ".x:80/", "http://127.0.0.1:99999/", "http://..:1/"])
    subscription.update([f"http://127.0.0.{n}:1/" for n in range(1, 200)])
    assert len(subscription._links) == MOST_PUBLISHERS
    time.sleep(0.2)
    subscription.close()
    assert not dead_threads


def test_a_publisher_heard_beside_a_bad_one(node: Node, dead_threads) -> None:
    bad = BadPublisher(body(b"<html>"))
    heard = Heard()
    subscription = SocketSubscription("/me", "/t", Float64, heard, lambda: None)
    subscription.update([bad.uri, node.server.uri, "http://[bad"])
    assert until(lambda: node.topic.count() == 1)
    SocketPublisher(node.topic, lambda: None).send(Float64(2.5))
    assert until(lambda: heard.messages == [Float64(2.5)])
    subscription.close()
    bad.listener.close()


def test_a_connection_is_over_at_its_time_however_slowly_the_other_side_talks() -> None:
    one, other = socket.socketpair()
    timed, over = TimedSocket.of(one, 0.3), threading.Event()

    def drip() -> None:
        while not over.wait(0.05):
            other.send(b"x")

    threading.Thread(target=drip, daemon=True).start()
    with pytest.raises(TimeoutError):
        while True:
            timed.recv(1)
    over.set()
    plain = timed.untimed()
    assert plain.gettimeout() is None and timed.fileno() == -1
    plain.close()
