# SPDX-License-Identifier: BSD-3-Clause
"""When a phase would end: contact as the run judges it, arrival by distance.

The run takes contact from measured effort through a filter (``control.conditions``, ``robot.external_torque``). The
same formula is applied to the predicted motion, so a predicted contact is as late as the real one.
"""

from __future__ import annotations

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.control.contact_detection import REGULARISATION
from impedance_modules.modules.arms import ArmModule
from impedance_modules.modules.between_spring import springs_at
from impedance_modules.modules.equilibrium import OBJECT_TARGETS, PhaseMotion
from impedance_modules.prediction.mechanism import Mechanism
from impedance_modules.robot.pose import Pose
from impedance_modules.robot.rotation import log3
from impedance_modules.spec.task import ContactCondition, PhaseSpec, ReachedCondition


class ExternalForce:
    """Force of the surroundings on every hand, as the run would estimate it.

    Attributes:
        torque: (k,) filtered external torque [N.m].
    """

    def __init__(self, mechanism: Mechanism) -> None:
        self._mechanism = mechanism
        self.torque: Array = np.zeros(mechanism.k)
        self._started = False

    def update(self, external: Array, step: float) -> None:
        """Takes the external torque (k,) [N.m] of the last ``step`` [s]."""
        time_constant = self._mechanism.model.spec.contact_detection.time
        share = step / (time_constant + step) if self._started else 1.0
        self.torque = self.torque + share * (external - self.torque)
        self._started = True

    def force_on(self, target: str | None) -> float:
        """Gives how hard the surroundings push on an arm, the object, or the arm pushed hardest [N]."""
        by_arm = {arm.limb.name: self._force(arm.limb.hand, arm.limb.name) for arm in self._arms()}
        if target in by_arm:
            return float(np.linalg.norm(by_arm[target]))
        held = self._mechanism.modules.held
        if held is not None:
            total = np.sum([by_arm[name] for name in held.limbs], axis=0) - held.weight_on_hands
            return float(np.linalg.norm(total))
        return max(float(np.linalg.norm(force)) for force in by_arm.values())

    def _arms(self) -> tuple[ArmModule, ...]:
        return self._mechanism.modules.arms

    def _force(self, hand: str, limb: str) -> Array:
        part = self._mechanism.parts[limb]
        J = self._mechanism.jacobian(hand)[:, part]
        gram = J @ J.T + REGULARISATION * np.eye(6)
        return np.asarray(np.linalg.solve(gram, J @ self.torque[part])[:3])


class PhaseEnd:
    """Judges, step by step, whether a phase's ``until`` is met."""

    def __init__(
        self, phase: PhaseSpec, mechanism: Mechanism, external: ExternalForce, motion: PhaseMotion
    ) -> None:
        self._until = phase.until
        self._mechanism, self._external = mechanism, external
        self._held_for = 0.0
        self._goals = _goals(motion) if isinstance(phase.until, ReachedCondition) else {}

    def met(self, step: float) -> bool:
        """Tells whether the phase ends now; call once per step of ``step`` seconds."""
        until = self._until
        if isinstance(until, ContactCondition):
            return self._in_contact(until, step)
        return isinstance(until, ReachedCondition) and self._reached(until)

    def _in_contact(self, until: ContactCondition, step: float) -> bool:
        detection = self._mechanism.model.spec.contact_detection
        force = detection.force if until.force is None else until.force
        time = detection.time if until.time is None else until.time
        there = self._external.force_on(until.target) >= force
        self._held_for = self._held_for + step if there == until.present else 0.0
        return self._held_for >= time

    def _reached(self, until: ReachedCondition) -> bool:
        for arm in self._mechanism.modules.arms:
            for spring in arm.springs:
                if spring.name not in self._goals:
                    continue
                pose, goal = self._mechanism.kinematics.pose(spring.frame), self._goals[spring.name]
                turn = log3(pose.rotation @ goal.rotation.T)
                near = float(np.linalg.norm(pose.translation - goal.translation)) <= until.distance
                if not (near and float(np.linalg.norm(turn)) <= until.angle):
                    return False
        moved = [spring for spring in self._mechanism.modules.between if spring.name in self._goals]
        stretched = springs_at(moved, self._mechanism.kinematics, self._goals).error
        far = np.linalg.norm(stretched[:, :3], axis=1) > until.distance
        turned = np.linalg.norm(stretched[:, 3:], axis=1) > until.angle
        return not bool(np.any(far | turned))


def _goals(motion: PhaseMotion) -> dict[str, Pose]:
    names = {name for name in motion.moved if name not in OBJECT_TARGETS} | set(motion.carried)
    end = motion.at(motion.duration).springs
    return {name: end[name] for name in names}
