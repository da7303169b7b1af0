# SPDX-License-Identifier: BSD-3-Clause
"""A ROS node by the standard library alone; no ROS needs to be installed.

``NodeServer`` has the node's two ports: XML-RPC, by which master and other nodes call it, and TCP, for its topics.
"""

from __future__ import annotations

import os
import socket
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from socketserver import ThreadingMixIn
from typing import Any, TypeVar
from xmlrpc.server import SimpleXMLRPCRequestHandler, SimpleXMLRPCServer

from impedance_modules.backends.baxter.ros.master_client import MasterTransport, check_own_host, own_host
from impedance_modules.backends.baxter.ros.messages import Message
from impedance_modules.backends.baxter.ros.socket_topics import (
    PublishedTopic,
    SocketPublisher,
    SocketSubscription,
)
from impedance_modules.backends.baxter.ros.tcp_connection import (
    GREETING_TIME,
    HeaderError,
    pack_header,
    read_header,
)
from impedance_modules.backends.baxter.ros.timed_socket import TimedSocket
from impedance_modules.backends.baxter.ros.transport import (
    Callback,
    NoMasterError,
)

M = TypeVar("M", bound=Message)

Answer = tuple[int, str, Any]

MOST_GREETERS = 32
"""Connections at once that have not yet said what they want."""

MOST_CALLS = 16
"""Calls at once that are answered."""

LONGEST_CALL = 1 << 20
"""Bytes; a list of publishers is the longest call that there is."""

LISTEN_TIME = 0.05
"""Longest time that closing a node takes [s]."""

_METHODS = {
    "requestTopic": "request_topic",
    "publisherUpdate": "publisher_update",
    "shutdown": "shutdown",
    "getPid": "pid",
    "getMasterUri": "master",
    "getPublications": "publications",
    "getSubscriptions": "subscriptions",
    "getBusInfo": "nothing",
    "getBusStats": "nothing",
    "paramUpdate": "nothing",
}
"""Name in ROS's slave API -> method of ``NodeServer``."""


class SocketTransport(MasterTransport):
    """One ROS node."""

    def __init__(self, node_name: str, master_uri: str) -> None:
        """Registers nothing yet; the master must answer.

        Args:
            node_name: Full name, e.g. ``/impedance_modules_1234``; a second node of that name would replace this.
            master_uri: From ``master_uri_of(os.environ)``.

        Raises:
            NoMasterError: No master answers there, or this machine's own name (ROS_IP) is wrong.
        """
        super().__init__(node_name, master_uri)
        self._master.check()
        self._lock = threading.RLock()
        self._topics: dict[str, PublishedTopic] = {}
        self._subscriptions: list[SocketSubscription[Any]] = []
        host = own_host(os.environ, master_uri)
        events = NodeEvents(
            self._follow,
            self._topics.get,
            self._subscribed_topics,
            self._published_topics,
            self.close,
        )
        check_own_host(host)
        self._server = NodeServer(host, master_uri, events)

    def advertise(self, topic: str, message_type: type[M], *, latch: bool = False) -> SocketPublisher[M]:
        """Becomes a publisher of a topic."""
        self._check()
        with self._lock:
            published = self._topics.get(topic)
            if published is None:
                published = PublishedTopic(self._node_name, topic, message_type)
                self._topics[topic] = published
                self._master.ask("registerPublisher", topic, message_type.ros_type, self._server.uri)
            published.users += 1
            if latch:
                published.keep_last()
        return SocketPublisher(published, lambda: self._release_topic(topic))

    def subscribe(self, topic: str, message_type: type[M], callback: Callback[M]) -> SocketSubscription[M]:
        """Subscribes to every publisher of a topic."""
        self._check()
        subscription = SocketSubscription(
            self._node_name, topic, message_type, callback, lambda: self._unsubscribed(subscription)
        )
        with self._lock:
            self._subscriptions.append(subscription)
        publishers = self._master.ask("registerSubscriber", topic, message_type.ros_type, self._server.uri)
        subscription.update(publishers)
        return subscription

    def close(self) -> None:
        """Unregisters everything of this node; a master that has ended does not matter."""
        with self._lock:
            if self._closed:
                return
            self._closed = True
            subscriptions, topics = list(self._subscriptions), list(self._topics)
        for subscription in subscriptions:
            subscription.close()
        for topic in topics:
            self._drop(topic)
        self._unregister_all(self._server.uri)
        self._server.close()

    def _follow(self, topic: str, publishers: list[str]) -> None:
        with self._lock:
            concerned = [s for s in self._subscriptions if s.topic == topic]
        for subscription in concerned:
            subscription.update(publishers)

    def _subscribed_topics(self) -> list[tuple[str, str]]:
        with self._lock:
            return [(s.topic, s.kind.ros_type) for s in self._subscriptions]

    def _published_topics(self) -> list[tuple[str, str]]:
        with self._lock:
            return [(t.topic, t.kind.ros_type) for t in self._topics.values()]

    def _unsubscribed(self, subscription: SocketSubscription[Any]) -> None:
        with self._lock:
            self._subscriptions.remove(subscription)
            others = any(s.topic == subscription.topic for s in self._subscriptions)
        if not others:
            self._tell("unregisterSubscriber", subscription.topic)

    def _release_topic(self, topic: str) -> None:
        with self._lock:
            published = self._topics.get(topic)
            if published is None:
                return
            published.users -= 1
            last = published.users == 0
        if last:
            self._drop(topic)

    def _drop(self, topic: str) -> None:
        with self._lock:
            published = self._topics.pop(topic, None)
        if published is not None:
            self._tell("unregisterPublisher", topic)
            published.close()

    def _tell(self, method: str, topic: str) -> None:
        try:
            self._master.ask(method, topic, self._server.uri)
        except NoMasterError:
            # A master that is gone lists nothing that could be removed.
            return


