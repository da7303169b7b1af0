# SPDX-License-Identifier: BSD-3-Clause
"""The ROS master: who publishes what, and the parameters. Every request has a time limit.

``publisher_info`` also asks each publisher what it sends, and finds out which ones have ended. A node that is killed
stays registered with the master until somebody removes it, and its port may go to another program. So what answers at
its address decides; a node that cannot be proved to have ended counts as running:

    nothing listens at its address                                     gone
    what listens there is no ROS node                                  gone
    the node there does not publish the topic                          gone
    the node there gives another name, which the master knows there    gone
    no answer in time, no such host, the connection breaks             running
"""

from __future__ import annotations

import os
import socket
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any
from urllib.parse import urlsplit

from impedance_modules.backends.baxter.ros.tcp_connection import (
    ANYTHING,
    CONNECT_TIME,
    LENGTH,
    LONGEST_HEADER,
    NOT_XMLRPC,
    HeaderError,
    NoNodeError,
    NotPublishedError,
    open_connection,
    pack_header,
    remote,
    topic_address,
)
from impedance_modules.backends.baxter.ros.transport import (
    NoMasterError,
    ParameterValue,
    PublisherInfo,
    TransportClosedError,
)

ANSWER_TIME = 2.0
"""Longest wait for the master's answer [s]; a robot description takes most of it over a slow network."""

SUCCESS = 1

ASKING = {"type": ANYTHING, "md5sum": ANYTHING}


class MasterClient:
    """Asks a ROS master on behalf of one node.

    Attributes:
        uri: Of the master.
    """

    def __init__(self, uri: str, caller: str) -> None:
        """Takes the master's address and the name of the asking node; asks nothing yet."""
        self.uri = uri
        self._caller = caller

    def check(self) -> None:
        """Makes sure that a ROS master answers.

        Raises:
            NoMasterError: Nothing answers, or no ROS master does.
        """
        self.ask("getPid")

    def ask(self, method: str, *arguments: Any) -> Any:
        """Calls a method of the master's interface and returns its value.

        Raises:
            NoMasterError: Nothing answers, no ROS master does, or it refuses.
        """
        code, message, value = self._answer(method, *arguments)
        if code != SUCCESS:
            raise NoMasterError(f"the ROS master at {self.uri} refused {method}{arguments}: {message}")
        return value

    def get_parameter(self, name: str) -> ParameterValue | None:
        """Returns a parameter, or None if it is not set.

        Raises:
            NoMasterError: As in ``ask``.
        """
        code, _, value = self._answer("getParam", _absolute(name))
        return value if code == SUCCESS else None

    def set_parameter(self, name: str, value: ParameterValue) -> None:
        """Sets a parameter.

        Raises:
            NoMasterError: As in ``ask``.
        """
        self.ask("setParam", _absolute(name), value)

    def publishers_of(self, topic: str) -> tuple[str, ...]:
        """Names the nodes registered as publishers of a topic, sorted.

        Raises:
            NoMasterError: As in ``ask``.
        """
        publishers, _, _ = self._system_state()
        return tuple(sorted({node for name, nodes in publishers if name == topic for node in nodes}))

    def registrations_of(self, node: str) -> dict[str, list[str]]:
        """Lists the topics of a node that are registered, by the method that ends the registration.

        Raises:
            NoMasterError: As in ``ask``.
        """
        publishers, subscribers, _ = self._system_state()
        return {
            "unregisterSubscriber": [topic for topic, nodes in subscribers if node in nodes],
            "unregisterPublisher": [topic for topic, nodes in publishers if node in nodes],
        }

    def address_of(self, node: str) -> str | None:
        """Returns the XML-RPC address of a node, or None if the master does not know it.

        Raises:
            NoMasterError: Nothing answers, or no ROS master does.
        """
        code, _, value = self._answer("lookupNode", node)
        return str(value) if code == SUCCESS else None

    def _system_state(self) -> list[list[tuple[str, list[str]]]]:
        """Asks who publishes, who listens and who offers services: (name, nodes) each."""
        said = self.ask("getSystemState")
        try:
            state = [[(str(name), [str(node) for node in nodes]) for name, nodes in part] for part in said]
        except (TypeError, ValueError):
            state = []
        if len(state) != 3:
            raise NoMasterError(
                f"what answers at {self.uri} is no ROS master: its state is {str(said)[:60]!r}"
            )
        return state

    def _answer(self, method: str, *arguments: Any) -> tuple[int, str, Any]:
        try:
            with remote(self.uri, ANSWER_TIME) as master:
                answer: Any = getattr(master, method)(self._caller, *arguments)
        except OSError as error:
            raise NoMasterError(_unreachable(self.uri, error)) from error
        except NOT_XMLRPC as error:
            raise NoMasterError(
                f"what answers at {self.uri} is no ROS master ({type(error).__name__})"
                " (valid: the address of the robot's master in ROS_MASTER_URI)"
            ) from error
        if not isinstance(answer, list) or len(answer) != 3:
            raise NoMasterError(f"what answers at {self.uri} is no ROS master: it says {str(answer)[:60]!r}")
        if type(answer[0]) is not int:
            raise NoMasterError(f"what answers at {self.uri} is no ROS master: it says {str(answer)[:60]!r}")
        return answer[0], str(answer[1]), answer[2]


