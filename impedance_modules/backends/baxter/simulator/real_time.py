# SPDX-License-Identifier: BSD-3-Clause
"""Lets a simulator live in real time."""

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

TURN = 0.0005
"""How long a thread may keep the others waiting [s]; commands come in threads of their own."""

COMPLAINT_PAUSE = 5.0
"""Slow machines are told about at most this often [s]."""

PATIENCE = 0.05
"""Ticks that are late are made up for; beyond this lateness they are given up [s]."""


def run_in_real_time(
    node: SimulatorNode,
    event_log: EventLog,
    tell: Callable[[str], None],
    asked_to_end: Callable[[], bool],
    duration: float | None,
) -> float:
    """Lives until somebody asks for the end, or a duration [s] is over; closes the node in any case.

    Args:
        node: Open.
        event_log: Takes notes.
        tell: Is told every event.
        asked_to_end: Asked every millisecond.
        duration: On the simulator's clock; None for no end.

    Returns:
        By how much its clock fell behind the wall's [s].
    """
    robot, pacer = node.robot, Pacer()
    told, complained = 0.0, -COMPLAINT_PAUSE
    turn = sys.getswitchinterval()
    sys.setswitchinterval(TURN)
    gc.freeze()
    gc.disable()
    try:
        while not asked_to_end() and (duration is None or robot.now < duration):
            pacer.wait()
            node.slipped = pacer.slipped
            node.tick()
            for text in event_log.update():
                tell(f"{robot.now:9.3f} s  {text}")
            if pacer.slipped - told > 0.0 and robot.now - complained >= COMPLAINT_PAUSE:
                tell(f"{robot.now:9.3f} s  this machine is too slow: {pacer.slipped:.2f} s behind in all")
                told, complained = pacer.slipped, robot.now
    finally:
        gc.enable()
        gc.unfreeze()
        sys.setswitchinterval(turn)
        node.close()
    return pacer.slipped


class EventLog:
    """Writes what a robot says; its clock is the robot's."""

    def __init__(self, robot: SimulatedBaxter, file: TextIO | None) -> None:
        """``file`` is open for text, or None for no diary."""
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
            "enabled": robot.machine.power.enabled,
            "stopped": robot.machine.power.stopped,
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
    """Says when the next tick is due.

    Attributes:
        slipped: By how much the simulator's clock is behind the wall's in all [s].
    """

    def __init__(
        self,
        clock: Callable[[], float] = time.perf_counter,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        self._clock, self._sleep = clock, sleep
        self._start = clock()
        self._ticks = 0
        self.slipped = 0.0

    def wait(self) -> float:
        """Sleeps until the next tick; returns how much time was given up just now [s]."""
        self._ticks += 1
        early = self._start + self._ticks * TICK - self._clock()
        if early > 0.0:
            self._sleep(early)
        if early >= -PATIENCE:
            return 0.0
        self._start -= early
        self.slipped -= early
        return -early
