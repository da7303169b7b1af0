# SPDX-License-Identifier: BSD-3-Clause
r"""What the surroundings put on the hands, judged from measured effort alone, and what follows from it.

The wrench of the surroundings on a hand is the least-squares solution of J^T w = \tau_ext over its limb's joints;
\tau_ext comes from ``robot.external_torque``. On a held object of mass m, slow motion, the environment puts

    F_env = \sum_i w_i + m g e_z         (w_i: the object on hand i; without m g on a hinge, which carries it)

Contact ends a phase (``ContactJudge``); a force axis that pushed against something and then against nothing is
reported (``ContactLoss``). What the model does not know of counts as a force at the hand: Baxter's springs beside s1
carry 20 N.m, and ``until: contact`` would be met at once. So a robot at rest, touching nothing, must measure nearly
no force before a task that waits for contact may begin (``contact_checks``):

    |w_i|  <  F / 2,      J^T w = g(q) + k (q - q_0) - \tau_s    (a robot at rest, F the smallest force waited for)
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.backends.preflight import PreflightResult
from impedance_modules.control.assembly import Assembly
from impedance_modules.effects.catalogue import CATALOGUE
from impedance_modules.modules.arms import TaskModules
from impedance_modules.modules.held_object import HeldObject
from impedance_modules.robot.external_torque import ExternalTorque
from impedance_modules.robot.kinematics import Kinematics
from impedance_modules.robot.model import RobotModel
from impedance_modules.robot.state import RobotState
from impedance_modules.spec.patch_file import read_patch
from impedance_modules.spec.task import AXES, ContactCondition

if TYPE_CHECKING:
    from impedance_modules.control.controller import Controller

REGULARISATION = 1e-4
"""Added to J J^T [m^2, rad^2]: along a singular direction no wrench is claimed."""

TOUCHING, LOST = 0.5, 0.2
"""Parts of an axis's force: what pushes back more than the first is contact, less than the second its loss."""

SHARE = 0.5
"""Of the force that a phase waits for: the most that may be measured where nothing touches."""


class HandWrenches:
    """Estimated wrench on every hand of the task.

    Attributes:
        wrench: (arms, 6) of the surroundings on each hand, world axes at the hand [N, N.m].
        period: Time between updates [s].
        state: The newest one.
    """

    state: RobotState

    def __init__(
        self, model: RobotModel, modules: TaskModules, kinematics: Kinematics, period: float
    ) -> None:
        self.period = period
        self._arms = modules.arms
        self._held = modules.held
        time_constant = max(model.spec.contact_detection.time, 2.0 * period)
        self._torque = ExternalTorque(model, time_constant, period)
        # Kinematics overwrites its arrays in place: a view of each hand's Jacobian is taken once.
        self._hands = [(kinematics.jacobian_of(arm.limb.hand), arm.limb.joints) for arm in modules.arms]
        self._gram, self._push = np.zeros((len(modules.arms), 6, 6)), np.zeros((len(modules.arms), 6))
        self._ridge = REGULARISATION * np.eye(6)
        self.wrench: Array = np.zeros((len(modules.arms), 6))

    def reset(self, state: RobotState) -> None:
        """Starts from a state taken as steady."""
        self.state = state
        self._torque.reset(state)
        self._solve()

    def update(self, state: RobotState) -> None:
        """Takes a state for which the kinematics are up to date."""
        self.state = state
        self._torque.update(state)
        self._solve()

    def _solve(self) -> None:
        """Solves the normal equations (J J^T + r I) w = J tau_ext of all hands at once."""
        for row, (J, joints) in enumerate(self._hands):
            arm = J[:, joints]
            np.matmul(arm, arm.T, out=self._gram[row])
            np.matmul(arm, self._torque.torque[joints], out=self._push[row])
        self._gram += self._ridge
        self.wrench[:] = np.linalg.solve(self._gram, self._push[:, :, None])[:, :, 0]

    def force_on(self, target: str | None) -> float:
        """Returns how hard the environment pushes on a target [N].

        Args:
            target: ``object``, an arm's name, or None: the object when one is held, else the arm of largest force.
        """
        names = [arm.limb.name for arm in self._arms]
        if target in names:
            return float(np.linalg.norm(self.wrench[names.index(target), :3]))
        if self._held is not None:
            return float(np.linalg.norm(self._force_on_object(self._held)))
        return max(float(np.linalg.norm(force)) for force in self.wrench[:, :3])

    def force_on_hand(self, limb: str) -> Array:
        """Returns the force of the surroundings on a hand, (3,) in world axes [N].

        On a hand that holds the object act the object's weight and squeeze too, which are no contact: it gets its equal
        share of what the surroundings put on the object.
        """
        held = self._held
        if held is not None and limb in held.limbs:
            return self._force_on_object(held) / len(held.limbs)
        row = [arm.limb.name for arm in self._arms].index(limb)
        return self.wrench[row, :3].copy()

    def _force_on_object(self, held: HeldObject) -> Array:
        names = [arm.limb.name for arm in self._arms]
        total: Array = self.wrench[[names.index(limb) for limb in held.limbs], :3].sum(axis=0)
        return total - held.weight_on_hands


