# SPDX-License-Identifier: BSD-3-Clause
"""Starts a real ROS master on a free port, and ends it; the reasons to skip a test where ROS or rospy is missing."""

from __future__ import annotations

import importlib.util
import os
import shutil
import signal
import socket
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from impedance_modules.backends.baxter.ros.master_client import MasterClient
from impedance_modules.backends.baxter.ros.messages import Message
from impedance_modules.backends.baxter.ros.transport import NoMasterError

INSTALL = "apt-get install --no-install-recommends python3-rospy python3-roslaunch python3-sensor-msgs rosout"

NO_MASTER = "" if shutil.which("rosmaster") else f"no rosmaster here ({INSTALL})"
NO_ROSPY = (
    "" if importlib.util.find_spec("rospy") else f"this Python sees no rospy ({INSTALL}, docs/baxter.md)"
)
"""A machine may have Debian's master and an environment that does not see Debian's rospy."""

ROSPY_NODE = "/by_rospy"
"""Name of the one rospy node that a process can have."""

TRANSPORTS = ("sockets", pytest.param("rospy", marks=pytest.mark.skipif(bool(NO_ROSPY), reason=NO_ROSPY)))
"""Values of ``--transport`` for a test of both."""


def free_port() -> int:
    """Returns a free TCP port."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        return int(server.getsockname()[1])


@contextmanager
def ros_master(logs: Path) -> Iterator[str]:
    """Runs ``rosmaster`` on loopback, with the environment pointing at it; yields its address."""
    port = free_port()
    uri = f"http://127.0.0.1:{port}"
    before = dict(os.environ)
    os.environ.update(ROS_MASTER_URI=uri, ROS_IP="127.0.0.1", ROS_LOG_DIR=str(logs))
    os.environ.pop("ROS_HOSTNAME", None)
    with (logs / "rosmaster.log").open("w") as log:
        process = subprocess.Popen(
            ["rosmaster", "--core", "-p", str(port)], stdout=log, stderr=log, start_new_session=True
        )
    try:
        _wait_for(uri, process)
        yield uri
    finally:
        os.killpg(process.pid, signal.SIGTERM)
        try:
            process.wait(5)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            process.wait(5)
        os.environ.clear()
        os.environ.update(before)


def _wait_for(uri: str, process: subprocess.Popen) -> None:
    end = time.monotonic() + 20.0
    while time.monotonic() < end:
        try:
            MasterClient(uri, "/test").check()
        except NoMasterError:
            assert process.poll() is None, "the ROS master ended at once"
            time.sleep(0.05)
        else:
            return
    raise AssertionError("the ROS master did not come up in 20 s")


def until(condition: Callable[[], bool], seconds: float = 5.0) -> bool:
    end = time.monotonic() + seconds
    while not condition() and time.monotonic() < end:
        time.sleep(0.005)
    return condition()


def forget(uri: str, node: str) -> None:
    """Removes a node from a master, as ``rosnode cleanup`` does for one that was killed."""
    master = MasterClient(uri, node)
    address = master.address_of(node)
    for method, topics in master.registrations_of(node).items():
        for topic in topics:
            master.ask(method, topic, address)


class Heard:
    """A callback that keeps everything."""

    def __init__(self) -> None:
        self.messages: list[Message] = []
        self.times: list[float] = []

    def __call__(self, message: Message, received: float) -> None:
        self.messages.append(message)
        self.times.append(received)
