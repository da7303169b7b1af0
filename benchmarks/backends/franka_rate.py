# SPDX-License-Identifier: BSD-3-Clause
"""How often, and how fast, Franka arms are answered: bare pylibfranka, a thread per arm, and this package's processes.

    python -m benchmarks.backends.franka_rate [--arms 2] [--seconds 5] [--clocks one|two]

Simulated arms (franky-sim) run in a process of their own; with ``--clocks two`` each in one of its own, whose clocks
differ as those of two robots do. Columns: ``period`` of the answers by our clock, ``lost`` states of the robot that
nobody saw, ``answer`` from the arrival of a state until its command left; percentiles 50, 90, 99, 99.9.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from tests.support.franka_robot import write_robot, write_task
from tests.support.franka_simulator import simulated_arms

LIMBS = ("right", "left")
PERCENTILES = (50.0, 90.0, 99.0, 99.9)


class Answers:
    """What one arm was answered: moments [s], robot's time [s], time that the answer took [s]."""

    def __init__(self) -> None:
        self.moments: list[float] = []
        self.times: list[float] = []
        self.taken: list[float] = []

    def add(self, moment: float, robot: float, taken: float) -> None:
        """Adds one answer."""
        self.moments.append(moment)
        self.times.append(robot)
        self.taken.append(taken)

    def line(self, name: str) -> str:
        """One row of the table."""
        period = 1e3 * np.percentile(np.diff(self.moments), PERCENTILES)
        answer = 1e3 * np.percentile(self.taken, PERCENTILES)
        steps = np.round(1e3 * np.diff(self.times)).astype(int)
        lost = int(np.maximum(steps - 1, 0).sum()) / max(int(steps.sum()), 1)
        rate = (len(self.moments) - 1) / (self.moments[-1] - self.moments[0])
        shown = [" ".join(f"{value:6.2f}" for value in row) for row in (period, answer)]
        return f"{name:<28} {rate:6.0f} Hz   period {shown[0]} ms   lost {lost:6.2%}   answer {shown[1]} ms"


def echo(addresses: tuple[str, ...], seconds: float, *, threads: bool) -> list[Answers]:
    """Answers every state with zero torque by bare pylibfranka, from one loop or from a thread per arm."""
    import pylibfranka

    robots = [pylibfranka.Robot(address, pylibfranka.RealtimeConfig.kIgnore) for address in addresses]
    controls = [robot.start_torque_control() for robot in robots]
    found = [Answers() for _ in controls]
    last = pylibfranka.Torques([0.0] * 7)
    end = time.perf_counter() + seconds

    def answer(ks: range) -> None:
        zero = pylibfranka.Torques([0.0] * 7)
        while time.perf_counter() < end:
            arrived = []
            for k in ks:
                state, _ = controls[k].readOnce()
                arrived.append((time.perf_counter(), state.time.to_sec()))
            for k, (moment, robot) in zip(ks, arrived, strict=True):
                controls[k].writeOnce(zero)
                found[k].add(moment, robot, time.perf_counter() - moment)

    if threads:
        sys.setswitchinterval(1e-4)
        workers = [threading.Thread(target=answer, args=(range(k, k + 1),)) for k in range(len(controls))]
        for worker in workers:
            worker.start()
        for worker in workers:
            worker.join()
    else:
        answer(range(len(controls)))
    last.motion_finished = True
    for control in controls:
        control.readOnce()
        control.writeOnce(last)
    return found


def whole_run(limbs: tuple[str, ...], connection: str, seconds: float) -> list[Answers]:
    """Carries a task out at 1 kHz and reads what its recording says of the arms."""
    from impedance_modules.episode.reader import read_episode

    with TemporaryDirectory() as name:
        folder = Path(name)
        task = write_task(
            folder / "task.yaml", write_robot(folder / "robots" / "arms", limbs), limbs, seconds
        )
        (folder / "connection.yaml").write_text(connection)
        subprocess.run(
            [
                *(
                    sys.executable,
                    "-m",
                    "impedance_modules",
                    "run",
                    str(task),
                    "--backend",
                    "franka",
                    "--approach",
                ),
                *("--connection", str(folder / "connection.yaml"), "--out", str(folder / "out")),
            ],
            check=True,
            stdout=subprocess.DEVNULL,
        )
        episode = read_episode(folder / "out")
    found = []
    for limb in limbs:
        arm = Answers()
        # The columns tell of the newest state of each cycle: its answer is told one cycle later.
        for robot, moment, taken in zip(
            episode.extra[f"robot_time.{limb}"],
            episode.extra[f"arrival.{limb}"],
            episode.extra[f"answer_time.{limb}"],
            strict=True,
        ):
            if not arm.times or robot > arm.times[-1]:
                arm.add(float(moment), float(robot), float(taken))
        print(f"{'':<28} torque of its own state: {np.mean(episode.extra[f'fresh_torque.{limb}']):.2%}")
        found.append(arm)
    return found


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--arms", type=int, choices=(1, 2), default=2)
    parser.add_argument("--seconds", type=float, default=5.0)
    parser.add_argument("--clocks", choices=("one", "two"), default="one")
    asked = parser.parse_args()
    limbs = LIMBS[: asked.arms]
    counts = [len(limbs)] if asked.clocks == "one" else [1] * len(limbs)
    with ExitStack() as ending:
        simulators = [ending.enter_context(simulated_arms(count, "--slower=1")) for count in counts]
        addresses = tuple(address for simulator in simulators for address in simulator.addresses)
        watch = "{least_rate: 50, least_success: 0, silent: 0.2, patience: 0.05}"
        named = ", ".join(f"{limb}: {host}" for limb, host in zip(limbs, addresses, strict=True))
        connection = f"format: 1\nfranka: {{addresses: {{{named}}}, realtime: optional, watch: {watch}}}\n"
        ways: dict[str, Callable[[], list[Answers]]] = {
            "pylibfranka, one loop": lambda: echo(addresses, asked.seconds, threads=False),
            "pylibfranka, thread per arm": lambda: echo(addresses, asked.seconds, threads=True),
            "whole run, process per arm": lambda: whole_run(limbs, connection, asked.seconds),
        }
        for name, way in ways.items():
            for limb, arm in zip(limbs, way(), strict=True):
                print(arm.line(f"{name}, {limb}"))


if __name__ == "__main__":
    main()