@dataclass(frozen=True)
class NodeEvents:
    """What a node does when it is called.

    Attributes:
        publishers_changed: Takes a topic and the addresses of its publishers.
        topic: Name -> topic that this node publishes, or None.
        subscribed: Lists (topic, type) that this node subscribes to.
        published: Lists (topic, type) that it publishes.
        asked_to_stop: The master, or a person, ends this node.
    """

    publishers_changed: Callable[[str, list[str]], None]
    topic: Callable[[str], PublishedTopic | None]
    subscribed: Callable[[], list[tuple[str, str]]]
    published: Callable[[], list[tuple[str, str]]]
    asked_to_stop: Callable[[], None]


class NodeServer:
    """Answers other nodes until it is closed.

    Attributes:
        uri: XML-RPC address for the master.
    """

    def __init__(self, host: str, master_uri: str, events: NodeEvents) -> None:
        """Opens both ports on ``host``, the name under which others reach this machine.

        Raises:
            OSError: The host is not this machine.
        """
        self._events, self._host, self._master_uri = events, host, master_uri
        self._tcp = socket.create_server((host, 0))
        self._xmlrpc = _Server((host, 0))
        for name, method in _METHODS.items():
            self._xmlrpc.register_function(getattr(self, f"_{method}"), name)
        self.uri = f"http://{host}:{self._xmlrpc.server_address[1]}/"
        self._closed = self._asked_to_stop = False
        self._greeters = threading.BoundedSemaphore(MOST_GREETERS)
        serve = threading.Thread(
            target=self._xmlrpc.serve_forever, args=(LISTEN_TIME,), daemon=True, name="node"
        )
        serve.start()
        threading.Thread(target=self._accept, daemon=True, name="accept").start()

    def close(self) -> None:
        """Closes both ports."""
        if self._closed:
            return
        self._closed = True
        self._xmlrpc.shutdown()
        self._xmlrpc.server_close()
        self._tcp.shutdown(socket.SHUT_RDWR)
        self._tcp.close()

    def _accept(self) -> None:
        while not self._closed:
            try:
                connection, _ = self._tcp.accept()
            except OSError:
                # The port was closed, or no descriptor is left: then there may be one later.
                time.sleep(LISTEN_TIME)
                continue
            if not _start_one_of(self._greeters, self._answer_header, connection):
                connection.close()

    def _answer_header(self, plain: socket.socket) -> None:
        """Passes a new subscriber to its topic, or answers why not."""
        connection = TimedSocket.of(plain, GREETING_TIME)
        try:
            header = read_header(connection)
            name = header.get("topic", "")
            topic = self._events.topic(name)
            refusal = (
                f"{name} is not published here"
                if topic is None
                else topic.refusal(header) or topic.refuse_more()
            )
            if topic is not None and refusal is None:
                topic.accept(connection)
                return
            connection.sendall(pack_header({"error": str(refusal)}))
        except (OSError, HeaderError, RuntimeError):
            # The other side has gone or does not speak TCPROS, or no thread is left; no answer is possible.
            connection.close()
            return
        connection.close()

    def _request_topic(self, caller: str, topic: str, protocols: list[list[str]]) -> Answer:  # noqa: ARG002
        if self._events.topic(topic) is None:
            return 0, f"{topic} is not published here", 0
        if not any(protocol and protocol[0] == "TCPROS" for protocol in protocols):
            return 0, "only TCPROS is spoken here", 0
        return 1, "ready", ["TCPROS", self._host, self._tcp.getsockname()[1]]

    def _publisher_update(self, caller: str, topic: str, publishers: object) -> Answer:  # noqa: ARG002
        if not isinstance(publishers, list) or not isinstance(topic, str):
            return -1, "publisherUpdate takes a topic and a list of addresses", 0
        self._events.publishers_changed(topic, publishers)
        return 1, "", 0

    def _shutdown(self, caller: str, reason: str = "") -> Answer:  # noqa: ARG002 - the slave API's signature
        if not self._asked_to_stop:
            self._asked_to_stop = True
            threading.Thread(target=self._events.asked_to_stop, daemon=True, name="shutdown").start()
        return 1, "", 0

    def _pid(self, caller: str) -> Answer:  # noqa: ARG002 - the slave API's signature
        return 1, "", os.getpid()

    def _master(self, caller: str) -> Answer:  # noqa: ARG002 - the slave API's signature
        return 1, "", self._master_uri

    def _publications(self, caller: str) -> Answer:  # noqa: ARG002 - the slave API's signature
        return 1, "", [list(pair) for pair in self._events.published()]

    def _subscriptions(self, caller: str) -> Answer:  # noqa: ARG002 - the slave API's signature
        return 1, "", [list(pair) for pair in self._events.subscribed()]

    def _nothing(self, caller: str, *arguments: Any) -> Answer:  # noqa: ARG002 - the slave API's signature
        return 1, "", []


