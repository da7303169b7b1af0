# SPDX-License-Identifier: BSD-3-Clause
"""Connections between ROS nodes (TCPROS): connection header, framing, opening a connection, sending without waiting.

A length precedes every part of the stream; the connection header that opens it consists of ``key=value`` fields.
"""

from __future__ import annotations

import http.client
import re
import select
import socket
import struct
import threading
import xmlrpc.client
from collections.abc import Callable, Mapping
from typing import Any
from xml.parsers.expat import ExpatError

from impedance_modules.backends.baxter.ros.timed_socket import TimedSocket
from impedance_modules.errors import ImpedanceError

LENGTH = struct.Struct("<I")

LONGEST_HEADER = 1 << 20
"""Longest connection header that is accepted [bytes]."""

LONGEST_MESSAGE = 1 << 22
"""Longest message that is accepted [bytes]."""

CONNECT_TIME = 1.0
"""Longest wait for another node in each step of opening a connection [s]."""

GREETING_TIME = 5.0
"""Longest time that opening a connection takes altogether, however slowly the other side talks [s]."""

LONGEST_ANSWER = 1 << 24
"""Longest answer to a call that is read [bytes]; a robot's description is the longest that there is."""

NOT_XMLRPC = (
    *(xmlrpc.client.Error, http.client.HTTPException, ExpatError, ValueError, TypeError, LookupError),
    *(AttributeError, ArithmeticError, RecursionError, AssertionError),
)
"""What Python's XML-RPC raises for answers that are none: its parser takes whatever comes for granted."""

READS, WRITES = select.POLLIN, select.POLLOUT

_HOST = re.compile(r"[A-Za-z0-9._:%-]{1,253}")

ANYTHING = "*"
"""Type and checksum of a subscriber that accepts every message."""


class HeaderError(ImpedanceError):
    """The other side of a connection sent a wrong header, refused, or closed the connection."""


class NoNodeError(HeaderError):
    """What answers at an address is no ROS node."""


class NotPublishedError(HeaderError):
    """The node at an address says that it does not publish a topic."""


def connect_to_topic(
    node_uri: str, caller: str, topic: str, fields: Mapping[str, str]
) -> tuple[socket.socket, dict[str, str]]:
    """Asks a node for a topic and opens the connection on which its messages come.

    Args:
        node_uri: XML-RPC address of the publisher.
        caller: Name of this node.
        topic: Full name.
        fields: Type, checksum and definition that this side expects.

    Returns:
        The connected socket, without a time-out, and the publisher's header.

    Raises:
        HeaderError: The node does not publish the topic (any more), or publishes another message type.
        OSError: It cannot be reached.
    """
    return open_connection(topic_address(node_uri, caller, topic), caller, topic, fields)


def open_connection(
    address: tuple[str, int], caller: str, topic: str, fields: Mapping[str, str]
) -> tuple[socket.socket, dict[str, str]]:
    """Opens a connection to a node's topic port; arguments and errors as in ``connect_to_topic``."""
    try:
        plain = socket.create_connection(address, CONNECT_TIME)
    except (ValueError, OverflowError) as error:  # no host has that name
        raise HeaderError(f"{address[0][:60]!r}:{address[1]} is no address: {error}") from error
    connection = TimedSocket.of(plain, GREETING_TIME)
    try:
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        header = {"callerid": caller, "topic": topic, "tcp_nodelay": "1", **fields}
        connection.sendall(pack_header(header))
        answer = read_header(connection)
    except (OSError, HeaderError):
        connection.close()
        raise
    return connection.untimed(), answer


def topic_address(node_uri: str, caller: str, topic: str) -> tuple[str, int]:
    """Asks a node for the host and port of a topic.

    Raises:
        NotPublishedError: It does not publish the topic.
        NoNodeError: What answers is no ROS node.
        OSError: Nothing answers; ``ConnectionRefusedError`` where nothing listens.
    """
    try:
        with remote(node_uri, CONNECT_TIME) as node:
            answer: Any = node.requestTopic(caller, topic, [["TCPROS"]])
    except NOT_XMLRPC as error:
        raise NoNodeError(f"{node_uri} is no ROS node ({type(error).__name__})") from error
    if not isinstance(answer, list) or len(answer) != 3:
        raise NoNodeError(f"{node_uri} is no ROS node: it says {str(answer)[:60]!r}")
    if answer[0] != 1 or not isinstance(answer[2], list) or len(answer[2]) < 3:
        raise NotPublishedError(f"{node_uri} does not publish {topic}")
    host, port = answer[2][1], answer[2][2]
    if (
        not isinstance(host, str)
        or not _HOST.fullmatch(host)
        or type(port) is not int
        or not 0 < port < 65536
    ):
        raise NoNodeError(f"{node_uri} is no ROS node: {str(answer[2])[:60]!r} is no address")
    return host, port


