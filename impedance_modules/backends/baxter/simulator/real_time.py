# SPDX-License-Identifier: BSD-3-Clause
"""Runs a simulated Baxter in real time and writes its event log.

Each tick waits for its time: there is no drift while the machine keeps up, and a lag that is stated when it does not.
"""

from __future__ import annotations

import gc
import json
import sys
import time
from collections.abc import Callable
from typing import TextIO

from impedance_modules.backends.baxter.simulator.parameters import TICK
from impedance_modules.backends.baxter.simulator.simulated_baxter import SimulatedBaxter
from impedance_modules.backends.baxter.simulator.simulator_node import SimulatorNode

SWITCH_INTERVAL = 0.0005
"""Longest time for which a thread may hold the interpreter lock [s]; commands come in threads of their own."""

WARNING_PERIOD = 5.0
"""Shortest time between two warnings that the machine is too slow [s]."""

LARGEST_LATENESS = 0.05
"""A lateness up to this is caught up; a larger one is added to the lag [s]."""


def run_in_real_time(
    node: SimulatorNode,
    event_log: EventLog,
    tell: Callable[[str], None],
    asked_to_end: Callable[[], bool],
    duration: float | None,
) -> float:
    """Runs until it is asked to end or a duration [s] is over; closes the node in any case.

    Args:
        node: Open.
        event_log: Of the robot.
        tell: Called with every event.
        asked_to_end: Called every millisecond; True ends the run.
        duration: In simulated time; None for no end.

    Returns:
        By how much simulated time fell behind real time [s].
    """
    robot, pacer = node.robot, Pacer()
    told, warned = 0.0, -WARNING_PERIOD
    usual = sys.getswitchinterval()
    sys.setswitchinterval(SWITCH_INTERVAL)
    gc.freeze()
    gc.disable()
    try:
        while not asked_to_end() and (duration is None or robot.now < duration):
            pacer.wait()
            node.lag = pacer.lag
            node.tick()
            for text in event_log.update():
                tell(f"{robot.now:9.3f} s  {text}")
            if pacer.lag - told > 0.0 and robot.now - warned >= WARNING_PERIOD:
                tell(f"{robot.now:9.3f} s  this machine is too slow: {pacer.lag:.2f} s behind in all")
                told, warned = pacer.lag, robot.now
    finally:
        gc.enable()
        gc.unfreeze()
        sys.setswitchinterval(usual)
        node.close()
    return pacer.lag


class EventLog:
    """Writes one JSON line per event and per second: power, and each limb's mode, commands and their last times."""

    def __init__(self, robot: SimulatedBaxter, file: TextIO | None) -> None:
        """``file`` is open for text, or None to write nothing."""
        self._robot, self._file = robot, file
        self._told = 0
        self._next = 0.0

    def update(self) -> list[str]:
        """Writes what is new; returns the new events' texts."""
        robot = self._robot
        fresh = robot.events[self._told :]
        self._told = len(robot.events)
        for at, text in fresh:
            self._write(at, text)
        if robot.now >= self._next:
            self._next = robot.now + 1.0
            self._write(robot.now, "")
        return [text for _, text in fresh]

    def _write(self, at: float, text: str) -> None:
        if self._file is None:
            return
        robot = self._robot
        line = {
            "time": round(at, 6),
            "event": text,
            "enabled": robot.machine.state.enabled,
            "stopped": robot.machine.state.stopped,
            "commands": {name: drive.received for name, drive in robot.limbs.items()},
            "ignored": {name: drive.ignored for name, drive in robot.limbs.items()},
            "last_command": {name: round(drive.last_received, 6) for name, drive in robot.limbs.items()},
            "last_torque": {name: round(drive.last_torque, 6) for name, drive in robot.limbs.items()},
            "modes": {
                name: drive.mode.name if drive.mode else drive.activity.value
                for name, drive in robot.limbs.items()
            },
        }
        self._file.write(json.dumps(line) + "\n")
        self._file.flush()


class Pacer:
    """Keeps ticks at their time.

    Attributes:
        lag: By how much simulated time is behind real time in all [s].
    """

    def __init__(
        self,
        clock: Callable[[], float] = time.perf_counter,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        self._clock, self._sleep = clock, sleep
        self._start = clock()
        self._ticks = 0
        self.lag = 0.0

    def wait(self) -> float:
        """Sleeps until the next tick; returns by how much the lag has grown just now [s]."""
        self._ticks += 1
        early = self._start + self._ticks * TICK - self._clock()
        if early > 0.0:
            self._sleep(early)
        if early >= -LARGEST_LATENESS:
            return 0.0
        self._start -= early
        self.lag -= early
        return -early
