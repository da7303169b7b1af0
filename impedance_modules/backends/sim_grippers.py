# SPDX-License-Identifier: BSD-3-Clause
r"""Simulated grippers: a width that goes to where it is ordered at a constant speed, and a force. No bodies of fingers.

    w <- w + clip(w_order - w, -v dt, v dt),  not below the thing between the fingers

What is between the fingers is what the task's object says: an object that the limb holds, and whose smallest edge (or
diameter) the gripper can take in. The plant's own grasp holds that object whatever the fingers do.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from impedance_modules.backends.grippers import GripperReport, GripperSample, OrderedGripper
from impedance_modules.spec.gripper_spec import GripperMotion, GripperSpec
from impedance_modules.spec.robot_spec import LimbSpec
from impedance_modules.spec.task import ObjectSpec

NO_FORCE = 0.0


class SimulatedGripper:
    """A gripper of no mass.

    Attributes:
        width: Between the fingers [m].
        force: With which they press [N].
        thing: Width of what is between them [m]; None for nothing.
    """

    def __init__(self, spec: GripperSpec, thing: float | None) -> None:
        """Takes the gripper, which begins open, and the width of what is between its fingers [m]; None for nothing."""
        self.width, self.force = spec.widest, NO_FORCE
        self.thing = thing
        self._number = self._ended = 0
        self._motion: GripperMotion | None = None

    def order(self, number: int, motion: GripperMotion) -> None:
        """Takes an order."""
        self._number, self._motion, self.force = number, motion, NO_FORCE

    def advance(self, seconds: float) -> None:
        """Moves the fingers for a time [s]."""
        motion = self._motion
        if motion is None or self._ended == self._number:
            return
        step = min(max(motion.width - self.width, -motion.speed * seconds), motion.speed * seconds)
        goal = self.width + step
        met = self.thing is not None and step < 0.0 and goal <= self.thing <= self.width
        self.width = self.thing if met and self.thing is not None else goal
        if met or math.isclose(self.width, motion.width, abs_tol=1e-12):
            self._ended = self._number
            self.force = motion.force if met and motion.force is not None else NO_FORCE

    def sample(self, now: float) -> GripperSample:
        """Reports at an instant [s]."""
        return GripperSample(now, self.width, self.force, self._ended, held=self.force > NO_FORCE)


class SimulatedGrippers:
    """All grippers of a simulated robot, and their clock."""

    def __init__(self, limbs: Mapping[str, LimbSpec], held: ObjectSpec | None) -> None:
        """Takes the robot's limbs, and the task's object; None where there is none."""
        self._now = 0.0
        self._bodies: dict[str, SimulatedGripper] = {}
        self._ordered: dict[str, OrderedGripper] = {}
        for name, limb in limbs.items():
            if limb.gripper is not None:
                body = SimulatedGripper(limb.gripper, thing_between(name, limb.gripper, held))
                self._bodies[name] = body
                self._ordered[name] = OrderedGripper(limb.gripper, body.order)

    @property
    def limbs(self) -> tuple[str, ...]:
        """Names the limbs with a gripper."""
        return tuple(self._bodies)

    def order(self, limb: str, motion: GripperMotion) -> None:
        """Hands an order on."""
        self._ordered[limb].order(motion, self._now)

    def advance(self, seconds: float) -> None:
        """Moves all fingers for a time [s]."""
        self._now += seconds
        for body in self._bodies.values():
            body.advance(seconds)

    def report(self, limb: str) -> GripperReport:
        """What is known of one."""
        ordered = self._ordered[limb]
        ordered.hear(self._bodies[limb].sample(self._now))
        return ordered.report(self._now)


def thing_between(limb: str, gripper: GripperSpec, held: ObjectSpec | None) -> float | None:
    """Width of the object between a limb's fingers [m]; None where the limb holds none, or none that fits."""
    if held is None or limb not in held.held_by:
        return None
    width = min(held.size)
    return width if gripper.narrowest < width < gripper.widest else None
