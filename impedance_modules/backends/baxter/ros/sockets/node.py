# SPDX-License-Identifier: BSD-3-Clause
"""The two doors of a node: XML-RPC, by which master and nodes call it, and TCP, on which its topics leave."""

from __future__ import annotations

import os
import socket
import threading
from collections.abc import Callable
from dataclasses import dataclass
from socketserver import ThreadingMixIn
from typing import Any
from xmlrpc.server import SimpleXMLRPCRequestHandler, SimpleXMLRPCServer

from impedance_modules.backends.baxter.ros.socket_topics import Outlet
from impedance_modules.backends.baxter.ros.sockets.connect import CONNECT_TIME
from impedance_modules.backends.baxter.ros.tcp_connection import (
    GreetingError,
    pack_greeting,
    read_greeting,
)

Answer = tuple[int, str, Any]

LISTEN_TIME = 0.05
"""How long closing a node may take [s]."""


@dataclass(frozen=True)
class NodeEvents:
    """What a node does when it is called.

    Attributes:
        publishers_changed: Takes a topic and the addresses of its publishers.
        outlet: Topic -> what this node publishes there, or None.
        listened: Lists (topic, type) that this node listens to.
        published: Lists (topic, type) that it publishes.
        asked_to_stop: The master, or somebody by hand, ends this node.
    """

    publishers_changed: Callable[[str, list[str]], None]
    outlet: Callable[[str], Outlet | None]
    listened: Callable[[], list[tuple[str, str]]]
    published: Callable[[], list[tuple[str, str]]]
    asked_to_stop: Callable[[], None]


class NodeServer:
    """Answers other nodes until it is closed.

    Attributes:
        uri: XML-RPC address for the master.
    """

    def __init__(self, host: str, master_uri: str, events: NodeEvents) -> None:
        """Opens both doors on free ports of ``host``, the name under which others reach this machine.

        Raises:
            OSError: The host is not this machine.
        """
        self._events, self._host, self._master_uri = events, host, master_uri
        self._tcp = socket.create_server((host, 0))
        self._xmlrpc = _Server((host, 0))
        for name, method in _METHODS.items():
            self._xmlrpc.register_function(getattr(self, f"_{method}"), name)
        self.uri = f"http://{host}:{self._xmlrpc.server_address[1]}/"
        self._closed = False
        serve = threading.Thread(
            target=self._xmlrpc.serve_forever, args=(LISTEN_TIME,), daemon=True, name="node"
        )
        serve.start()
        threading.Thread(target=self._accept, daemon=True, name="accept").start()

    def close(self) -> None:
        """Closes both doors."""
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
                # The door was closed.
                return
            threading.Thread(target=self._greet, args=(connection,), daemon=True, name="greet").start()

    def _greet(self, connection: socket.socket) -> None:
        """Hands a new listener to its topic, or says why not."""
        connection.settimeout(CONNECT_TIME)
        try:
            greeting = read_greeting(connection)
            topic = greeting.get("topic", "")
            outlet = self._events.outlet(topic)
            refusal = f"{topic} is not published here" if outlet is None else outlet.refusal(greeting)
            if outlet is not None and refusal is None:
                outlet.accept(connection)
                return
            connection.sendall(pack_greeting({"error": str(refusal)}))
        except (OSError, GreetingError):
            # Whoever knocked has gone or does not speak TCPROS; nobody is left to tell.
            connection.close()
            return
        connection.close()

    def _request_topic(self, caller: str, topic: str, protocols: list[list[str]]) -> Answer:  # noqa: ARG002
        if self._events.outlet(topic) is None:
            return 0, f"{topic} is not published here", 0
        if not any(protocol and protocol[0] == "TCPROS" for protocol in protocols):
            return 0, "only TCPROS is spoken here", 0
        return 1, "ready", ["TCPROS", self._host, self._tcp.getsockname()[1]]

    def _publisher_update(self, caller: str, topic: str, publishers: list[str]) -> Answer:  # noqa: ARG002
        self._events.publishers_changed(topic, publishers)
        return 1, "", 0

    def _shutdown(self, caller: str, reason: str = "") -> Answer:  # noqa: ARG002 - the slave API's signature
        threading.Thread(target=self._events.asked_to_stop).start()
        return 1, "", 0

    def _pid(self, caller: str) -> Answer:  # noqa: ARG002 - the slave API's signature
        return 1, "", os.getpid()

    def _master(self, caller: str) -> Answer:  # noqa: ARG002 - the slave API's signature
        return 1, "", self._master_uri

    def _publications(self, caller: str) -> Answer:  # noqa: ARG002 - the slave API's signature
        return 1, "", [list(pair) for pair in self._events.published()]

    def _subscriptions(self, caller: str) -> Answer:  # noqa: ARG002 - the slave API's signature
        return 1, "", [list(pair) for pair in self._events.listened()]

    def _nothing(self, caller: str, *arguments: Any) -> Answer:  # noqa: ARG002 - the slave API's signature
        return 1, "", []


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


class _Quiet(SimpleXMLRPCRequestHandler):
    rpc_paths = ()

    def log_message(self, *arguments: Any) -> None:
        """Says nothing; calls are routine."""


class _Server(ThreadingMixIn, SimpleXMLRPCServer):
    daemon_threads = True

    def __init__(self, address: tuple[str, int]) -> None:
        super().__init__(address, requestHandler=_Quiet, logRequests=False, allow_none=True)
