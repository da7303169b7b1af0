# SPDX-License-Identifier: BSD-3-Clause
"""Which set-points count: one sender at a time, rising sequence, fresh, within the task's limits; others are refused.

``put`` is called by whoever receives messages, ``begin``, ``write`` and ``look`` by the loop. A message counts as a
whole or not at all, and every refusal has its reason, for the sender and in the run's log.
"""

from __future__ import annotations

import threading
import time
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.control.equilibrium_following import Following, following_nothing
from impedance_modules.control.set_point_source import RunReport
from impedance_modules.errors import BadInput, nearest
from impedance_modules.robot.rotation import rotation_angle, write_quaternion, write_rotation
from impedance_modules.robot.state import RobotState
from impedance_modules.spec.set_point_limits import SetPointLimits
from impedance_modules.spec.task import AXES
from impedance_modules.streaming.set_point_message import SetPointMessage, TargetSetPoint

SILENCE = 1.0
"""A sender that is silent for so long, or for the age of a set-point if that is longer, has left its place [s]."""

TELLING = 1.0
"""The same thing is told once in so much time [s]."""


@dataclass(frozen=True)
class Goal:
    """What counts for one target, with the time it came at, by the inbox's clock [s].

    Attributes:
        pose: (7,) position [m] and unit quaternion in world.
        stiffness, force: (6,) in the spring's axes [N/m, N.m/rad], [N, N.m].
        came: When.
    """

    pose: Array
    stiffness: Array
    force: Array
    came: float


