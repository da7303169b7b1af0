# SPDX-License-Identifier: BSD-3-Clause
"""Preflight checks: conditions that must hold before a robot may be commanded, and the refusal where one fails."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from impedance_modules.errors import RobotRefused


@dataclass(frozen=True)
class PreflightResult:
    """One condition that was checked.

    Attributes:
        name: Short.
        passed: None where the robot publishes nothing about it.
        found: What was measured.
        remedy: What would pass; printed when it failed.
        for_motion: Matters only where the robot is to be commanded.
    """

    name: str
    passed: bool | None
    found: str
    remedy: str
    for_motion: bool = True


def refuse_failed(results: Iterable[PreflightResult], *, commanding: bool) -> None:
    """Refuses a robot that failed a check.

    Args:
        results: From ``run_checks``.
        commanding: False where only listening is wanted; checks that matter for motion alone are then ignored.

    Raises:
        RobotRefused: With the reason and remedy of every failed check.
    """
    failed = [
        result for result in results if result.passed is False and (commanding or not result.for_motion)
    ]
    if failed:
        lines = [f"{result.name}: {result.found} (valid: {result.remedy})" for result in failed]
        raise RobotRefused("the robot must not be moved now; nothing was sent\n  " + "\n  ".join(lines))
