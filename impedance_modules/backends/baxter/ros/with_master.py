# SPDX-License-Identifier: BSD-3-Clause
"""What every transport over a ROS master asks the master itself: parameters, and who publishes what."""

from __future__ import annotations

from impedance_modules.backends.baxter.ros.master_client import MasterClient
from impedance_modules.backends.baxter.ros.sockets.offers import offers_of
from impedance_modules.backends.baxter.ros.transport import (
    NoMasterError,
    Offer,
    ParameterValue,
    TransportClosedError,
)


class MasterTransport:
    """The questions of one node to its master; how topics travel is its heirs' business."""

    def __init__(self, node_name: str, master_uri: str) -> None:
        """Takes a full name and an address; asks nothing yet."""
        self._node_name = node_name
        self._master = MasterClient(master_uri, node_name)
        self._closed = False

    @property
    def node_name(self) -> str:
        """Full name of this node."""
        return self._node_name

    def get_parameter(self, name: str) -> ParameterValue | None:
        """Returns a parameter, or None if nobody has set it."""
        self._check()
        return self._master.get_parameter(name)

    def set_parameter(self, name: str, value: ParameterValue) -> None:
        """Sets a parameter."""
        self._check()
        self._master.set_parameter(name, value)

    def publishers_of(self, topic: str) -> tuple[str, ...]:
        """Names the nodes registered as publishers of a topic, dead ones too, sorted."""
        self._check()
        return self._master.publishers_of(topic)

    def offers_of(self, topic: str) -> tuple[Offer, ...]:
        """Asks every other publisher of a topic what it sends."""
        self._check()
        return offers_of(self._master, self._node_name, topic)

    def _sweep(self, uri: str) -> None:
        """Has the master forget whatever it still knows of this node at an address.

        An interrupt in the middle of a registration leaves the master knowing of a topic of which the node does not.
        """
        try:
            for method, topics in self._master.registrations_of(self._node_name).items():
                for topic in topics:
                    self._master.ask(method, topic, uri)
        except NoMasterError:
            # A master that is gone remembers nothing that could be withdrawn.
            return

    def _check(self) -> None:
        if self._closed:
            raise TransportClosedError(f"{self._node_name}: the transport is closed")
