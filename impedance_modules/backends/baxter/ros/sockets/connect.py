# SPDX-License-Identifier: BSD-3-Clause
"""Connects to one publisher of a topic."""

from __future__ import annotations

import http.client
import socket
import xmlrpc.client
from collections.abc import Mapping
from typing import Any
from xml.parsers.expat import ExpatError

from impedance_modules.backends.baxter.ros.tcp_connection import (
    GreetingError,
    pack_greeting,
    read_greeting,
    remote,
)

CONNECT_TIME = 1.0
"""Longest wait for another node in each step of a connection [s]."""

ANYTHING = "*"
"""Type and checksum of a listener that takes whatever comes."""


class NoNodeError(GreetingError):
    """What answers at an address is no ROS node."""


class NotPublishedError(GreetingError):
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
        The connected socket, without a time-out, and the publisher's greeting.

    Raises:
        GreetingError: The node does not publish the topic (any more), or means another message.
        OSError: It cannot be reached.
    """
    return greet(topic_address(node_uri, caller, topic), caller, topic, fields)


def greet(
    address: tuple[str, int], caller: str, topic: str, fields: Mapping[str, str]
) -> tuple[socket.socket, dict[str, str]]:
    """Opens a connection to where a topic leaves a node; arguments and errors as in ``connect_to_topic``."""
    connection = socket.create_connection(address, CONNECT_TIME)
    try:
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        greeting = {"callerid": caller, "topic": topic, "tcp_nodelay": "1", **fields}
        connection.sendall(pack_greeting(greeting))
        answer = read_greeting(connection)
    except (OSError, GreetingError):
        connection.close()
        raise
    connection.settimeout(None)
    return connection, answer


def topic_address(node_uri: str, caller: str, topic: str) -> tuple[str, int]:
    """Asks a node where a topic leaves it.

    Raises:
        NotPublishedError: It does not publish the topic.
        NoNodeError: What answers is no ROS node.
        OSError: Nobody answers; ``ConnectionRefusedError`` where nobody is there.
    """
    try:
        with remote(node_uri, CONNECT_TIME) as node:
            answer: Any = node.requestTopic(caller, topic, [["TCPROS"]])
    except (xmlrpc.client.Error, http.client.HTTPException, ExpatError) as error:
        raise NoNodeError(f"{node_uri} is no ROS node ({type(error).__name__})") from error
    if not isinstance(answer, list) or len(answer) != 3:
        raise NoNodeError(f"{node_uri} is no ROS node: it says {str(answer)[:60]!r}")
    if answer[0] != 1 or not isinstance(answer[2], list) or len(answer[2]) < 3:
        raise NotPublishedError(f"{node_uri} does not publish {topic}")
    return str(answer[2][1]), int(answer[2][2])
