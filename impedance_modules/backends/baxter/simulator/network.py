# SPDX-License-Identifier: BSD-3-Clause
"""How the double reaches the others: nodes on a ROS master, and registrations of nodes that are gone."""

from __future__ import annotations

import xmlrpc.client
from typing import Protocol

from impedance_modules.backends.baxter.ros.socket_transport import SocketTransport
from impedance_modules.backends.baxter.ros.transport import Transport

GONE_NODE, GONE_ADDRESS = "/realtime_loop_of_yesterday", "http://127.0.0.1:9/"
"""A node that was killed without a word; nobody listens at its address."""


class Network(Protocol):
    """Where nodes meet."""

    def connect(self, node_name: str) -> Transport:
        """Brings a node up."""

    def haunt(self, topic: str, ros_type: str, on: bool) -> None:
        """Registers a publisher that no longer exists, or has it forgotten."""


class RosNetwork:
    """Nodes on a ROS master, by plain sockets: one process can be several nodes, and needs no ROS."""

    def __init__(self, master_address: str) -> None:
        """Takes the master's address."""
        self._address = master_address

    def connect(self, node_name: str) -> Transport:
        """Brings a node up."""
        return SocketTransport(node_name, self._address)

    def haunt(self, topic: str, ros_type: str, on: bool) -> None:
        """Registers a publisher that no longer exists, or has it forgotten."""
        master = xmlrpc.client.ServerProxy(self._address)
        if on:
            master.registerPublisher(GONE_NODE, topic, ros_type, GONE_ADDRESS)
        else:
            master.unregisterPublisher(GONE_NODE, topic, GONE_ADDRESS)
