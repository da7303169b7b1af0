# SPDX-License-Identifier: BSD-3-Clause
"""Grippers in a task: what each phase orders, what they report, whether that is what the phase waits for.

Orders are handed on when a phase begins and reports are read when phases are judged, both after the cycle's torque has
left. No torque depends on a gripper; one that fails stops the run like a phase that is not met.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.backends.grippers import THIN, GripperReport, GripperRobot, GripperState
from impedance_modules.control.assembly import Assembly
from impedance_modules.errors import BadInput
from impedance_modules.safety.stop_levels import Event, Occurrence
from impedance_modules.spec.gripper_spec import (
    CLOSED,
    HELD,
    OPENED,
    GripperCondition,
    GripperMotion,
    GripperSpec,
)
from impedance_modules.spec.task import PhaseSpec, TaskSpec

GRIPPER_COLUMNS = ("width", "force", "state", "ordered_width", "ordered_force")
"""Recorded of each gripper [m], [N]; the state by its number (``GripperState``)."""


def ordered_grippers(task: TaskSpec) -> tuple[str, ...]:
    """Names the arms whose grippers a task orders, each once."""
    return tuple(dict.fromkeys(arm for phase in task.phases for arm in phase.grippers))


def gripper_columns(task: TaskSpec) -> tuple[str, ...]:
    """Names the columns of all ordered grippers, one gripper after the other."""
    return tuple(f"gripper.{arm}.{part}" for arm in ordered_grippers(task) for part in GRIPPER_COLUMNS)


def grippers_of(
    robot: object, assembly: Assembly, name: str, *, read_only: bool = False
) -> GripperRobot | None:
    """Takes what orders a robot's grippers; None for a task that orders none.

    Args:
        robot: A backend, not yet started.
        assembly: The task.
        name: Of the backend.
        read_only: Orders are not handed on.

    Raises:
        BadInput: It takes no orders for a gripper of the task; with the phases that ask for it.
    """
    wanted = ordered_grippers(assembly.task)
    if not wanted:
        return None
    taken = robot.gripper_limbs() if isinstance(robot, GripperRobot) else ()
    if not isinstance(robot, GripperRobot) or any(arm not in taken for arm in wanted):
        phases = [phase.name for phase in assembly.task.phases if phase.grippers]
        raise BadInput(
            f"{name} takes no orders for the gripper of {', '.join(arm for arm in wanted if arm not in taken)}, which"
            f" the phases {', '.join(phases)} of task '{assembly.task.name}' ask for (valid: sim, mujoco; a replay of a"
            " recording with these grippers; franka for a franka-hand; baxter for a baxter-electric-gripper; or the"
            " task without grippers:)"
        )
    return _ReadOnly(robot) if read_only else robot


class _ReadOnly:
    """Grippers that are read and not ordered."""

    def __init__(self, robot: GripperRobot) -> None:
        self.gripper_limbs, self.gripper_report = robot.gripper_limbs, robot.gripper_report

    def order_gripper(self, limb: str, motion: GripperMotion) -> None:
        """Orders nothing."""


class GripperWatch:
    """The grippers that a task orders.

    Attributes:
        arms: Their names.
        reports: Arm -> what was last read of its gripper.
        motions: Arm -> the order that stands; none before the first.
    """

    def __init__(self, assembly: Assembly, robot: GripperRobot | None) -> None:
        """Takes the task and what carries its orders out; see ``grippers_of``.

        Raises:
            BadInput: The task orders grippers, and nothing carries that out.
        """
        self.arms = ordered_grippers(assembly.task)
        if robot is None and self.arms:
            grippers_of(None, assembly, "this loop")
        self.reports: dict[str, GripperReport] = {}
        self.motions: dict[str, GripperMotion] = {}
        self._robot = robot
        self._specs: Mapping[str, GripperSpec] = {
            name: limb.gripper for name, limb in assembly.robot.limbs.items() if limb.gripper is not None
        }
        self._told: set[str] = set()

    def begin(self, phase: PhaseSpec, say: Callable[[str], None]) -> None:
        """Hands on what a phase orders, and says so."""
        for arm, order in phase.grippers.items():
            self.motions[arm] = motion = order.motion(self._specs[arm])
            if self._robot is not None:
                self._robot.order_gripper(arm, motion)
            say(f"gripper of {arm}: {motion.described()}")
        if not self.reports:
            # Later ones are read by ``look`` alone: a row records what its look has judged, for the replay to judge.
            self.read()

    def read(self) -> None:
        """Reads all reports."""
        if self._robot is not None:
            for arm in self.arms:
                self.reports[arm] = self._robot.gripper_report(arm)

    def look(self) -> list[Occurrence]:
        """Reads all reports and tells what has failed, once for each gripper."""
        if not self.arms:
            return []
        self.read()
        found = []
        for arm, report in self.reports.items():
            if report.state is GripperState.FAILED and arm not in self._told:
                self._told.add(arm)
                found.append(Occurrence(Event.GRIPPER_FAILED, arm, f"gripper: {report.why}"))
        return found

    def write(self, row: Array) -> None:
        """Writes the columns of ``gripper_columns`` into a part of a recorded row; NaN before the first order."""
        at = 0
        for arm in self.arms:
            report, motion = self.reports.get(arm), self.motions.get(arm)
            row[at : at + len(GRIPPER_COLUMNS)] = np.nan
            if report is not None:
                row[at], row[at + 1], row[at + 2] = report.width, report.force, report.state
            if motion is not None:
                row[at + 3] = motion.width
                row[at + 4] = np.nan if motion.force is None else motion.force
            at += len(GRIPPER_COLUMNS)

    def meets(self, arm: str, state: str) -> bool:
        """Whether a gripper reports what a phase waits for, its last order carried out."""
        report, spec, motion = self.reports[arm], self._specs[arm], self.motions.get(arm)
        if report.state in (GripperState.MOVING, GripperState.FAILED):
            return False
        if state == HELD:
            return report.state is GripperState.HELD
        goals = {OPENED: spec.widest, CLOSED: spec.narrowest}
        goal = goals.get(state, spec.widest if motion is None else motion.width)
        return report.state is GripperState.REST and abs(report.width - goal) <= THIN

    def account(self, condition: GripperCondition) -> str:
        """Says what is reported of every gripper that a phase waits for, and what is asked for."""
        return "; ".join(
            f"the gripper of {arm} reports {self._told_of(arm)}, '{state}' is asked for"
            for arm, state in condition.states.items()
        )

    def _told_of(self, arm: str) -> str:
        report = self.reports[arm]
        pressed = "" if np.isnan(report.force) else f" and {report.force:.1f} N"
        words = {
            GripperState.REST: "rest",
            GripperState.MOVING: "a motion",
            GripperState.HELD: "something held",
        }
        return f"{words.get(report.state, 'a failure')} at {1e3 * report.width:.1f} mm{pressed}"


class GripperJudge:
    """Decides whether all grippers report what a phase waits for."""

    def __init__(self, condition: GripperCondition, watch: GripperWatch) -> None:
        """Takes the condition and the grippers."""
        self._condition, self._watch = condition, watch

    def met(self) -> bool:
        """Compares the newest reports with the condition."""
        return all(self._watch.meets(arm, state) for arm, state in self._condition.states.items())

    def account(self) -> str:
        """Says what was measured and what is asked for."""
        return self._watch.account(self._condition)
