# SPDX-License-Identifier: BSD-3-Clause
"""From a robot's state to the torque command for it, between two processes over ROS: all of ``run``, against an echo.

This process plays a robot that stands still and stamps what it sends and hears; the other one is
``impedance run soft-hold --backend baxter`` with both arms, recording and watchdog. The echo answers each state with
a constant torque in the callback: what the transport alone costs. Medians and the ratio to the echo say something
about the code; the tails say how busy the machine was. The robot's other topics come half a period later.

Usage: python benchmarks/backends/baxter_latency.py [--transport rospy|sockets] [--rate HZ ...]
"""

from __future__ import annotations

import argparse
import os
import socket
import subprocess
import sys
import tempfile
import time
from functools import partial
from pathlib import Path

import numpy as np

from impedance_modules.backends.baxter import topics
from impedance_modules.backends.baxter.preflight_checks import TIP
from impedance_modules.backends.baxter.ros import messages
from impedance_modules.backends.baxter.ros.master_client import MasterClient
from impedance_modules.backends.baxter.ros.rospy_transport import RospyTransport, connect
from impedance_modules.backends.baxter.ros.socket_transport import SocketTransport
from impedance_modules.backends.baxter.ros.transport import NoMasterError, Transport
from impedance_modules.control.assembly import assemble

TASK = "soft-hold"
ON = messages.AssemblyState(True, True, False, False, 0, 0)
PERCENTILES = (50.0, 90.0, 99.0, 99.9, 100.0)
ECHO_TIME = 6.0