class Inbox:
    """Set-points as they come, for a loop that never waits; a ``SetPointSource``.

    Attributes:
        accepted, refused: Messages so far.
        report: The newest of the run; None before it begins.
    """

    def __init__(
        self,
        limits: SetPointLimits,
        *,
        clock: Callable[[], float] = time.monotonic,
        calendar: Callable[[], float] = time.time,
    ) -> None:
        """Takes the limits of the task, a clock for ages [s], and a clock that senders share [s since 1970]."""
        self.accepted = self.refused = 0
        self.report: RunReport | None = None
        self._limits, self._clock, self._calendar = limits, clock, calendar
        self._names = tuple(limits.targets)
        self._lock = threading.Lock()
        self._phase, self._following = "", following_nothing()
        self._goals: Mapping[str, Goal] = {}
        self._written: dict[int, Goal] = {}
        self._sender: str | None = None
        self._sequence, self._heard = -1, -np.inf
        self._news = News()

    def put(self, message: SetPointMessage, sender: str) -> None:
        """Takes a message, or refuses it.

        Args:
            message: What is asked.
            sender: Who asks.

        Raises:
            BadInput: It is refused, with the reason; nothing of it counts.
        """
        with self._lock:
            now = self._clock()
            try:
                age = self._admit(message, sender, now)
            except BadInput as refusal:
                self.refused += 1
                self._news.add("refused", f"set-points of {sender} refused: {refusal}")
                raise
            self.accepted += 1
            self._sender, self._sequence, self._heard = sender, message.sequence, now
            made = {name: self._goal(name, asked, now - age) for name, asked in message.targets.items()}
            self._goals = {**self._goals, **made}

    def begin(self, phase: str, following: Following) -> None:
        """Forgets all set-points: those of a new phase come after its beginning."""
        with self._lock:
            self._phase, self._following = phase, following
            self._goals, self._written = {}, {}

    def write(self, following: Following, state: RobotState) -> None:  # noqa: ARG002 - ages count by the wall's clock
        """Writes goals and which of them are fresh."""
        now, goals = self._clock(), self._goals
        for k, name in enumerate(self._names):
            goal = goals.get(name)
            fresh = goal is not None and now - goal.came <= self._limits.age
            if bool(following.fresh[k]) != fresh:
                self._tell_change(name, fresh)
            following.fresh[k] = fresh
            if goal is not None and fresh and self._written.get(k) is not goal:
                following.goal[k], following.stiffness[k], following.force[k] = (
                    goal.pose,
                    goal.stiffness,
                    goal.force,
                )
                self._written[k] = goal
        if following.granted == 0.0:
            self._news.add("unpaid", "the energy tank cannot pay for the step towards the set-points")

    def look(self, report: RunReport) -> list[str]:
        """Keeps the newest report, for answers; returns what is worth telling."""
        self.report = report
        return self._news.due(report.time)

    def _tell_change(self, name: str, fresh: bool) -> None:
        if fresh:
            self._news.add(f"fresh {name}", f"'{name}' follows set-points of {self._sender}")
        else:
            text = f"no set-point of '{name}' for {self._limits.age:g} s: its equilibrium comes to rest"
            self._news.add(f"stale {name}", text)

    def _admit(self, message: SetPointMessage, sender: str, now: float) -> float:
        """Returns how old a message is when it comes [s]; raises BadInput for one that does not count."""
        if not self._following.active:
            raise BadInput(f"phase '{self._phase}' does not listen to set-points")
        silence = max(SILENCE, self._limits.age)
        if self._sender not in (None, sender) and now - self._heard <= silence:
            raise BadInput(
                f"{self._sender} is sending (valid: one sender; its place is free {silence:g} s after)"
            )
        if sender == self._sender and message.sequence <= self._sequence:
            raise BadInput(f"sequence {message.sequence} after {self._sequence} (valid: a larger one)")
        for name, asked in message.targets.items():
            if name not in self._names:
                raise BadInput(
                    f"no target '{name}'{nearest(name, self._names)} (valid: {', '.join(self._names)})"
                )
            self._check(name, self._names.index(name), asked)
        return self._age(message.sent)

    def _age(self, sent: float | None) -> float:
        if sent is None:
            return 0.0
        age, most = self._calendar() - sent, self._limits.age
        if age > most:
            raise BadInput(f"sent {age:.3g} s ago (valid: up to age, {most:g} s)")
        if age < -most:
            raise BadInput(f"sent {-age:.3g} s in the future (valid: clocks that agree, or no 'sent')")
        return max(0.0, age)

    def _check(self, name: str, k: int, asked: TargetSetPoint) -> None:
        limits, following = self._limits.targets[name], self._following
        if asked.position is not None:
            step = float(np.linalg.norm(asked.position - following.translation[k]))
            if not step <= limits.step:
                raise BadInput(
                    f"'{name}' {step:.3g} m from its equilibrium (valid: up to step, {limits.step:g} m)"
                )
        if asked.rotation is not None:
            turned = np.empty((3, 3))
            write_rotation(asked.rotation, turned)
            turn = float(rotation_angle(turned @ following.rotation[k].T))
            if not turn <= limits.turn:
                raise BadInput(
                    f"'{name}' {turn:.3g} rad from its equilibrium (valid: up to turn, {limits.turn:g} rad)"
                )
        if following.spring[k] < 0 and (asked.stiffness is not None or asked.force is not None):
            raise BadInput(
                f"'{name}' has no spring of its own: its stiffness and forces are those of the hands"
            )
        for kind, given, stated in (
            ("stiffness", asked.stiffness, np.diag(following.stated_stiffness[k])),
            ("force", asked.force, following.stated_force[k]),
        ):
            if given is not None:
                _check_between(name, kind, given, stated)

    def _goal(self, name: str, asked: TargetSetPoint, came: float) -> Goal:
        """Completes what is asked by what is in force."""
        k, following = self._names.index(name), self._following
        pose = np.empty(7)
        pose[:3] = following.translation[k] if asked.position is None else asked.position
        if asked.rotation is None:
            write_quaternion(following.rotation[k], pose[3:])
        else:
            pose[3:] = asked.rotation
        stiffness = np.diag(following.stated_stiffness[k]) if asked.stiffness is None else asked.stiffness
        force = following.stated_force[k] if asked.force is None else asked.force
        return Goal(pose, stiffness.copy(), force.copy(), came)


def _check_between(name: str, kind: str, given: Array, stated: Array) -> None:
    """Refuses a stiffness or force that is not between 0 and what the task states."""
    wrong = (given * np.sign(stated) < 0.0) | (np.abs(given) > np.abs(stated))
    if wrong.any():
        i = int(np.argmax(wrong))
        raise BadInput(
            f"{kind} of '{name}' along {AXES[i]} is {given[i]:g} (valid: from 0 to {stated[i]:g}, which the task"
            " states)"
        )


class News:
    """What is worth telling, each thing once a second, with how often it happened."""

    def __init__(self) -> None:
        """Starts with nothing to tell."""
        self._texts: dict[str, str] = {}
        self._counts: Counter[str] = Counter()
        self._told: dict[str, float] = {}

    def add(self, key: str, text: str) -> None:
        """Adds one; of several with the same key the first is told."""
        self._texts.setdefault(key, text)
        self._counts[key] += 1

    def due(self, now: float) -> list[str]:
        """Returns the texts whose time has come [s]."""
        found = []
        for key in list(self._texts):
            if now - self._told.get(key, -np.inf) < TELLING:
                continue
            text, count = self._texts.pop(key), self._counts.pop(key)
            found.append(text if count == 1 else f"{text} ({count} times)")
            self._told[key] = now
        return found
