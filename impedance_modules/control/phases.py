# SPDX-License-Identifier: BSD-3-Clause
"""The phases of a task in order: when one ends, and whether what it waited for has come."""

from __future__ import annotations

from enum import Enum

import numpy as np

from impedance_modules.control.conditions import ContactJudge, Touch
from impedance_modules.control.controller import Controller
from impedance_modules.control.roughness_judge import SmoothJudge
from impedance_modules.modules.held_object import OBJECT
from impedance_modules.robot.rotation import log3
from impedance_modules.spec.task import ContactCondition, PhaseSpec, ReachedCondition, SmoothCondition

SLOWEST = 20.0
"""A phase that takes this many times its duration, because the tank grants it next to nothing, is not met."""


class Outcome(Enum):
    """What a look at the phase found."""

    GOES_ON = "goes on"
    NEXT = "next"
    NOT_MET = "not met"
    DONE = "done"


class Sequence:
    """Which phase is on.

    Attributes:
        index: Of the current phase.
        ended: How every finished phase ended, (name, seconds, reason).
    """

    def __init__(self, controller: Controller, touch: Touch) -> None:
        self._controller = controller
        self._touch = touch
        self._phases = controller.assembly.task.phases
        self.index = 0
        self.ended: list[tuple[str, float, str]] = []
        self._began = 0.0
        self._judge, self._smooth = self._contact_judge(), self._smooth_judge()

    @property
    def phase(self) -> PhaseSpec:
        """The current phase."""
        return self._phases[self.index]

    def look(self, time: float) -> Outcome:
        """Decides at an instant [s], after the touch was updated, whether the phase is over."""
        phase, elapsed = self.phase, time - self._began
        if self._met():
            return self._end(time, f"{_condition_name(phase)} after {elapsed:.2f} s")
        over = self._controller.clock >= phase.duration - 1e-9
        if not over and elapsed < SLOWEST * phase.duration:
            return Outcome.GOES_ON
        if over and (phase.until is None or phase.otherwise == "next"):
            return self._end(time, "duration over")
        return Outcome.NOT_MET

    def why_not_met(self) -> str:
        """Says what the phase waited for."""
        phase = self.phase
        if phase.until is None:
            return (
                f"phase '{phase.name}' ran {SLOWEST:g} times its {phase.duration:g} s and reached only"
                f" {self._controller.clock:.2f} s of it: the tank cannot pay for its motion"
            )
        return f"phase '{phase.name}': no {_condition_name(phase)} within its {phase.duration:g} s"

    def _end(self, time: float, reason: str) -> Outcome:
        self.ended.append((self.phase.name, time - self._began, reason))
        if self.index + 1 == len(self._phases):
            return Outcome.DONE
        self.index += 1
        self._began = time
        self._judge, self._smooth = self._contact_judge(), self._smooth_judge()
        return Outcome.NEXT

    def _contact_judge(self) -> ContactJudge | None:
        until = self.phase.until
        if not isinstance(until, ContactCondition):
            return None
        return ContactJudge(until, self._touch, self._controller.assembly.model)

    def _smooth_judge(self) -> SmoothJudge | None:
        until = self.phase.until
        if not isinstance(until, SmoothCondition):
            return None
        return SmoothJudge(until, self._controller.assembly.model, self._touch.period)

    def _met(self) -> bool:
        if self._smooth is not None:
            return self._smooth.met(self._touch.state)
        if self._judge is not None:
            return self._judge.met()
        until = self.phase.until
        return isinstance(until, ReachedCondition) and self._reached(until)

    def _reached(self, until: ReachedCondition) -> bool:
        """Compares every moved frame with where the phase takes it."""
        motion = self._controller.motion
        goal = motion.at(motion.duration)
        names = {name for name in motion.moved if name != OBJECT} | set(motion.carried)
        springs = [s for arm in self._controller.modules.arms for s in arm.springs if s.name in names]
        for spring in springs:
            pose, target = self._controller.kinematics.pose(spring.frame), goal.springs[spring.name]
            if float(np.linalg.norm(pose.translation - target.translation)) > until.distance:
                return False
            if float(np.linalg.norm(log3(pose.rotation @ target.rotation.T))) > until.angle:
                return False
        return True


def _condition_name(phase: PhaseSpec) -> str:
    if isinstance(phase.until, ContactCondition):
        return "contact" if phase.until.present else "loss of contact"
    if isinstance(phase.until, SmoothCondition):
        return "smooth surface"
    return "arrival" if phase.until is not None else "end"
