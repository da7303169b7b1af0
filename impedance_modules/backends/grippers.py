# SPDX-License-Identifier: BSD-3-Clause
"""Grippers of any robot: what one reports, and the order that stands, whoever carries it out.

An order never waits and never meets a torque: it is handed on, and what became of it is read from the gripper's own
samples. ``OrderedGripper`` is the one place that decides what a sample means, when an order has taken too long and when
a gripper is silent, for simulated and real ones.

A stop orders nothing: a gripper that holds something goes on holding it, and one that moves ends its motion by itself.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum
from typing import Protocol, runtime_checkable

from impedance_modules.spec.gripper_spec import GripperMotion, GripperSpec

SILENT = 1.0
"""A gripper without an order under way that has sent no sample for this time is lost [s]."""

THIN = 0.002
"""Fingers this near to where they meet hold nothing, whatever the gripper says; widths are compared to this [m]."""


class GripperState(IntEnum):
    """What a gripper does; the numbers are those of a recording."""

    REST = 0
    MOVING = 1
    HELD = 2
    FAILED = 3


@dataclass(frozen=True)
class GripperReport:
    """What is known of a gripper.

    Attributes:
        width: Between the fingers [m].
        force: With which they press [N]; NaN where the gripper does not tell.
        state: What it does.
        why: What failed; empty otherwise.
    """

    width: float
    force: float
    state: GripperState
    why: str = ""


@dataclass(frozen=True)
class GripperSample:
    """What a gripper itself has said.

    Attributes:
        taken: When [s], by the clock of the orders.
        width: Between the fingers [m].
        force: With which they press [N]; NaN where it does not tell.
        ended: Number of the last order that it has carried out; 0 before the first.
        held: It says that something is between the fingers.
        error: Its error; empty for none.
    """

    taken: float
    width: float
    force: float
    ended: int
    held: bool
    error: str = ""


@runtime_checkable
class GripperRobot(Protocol):
    """A robot, simulated, recorded or real, some limbs of which have grippers that take orders."""

    def gripper_limbs(self) -> tuple[str, ...]:
        """Names the limbs whose grippers take orders; known before ``start``."""

    def order_gripper(self, limb: str, motion: GripperMotion) -> None:
        """Hands an order on; never waits."""

    def gripper_report(self, limb: str) -> GripperReport:
        """What is known of a gripper now; never waits."""


class OrderedGripper:
    """One gripper and the order that stands.

    Attributes:
        spec: What it can.
        sample: The newest; None before the first.
    """

    def __init__(self, spec: GripperSpec, send: Callable[[int, GripperMotion], None]) -> None:
        """Takes the gripper and what hands on an order with its number; it must not wait."""
        self.spec, self._send = spec, send
        self.sample: GripperSample | None = None
        self._number, self._ordered = 0, -math.inf
        self._failed = ""

    def order(self, motion: GripperMotion, now: float) -> None:
        """Hands on an order at an instant [s]; it takes the place of the one before."""
        self._number += 1
        self._ordered = now
        self._send(self._number, motion)

    def hear(self, sample: GripperSample) -> None:
        """Takes a sample; the newest counts."""
        self.sample = sample

    def report(self, now: float) -> GripperReport:
        """Judges order and samples at an instant [s]; what has failed stays failed."""
        sample = self.sample
        self._failed = self._failed or self._failure(sample, now)
        width, force = (math.nan, math.nan) if sample is None else (sample.width, sample.force)
        if self._failed or sample is None:
            return GripperReport(width, force, GripperState.FAILED, self._failed)
        if sample.ended < self._number:
            return GripperReport(width, force, GripperState.MOVING)
        held = sample.held and width > self.spec.narrowest + THIN
        return GripperReport(width, force, GripperState.HELD if held else GripperState.REST)

    def _failure(self, sample: GripperSample | None, now: float) -> str:
        """Says what is wrong; empty for nothing."""
        if sample is None:
            return "it has not reported anything"
        if sample.error:
            return sample.error
        if not math.isfinite(sample.width):
            return f"it reports a width of {sample.width} m"
        if sample.ended < self._number:
            over = now - self._ordered > self.spec.time_out
            return f"no end of its order within {self.spec.time_out:g} s, {_place(sample)}" if over else ""
        silent = now - max(sample.taken, self._ordered)
        return f"no report for {silent:.2f} s" if silent > SILENT else ""


def _place(sample: GripperSample) -> str:
    return f"the fingers {1e3 * sample.width:.1f} mm apart"
