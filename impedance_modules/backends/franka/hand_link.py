# SPDX-License-Identifier: BSD-3-Clause
"""The run's end of the line to one hand's process: hands orders on, takes samples, never waits once a run goes on."""

from __future__ import annotations

import json
import math
import select
import socket
import time
from collections.abc import Mapping
from typing import Any

from impedance_modules.backends.franka.hand_process import LARGEST
from impedance_modules.backends.franka.processes import arrived, end_process, start_process
from impedance_modules.backends.grippers import GripperReport, GripperSample, OrderedGripper
from impedance_modules.errors import RobotRefused
from impedance_modules.spec.gripper_spec import GripperMotion, GripperSpec

KIND = "franka-hand"
"""Kind of gripper in a robot file that is this one."""

LEAST_OPENING = 0.9
"""Of the stated opening that a hand must know by its homing; one that was never homed knows less."""


class HandLink:
    """One hand's process and what it has said."""

    def __init__(self, limb: str, address: str, spec: GripperSpec) -> None:
        """Starts the process, which connects at once."""
        self._limb, self._address = limb, address
        self._ordered = OrderedGripper(spec, self._send)
        self._widest = math.nan
        self._channel, self._process = start_process(
            "impedance_modules.backends.franka.hand_process", address, ()
        )

    def wait_until_known(self, seconds: float) -> None:
        """Waits for a first sample.

        Raises:
            RobotRefused: None comes, the hand cannot be reached, or it has not been homed.
        """
        end = time.monotonic() + seconds
        while self._ordered.sample is None and time.monotonic() < end:
            select.select([self._channel], [], [], 0.1)
            self._drain()
        sample = self._ordered.sample
        why = f"no report for {seconds:g} s" if sample is None else sample.error
        if why:
            raise RobotRefused(
                f"gripper of {self._limb} ({self._address}): {why} (valid: a Franka Hand that is mounted and switched"
                " on in Desk, no other program connected with it)"
            )
        stated = self._ordered.spec.widest
        if not self._widest >= LEAST_OPENING * stated:
            raise RobotRefused(
                f"gripper of {self._limb} ({self._address}): by its homing it opens {self._widest:.3f} m, the robot"
                f" file states {stated:g} m (valid: a hand that was homed in Desk, its fingers free)"
            )

    def order(self, motion: GripperMotion) -> None:
        """Hands an order on."""
        self._ordered.order(motion, time.monotonic())

    def report(self) -> GripperReport:
        """What is known of the hand now."""
        self._drain()
        return self._ordered.report(time.monotonic())

    def close(self) -> None:
        """Ends the process and orders nothing; may be called twice."""
        self._channel.close()
        end_process(self._process)

    def _send(self, number: int, motion: GripperMotion) -> None:
        order = {"number": number, "width": motion.width, "speed": motion.speed, "force": motion.force}
        try:
            self._channel.send(json.dumps(order).encode(), socket.MSG_DONTWAIT)
        except OSError as error:
            self._fail(f"its process takes no order ({error})")

    def _drain(self) -> None:
        """Takes everything that has arrived; never waits."""
        for message in arrived(self._channel, LARGEST):
            if message:
                self._take(json.loads(message))
            else:
                self._fail("its process has ended")

    def _take(self, said: Mapping[str, Any]) -> None:
        if "error" in said:
            self._fail(said["error"])
            return
        self._widest = said["widest"]
        # A Franka Hand does not tell its force.
        sample = GripperSample(time.monotonic(), said["width"], math.nan, said["ended"], said["held"])
        if self._ordered.sample is None or not self._ordered.sample.error:
            self._ordered.hear(sample)

    def _fail(self, why: str) -> None:
        """Keeps the first error, with the width that was last known."""
        last = self._ordered.sample
        if last is None or not last.error:
            width = math.nan if last is None else last.width
            self._ordered.hear(GripperSample(time.monotonic(), width, math.nan, 0, held=False, error=why))