class StandingRobot:
    """Publishes the pose in which the task begins, and times the torques that come back."""

    def __init__(self, transport: Transport) -> None:
        assembly = assemble(TASK, effects=None, rate=100.0, scale=1.0, arm=None)
        self._model, self._q = assembly.model, assembly.modules.posture
        self.rate, self.sent = topics.DEFAULT_STATE_RATE, 0
        self.latencies: list[float] = []
        self._open: dict[str, float] = {}
        transport.set_parameter(topics.SOFTWARE_VERSION, "1.2.0.57")
        transport.set_parameter(topics.DESCRIPTIONS[0], self._model.spec.urdf.read_text())
        self._states = transport.advertise(topics.JOINT_STATES, messages.JointState)
        self._robot = transport.advertise(topics.ROBOT_STATE, messages.AssemblyState)
        self._slow = [self._limb(transport, limb) for limb in self._model.limbs]
        transport.subscribe(topics.STATE_RATE_REQUEST, messages.UInt16, self._hear_rate)
        for limb in self._model.limbs:
            transport.subscribe(topics.joint_command(limb), messages.JointCommand, partial(self._hear, limb))
        self._names = (*sorted(self._model.joint_names), "head_pan")
        order = [self._model.joint_names.index(name) for name in self._names[:-1]]
        self._numbers = [
            (*vector[order].tolist(), 0.0)
            for vector in (self._q, np.zeros(self._model.n), self._model.gravity(self._q))
        ]

    def live(self, process: subprocess.Popen[bytes]) -> None:
        """Publishes until a process has ended."""
        due, seq = time.monotonic(), 0
        while process.poll() is None:
            seq += 1
            state = messages.JointState(messages.Header(seq, time.time_ns(), ""), self._names, *self._numbers)
            self._open = dict.fromkeys(self._model.limbs, time.monotonic())
            self._states.send(state)
            self.sent += 1
            self._until(due + 0.5 / self.rate)
            if seq % max(1, self.rate // 100) == 0:
                self._robot.send(ON)
                for publisher, message in self._slow:
                    publisher.send(message)
            due = max(due + 1.0 / self.rate, time.monotonic())
            self._until(due)

    @staticmethod
    def _until(moment: float) -> None:
        time.sleep(max(0.0, moment - time.monotonic()))

    def _hear(self, limb: str, message: messages.JointCommand, received: float) -> None:  # noqa: ARG002 - a callback
        if message.mode == message.TORQUE_MODE and limb in self._open:
            self.latencies.append(time.monotonic() - self._open.pop(limb))

    def _hear_rate(self, message: messages.UInt16, received: float) -> None:  # noqa: ARG002 - a callback
        self.rate = message.data

    def _limb(self, transport: Transport, limb: str) -> tuple[object, messages.EndpointState]:
        hand = self._model.pose(self._q, self._model.limbs[limb].hand)
        tip = hand.translation + TIP * hand.rotation[:, 2]
        zero = messages.Vector3(0.0, 0.0, 0.0)
        message = messages.EndpointState(
            messages.Header(0, 0, "base"),
            messages.PoseMessage(messages.Point(*tip.tolist()), messages.Quaternion(0.0, 0.0, 0.0, 1.0)),
            messages.Twist(zero, zero),
            messages.Wrench(zero, zero),
        )
        return transport.advertise(topics.endpoint_state(limb), messages.EndpointState), message


def echo(kind: str, rate: int) -> None:
    """Answers every state at once with a torque for both arms; what any controller in Python pays."""
    transport = connect(kind, "echo")
    limbs = assemble(TASK, effects=None, rate=100.0, scale=1.0, arm=None).model.limbs
    publishers = {
        name: transport.advertise(topics.joint_command(name), messages.JointCommand) for name in limbs
    }
    transport.advertise(topics.STATE_RATE_REQUEST, messages.UInt16, latch=True).send(messages.UInt16(rate))

    def answer(message: messages.JointState, received: float) -> None:  # noqa: ARG001 - a callback
        for name, publisher in publishers.items():
            publisher.send(messages.JointCommand(3, (0.0,) * 7, limbs[name].joint_names))

    transport.subscribe(topics.JOINT_STATES, messages.JointState, answer)
    time.sleep(ECHO_TIME)
    transport.close()


def measure(robot: StandingRobot, command: list[str]) -> np.ndarray:
    """Latencies of one controller [s], without its first ones, and the share of states left unanswered."""
    robot.latencies.clear()
    robot.rate = topics.DEFAULT_STATE_RATE
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, start_new_session=True)
    robot.live(process)
    if process.returncode != 0:
        print(f"  ended with exit {process.returncode}", file=sys.stderr)
    return np.array(robot.latencies[len(robot.latencies) // 10 :])


def report(name: str, rate: int, latencies: np.ndarray, floor: float | None) -> float:
    """Prints one line; returns the median [s]."""
    if latencies.size == 0:
        print(f"{rate:5d} Hz  {name:5s}  nothing was answered")
        return float("nan")
    cells = "  ".join(f"{1e3 * value:8.3f}" for value in np.percentile(latencies, PERCENTILES))
    ratio = "" if floor is None else f"   median {np.median(latencies) / floor:.1f} x echo"
    print(f"{rate:5d} Hz  {name:5s}  {cells}   {latencies.size:6d} commands{ratio}", flush=True)
    return float(np.median(latencies))


def start_master() -> tuple[subprocess.Popen[bytes], str]:
    """A ROS master of our own on a free port; the environment points at it."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
    uri = f"http://127.0.0.1:{port}"
    os.environ.update(ROS_MASTER_URI=uri, ROS_IP="127.0.0.1")
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    master = subprocess.Popen(["rosmaster", "--core", "-p", str(port)], **quiet)
    for _ in range(200):
        try:
            MasterClient(uri, "/benchmark").check()
            break
        except NoMasterError:
            time.sleep(0.1)
    return master, uri


def main() -> None:
    """Measures both controllers at every rate."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--transport", choices=["rospy", "sockets"], default="rospy")
    parser.add_argument("--rate", type=int, nargs="+", default=[100, 500])
    parser.add_argument("--echo", action="store_true", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.echo:
        echo(given.transport, given.rate[0])
        return
    master, uri = start_master()
    os.environ["ROS_LOG_DIR"] = tempfile.mkdtemp()
    transport = (
        RospyTransport(topics.REALTIME_NODE, uri)
        if given.transport == "rospy"
        else SocketTransport(topics.REALTIME_NODE, uri)
    )
    robot = StandingRobot(transport)
    print(f"{given.transport}: state to command [ms] at percentiles {', '.join(map(str, PERCENTILES))}")
    for rate in given.rate:
        common = ["--transport", given.transport, "--rate", str(rate)]
        floor = report("echo", rate, measure(robot, [sys.executable, __file__, "--echo", *common]), None)
        out = Path(tempfile.mkdtemp()) / "run"
        run = [sys.executable, "-m", "impedance_modules", "run", TASK, "--backend", "baxter", *common]
        report("run", rate, measure(robot, [*run, "--out", str(out)]), floor)
    transport.close()
    master.terminate()
    master.wait()


if __name__ == "__main__":
    main()
