# SPDX-License-Identifier: BSD-3-Clause
"""A simulated robot on ROS 2: the built-in plant behind a node, in a process of its own, with faults.

The node runs in the Python that has rclpy and knows nothing of this package: the plant runs in the parent process's
Python, ``python -m tests.support.ros2_robot TASK RATE OPTIONS``, and the two talk by a pipe, line by line.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from importlib.util import find_spec
from itertools import count as count_from
from pathlib import Path
from typing import Any

from tests.support.paths import CHECKOUT

OWN = Path(sys.prefix) / "ros2" / "bin" / "python"
"""ROS 2's wheels have an environment of their own below the tests' (Makefile): they set library paths for every program
of an environment, and their std_msgs would hide that of ROS 1."""

ROS2_PYTHON = (
    str(OWN)
    if [*OWN.parent.parent.glob("lib/python*/site-packages/rclpy")]
    else sys.executable
    if find_spec("rclpy")
    else ""
)
NO_ROS2 = (
    ""
    if ROS2_PYTHON
    else "no rclpy here: make test installs its wheels for Linux, x86_64 and Python 3.11 to 3.13"
)

CALLS = count_from(os.getpid())
"""Numbers the domains of this process's nodes: others on the machine, and nodes that were killed, are not heard."""

NODE = r"""
import json, os, sys, threading
import rclpy
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
topic = sys.argv[1]
rclpy.init(args=[])
node = rclpy.create_node("simulated_robot")
best_effort = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
states = node.create_publisher(JointState, "/joint_states", best_effort)
def command(message):
    print(json.dumps(list(message.data)), flush=True)
node.create_subscription(Float64MultiArray, topic, command, 1) if topic else None
def publish():
    for line in sys.stdin:
        for data in json.loads(line):
            message = JointState()
            message.header.stamp.sec, message.header.stamp.nanosec = int(data["t"]), round(1e9 * (data["t"] % 1.0))
            message.name, message.position = data["name"], data["q"]
            message.velocity, message.effort = data["v"], data["tau"]
            states.publish(message)
    os._exit(0)
threading.Thread(target=publish, daemon=True).start()
print("[]", flush=True)
rclpy.spin(node)
"""


class SimulatedRobot:
    """The process."""

    def __init__(self, process: subprocess.Popen[str]) -> None:
        self._process = process

    def fault(self, name: str) -> None:
        """Begins a fault: ``mute``, ``nan``, ``doubled``, ``disordered`` or ``none``."""
        assert self._process.stdin is not None
        self._process.stdin.write(f"{name}\n")
        self._process.stdin.flush()


@contextmanager
def simulated_robot(task: Path, rate: float, **options: Any) -> Iterator[SimulatedRobot]:
    """Runs the robot of a task, which stands where the task begins.

    Args:
        task: A task file.
        rate: Of its states [Hz].
        options: ``topic`` of its controller, ``carries`` its own weight, joints left out (``without``), efforts or
            velocities that are empty (``empty``), ``joints`` in the controller's order, and what efforts hold
            (``effort``): ``with_weight``, ``without_weight``, or ``amperes``, as drives of 12 N.m/A report them.
    """
    asked = {
        "topic": "/forward_effort_controller/commands",
        "carries": True,
        "without": [],
        "empty": [],
        "joints": [],
        "effort": "with_weight",
        **options,
    }
    process = subprocess.Popen(
        [sys.executable, "-m", "tests.support.ros2_robot", str(task), str(rate), json.dumps(asked)],
        cwd=CHECKOUT,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        assert process.stdout is not None and process.stdout.readline().strip() == "ready"
        yield SimulatedRobot(process)
    finally:
        process.kill()
        process.wait()


def own_domain() -> dict[str, str]:
    """Variables with which the nodes of one test meet each other and no others."""
    return {"ROS_DOMAIN_ID": str(1 + next(CALLS) % 100), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}


def main(arguments: list[str]) -> None:
    """Simulates in real time until the input ends."""
    from impedance_modules.control.assembly import assemble
    from impedance_modules.runs.run_backends import sim_backend

    task, rate, asked = arguments[0], float(arguments[1]), json.loads(arguments[2])
    assembly = assemble(task, effects=None, rate=rate, scale=1.0, arm=None)
    robot, names = sim_backend(assembly, 0), assembly.model.joint_names
    first = robot.start().state
    node = subprocess.Popen(
        [ROS2_PYTHON, "-c", NODE, asked["topic"]], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    assert node.stdout is not None and node.stdout.readline().strip() == "[]"
    newest: dict[str, Any] = {"torque": None, "fault": "none"}
    threading.Thread(target=_listen, args=(node.stdout, newest, "torque"), daemon=True).start()
    threading.Thread(target=_listen, args=(sys.stdin, newest, "fault"), daemon=True).start()
    print("ready", flush=True)
    state, began, cycle, held = (
        first,
        time.time(),
        0,
        [name for name in names if name not in asked["without"]],
    )
    # Until torques come, another controller holds the arm.
    while True:
        cycle += 1
        torque = 0.0 * state.position
        if newest["torque"] is not None:
            torque[[names.index(name) for name in asked["joints"] or names]] = newest["torque"]
            torque -= 0.0 if asked["carries"] else assembly.model.gravity(state.position)
        robot.write(torque)
        state = robot.read() or state
        weight = assembly.model.gravity(state.position) if asked["effort"] == "without_weight" else 0.0
        effort = (state.effort - weight) / (12.0 if asked["effort"] == "amperes" else 1.0)
        reported = replace(state, effort=effort)
        _publish(node, newest["fault"], names, held, reported, began + cycle / rate, asked["empty"])
        time.sleep(max(0.0, began + cycle / rate - time.time()))


def _listen(stream: Any, newest: dict[str, Any], key: str) -> None:
    for line in stream:
        newest[key] = json.loads(line) if key == "torque" else line.strip()
    os._exit(0)


def _publish(
    node: subprocess.Popen[str],
    fault: str,
    names: tuple[str, ...],
    held: list[str],
    state: Any,
    moment: float,
    empty: list[str],
) -> None:
    if fault == "mute" or node.stdin is None:
        return
    places = [names.index(name) for name in held]
    rows = {"q": state.position, "v": state.velocity, "tau": state.effort}
    data: dict[str, Any] = {key: [] if key in empty else row[places].tolist() for key, row in rows.items()}
    data.update(t=moment, name=held)
    if fault == "nan":
        data["tau"] = [float("nan")] * len(held)
    messages = [data]
    if fault == "doubled":
        messages = [data, data]
    if fault == "disordered":
        messages = [data, {**data, "t": moment - 0.05}]
    node.stdin.write(json.dumps(messages) + "\n")
    node.stdin.flush()


if __name__ == "__main__":
    main(sys.argv[1:])
