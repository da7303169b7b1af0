# SPDX-License-Identifier: BSD-3-Clause
"""The double's diary: one JSON line per event and per second, with who commanded how often and when last."""

from __future__ import annotations

import json
from typing import TextIO

from impedance_modules.backends.baxter.simulator.simulated_baxter import FakeBaxter


class Journal:
    """Writes what a robot says; its clock is the robot's."""

    def __init__(self, robot: FakeBaxter, file: TextIO | None) -> None:
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
            "enabled": robot.machine.standing.enabled,
            "stopped": robot.machine.standing.stopped,
            "commands": {name: drive.received for name, drive in robot.limbs.items()},
            "ignored": {name: drive.ignored for name, drive in robot.limbs.items()},
            "last_command": {name: round(drive.last_received, 6) for name, drive in robot.limbs.items()},
            "last_torque": {name: round(drive.last_torque, 6) for name, drive in robot.limbs.items()},
            "modes": {
                name: drive.mode.name if drive.mode else drive.doing.value
                for name, drive in robot.limbs.items()
            },
        }
        self._file.write(json.dumps(line) + "\n")
        self._file.flush()