def _start_one_of(places: threading.BoundedSemaphore, body: Callable[..., object], *arguments: Any) -> bool:
    """Runs a function in a thread if there is a place for one more; says whether there was."""
    if not places.acquire(blocking=False):
        return False

    def in_place() -> None:
        try:
            body(*arguments)
        finally:
            places.release()

    try:
        threading.Thread(target=in_place, daemon=True, name="handshake").start()
    except RuntimeError:  # the system has no thread left
        places.release()
        return False
    return True


class _SilentHandler(SimpleXMLRPCRequestHandler):
    rpc_paths = ()

    def do_POST(self) -> None:  # noqa: N802 - the name that the server calls
        """Answers a call of bounded length."""
        length = self.headers.get("content-length", "")
        if not length.isascii() or not length.isdigit() or len(length) > 12 or int(length) > LONGEST_CALL:
            self.send_error(413, f"a call has at most {LONGEST_CALL} bytes")
        elif self.headers.get("content-encoding", "identity").lower() != "identity":
            self.send_error(415, "calls are not compressed")
        else:
            super().do_POST()

    def log_message(self, *arguments: Any) -> None:
        """Logs nothing; calls are routine."""


class _Server(ThreadingMixIn, SimpleXMLRPCServer):
    daemon_threads = True

    def __init__(self, address: tuple[str, int]) -> None:
        super().__init__(address, requestHandler=_SilentHandler, logRequests=False, allow_none=True)
        self._places = threading.BoundedSemaphore(MOST_CALLS)

    def get_request(self) -> tuple[TimedSocket, Any]:
        """Accepts a connection, which is over after a time."""
        try:
            connection, address = super().get_request()
        except OSError:
            time.sleep(LISTEN_TIME)  # no descriptor is left: it would be tried again at once
            raise
        return TimedSocket.of(connection, GREETING_TIME), address

    def process_request(self, request: Any, client_address: Any) -> None:
        """Answers in a thread, as long as there are not too many; those beyond are closed."""
        if not _start_one_of(self._places, self.process_request_thread, request, client_address):
            self.shutdown_request(request)

    def handle_error(self, *_: Any) -> None:
        """Says nothing of callers that hang up or talk too slowly."""
