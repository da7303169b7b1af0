# SPDX-License-Identifier: BSD-3-Clause
"""Which transport a command uses: rospy where ROS 1 is installed, plain sockets where it is not."""

from __future__ import annotations

import importlib.util
import os
from collections.abc import Mapping

from impedance_modules.backends.baxter.ros.master_client import master_uri_of
from impedance_modules.backends.baxter.ros.rospy_transport import RospyTransport
from impedance_modules.backends.baxter.ros.socket_transport import SocketTransport
from impedance_modules.backends.baxter.ros.transport import Transport
from impedance_modules.errors import BadInput

KINDS = ("auto", "rospy", "sockets")
"""Names on the command line; ``auto`` is rospy where it can be imported, else sockets."""


def connect(kind: str, purpose: str, environment: Mapping[str, str] = os.environ) -> Transport:
    """Brings a node up on the master that ROS_MASTER_URI names.

    Args:
        kind: One of ``KINDS``.
        purpose: Becomes part of the node's name, e.g. ``check``; the process's number makes it unique.
        environment: Of the process.

    Raises:
        BadInput: Another kind.
        NoMasterError: No master answers; the message says what to set.
        NoRospyError: rospy was asked for and is not installed.
    """
    if kind not in KINDS:
        raise BadInput(f"transport '{kind}' (valid: {', '.join(KINDS)})")
    name, uri = f"/impedance_{purpose}_{os.getpid()}", master_uri_of(environment)
    by_rospy = kind == "rospy" or (kind == "auto" and importlib.util.find_spec("rospy") is not None)
    return RospyTransport(name, uri) if by_rospy else SocketTransport(name, uri)
