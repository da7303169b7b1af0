# SPDX-License-Identifier: BSD-3-Clause
"""The ROS master: who publishes what, and the parameters. Every question has a deadline."""

from __future__ import annotations

import http.client
import os
import socket
import xmlrpc.client
from collections.abc import Mapping
from typing import Any
from urllib.parse import urlsplit
from xml.parsers.expat import ExpatError

from impedance_modules.backends.baxter.ros.tcp_connection import remote
from impedance_modules.backends.baxter.ros.transport import NoMasterError, ParameterValue

ANSWER_TIME = 2.0
"""Longest wait for the master's answer [s]; a robot description takes most of it over a slow network."""

SUCCESS = 1


def master_uri_of(environment: Mapping[str, str]) -> str:
    """Reads the master's address from ROS's own variable.

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
            NoMasterError: Nobody answers, or somebody else does.
        """
        self.ask("getPid")

    def ask(self, method: str, *arguments: Any) -> Any:
        """Calls a method of the master's interface and returns its value.

        Raises:
            NoMasterError: Nobody answers, somebody else does, or the master refuses.
        """
        code, message, value = self._answer(method, *arguments)
        if code != SUCCESS:
            raise NoMasterError(f"the ROS master at {self.uri} refused {method}{arguments}: {message}")
        return value

    def get_parameter(self, name: str) -> ParameterValue | None:
        """Returns a parameter, or None if nobody has set it.

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
        publishers, _, _ = self.ask("getSystemState")
        return tuple(sorted({node for name, nodes in publishers if name == topic for node in nodes}))

    def registrations_of(self, node: str) -> dict[str, list[str]]:
        """Lists the topics of a node that are registered, by the method that ends the registration.

        Raises:
            NoMasterError: As in ``ask``.
        """
        publishers, subscribers, _ = self.ask("getSystemState")
        return {
            "unregisterSubscriber": [topic for topic, nodes in subscribers if node in nodes],
            "unregisterPublisher": [topic for topic, nodes in publishers if node in nodes],
        }

    def address_of(self, node: str) -> str | None:
        """Returns the XML-RPC address of a node, or None if the master does not know it.

        Raises:
            NoMasterError: Nobody answers, or somebody else does.
        """
        code, _, value = self._answer("lookupNode", node)
        return str(value) if code == SUCCESS else None

    def _answer(self, method: str, *arguments: Any) -> tuple[int, str, Any]:
        try:
            with remote(self.uri, ANSWER_TIME) as master:
                answer: Any = getattr(master, method)(self._caller, *arguments)
        except OSError as error:
            raise NoMasterError(_unreachable(self.uri, error)) from error
        except (xmlrpc.client.Error, http.client.HTTPException, ExpatError) as error:
            raise NoMasterError(
                f"what answers at {self.uri} is no ROS master ({type(error).__name__})"
                " (valid: the address of the robot's master in ROS_MASTER_URI)"
            ) from error
        if not isinstance(answer, list) or len(answer) != 3:
            raise NoMasterError(f"what answers at {self.uri} is no ROS master: it says {str(answer)[:60]!r}")
        return int(answer[0]), str(answer[1]), answer[2]


def _absolute(name: str) -> str:
    return name if name.startswith("/") else f"/{name}"


def _unreachable(uri: str, error: OSError) -> str:
    host = urlsplit(uri).hostname
    return (
        f"no ROS master answers at {uri}: {error.strerror or error}."
        f" Is the robot on, does 'ping {host}' reach it, and is ROS_MASTER_URI its address"
        f" (host {host} may need a line in /etc/hosts)?"
    )