class ContactJudge:
    """Decides whether contact is there: a force over a threshold, or under it, for a time."""

    def __init__(self, condition: ContactCondition, touch: HandWrenches, model: RobotModel) -> None:
        detection = model.spec.contact_detection
        self._condition = condition
        self._touch = touch
        self._force = detection.force if condition.force is None else condition.force
        self._time = detection.time if condition.time is None else condition.time
        self._held_for = 0.0
        self._elapsed = 0.0
        self._measured = self._best = self._touch.force_on(condition.target)
        self._best_at = 0.0

    def met(self) -> bool:
        """Takes the newest estimate into account; call once per update of the hands' wrenches."""
        self._elapsed += self._touch.period
        self._measured = self._touch.force_on(self._condition.target)
        if (self._measured > self._best) == self._condition.present:
            self._best, self._best_at = self._measured, self._elapsed
        as_wanted = (self._measured >= self._force) == self._condition.present
        self._held_for = self._held_for + self._touch.period if as_wanted else 0.0
        return self._held_for >= self._time

    def account(self) -> str:
        """Says what was measured, what is asked for, and since when it is so."""
        who = self._condition.target or "the object or the hand with the largest force"
        asked = (
            f"{'at least' if self._condition.present else 'less than'} {self._force:g} N for {self._time:g} s"
        )
        if self._held_for > 0.0:
            state = f"as asked for, but only for the last {self._held_for:.3f} s"
        else:
            most = "most" if self._condition.present else "least"
            state = f"{most} {self._best:.1f} N, {self._best_at:.2f} s into the phase"
        return f"{self._measured:.1f} N on {who}, {asked} is asked for; {state}"


@dataclass(frozen=True)
class ForceAxis:
    """A translational axis along which a spring pushes.

    Attributes:
        spring, axis: Names.
        limb: Whose hand pushes.
        share: (3,) direction of the push over its force, world axes [1/N]: minus its product with the force of the
            surroundings is 1 where they resist in full.
    """

    spring: str
    axis: str
    limb: str
    share: Array


class ContactLoss:
    """Remembers which translational force axes touch."""

    def __init__(self, controller: Controller, touch: HandWrenches) -> None:
        self._controller = controller
        self._touch = touch
        self._touching: set[tuple[str, str]] = set()
        self._modules: TaskModules | None = None
        self._axes: tuple[ForceAxis, ...] = ()

    def look(self) -> list[str]:
        """Returns a sentence for every axis that has lost its contact since the last look."""
        modules = self._controller.modules
        if modules is not self._modules:
            self._modules, self._axes = modules, tuple(_force_axes(modules))
        return [
            f"force axis {axis.axis} of {axis.spring} lost contact"
            for axis in self._axes
            if self._follow(
                (axis.spring, axis.axis), -float(axis.share @ self._touch.force_on_hand(axis.limb))
            )
        ]

    def _follow(self, key: tuple[str, str], force: float) -> bool:
        if force >= TOUCHING:
            self._touching.add(key)
        elif force < LOST and key in self._touching:
            self._touching.discard(key)
            return True
        return False


