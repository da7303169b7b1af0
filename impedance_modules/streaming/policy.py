# SPDX-License-Identifier: BSD-3-Clause
"""Set-points from a function in the same process, called with what the run reports: a policy, a test, a script."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from impedance_modules.control.equilibrium_following import Following
from impedance_modules.control.set_point_source import RunReport
from impedance_modules.errors import BadInput
from impedance_modules.robot.state import RobotState
from impedance_modules.spec.set_point_limits import SetPointLimits
from impedance_modules.streaming.inbox import Inbox
from impedance_modules.streaming.set_point_message import make_message

Policy = Callable[[RunReport], Mapping[str, Any] | None]
"""From a report to the ``targets`` of a message (``schemas/set-point.schema.json``), or None for no message."""

NAME = "the policy"


class PolicySource:
    """Asks a function for set-points in phases that listen; a ``SetPointSource``.

    The function runs between two cycles, by the robot's time: on a simulated robot nothing need run in real time, and
    the same function gives the same run. Its messages are admitted and refused like everybody else's.

    Attributes:
        inbox: Admits them; counts what was accepted and refused.
        refusals: Reasons of the last refusals.
    """

    def __init__(self, policy: Policy, limits: SetPointLimits, *, rate: float) -> None:
        """Takes the function, the limits of the task, and how often it is asked [Hz]: at most a hundred times a second.

        Raises:
            BadInput: The rate is not above 0.
        """
        if not rate > 0.0:
            raise BadInput(f"a policy at {rate:g} Hz is never asked (valid: above 0)")
        self._policy, self._step = policy, 1.0 / rate
        self._now, self._due, self._sequence = 0.0, 0.0, 0
        self.inbox = Inbox(limits, clock=self._time, calendar=self._time)
        self.refusals: list[str] = []

    def begin(self, phase: str, following: Following) -> None:
        """Takes notice of a new phase."""
        self.inbox.begin(phase, following)

    def write(self, following: Following, state: RobotState) -> None:
        """Writes goals and which of them are fresh."""
        self._now = state.time
        self.inbox.write(following, state)

    def look(self, report: RunReport) -> list[str]:
        """Asks the function if it is time; returns what is worth telling."""
        self._now = report.time
        if report.listening and report.time >= self._due - 1e-9:
            self._due = max(self._due + self._step, report.time)
            self._ask(report)
        return self.inbox.look(report)

    def _ask(self, report: RunReport) -> None:
        targets = self._policy(report)
        if targets is None:
            return
        self._sequence += 1
        try:
            self.inbox.put(make_message({"sequence": self._sequence, "targets": dict(targets)}), NAME)
        except BadInput as refusal:
            self.refusals = [*self.refusals[-9:], str(refusal)]

    def _time(self) -> float:
        return self._now
