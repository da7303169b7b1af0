# SPDX-License-Identifier: BSD-3-Clause
"""The phases of a task in order: when one ends, whether what it waited for has come, and if not, by how much."""

from __future__ import annotations

from collections.abc import Iterator
from enum import Enum

import numpy as np

from impedance_modules.control.contact_detection import ContactJudge, HandWrenches
from impedance_modules.control.controller import Controller
from impedance_modules.control.gripper_watch import GripperJudge, GripperWatch
from impedance_modules.control.roughness_detection import SmoothJudge
from impedance_modules.modules.between_spring import springs_at
from impedance_modules.modules.equilibrium import OBJECT_TARGETS, PhaseMotion
from impedance_modules.robot.rotation import log3
from impedance_modules.spec.gripper_spec import GripperCondition
from impedance_modules.spec.task import ContactCondition, PhaseSpec, ReachedCondition, SmoothCondition

SLOWEST = 20.0
"""A phase that takes this many times its duration, because the tank grants it next to nothing, is not met."""


class Outcome(Enum):
    """What a look at the phase found."""

    GOES_ON = "goes on"
    NEXT = "next"
    NOT_MET = "not met"
    DONE = "done"


class ArrivalJudge:
    """Decides whether every moved frame is where the phase takes it."""

    def __init__(self, condition: ReachedCondition, controller: Controller, period: float) -> None:
        """Takes the condition, the law, and the time between two looks [s]."""
        self._condition, self._controller, self._period = condition, controller, period
        self._motion: PhaseMotion | None = None
        self._farthest = ("", 0.0, 0.0)
        self._nearest, self._nearest_at, self._elapsed = np.inf, 0.0, 0.0

    def _begin(self, motion: PhaseMotion) -> None:
        """Finds out which springs the phase moves, and where to."""
        self._motion, self._goal = motion, motion.at(motion.duration)
        names = {name for name in motion.moved if name not in OBJECT_TARGETS} | set(motion.carried)
        springs = [spring for arm in self._controller.modules.arms for spring in arm.springs]
        self._springs = [spring for spring in springs if spring.name in names]
        self._between = [spring for spring in self._controller.modules.between if spring.name in names]

    def met(self) -> bool:
        """Compares every moved frame with its goal; call once per look."""
        if self._motion is not self._controller.motion:
            self._begin(self._controller.motion)
        self._elapsed += self._period
        excess, met = -np.inf, True
        for name, distance, angle in self._distances():
            met = met and distance <= self._condition.distance and angle <= self._condition.angle
            beyond = max(
                distance / max(self._condition.distance, 1e-9), angle / max(self._condition.angle, 1e-9)
            )
            if beyond > excess:
                excess, self._farthest = beyond, (name, distance, angle)
        if excess < self._nearest:
            self._nearest, self._nearest_at = excess, self._elapsed
        return met

    def _distances(self) -> Iterator[tuple[str, float, float]]:
        """Lists how far every moved target is from its goal: name, distance [m], angle [rad]."""
        kinematics = self._controller.kinematics
        for spring in self._springs:
            pose, target = kinematics.pose(spring.frame), self._goal.springs[spring.name]
            distance = float(np.linalg.norm(pose.translation - target.translation))
            yield spring.name, distance, float(np.linalg.norm(log3(pose.rotation @ target.rotation.T)))
        if self._between:
            stretched = springs_at(self._between, kinematics, self._goal.springs).error
            for joined, error in zip(self._between, stretched, strict=True):
                yield joined.name, float(np.linalg.norm(error[:3])), float(np.linalg.norm(error[3:]))

    def account(self) -> str:
        """Says how far the farthest frame is, what is asked for, and when all were nearest."""
        name, distance, angle = self._farthest
        return (
            f"{name} is {1e3 * distance:.1f} mm and {angle:.3f} rad from its goal, at most"
            f" {1e3 * self._condition.distance:g} mm and {self._condition.angle:g} rad are asked for;"
            f" nearest {self._nearest_at:.2f} s into the phase, at {self._nearest:.2f} times that"
        )


class Sequence:
    """Which phase is on.

    Attributes:
        index: Of the current phase.
        ended: How every finished phase ended, (name, seconds, reason).
    """

    def __init__(self, controller: Controller, touch: HandWrenches, grippers: GripperWatch) -> None:
        self._controller = controller
        self._touch, self._grippers = touch, grippers
        self._phases = controller.assembly.task.phases
        self.index = 0
        self.ended: list[tuple[str, float, str]] = []
        self._began = 0.0
        self._judge = self._make_judge()

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
        """Says what the phase waited for: what was measured, what is asked for, and since when."""
        phase = self.phase
        if phase.until is None:
            return (
                f"phase '{phase.name}' ran {SLOWEST:g} times its {phase.duration:g} s and reached only"
                f" {self._controller.clock:.2f} s of it: the tank cannot pay for its motion"
            )
        account = "" if self._judge is None else f": {self._judge.account()}"
        return f"phase '{phase.name}': no {_condition_name(phase)} within its {phase.duration:g} s{account}"

    def _end(self, time: float, reason: str) -> Outcome:
        self.ended.append((self.phase.name, time - self._began, reason))
        if self.index + 1 == len(self._phases):
            return Outcome.DONE
        self.index += 1
        self._began = time
        self._judge = self._make_judge()
        return Outcome.NEXT

    def _make_judge(self) -> ContactJudge | SmoothJudge | ArrivalJudge | GripperJudge | None:
        """Prepares what the current phase waits for; None where it waits for its duration alone."""
        until, model = self.phase.until, self._controller.assembly.weighed
        if isinstance(until, ContactCondition):
            return ContactJudge(until, self._touch, model)
        if isinstance(until, SmoothCondition):
            return SmoothJudge(until, model, self._touch.period)
        if isinstance(until, ReachedCondition):
            return ArrivalJudge(until, self._controller, self._touch.period)
        if isinstance(until, GripperCondition):
            return GripperJudge(until, self._grippers)
        return None

    def _met(self) -> bool:
        judge = self._judge
        if isinstance(judge, SmoothJudge):
            return judge.met(self._touch.state)
        return judge is not None and judge.met()


def _condition_name(phase: PhaseSpec) -> str:
    if isinstance(phase.until, ContactCondition):
        return "contact" if phase.until.present else "loss of contact"
    if isinstance(phase.until, SmoothCondition):
        return "smooth surface"
    if isinstance(phase.until, GripperCondition):
        return ", ".join(f"gripper of {arm} '{state}'" for arm, state in phase.until.states.items())
    return "arrival" if phase.until is not None else "end"
