# SPDX-License-Identifier: BSD-3-Clause
"""Connects to one publisher of a topic, and asks publishers what they send."""

from __future__ import annotations

import http.client
import socket
import xmlrpc.client
from collections.abc import Mapping
from typing import Any
from xml.parsers.expat import ExpatError

from impedance_modules.backends.baxter.transport.protocol import NoMasterError, Offer
from impedance_modules.backends.baxter.transport.sockets.framing import (
    GreetingError,
    pack_greeting,
    read_greeting,
)
from impedance_modules.backends.baxter.transport.sockets.master import MasterClient, remote

CONNECT_TIME = 1.0
"""Longest wait for another node in each step of a connection [s]."""

ANYTHING = "*"
"""Type and checksum of a listener that takes whatever comes."""


def connect(
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
    host, port = _tcp_address(node_uri, caller, topic)
    connection = socket.create_connection((host, port), CONNECT_TIME)
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


def _tcp_address(node_uri: str, caller: str, topic: str) -> tuple[str, int]:
    try:
        with remote(node_uri, CONNECT_TIME) as node:
            answer: Any = node.requestTopic(caller, topic, [["TCPROS"]])
    except (xmlrpc.client.Error, http.client.HTTPException, ExpatError) as error:
        raise GreetingError(f"{node_uri} is no ROS node ({type(error).__name__})") from error
    well_formed = isinstance(answer, list) and len(answer) == 3
    if not well_formed or answer[0] != 1 or not isinstance(answer[2], list) or len(answer[2]) < 3:
        raise GreetingError(f"{node_uri} does not publish {topic}")
    return str(answer[2][1]), int(answer[2][2])


def offers_of(master: MasterClient, caller: str, topic: str) -> tuple[Offer, ...]:
    """Asks every publisher of a topic except this node what it sends.

    Raises:
        NoMasterError: The master does not answer.
    """
    return tuple(
        _offer(master, caller, topic, node) for node in master.publishers_of(topic) if node != caller
    )


def _offer(master: MasterClient, caller: str, topic: str, node: str) -> Offer:
    try:
        uri = master.address_of(node)
        # Under another name: rospy hangs up on a listener when a second one of its name comes.
        connection, greeting = connect(uri, f"{caller}_asks", topic, {"type": ANYTHING, "md5sum": ANYTHING})
    except OSError as error:
        gone = isinstance(error, ConnectionRefusedError)
        return Offer(node, None, None, f"cannot be reached: {error.strerror or error}", gone)
    except (GreetingError, NoMasterError) as error:
        return Offer(node, None, None, str(error))
    connection.close()
    kind, checksum = greeting.get("type"), greeting.get("md5sum")
    if kind is None or checksum is None:
        return Offer(node, kind, checksum, "does not say what it sends")
    return Offer(node, kind, checksum, None)