class MasterTransport:
    """One node's requests to its master; subclasses transport the topics."""

    def __init__(self, node_name: str, master_uri: str) -> None:
        """Takes a full name and an address; asks nothing yet."""
        self._node_name = node_name
        self._master = MasterClient(master_uri, node_name)
        self._closed = False

    def get_parameter(self, name: str) -> ParameterValue | None:
        """Returns a parameter, or None if it is not set."""
        self._check()
        return self._master.get_parameter(name)

    def set_parameter(self, name: str, value: ParameterValue) -> None:
        """Sets a parameter."""
        self._check()
        self._master.set_parameter(name, value)

    def publishers_of(self, topic: str) -> tuple[str, ...]:
        """Names the nodes registered as publishers of a topic, also those that have ended, sorted."""
        self._check()
        return self._master.publishers_of(topic)

    def publisher_info(self, topic: str) -> tuple[PublisherInfo, ...]:
        """Asks every other publisher of a topic what it sends."""
        self._check()
        return publisher_info(self._master, self._node_name, topic)

    def _unregister_all(self, uri: str) -> None:
        """Removes whatever the master still lists of this node at an address.

        An interrupt in the middle of a registration leaves the master knowing of a topic of which the node does not.
        """
        try:
            for method, topics in self._master.registrations_of(self._node_name).items():
                for topic in topics:
                    self._master.ask(method, topic, uri)
        except NoMasterError:
            # A master that is gone lists nothing that could be removed.
            return

    def _check(self) -> None:
        if self._closed:
            raise TransportClosedError(f"{self._node_name}: the transport is closed")


def publisher_info(master: MasterClient, caller: str, topic: str) -> tuple[PublisherInfo, ...]:
    """Asks every publisher of a topic except this node what it sends.

    Raises:
        NoMasterError: The master does not answer.
    """
    inquiry = _Inquiry(master, caller, topic)
    return tuple(inquiry.ask(node) for node in master.publishers_of(topic) if node != caller)


def master_uri_of(environment: Mapping[str, str]) -> str:
    """Reads the master's address from ``ROS_MASTER_URI``.

    Raises:
        NoMasterError: ``ROS_MASTER_URI`` is not set, or is no address.
    """
    uri = environment.get("ROS_MASTER_URI", "")
    parts = urlsplit(uri)
    if parts.scheme != "http" or not parts.hostname or parts.port is None:
        said = f"ROS_MASTER_URI is '{uri}', no address" if uri else "ROS_MASTER_URI is not set"
        raise NoMasterError(
            f"{said}: which robot is meant? (valid: export ROS_MASTER_URI=http://ROBOT.local:11311)"
        )
    return uri


