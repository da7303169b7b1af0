# SPDX-License-Identifier: BSD-3-Clause
"""Simulated FR3 arms (franky-sim) in a process of their own, behind the maker's network protocol, with faults.

As a program, ``python -m tests.support.franka_simulator ADDRESS...``; each line on its input is ``FAULT [ARM]``:
``reflex``, ``user_stop``, ``guiding``, ``nan``, ``mute`` (no states), ``unplug`` (the connection is cut), ``none``;
``home`` is none, and puts the arm back to where it began. Of the hand: ``thing`` (something 30 mm wide is between its
fingers), ``unhomed``, ``hand_mute`` (it answers no order), ``hand_unplug`` (its connection is cut).
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from itertools import count as count_from
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from tests.support.franka_robot import POSTURE, SPACING
from tests.support.paths import CHECKOUT

NO_FRANKA = "; ".join(
    f"no {name} here: {why}"
    for name, why in (
        ("pylibfranka", "its wheels exist for Linux on x86_64 and Python 3.9 to 3.12"),
        ("franky_sim", "it comes with the dependency group 'test' where pylibfranka does"),
    )
    if find_spec(name) is None
)
JOINT_REFLEX = 6
"""Place of that error in the maker's list."""

THING = 0.03
"""Width of what is between the fingers, where something is [m]."""

CALLS = count_from(0)
"""Counts the simulators of this process."""

PATIENT = "{patience: 0.2, silent: 0.5, least_rate: 20, least_success: 0}"
"""A watch for machines that do other things, too."""


class SimulatedArms:
    """The process.

    Attributes:
        addresses: One per arm.
    """

    def __init__(self, process: subprocess.Popen[str], addresses: tuple[str, ...]) -> None:
        self.addresses = addresses
        self._process = process

    def fault(self, name: str, arm: int = 0) -> None:
        """Injects a fault into one arm, or ends it with ``none``."""
        assert self._process.stdin is not None
        self._process.stdin.write(f"{name} {arm}\n")
        self._process.stdin.flush()

    def connection(self, limbs: tuple[str, ...], watch: str = PATIENT) -> str:
        """Text of a connection file."""
        named = ", ".join(f"{limb}: {host}" for limb, host in zip(limbs, self.addresses, strict=True))
        return f"format: 1\nfranka:\n  addresses: {{{named}}}\n  realtime: optional\n  watch: {watch}\n"


