# SPDX-License-Identifier: BSD-3-Clause
"""Asks the publishers of a topic what they send, and tells those that live from what the dead have left behind.

A node that is killed stays registered with the master until somebody removes it, and its port may go to another
program. So the one that answers decides, and whoever cannot be told dead counts as living:

    nobody listens at its address                                      gone
    what listens there speaks no node's language                       gone
    the node there does not publish the topic                          gone
    the node there gives another name, which the master knows there    gone
    no answer in time, no such host, the line breaks                   living
"""

from __future__ import annotations

import socket
from dataclasses import dataclass
from urllib.parse import urlsplit

from impedance_modules.backends.baxter.ros.master_client import MasterClient
from impedance_modules.backends.baxter.ros.sockets.connect import (
    ANYTHING,
    CONNECT_TIME,
    NoNodeError,
    NotPublishedError,
    greet,
    topic_address,
)
from impedance_modules.backends.baxter.ros.tcp_connection import (
    LENGTH,
    LONGEST_GREETING,
    GreetingError,
    pack_greeting,
)
from impedance_modules.backends.baxter.ros.transport import Offer

ASKING = {"type": ANYTHING, "md5sum": ANYTHING}


def offers_of(master: MasterClient, caller: str, topic: str) -> tuple[Offer, ...]:
    """Asks every publisher of a topic except this node what it sends.

    Raises:
        NoMasterError: The master does not answer.
    """
    inquiry = _Inquiry(master, caller, topic)
    return tuple(inquiry.ask(node) for node in master.publishers_of(topic) if node != caller)


@dataclass(frozen=True)
class _Inquiry:
    """Who asks for what."""

    master: MasterClient
    caller: str
    topic: str

    def ask(self, node: str) -> Offer:
        """Asks one registered publisher."""
        uri = self.master.address_of(node)
        if uri is None:
            return _gone(node, "has withdrawn meanwhile")
        try:
            address = topic_address(uri, self.caller, self.topic)
        except ConnectionRefusedError as error:
            return _gone(node, f"cannot be reached: {error.strerror}")
        except (NotPublishedError, NoNodeError) as error:
            return _gone(node, str(error))
        except OSError as error:
            if self._is_topic_door(uri):
                return _gone(node, f"{uri} is where another node's topics leave")
            return _silent(node, error)
        return self._greeted(node, uri, address)

    def _greeted(self, node: str, uri: str, address: tuple[str, int]) -> Offer:
        """Judges the node at ``uri`` by the greeting that it sends from where the topic leaves it."""
        try:
            # Under another name: rospy hangs up on a listener when a second one of its name comes.
            connection, greeting = greet(address, f"{self.caller}_asks", self.topic, ASKING)
        except OSError as error:
            return _silent(node, error)
        except GreetingError as error:
            return Offer(node, None, None, str(error))
        connection.close()
        name = greeting.get("callerid", node)
        if name != node and self.master.address_of(name) == uri:
            return _gone(node, f"{uri} is {name} now")
        kind, checksum = greeting.get("type"), greeting.get("md5sum")
        if kind is None or checksum is None:
            return Offer(node, kind, checksum, "does not say what it sends")
        return Offer(node, kind, checksum, None)

    def _is_topic_door(self, uri: str) -> bool:
        """Says whether TCPROS is spoken at an address: no node's XML-RPC is then, since a port is one or the other."""
        parts = urlsplit(uri)
        if parts.hostname is None or parts.port is None:
            return False
        asking = {"callerid": f"{self.caller}_asks", "topic": self.topic, **ASKING}
        try:
            with socket.create_connection((parts.hostname, parts.port), CONNECT_TIME) as connection:
                connection.settimeout(CONNECT_TIME)
                connection.sendall(pack_greeting(asking))
                head = connection.recv(LENGTH.size, socket.MSG_WAITALL)
        except OSError:
            return False
        # Words, as a web server's, would read as a length of a gigabyte.
        return len(head) == LENGTH.size and int(LENGTH.unpack(head)[0]) <= LONGEST_GREETING


def _gone(node: str, why: str) -> Offer:
    return Offer(node, None, None, why, gone=True)


def _silent(node: str, error: OSError) -> Offer:
    return Offer(node, None, None, f"cannot be reached: {error.strerror or error}")
