# SPDX-License-Identifier: BSD-3-Clause
"""As much of a ROS master as the package asks for, in this process: the Baxter's verbs run without any ROS installed.

Methods and answers (code, message, value) are those of ROS's master API, https://wiki.ros.org/ROS/Master_API.
"""

from __future__ import annotations

import os
import threading
import xmlrpc.client
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from socketserver import ThreadingMixIn
from typing import Any
from unittest.mock import patch
from xmlrpc.server import SimpleXMLRPCRequestHandler, SimpleXMLRPCServer

Answer = tuple[int, str, Any]
METHODS = (
    *("getPid", "getParam", "setParam", "lookupNode", "getSystemState"),
    *("registerPublisher", "unregisterPublisher", "registerSubscriber", "unregisterSubscriber"),
)


class OwnMaster:
    """Who publishes and who listens, and the parameters; nodes are told of new publishers."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._publishers: dict[str, dict[str, str]] = defaultdict(dict)
        self._subscribers: dict[str, dict[str, str]] = defaultdict(dict)
        self._nodes: dict[str, str] = {}
        self._parameters: dict[str, Any] = {}

    def answer(self, method: str, *arguments: Any) -> Answer:
        """Answers a request of the master API."""
        return getattr(self, f"_{method}")(*arguments)  # type: ignore[no-any-return]

    def _getPid(self, _caller: str) -> Answer:
        return 1, "", os.getpid()

    def _getParam(self, _caller: str, name: str) -> Answer:
        return (1, "", self._parameters[name]) if name in self._parameters else (-1, f"no {name}", 0)

    def _setParam(self, _caller: str, name: str, value: Any) -> Answer:
        self._parameters[name] = value
        return 1, "", 0

    def _lookupNode(self, _caller: str, node: str) -> Answer:
        return (1, "", self._nodes[node]) if node in self._nodes else (-1, f"no {node}", "")

    def _getSystemState(self, _caller: str) -> Answer:
        with self._lock:
            tables = [
                [[topic, list(nodes)] for topic, nodes in table.items() if nodes]
                for table in (self._publishers, self._subscribers)
            ]
        return 1, "", [*tables, []]

    def _registerPublisher(self, caller: str, topic: str, _kind: str, uri: str) -> Answer:
        with self._lock:
            self._nodes[caller] = uri
            self._publishers[topic][caller] = uri
        self._tell(topic)
        return 1, "", list(self._subscribers[topic].values())

    def _unregisterPublisher(self, caller: str, topic: str, _uri: str) -> Answer:
        with self._lock:
            known = self._publishers[topic].pop(caller, None) is not None
        self._tell(topic)
        return 1, "", int(known)

    def _registerSubscriber(self, caller: str, topic: str, _kind: str, uri: str) -> Answer:
        with self._lock:
            self._nodes[caller] = uri
            self._subscribers[topic][caller] = uri
        return 1, "", list(self._publishers[topic].values())

    def _unregisterSubscriber(self, caller: str, topic: str, _uri: str) -> Answer:
        with self._lock:
            known = self._subscribers[topic].pop(caller, None) is not None
        return 1, "", int(known)

    def _tell(self, topic: str) -> None:
        """Tells all listeners of a topic who publishes it; a listener that has ended needs to know nothing."""
        with self._lock:
            listeners, addresses = (
                list(self._subscribers[topic].values()),
                list(self._publishers[topic].values()),
            )
        for uri in listeners:
            try:
                with xmlrpc.client.ServerProxy(uri) as node:
                    node.publisherUpdate("/master", topic, addresses)
            except OSError:
                continue


class _Silent(SimpleXMLRPCRequestHandler):
    rpc_paths = ()

    def log_message(self, *arguments: Any) -> None:
        """Logs nothing."""


class _Server(ThreadingMixIn, SimpleXMLRPCServer):
    daemon_threads = True


@contextmanager
def own_ros_master() -> Iterator[str]:
    """Runs a master on a free port of loopback, with the environment pointing at it; yields its address."""
    master = OwnMaster()
    server = _Server(("127.0.0.1", 0), requestHandler=_Silent, logRequests=False, allow_none=True)
    for method in METHODS:
        server.register_function(lambda *values, of=method: master.answer(of, *values), method)
    threading.Thread(target=server.serve_forever, args=(0.05,), daemon=True, name="master").start()
    uri = f"http://127.0.0.1:{server.server_address[1]}"
    # Without ROS_HOSTNAME, which would count before ROS_IP.
    rest = {name: value for name, value in os.environ.items() if name != "ROS_HOSTNAME"}
    try:
        with patch.dict(os.environ, {**rest, "ROS_MASTER_URI": uri, "ROS_IP": "127.0.0.1"}, clear=True):
            yield uri
    finally:
        server.shutdown()
        server.server_close()