@contextmanager
def simulated_arms(count: int, *options: str) -> Iterator[SimulatedArms]:
    """Runs the process; every call has addresses of its own, so tests may run side by side."""
    pid, first = os.getpid(), 1 + 4 * next(CALLS)
    addresses = tuple(f"127.{1 + (pid >> 8) % 250}.{pid % 250}.{first + k}" for k in range(count))
    process = subprocess.Popen(
        [sys.executable, "-m", "tests.support.franka_simulator", *options, *addresses],
        cwd=CHECKOUT,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        assert process.stdout is not None and process.stdout.readline().strip() == "ready"
        yield SimulatedArms(process, addresses)
    finally:
        process.kill()
        process.wait()


def main(arguments: list[str]) -> None:
    """Simulates until the input ends."""
    from franky_sim import simulation_server
    from franky_sim.mujoco_simulator import MujocoSimulator

    from tests.support.franka_scene import TaskScene

    asked = read_arguments(arguments)
    server_class = faulty_server()
    simulation_server.FrankaRobotServer = server_class
    make_hands_faulty()
    scene = TaskScene(asked.task) if asked.task else None
    with MujocoSimulator() as simulator:
        for k in range(len(asked.addresses)):
            y = SPACING * (k - 0.5 * (len(asked.addresses) - 1))
            if scene is None:
                robot = simulator.add_robot(initial_q=POSTURE, position=(0.0, y, 0.0))
            else:
                place, posture = scene.bases[k], scene.posture[k]
                robot = simulator.add_robot(initial_q=posture, initial_hand_width=0.0, position=place)
            if asked.falling:
                without_gravity_compensation(robot)
        if scene is not None:
            scene.add_to(simulator)
        with simulation_server.SimulationServer(simulator, asked.addresses) as server:
            if asked.old:
                server_class.refuse_version()
            if scene is not None:
                scene.soften_tables(simulator)
                simulator.register_post_step_callback(lambda _: scene.step(simulator, server.robot_servers))
            print("ready", flush=True)
            threading.Thread(target=obey, args=(server.robot_servers,), daemon=True).start()
            server.run_forever(realtime=asked.slower)


def read_arguments(arguments: list[str]) -> argparse.Namespace:
    """Reads the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("addresses", nargs="+")
    parser.add_argument(
        "--falling", action="store_true", help="in torque mode the arms are left to their weight"
    )
    parser.add_argument("--old", action="store_true", help="refuse the version of the maker's software")
    parser.add_argument("--slower", type=float, default=2.5, help="than real time, by this factor")
    parser.add_argument("--task", help="where the arms stand and what is around them: as this task says")
    return parser.parse_args(arguments)


def obey(servers: list[Any]) -> None:
    """Sets faults as they are asked for; ends the process with its input."""
    for line in sys.stdin:
        name, arm = line.split()
        servers[int(arm)].asked = name
    os._exit(0)


def without_gravity_compensation(robot: Any) -> None:
    """In torque mode, the arm is left to its weight."""
    carried = robot.torque_control

    def fall(torques: Any, has_new_command: bool = True) -> None:
        in_torque_mode = abs(torques).max() < 1e-9
        carried(torques, has_new_command)
        if in_torque_mode:
            robot._torque_control(0.0 * torques)

    robot.torque_control = fall


def make_hands_faulty() -> None:
    """Has every hand fail as its arm is asked to."""
    from franky_sim import franka_robot_server
    from franky_sim.franka_gripper_server import FrankaGripperServer

    class FaultyHand(FrankaGripperServer):
        arm: Any = SimpleNamespace(asked="none")

        def start_grasp(self, width: float, *rest: Any) -> None:
            super().start_grasp(max(width, THING) if self.arm.asked == "thing" else width, *rest)

        def _check_motion_state(self) -> None:
            if self.arm.asked == "hand_unplug":
                self.reset_state()
            elif self.arm.asked != "hand_mute":
                super()._check_motion_state()

        def _get_state_bytes(self) -> bytes:
            known, self._max_width = self._max_width, 0.0 if self.arm.asked == "unhomed" else self._max_width
            try:
                return super()._get_state_bytes()
            finally:
                self._max_width = known

    franka_robot_server.FrankaGripperServer = FaultyHand


def faulty_server() -> Any:
    """Makes a server of one arm that fails on request."""
    from franky_sim import franka_robot_protocol as protocol
    from franky_sim import franka_server
    from franky_sim.franka_robot_server import FrankaRobotServer

    class FaultyServer(FrankaRobotServer):
        asked = "none"
        shown = "none"

        def process_commands(self) -> None:
            if self.gripper_server is not None:
                self.gripper_server.arm = self
            if self.asked != self.shown:
                self.shown = self.asked
                self.begin_fault()
            super().process_commands()

        def begin_fault(self) -> None:
            aborted = {
                "reflex": protocol.MoveStatus.kReflexAborted,
                "user_stop": protocol.MoveStatus.kEmergencyAborted,
            }
            status = aborted.get(self.shown)
            if status is not None and self.current_motion_id:
                number = self.current_motion_id
                self.stop_motion(send_preemption_signal=False)
                self.reset_current_motion_id()
                # The state with the errors comes first, as from a robot.
                self.send_state()
                time.sleep(0.01)
                protocol.BaseCommand.send_response(
                    self._tcp_socket, protocol.RobotCommand.kMove, number, status
                )
            if self.shown in ("unplug", "home"):
                self.reset_state()
            if self.shown == "home":
                robot = self.robot
                robot.data.qpos[robot._qpos_addrs] = POSTURE
                robot.data.qvel[robot._dof_addrs] = 0.0
                self._FrankaRobotServer__holding_q = POSTURE
                self.asked = self.shown = "none"

        def send_state(self) -> None:
            if self.shown != "mute":
                super().send_state()

        @property
        def robot_state(self) -> Any:
            state = FrankaRobotServer.robot_state.fget(self)
            modes = {"reflex": "kReflex", "user_stop": "kUserStopped", "guiding": "kGuiding"}
            if self.shown in modes:
                state = state.replace(robot_mode=protocol.RobotMode[modes[self.shown]])
            if self.shown == "reflex":
                errors = tuple(k == JOINT_REFLEX for k in range(41))
                state = state.replace(
                    errors=errors, current_errors=errors, last_motion_errors=errors, reflex_reason=errors
                )
            if self.shown == "nan":
                state = state.replace(tau_J=(float("nan"),) * 7)
            return state

        @staticmethod
        def refuse_version() -> None:
            franka_server.ConnectStatus.kSuccess._value_ = 1

    def recover(command: Any, server: Any) -> None:
        server.asked = "none"
        command.reply(protocol.AutomaticErrorRecoveryStatus.kSuccess)

    protocol.AutomaticErrorRecoveryCommand.handle = recover
    return FaultyServer


def write_connection(path: Path, text: str) -> Path:
    """Writes a connection file and returns its path."""
    path.write_text(text)
    return path


if __name__ == "__main__":
    main(sys.argv[1:])