def own_host(environment: Mapping[str, str], master_uri: str) -> str:
    """Returns the name or address under which other nodes reach this machine.

    ``ROS_IP`` or ``ROS_HOSTNAME`` where set, else the address of the network card that leads to the master.

    Raises:
        NoMasterError: The master's host name is not known here.
    """
    for name in ("ROS_HOSTNAME", "ROS_IP"):
        if environment.get(name):
            return environment[name]
    parts = urlsplit(master_uri)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect((parts.hostname, parts.port))
        except OSError as error:
            raise NoMasterError(_unreachable(master_uri, error)) from error
        return str(probe.getsockname()[0])


def check_own_host(host: str) -> None:
    """Makes sure that a name or address leads to this machine.

    Raises:
        NoMasterError: It does not; says which variable to set.
    """
    try:
        socket.create_server((host, 0)).close()
    except OSError as error:
        # Python's own words for a failed bind repeat the address.
        why = error.strerror if isinstance(error, socket.gaierror) else os.strerror(error.errno or 0)
        raise NoMasterError(
            f"'{host}' is not an address of this machine: {why}"
            " (valid: ROS_IP=the address of this machine in the robot's network)"
        ) from error


def _absolute(name: str) -> str:
    return name if name.startswith("/") else f"/{name}"


def _unreachable(uri: str, error: OSError) -> str:
    host = urlsplit(uri).hostname
    return (
        f"no ROS master answers at {uri}: {error.strerror or error}."
        f" Is the robot on, does 'ping {host}' reach it, and is ROS_MASTER_URI its address"
        f" (host {host} may need a line in /etc/hosts)?"
    )


@dataclass(frozen=True)
class _Inquiry:
    """A request of one node about one topic."""

    master: MasterClient
    caller: str
    topic: str

    def ask(self, node: str) -> PublisherInfo:
        """Asks one registered publisher what it sends."""
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
            if self._is_topic_port(uri):
                return _gone(node, f"{uri} is another node's topic port")
            return _silent(node, error)
        return self._ask_publisher(node, uri, address)

    def _ask_publisher(self, node: str, uri: str, address: tuple[str, int]) -> PublisherInfo:
        """Judges the node at ``uri`` by the connection header that its topic port sends."""
        try:
            # Under another name: rospy closes a connection when a second one of the same name comes.
            connection, header = open_connection(address, f"{self.caller}_asks", self.topic, ASKING)
        except OSError as error:
            return _silent(node, error)
        except HeaderError as error:
            return PublisherInfo(node, None, None, str(error))
        connection.close()
        name = header.get("callerid", node)
        if name != node and self.master.address_of(name) == uri:
            return _gone(node, f"{uri} is {name} now")
        kind, checksum = header.get("type"), header.get("md5sum")
        if kind is None or checksum is None:
            return PublisherInfo(node, kind, checksum, "does not say what it sends")
        return PublisherInfo(node, kind, checksum, None)

    def _is_topic_port(self, uri: str) -> bool:
        """Says whether an address speaks TCPROS; then it is no node's XML-RPC address: a port is one or the other."""
        parts = urlsplit(uri)
        if parts.hostname is None or parts.port is None:
            return False
        fields = {"callerid": f"{self.caller}_asks", "topic": self.topic, **ASKING}
        try:
            with socket.create_connection((parts.hostname, parts.port), CONNECT_TIME) as connection:
                connection.settimeout(CONNECT_TIME)
                connection.sendall(pack_header(fields))
                head = connection.recv(LENGTH.size, socket.MSG_WAITALL)
        except OSError:
            return False
        # Text, as of a web server, would be a length of a gigabyte.
        return len(head) == LENGTH.size and int(LENGTH.unpack(head)[0]) <= LONGEST_HEADER


def _gone(node: str, why: str) -> PublisherInfo:
    return PublisherInfo(node, None, None, why, gone=True)


def _silent(node: str, error: OSError) -> PublisherInfo:
    return PublisherInfo(node, None, None, f"cannot be reached: {error.strerror or error}")