class SubscriberConnection:
    """One open connection, over which a publisher sends to one subscriber.

    A message is sent in the calling thread; only if the subscriber's buffer is full does a thread take over, and then
    only the newest of the messages that came meanwhile follows.
    """

    def __init__(self, connection: socket.socket, on_end: Callable[[SubscriberConnection], None]) -> None:
        """Takes a connection whose headers are exchanged, and closes it in the end.

        Args:
            connection: To the subscriber.
            on_end: Called once when the connection is over, whoever closed it.
        """
        connection.setblocking(False)
        self._connection, self._on_end = connection, on_end
        self._lock = threading.Lock()
        self._rest = b""
        self._next: bytes | None = None
        self._stopped = False
        self._wake_sender, self._wake_receiver = socket.socketpair()
        self._wake_sender.setblocking(False)
        threading.Thread(target=self._watch, daemon=True, name="subscriber").start()

    def send(self, data: bytes) -> None:
        """Sends now, or as soon as the subscriber has read what it was sent before."""
        with self._lock:
            if self._rest:
                self._next = data
                return
            self._rest = self._push(data)
            if self._rest:
                self._wake_sender.send(b"!")

    def stop(self) -> None:
        """Closes the connection."""
        with self._lock:
            if self._stopped:
                return
            self._stopped = True
            self._wake_sender.send(b"!")

    def _push(self, data: bytes) -> bytes:
        """Writes what fits and returns the rest; on a broken connection nothing remains."""
        try:
            return data[self._connection.send(data) :]
        except BlockingIOError:
            return data
        except OSError:
            # The subscriber is gone; the watching thread removes it.
            return b""

    def _watch(self) -> None:
        """Body of the thread: waits for the end of the connection, and writes what is left over."""
        poll = select.poll()  # unlike select(), it takes descriptors of any number
        poll.register(self._connection, READS)
        poll.register(self._wake_receiver, READS)
        while not self._stopped:
            poll.modify(self._connection, READS | WRITES if self._rest else READS)
            events = dict(poll.poll())
            if self._wake_receiver.fileno() in events:
                self._wake_receiver.recv(64)
            own = events.get(self._connection.fileno(), 0)
            if own & ~WRITES and self._is_closed():
                break
            if own & WRITES:
                with self._lock:
                    self._rest = self._push(self._rest)
                    if not self._rest and self._next is not None:
                        self._rest, self._next = self._push(self._next), None
        self._on_end(self)
        with self._lock:
            self._stopped = True
            for part in (self._connection, self._wake_sender, self._wake_receiver):
                part.close()

    def _is_closed(self) -> bool:
        try:
            return self._connection.recv(4096) == b""
        except BlockingIOError:
            return False
        except OSError:
            return True


def pack_header(fields: Mapping[str, str]) -> bytes:
    """Lays out the fields that open a connection."""
    parts = []
    for key, value in fields.items():
        field = f"{key}={value}".encode()
        parts.append(LENGTH.pack(len(field)) + field)
    body = b"".join(parts)
    return LENGTH.pack(len(body)) + body


def read_header(connection: socket.socket) -> dict[str, str]:
    """Reads the fields that open a connection.

    Raises:
        HeaderError: They are not a header, or contain ``error``.
        OSError: The connection fails or its time-out passes.
    """
    (length,) = LENGTH.unpack(_exactly(connection, LENGTH.size))
    if length > LONGEST_HEADER:
        raise HeaderError(f"a header of {length} bytes is not TCPROS")
    body = _exactly(connection, length)
    fields: dict[str, str] = {}
    at = 0
    while at < length:
        if at + LENGTH.size > length:
            raise HeaderError("the header breaks off")
        (size,) = LENGTH.unpack_from(body, at)
        key, equals, value = body[at + 4 : at + 4 + size].decode("utf-8", "replace").partition("=")
        if not equals or at + 4 + size > length:
            raise HeaderError("the header is not TCPROS")
        fields[key] = value
        at += 4 + size
    if "error" in fields:
        raise HeaderError(fields["error"])
    return fields


def cut_frames(buffer: bytearray) -> bytes | None:
    """Removes all complete messages from the front of a buffer and returns the newest one.

    Raises:
        HeaderError: A length that no message has; the stream is out of sync.
    """
    newest, at = None, 0
    while len(buffer) - at >= LENGTH.size:
        (size,) = LENGTH.unpack_from(buffer, at)
        if size > LONGEST_MESSAGE:
            raise HeaderError(f"a message of {size} bytes is not one")
        if len(buffer) - at - LENGTH.size < size:
            break
        newest = (at + LENGTH.size, at + LENGTH.size + size)
        at += LENGTH.size + size
    data = None if newest is None else bytes(buffer[newest[0] : newest[1]])
    del buffer[:at]
    return data


class _TimedConnection(http.client.HTTPConnection):
    """HTTP on a connection that ends in time."""

    def connect(self) -> None:
        """Connects, and begins to count."""
        super().connect()
        self.sock = TimedSocket.of(self.sock, SLOWEST * float(self.timeout or CONNECT_TIME))


SLOWEST = 3.0
"""A whole call may take so many times as long as its connecting."""


class TimedTransport(xmlrpc.client.Transport):
    """XML-RPC whose calls end in time, with answers of bounded length."""

    accept_gzip_encoding = False  # a short answer could be unpacked to a long one

    def __init__(self, seconds: float) -> None:
        super().__init__()
        self._seconds = seconds

    def make_connection(self, host: Any) -> http.client.HTTPConnection:
        """Connects with a time-out."""
        name, *_ = self.get_host_info(host)
        connection = _TimedConnection(name, timeout=self._seconds)
        self._connection = host, connection  # closed with the proxy
        return connection

    def parse_response(self, response: Any) -> Any:
        """Reads an answer as it comes, up to its longest length."""
        parser, target = self.getparser()
        length = 0
        while data := response.read1(1 << 16):
            length += len(data)
            if length > LONGEST_ANSWER:
                raise xmlrpc.client.ResponseError(f"an answer of more than {LONGEST_ANSWER} bytes")
            parser.feed(data)
        parser.close()
        return target.close()


def remote(uri: str, seconds: float) -> xmlrpc.client.ServerProxy:
    """Returns a proxy of an XML-RPC server whose every call takes at most ``seconds`` per socket operation."""
    return xmlrpc.client.ServerProxy(uri, transport=TimedTransport(seconds), allow_none=True)


def _exactly(connection: socket.socket, count: int) -> bytes:
    parts = bytearray()
    while len(parts) < count:
        more = connection.recv(count - len(parts))
        if not more:
            raise HeaderError("the other side hung up")
        parts += more
    return bytes(parts)