def _force_axes(modules: TaskModules) -> Iterator[ForceAxis]:
    for arm in modules.arms:
        for spring in arm.springs:
            for axis, hybrid in spring.spec.axes.items():
                if axis in AXES[:3] and hybrid.force != 0.0:
                    share = spring.axes[:, AXES.index(axis)] / hybrid.force
                    yield ForceAxis(spring.name, axis, arm.limb.name, share)


def contact_checks(assembly: Assembly, state: RobotState) -> tuple[PreflightResult, ...]:
    """Measures the force on the hands at rest; one answer per arm whose contact a phase of the task waits for.

    Args:
        assembly: The task, and the model that it is run with.
        state: Of the robot at rest.
    """
    awaited = _awaited(assembly)
    if not awaited:
        return ()
    kinematics = Kinematics(assembly.model, assembly.modules.frames)
    kinematics.update(state.position, state.velocity)
    touch = HandWrenches(assembly.weighed, assembly.modules, kinematics, assembly.period)
    touch.reset(state)
    names = [arm.limb.name for arm in assembly.modules.arms]
    forces = {arm: float(np.linalg.norm(touch.wrench[names.index(arm), :3])) for arm in awaited}
    return tuple(_gate(assembly, state, arm, forces[arm], awaited[arm]) for arm in awaited)


def _awaited(assembly: Assembly) -> dict[str, tuple[str, float]]:
    """Finds, per arm, the phase that waits for the smallest force, and that force [N]."""
    arms = [arm.limb.name for arm in assembly.modules.arms]
    held = assembly.modules.held
    found: dict[str, tuple[str, float]] = {}
    for phase in assembly.task.phases:
        until = phase.until
        if not isinstance(until, ContactCondition):
            continue
        force = assembly.robot.contact_detection.force if until.force is None else until.force
        if until.target in arms:
            concerned = [arm for arm in arms if arm == until.target]
        else:
            concerned = arms if held is None else list(held.limbs)
        for arm in concerned:
            if arm not in found or force < found[arm][1]:
                found[arm] = phase.name, force
    return found


def _gate(
    assembly: Assembly, state: RobotState, arm: str, measured: float, awaited: tuple[str, float]
) -> PreflightResult:
    """Judges the force that one arm measures [N]; that of a hand that holds something may be its weight."""
    phase, force = awaited
    held = assembly.modules.held
    carried = 0.0
    if held is not None and arm in held.limbs:
        carried = float(np.linalg.norm(held.weight_on_hands))
    name, found = f"contact {arm}", f"at rest {measured:.1f} N act on the hand"
    if measured < SHARE * force + carried:
        return PreflightResult(name, True, found, "")
    joints = assembly.model.limbs[arm].joints
    expected = assembly.weighed.gravity(state.position)
    worst = int(joints[np.argmax(np.abs(state.effort - expected)[joints])])
    found += (
        f" where phase '{phase}' waits for {force:g} N: {assembly.model.joint_names[worst]} measures"
        f" {state.effort[worst]:.1f} N.m, the model expects {expected[worst]:.1f} N.m: contact would be found at once"
    )
    known = ", ".join(_patches_with_springs(assembly))
    remedy = (
        "nothing that touches the arm, and a model that knows what carries it: --effects with a patch"
        f" that a diagnosis of this robot has written{f', or {known}' if known else ''}"
    )
    return PreflightResult(name, False, found, remedy)


def _patches_with_springs(assembly: Assembly) -> Iterator[str]:
    """Lists the robot folder's patches that know of springs beside the joints."""
    for path in sorted((assembly.robot.folder / "patches").glob("*.yaml")):
        if any(CATALOGUE[effect.effect].carried_by_robot for effect in read_patch(path).effects):
            yield f"robots/{assembly.robot.name}/patches/{path.name}"
