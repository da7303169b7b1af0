# SPDX-License-Identifier: BSD-3-Clause
"""One question asked of a robot, and its answer."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Gate:
    """One condition.

    Attributes:
        name: Short.
        passed: None where the robot does not tell.
        found: What was seen.
        remedy: What would be valid; said when closed.
        for_motion: Matters only where the robot is to be commanded.
    """

    name: str
    passed: bool | None
    found: str
    remedy: str
    for_motion: bool = True
